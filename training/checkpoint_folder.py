"""The checkpoints of one training: the last few by step, and the best."""

import re
from pathlib import Path
from typing import Any

from models import checkpoint

CHECKPOINTS = "checkpoints"
"""The folder of the checkpoints in a workdir."""


class CheckpointFolder:
    """step-00000123.npz for the last `keep` checkpoints, and best.npz."""

    def __init__(self, folder: str | Path, keep: int):
        self.folder, self.keep = Path(folder), keep
        self.best_path = self.folder / "best.npz"

    def steps(self) -> list[int]:
        """Steps that have a checkpoint, ascending."""
        found = (re.fullmatch(r"step-(\d+)\.npz", p.name) for p in self.folder.glob("step-*.npz"))
        return sorted(int(match[1]) for match in found if match)

    def path(self, step: int) -> Path:
        """Path of the checkpoint of a step."""
        return self.folder / f"step-{step:08d}.npz"

    def save(self, step: int, meta: dict[str, Any], **groups: checkpoint.Variables) -> None:
        """Writes the checkpoint of a step, then removes those older than the last `keep`."""
        checkpoint.save(self.path(step), {**meta, "step": step}, **groups)
        for old in self.steps()[: -self.keep]:
            self.path(old).unlink(missing_ok=True)
