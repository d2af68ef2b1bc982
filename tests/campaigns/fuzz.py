"""Fuzzes every entry point for input (a "door"), seeded and bounded.

    python -m campaigns.fuzz --n 2000 --seed 0      (from the root, PYTHONPATH=.:tests)

An input is accepted, or ends in an `InputError` of one line. Anything else is a find: it is printed
with its door and seed, and `--door DOOR --seed SEED --n 1` makes the same input again.
"""

import argparse
import contextlib
import io
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from campaigns.file_doors import FILE_DOORS
from campaigns.program_doors import PROGRAM_DOORS
from campaigns.weight_doors import WEIGHT_DOORS
from common.errors import InputError
from common.notes import note

DOORS = {door.__name__: door for door in (*FILE_DOORS, *WEIGHT_DOORS, *PROGRAM_DOORS)}
LIMIT_S = 30
"""Time for one input; more counts as a hang."""


class HangError(Exception):
    """An input took longer than `LIMIT_S`."""


@contextlib.contextmanager
def _time_limit(seconds: int) -> Iterator[None]:
    def stop(*_):
        raise HangError(f"more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def try_input(door: Callable, seed: int) -> str | None:
    """The text of the find of input number `seed` of a door; None without one."""
    rng = np.random.default_rng([seed, *door.__name__.encode()])
    note.cache_clear()
    with (
        tempfile.TemporaryDirectory(prefix="fuzz-") as folder,
        warnings.catch_warnings(),
        contextlib.redirect_stderr(io.StringIO()),
    ):
        warnings.simplefilter("error")
        try:
            with _time_limit(LIMIT_S):
                door(Path(folder), rng)
        except InputError as error:
            if "\n" in str(error) or not str(error):
                return f"a message of several lines: {error}"
        except Exception:  # whatever it is, it is a find
            return traceback.format_exc()
    return None


def campaign(n: int, seed: int, doors: list[str]) -> tuple[list[str], Counter]:
    """Tries `n` inputs, the doors in turn; returns the finds as texts and the inputs per door."""
    finds, tried = [], Counter()
    for number in range(n):
        name = doors[number % len(doors)]
        at = seed + number // len(doors)
        found = try_input(DOORS[name], at)
        tried[name] += 1
        if found is not None:
            finds.append(f"--door {name} --seed {at} --n 1\n{found}")
    return finds, tried


def main() -> int:
    """Prints the finds and a summary; returns 1 if there are finds."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=2000, help="inputs in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--door", choices=DOORS, action="append", help="default: all")
    args = parser.parse_args()
    start = time.monotonic()
    finds, tried = campaign(args.n, args.seed, args.door or list(DOORS))
    for find in finds:
        print(find, file=sys.stderr)
    counts = ", ".join(f"{name} {count}" for name, count in sorted(tried.items()))
    print(f"{args.n} inputs, {len(finds)} finds, {time.monotonic() - start:.0f} s ({counts})")
    return 1 if finds else 0


if __name__ == "__main__":
    raise SystemExit(main())
