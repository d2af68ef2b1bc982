"""Remarks on input that is used all the same, on standard error, each once in a process."""

from __future__ import annotations

import sys
from functools import cache


@cache
def note(message: str) -> None:
    """Prints `note: message`, unless it was printed before."""
    if sys.stderr is not None:
        print(f"note: {message}", file=sys.stderr)
