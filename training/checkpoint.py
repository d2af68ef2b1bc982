"""Checkpoints: one .npz a step, whole or not there, loaded without executing code.

Arrays are named `model/<number>/<variable>` and `optimizer/<number>/<variable>`; `meta` is JSON:
{"kind", "step", "config", ...}.
"""

from __future__ import annotations

import hashlib
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import InputError
from common.files import atomic_path

FORMAT = 1


def _names(group: str, variables) -> list[str]:
    return [f"{group}/{i:03d}/{variable.name}" for i, variable in enumerate(variables)]


def save(path: str | Path, meta: dict[str, Any], **groups) -> None:
    """Writes the variables of each group (model=..., optimizer=...) and `meta` to `path`."""
    arrays = {}
    for group, variables in groups.items():
        for name, variable in zip(_names(group, variables), variables, strict=True):
            arrays[name] = np.asarray(variable.value)
    text = json.dumps({"format": FORMAT, **meta}, allow_nan=False)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, meta=np.frombuffer(text.encode(), np.uint8), **arrays)


def load(path: str | Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Reads a checkpoint: its meta and its arrays by name; nothing in the file is executed.

    Raises:
        InputError: the file is missing, truncated, corrupt or not a checkpoint of this project.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError("expected a checkpoint file", path)
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        meta = json.loads(arrays.pop("meta").tobytes())
        if meta["format"] != FORMAT or not isinstance(meta["config"], dict):
            raise KeyError("format")
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"not a whole checkpoint of this project ({error})", path) from error
    return meta, arrays


def restore(path: str | Path, arrays: dict[str, np.ndarray], **groups) -> None:
    """Assigns the arrays to the variables of each group.

    Raises:
        InputError: a variable is missing or has another shape; nothing was assigned then.
    """
    pairs = []
    for group, variables in groups.items():
        for name, variable in zip(_names(group, variables), variables, strict=True):
            array = arrays.get(name)
            if array is None or array.shape != tuple(variable.shape):
                found = "nothing" if array is None else f"shape {array.shape}"
                expected = tuple(variable.shape)
                raise InputError(f"{name}: expected shape {expected}, found {found}", path)
            if not np.all(np.isfinite(array)):
                raise InputError(f"{name}: expected finite values", path)
            pairs.append((variable, array))
        extra = sum(name.startswith(f"{group}/") for name in arrays) - len(variables)
        if extra:
            raise InputError(f"expected {len(variables)} {group} arrays, found {extra} more", path)
    for variable, array in pairs:
        variable.assign(array)


def content_hash(variables) -> str:
    """SHA-256 of the values of variables, in order."""
    digest = hashlib.sha256()
    for variable in variables:
        digest.update(np.ascontiguousarray(variable.value).tobytes())
    return digest.hexdigest()


class CheckpointFolder:
    """The checkpoints of one training: the last few by step, and the best."""

    def __init__(self, folder: str | Path, keep: int):
        self.folder, self.keep = Path(folder), keep
        self.best_path = self.folder / "best.npz"

    def steps(self) -> list[int]:
        """Steps that have a checkpoint, ascending."""
        found = (re.fullmatch(r"step-(\d+)\.npz", p.name) for p in self.folder.glob("step-*.npz"))
        return sorted(int(match[1]) for match in found if match)

    def path(self, step: int) -> Path:
        """Where the checkpoint of a step is."""
        return self.folder / f"step-{step:08d}.npz"

    def save(self, step: int, meta: dict[str, Any], **groups) -> None:
        """Writes the checkpoint of a step, then removes those older than the last `keep`."""
        save(self.path(step), {**meta, "step": step}, **groups)
        for old in self.steps()[: -self.keep]:
            self.path(old).unlink(missing_ok=True)
