"""A training of the small detector on the tiny data, ready to run."""

from helpers.network_cases import SMALL_DETECTOR
from kitti.sequence import open_sequences
from training.config import DetectorTrainingConfig, ScheduleConfig
from training.detector_task import DetectorTask
from training.strategies import make_strategy
from training.training_run import start

SHORT = ScheduleConfig(epochs=1, frames_per_epoch=4, batch_size=2, validation_frames=2)


def detector_run(data, workdir, schedule, trained=("data/0000",), **changes):
    sequences = open_sequences(data, [0], "training")
    config = DetectorTrainingConfig(SMALL_DETECTOR, schedule=schedule, **changes)
    return start(
        lambda: DetectorTask(config, sequences, sequences),
        make_strategy("one"),
        workdir,
        {"training": list(trained)},
    )
