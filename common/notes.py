"""Notes on accepted input, on standard error, each once in a process."""

import contextlib
import os
import sys
from functools import cache
from typing import TextIO

from common.errors import printable


def report(line: str) -> None:
    """Prints a line on standard error; errors of the stream (closed, full) are ignored."""
    if sys.stderr is not None:
        write_or_silence(sys.stderr, line + "\n")


def write_or_silence(stream: TextIO, text: str) -> None:
    """Writes and flushes; after an error the stream is redirected to the null device."""
    try:
        stream.write(text)
        stream.flush()
    except (OSError, ValueError):
        with contextlib.suppress(OSError, ValueError):  # else Python writes again on exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@cache
def note(message: str) -> None:
    """Prints `note: message`, unless it was printed before."""
    report(f"note: {printable(message)}")
