"""A recipe of weights like training/recipe.py, with a small training: DATA WORKDIR."""

import sys
from pathlib import Path

from campaigns.kill_jobs import TRAIN
from training.recipe import Stage, make_weights


def main() -> None:
    """Trains the small detector and copies its best checkpoint."""
    data, work = sys.argv[1], Path(sys.argv[2])
    detector = work / "detector"
    copy = (
        "import pathlib, shutil, sys; a, b = sys.argv[1:]; pathlib.Path(b).mkdir(exist_ok=True); "
        "shutil.copy(a, b)"
    )
    stages = [
        Stage("detector", (*TRAIN, "detector", data, str(detector), "--epochs", "2"), detector),
        Stage("copy", ("-c", copy, str(detector / "checkpoints/best.npz"), str(work / "weights"))),
    ]
    make_weights(stages, work, work / "out", allow_changes=True)


if __name__ == "__main__":
    main()
