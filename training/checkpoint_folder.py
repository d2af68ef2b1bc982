"""The checkpoints of one training: the last few by step, and the best."""

import re
from pathlib import Path
from typing import Any

from common.files import temporary_of
from models import checkpoint

CHECKPOINTS = "checkpoints"
"""The folder of the checkpoints in a workdir."""


class CheckpointFolder:
    """step-00000123.npz for the last `keep` epochs, and best.npz.

    A checkpoint within an epoch (of `steps_per_epoch`) stays until the next one is there.
    """

    def __init__(self, folder: str | Path, keep: int = 1, steps_per_epoch: int = 1):
        self.folder, self.keep, self.steps_per_epoch = Path(folder), keep, steps_per_epoch
        self.best_path = self.folder / "best.npz"

    def steps(self) -> list[int]:
        """Steps that have a checkpoint, ascending."""
        found = (re.fullmatch(r"step-(\d+)\.npz", p.name) for p in self.folder.glob("step-*.npz"))
        return sorted(int(match[1]) for match in found if match)

    def path(self, step: int) -> Path:
        """Path of the checkpoint of a step."""
        return self.folder / f"step-{step:08d}.npz"

    def save(self, step: int, meta: dict[str, Any], **groups: checkpoint.Variables) -> None:
        """Writes the checkpoint of a step, then removes those that are not kept.

        Also removes what killed processes left of unfinished checkpoints.
        """
        checkpoint.save(self.path(step), {**meta, "step": step}, **groups)
        steps = self.steps()
        epochs = [s for s in steps if s % self.steps_per_epoch == 0]
        for old in set(steps[:-1]).difference(epochs[-self.keep :]):
            self.path(old).unlink(missing_ok=True)
        for path in self.folder.iterdir():
            if re.fullmatch(r"(best|step-\d+)\.npz", temporary_of(path) or ""):
                path.unlink(missing_ok=True)
