"""Loads the compiled ops, once and lazily, after a check of the TensorFlow they were built for."""

import ctypes
import functools
import json
import os
import threading
from pathlib import Path
from types import ModuleType

import tensorflow as tf

ENVIRONMENT = "TF_OPS_LIBRARY"  # another build of the library, e.g. one with a sanitizer
INSTRUCTIONS = "TF_OPS_INSTRUCTIONS"  # the instruction set instead of the processor's widest
DEFAULT = Path(__file__).resolve().parent / "build" / "libtf_ops.so"
REBUILD = "make clean-ops && make ops"
_LOCK = threading.Lock()


class LibraryError(ImportError):
    """The compiled ops are missing or unusable; the message names the command that repairs it."""


def library_path() -> Path:
    """Path of the compiled ops."""
    return Path(os.environ.get(ENVIRONMENT, DEFAULT))


def load_library() -> ModuleType:
    """The module of raw ops. A saved graph that uses them needs this call before it is loaded.

    Raises:
        LibraryError: the library is missing, was built against another TensorFlow, or lacks the
            instruction set that TF_OPS_INSTRUCTIONS names.
    """
    with _LOCK:
        return _load(library_path())


@functools.cache
def _load(path: Path) -> ModuleType:
    if not path.is_file():
        raise LibraryError(f"{path} is missing; run `make ops` in the project's root")
    check_version(path.with_suffix(".json"))
    try:
        library = tf.load_op_library(str(path))
    except (tf.errors.NotFoundError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise LibraryError(f"{path} cannot be loaded; run `{REBUILD}` ({reason})") from error
    check_instructions(path)
    return library


def instruction_sets(path: Path) -> list[str]:
    """Those that this processor and the loaded library at `path` have, the widest first."""
    function = ctypes.CDLL(str(path)).ptn_instruction_sets
    function.restype = ctypes.c_char_p
    return function().decode().split()


def check_instructions(path: Path) -> None:
    """Raises LibraryError unless the named instruction set, if any, is there."""
    name = os.environ.get(INSTRUCTIONS)
    if name is not None and name not in (found := instruction_sets(path)):
        raise LibraryError(
            f"{INSTRUCTIONS}: expected one of {', '.join(found)} (all that this processor and "
            f"{path} have), found {name!r}"
        )


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
