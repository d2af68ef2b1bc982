"""Trains the tracker graph on a frozen detector.

python train_track.py --data_root DIR --detector weights/detector.npz --workdir runs/tracker
"""

from collections.abc import Sequence

from common.flags import run
from training.command_line import configured, parser, train
from training.config import TrackerTrainingConfig


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the flags and trains; returns the exit code."""
    result = parser("Train PointTrackNet's tracker on a frozen detector.", TrackerTrainingConfig())
    result.add_argument(
        "--detector",
        required=True,
        metavar="CHECKPOINT",
        help="detector checkpoint, for instance weights/detector.npz",
    )
    flags = result.parse_args(argv)
    config = configured(flags, TrackerTrainingConfig())
    from models.weights import load_detector
    from training.tracker_task import TrackerTask
    from visualization.training_pictures import tracker_picture

    def task(config, training, validation):
        return TrackerTask(config, load_detector(flags.detector), training, validation)

    return train(flags, task, config, tracker_picture)


if __name__ == "__main__":
    raise SystemExit(run(main))
