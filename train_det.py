"""Trains the detector graph.

python train_det.py --data_root DIR --seqs 0000-0015 --workdir runs/detector
"""

from collections.abc import Sequence

from common.flags import run
from training.command_line import configured, parser, train
from training.config import DetectorTrainingConfig


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the flags and trains; returns the exit code."""
    flags = parser("Train PointTrackNet's detector.", DetectorTrainingConfig()).parse_args(argv)
    config = configured(flags, DetectorTrainingConfig())
    from training.detector_task import DetectorTask
    from visualization.training_pictures import detector_picture

    return train(flags, DetectorTask, config, detector_picture)


if __name__ == "__main__":
    raise SystemExit(run(main))
