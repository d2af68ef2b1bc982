"""Writes the compiler flags of this Python's TensorFlow as a makefile fragment.

Usage: tf_flags.py FLAGS.mk [NAME_OF_MAKE_TARGET]. Prints nothing on success; otherwise one line
that says what to do, and exits with code 1. The file is rewritten only when TensorFlow changed,
so it can serve as a prerequisite of every object; an unchanged TensorFlow is not imported.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from pathlib import Path

MINIMUM = (2, 16)


def fingerprint() -> str | None:
    """Names the installed TensorFlow without importing it; None if there is none."""
    spec = importlib.util.find_spec("tensorflow")
    if spec is None or spec.origin is None:
        return None
    return f"{spec.origin} {os.stat(spec.origin).st_mtime_ns}"


def fragment(found: str) -> str:
    """The makefile fragment for the TensorFlow that can be imported now."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    import tensorflow as tf

    if tuple(int(part) for part in tf.__version__.split(".")[:2]) < MINIMUM:
        raise ImportError(f"TensorFlow {tf.__version__} is too old, 2.16 or newer is needed")
    flags = [
        # A system include path: warnings are errors for our code, not for TensorFlow's.
        f"-isystem {flag[2:]}" if flag.startswith("-I") else flag
        for flag in tf.sysconfig.get_compile_flags()
    ]
    record = json.dumps({"tensorflow": tf.__version__, "git": tf.version.GIT_VERSION})
    return (
        f"# {found}\n"
        f"TF_CFLAGS := {' '.join(flags)}\n"
        f"TF_LFLAGS := {' '.join(tf.sysconfig.get_link_flags())}\n"
        f"TF_RECORD := {record}\n"
    )


def main(path: Path) -> str | None:
    """Brings the file up to date; returns what is wrong, if anything."""
    found = fingerprint()
    mend = "run `make venv` in the project's root"
    if found is None:
        return f"TensorFlow is not installed for {sys.executable}: {mend}"
    if path.is_file() and path.read_text().splitlines()[:1] == [f"# {found}"]:
        return None
    try:
        text = fragment(found)
    except ImportError as error:
        return f"TensorFlow cannot be used ({' '.join(str(error).split())}): {mend}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return None


if __name__ == "__main__":
    problem = main(Path(sys.argv[1]))
    if problem:
        print(problem)
        sys.exit(1)
