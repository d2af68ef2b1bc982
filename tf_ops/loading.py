"""Loads the compiled ops, once and lazily, after a check of the TensorFlow they were built for."""

import functools
import json
import os
import threading
from pathlib import Path
from types import ModuleType

import tensorflow as tf

ENVIRONMENT = "TF_OPS_LIBRARY"  # another build of the library, e.g. one with a sanitizer
DEFAULT = Path(__file__).resolve().parent / "build" / "libtf_ops.so"
_LOCK = threading.Lock()


class LibraryError(ImportError):
    """The compiled ops are missing or unusable; the message names the command that repairs it."""


def library_path() -> Path:
    """Path of the compiled ops."""
    return Path(os.environ.get(ENVIRONMENT, DEFAULT))


def load_library() -> ModuleType:
    """The module of raw ops. A saved graph that uses them needs this call before it is loaded.

    Raises:
        LibraryError: the library is missing, or was built against another TensorFlow.
    """
    with _LOCK:
        return _load(library_path())


@functools.cache
def _load(path: Path) -> ModuleType:
    if not path.is_file():
        raise LibraryError(f"{path} is missing; run `make ops` in the project's root")
    check_version(path.with_suffix(".json"))
    try:
        return tf.load_op_library(str(path))
    except (tf.errors.NotFoundError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise LibraryError(f"{path} cannot be loaded; run `make clean ops` ({reason})") from error


def check_version(record: Path) -> None:
    """Raises LibraryError unless `record`, written by the build, names the running TensorFlow."""
    try:
        built = json.loads(record.read_text())["tensorflow"]
    except (OSError, ValueError, KeyError, TypeError):
        raise LibraryError(f"{record} is missing or unreadable; run `make ops`") from None
    if built != tf.__version__:
        raise LibraryError(
            f"the ops were built against TensorFlow {built}, this is {tf.__version__}; "
            "run `make ops`"
        )
