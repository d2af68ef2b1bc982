"""Checkpoint files: one .npz, whole or absent, loaded without executing code.

Arrays are named by group and by the path of the layer, `model/sa1/local/linear0/kernel_xyz`;
`meta` is JSON: {"format", "kind", "network", "config", "step", ...}.
"""

import hashlib
import json
import math
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import keras
import numpy as np

from common.errors import InputError
from common.files import write_arrays

FORMAT = 2
MAX_BYTES = 2**30  # of all arrays; the networks with their optimizer's state take 20 MB

Variables = Mapping[str, keras.Variable]


def named_variables(layer: keras.layers.Layer) -> dict[str, keras.Variable]:
    """Every variable of a layer by its path of layer names, such as sa1/local/linear0/norm/beta."""
    named, inner = {}, set()
    for child in _children(layer):
        for path, variable in named_variables(child).items():
            name = f"{child.name}/{path}"
            if name in named and named[name] is not variable:
                raise ValueError(f"two layers are named {name}")
            named[name] = variable
            inner.add(id(variable))
    named |= {v.name: v for v in layer.weights if id(v) not in inner}
    return named


def _children(layer: keras.layers.Layer) -> Iterator[keras.layers.Layer]:
    """The layers that are attributes of `layer`, or in a list that is one; each once."""
    seen = set()
    for value in list(vars(layer).values()):
        for child in value if isinstance(value, (list, tuple)) else [value]:
            if isinstance(child, keras.layers.Layer) and id(child) not in seen:
                seen.add(id(child))
                yield child


def save(path: str | Path, meta: dict[str, Any], **groups: Variables) -> None:
    """Writes the variables of each group (model=..., optimizer=...) and `meta` to `path`."""
    arrays = {
        f"{group}/{name}": np.asarray(variable.value)
        for group, variables in groups.items()
        for name, variable in variables.items()
    }
    text = json.dumps({**meta, "format": FORMAT}, allow_nan=False)
    write_arrays(path, meta=np.frombuffer(text.encode(), np.uint8), **arrays)


def load(path: str | Path, kind: str | None = None) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Reads a checkpoint: its meta and its arrays by name; no code in the file is executed.

    Args:
        path: of the file.
        kind: "detector" or "tracker"; None: either.

    Raises:
        InputError: the file is missing, truncated, corrupt, larger than MAX_BYTES, of another
            format or kind, or not a checkpoint of this project.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError("expected a checkpoint file", path)
    try:
        with zipfile.ZipFile(path) as archive:
            _check_sizes(archive)
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        meta = json.loads(arrays.pop("meta").tobytes())
        version = meta["format"]
        if version == FORMAT and not isinstance(meta["config"], dict):
            raise KeyError("config")
    except InputError:
        raise
    except Exception as error:  # zipfile, zlib, NumPy and json raise many types on hostile files
        reason = " ".join(f"{error}".split()) or type(error).__name__
        raise InputError(f"not a whole checkpoint of this project ({reason})", path) from error
    if version != FORMAT:
        raise InputError(f"expected checkpoint format {FORMAT}, found {version!r}", path)
    if kind not in (None, meta.get("kind")):
        raise InputError(f"expected a {kind} checkpoint, found {meta.get('kind')!r}", path)
    return meta, arrays


def _check_sizes(archive: zipfile.ZipFile) -> None:
    """Raises ValueError unless the declared shapes fit the declared sizes, before any is read."""
    total = sum(entry.file_size for entry in archive.infolist())
    if total > MAX_BYTES:
        raise ValueError(f"expected at most {MAX_BYTES} bytes of arrays, found {total}")
    for entry in archive.infolist():
        with archive.open(entry) as file:
            major, _ = np.lib.format.read_magic(file)
            read = {1: np.lib.format.read_array_header_1_0, 2: np.lib.format.read_array_header_2_0}
            shape, _, dtype = read[major](file)
            if math.prod(shape) * dtype.itemsize + file.tell() != entry.file_size:
                raise ValueError(f"{entry.filename}: shape {shape} does not fit its size")


def restore(path: str | Path, arrays: Mapping[str, np.ndarray], **groups: Variables) -> None:
    """Assigns the arrays to the variables of each group.

    Raises:
        InputError: a variable or array is missing, or has another shape; nothing is assigned then.
    """
    pairs = []
    for group, variables in groups.items():
        expected = {f"{group}/{name}": variable for name, variable in variables.items()}
        found = {name for name in arrays if name.startswith(f"{group}/")}
        missing, unknown = sorted(set(expected) - found), sorted(found - set(expected))
        if missing or unknown:
            raise InputError(
                f"arrays do not fit: {_some(missing)} missing, {_some(unknown)} unknown",
                path,
            )
        for name, variable in expected.items():
            array, shape = arrays[name], tuple(variable.shape)
            if array.shape != shape or array.dtype.kind not in "fiu":
                raise InputError(
                    f"{name}: expected numbers of shape {shape}, found {array.dtype} of shape "
                    f"{array.shape}",
                    path,
                )
            with np.errstate(over="ignore"):
                array = array.astype(variable.dtype)
            if not np.all(np.isfinite(array)):
                raise InputError(f"{name}: expected finite values of {variable.dtype}", path)
            pairs.append((variable, array))
    for variable, array in pairs:
        variable.assign(array)


def _some(names: list[str]) -> str:
    if len(names) <= 3:
        return ", ".join(names) or "none"
    return f"{', '.join(names[:3])} and {len(names) - 3} more"


def content_hash(variables: Variables) -> str:
    """SHA-256 of the names and values of variables, in the order of their names."""
    digest = hashlib.sha256()
    for name, variable in sorted(variables.items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(variable.value).tobytes())
    return digest.hexdigest()
