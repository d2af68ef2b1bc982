"""Reads regular files of bounded size; writes files atomically."""

import contextlib
import fcntl
import json
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.errors import InputError

MAX_BYTES = 2**30
"""Default limit of `read_bytes`, above the size of any scan or table."""


def read_bytes(path: str | Path, limit: int = MAX_BYTES) -> bytes:
    """The content of a regular file of at most `limit` bytes.

    Raises:
        InputError: it does not exist, is a directory, a pipe or a device, is too large, or cannot
            be read.
    """
    try:
        check_regular(path, limit)
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read: {reason}", path) from error


def check_regular(path: str | Path, limit: int = MAX_BYTES) -> None:
    """Refuses pipes, devices and directories, and files larger than `limit` bytes.

    Raises:
        InputError: directory, pipe, device, or too large.
        OSError: there is no such file.
    """
    found = Path(path).stat()
    if stat.S_ISDIR(found.st_mode):
        raise InputError("expected a file, found a directory", path)
    if not stat.S_ISREG(found.st_mode):
        raise InputError("expected a regular file, found a pipe, socket or device", path)
    if found.st_size > limit:
        raise InputError(f"expected at most {limit} bytes, found {found.st_size}", path)


@contextlib.contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yields a temporary path beside `path`; on success it is synced and renamed to `path`.

    On any exception the temporary file is removed and `path` is left as it was; an OSError (disk
    full, no permission) names `path`.
    The temporary file has the suffix of `path`, which some writers depend on.
    """
    path, temporary = Path(path), None
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        begin = f".{path.stem[:40]}-"  # a file name has at most 255 bytes
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=begin, suffix=path.suffix)
        os.close(handle)
        temporary = Path(name)
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        begun = temporary is None or error.filename in (None, str(temporary))
        if error.errno is not None and begun:
            raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
        raise
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def temporary_of(path: Path) -> str | None:
    """The name of the file that `path` was to become; None unless `atomic_path` named it.

    A killed process leaves such files. Only 40 characters before the suffix are known.
    """
    found = re.fullmatch(r"\.(.{1,40})-[a-z0-9_]{8}(\.[^.]+)?", path.name)
    return found and found[1] + (found[2] or "")


def write_bytes(path: str | Path, data: bytes) -> None:
    """Writes `data` to `path` atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: str | Path, text: str) -> None:
    """Writes `text` to `path` atomically, as UTF-8; names of files in it keep their bytes."""
    write_bytes(path, text.encode(errors="surrogateescape"))


def write_json(path: str | Path, value: Any) -> None:
    """Writes `value` to `path` atomically, as indented JSON; NaN and infinity raise ValueError."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def write_arrays(path: str | Path, **arrays: Any) -> None:
    """Writes named arrays to `path` atomically, as an uncompressed .npz archive."""
    import numpy as np  # most callers of this module write text

    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


@contextlib.contextmanager
def locked(path: str | Path, wait: bool = True) -> Iterator[bool]:
    """Holds the lock file `path` against other processes; it stays on disk and frees at any end.

    Yields whether it is held: without `wait`, False while another process holds it.
    """
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with Path(path).open("wb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
        else:
            yield True


def copy_folder(source: str | Path, target: str | Path) -> None:
    """Copies the files of a folder, each atomically; other files of `target` stay.

    Files that a killed process left unfinished (`temporary_of`) are left out.
    """
    for path in sorted(Path(source).iterdir()):
        if temporary_of(path) is not None:
            continue
        with atomic_path(Path(target) / path.name) as temporary:
            shutil.copyfile(path, temporary)
