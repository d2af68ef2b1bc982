"""Writes the compiler flags of this Python's TensorFlow as a makefile fragment.

Usage: tf_flags.py FLAGS.mk. Prints nothing on success; otherwise prints one line with the problem
and its remedy and exits with code 1. The file is rewritten only when TensorFlow has changed, so it
can be a prerequisite of every object; an unchanged TensorFlow is not imported.
"""

import importlib.util
import json
import os
import shlex
import sys
from pathlib import Path

MINIMUM = (2, 16)


def fingerprint() -> str | None:
    """Identifies the installed TensorFlow without importing it; None if there is none."""
    spec = importlib.util.find_spec("tensorflow")
    if spec is None or spec.origin is None:
        return None
    return f"{spec.origin} {os.stat(spec.origin).st_mtime_ns}"


def fragment(found: str) -> str:
    """The makefile fragment for the installed TensorFlow."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    import tensorflow as tf

    if tuple(int(part) for part in tf.__version__.split(".")[:2]) < MINIMUM:
        raise ImportError(f"TensorFlow {tf.__version__} is too old, 2.16 or newer is needed")
    flags = [
        # A system include path: warnings are errors for our code, not for TensorFlow's.
        f"-isystem {shlex.quote(flag[2:])}" if flag.startswith("-I") else flag
        for flag in tf.sysconfig.get_compile_flags()
    ]
    record = json.dumps({"tensorflow": tf.__version__, "git": tf.version.GIT_VERSION})
    return (
        f"TF_CFLAGS := {' '.join(flags)}\n"
        f"TF_LFLAGS := {shlex.join(tf.sysconfig.get_link_flags())}\n"
        f"TF_RECORD := {record}\n"
        f"# {found}\n"  # last: a file that was cut short is made again
    )


def main(path: Path) -> str | None:
    """Updates the file; returns the problem and its remedy, or None."""
    found = fingerprint()
    mend = "run `make venv` in the project's root"
    if found is None:
        return f"TensorFlow is not installed for {sys.executable}: {mend}"
    if path.is_file() and path.read_text().splitlines()[-1:] == [f"# {found}"]:
        return None
    try:
        text = fragment(found)
    except Exception as error:  # of TensorFlow's own libraries, which raise many types
        return f"TensorFlow cannot be used ({' '.join(str(error).split())}): {mend}"
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.new")
    temporary.write_text(text)
    os.replace(temporary, path)
    return None


if __name__ == "__main__":
    problem = main(Path(sys.argv[1]))
    if problem:
        print(problem)
        sys.exit(1)
