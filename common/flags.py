"""Command-line behaviour shared by every script: one-line errors, exit code 2."""

import argparse
import errno
import io
import math
import os
import re
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from common.errors import InputError, printable
from common.notes import write_or_silence

_STREAM = dict.fromkeys((errno.ENOSPC, errno.EPIPE), "standard output: ")
"""Name of the full or closed target by error number, where the error names no file."""
MAX_COUNT = 10**6
"""Largest count of frames, points or repetitions; more is an input error."""
_MISSING = ": run `make` in the project's root, and use .venv/bin/python"
INTERRUPTED = 130  # the shell's code for a process ended by SIGINT


class _HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Names a flag's default, unless there is none, the help names it, or it is a switch."""

    def _get_help_string(self, action):
        none = action.default in (None, []) or action.nargs == 0
        if none or "default" in (action.help or ""):
            return action.help
        return super()._get_help_string(action)


class ArgumentParser(argparse.ArgumentParser):
    """argparse with one-line errors, exact flag names and defaults in the help.

    A word behind a single dash is a value, such as -1e-3 or -y,x,z. An empty value, such as an
    unset variable of a shell, is refused: as a path it would be the working directory.
    """

    def __init__(self, **kwargs):
        kwargs.setdefault("formatter_class", _HelpFormatter)
        super().__init__(allow_abbrev=False, **kwargs)
        self._negative_number_matcher = re.compile("-[^-]")  # argparse's own lacks exponents

    def parse_args(self, args=None, namespace=None):
        """See argparse."""
        words = sys.argv[1:] if args is None else list(args)
        for before, word in zip(["", *words], words, strict=False):
            name, equals, value = word.partition("=")
            if not word.strip():
                self.error(f"argument {before}: expected a value, found {word!r}")
            if name.startswith("--") and equals and not value.strip():
                self.error(f"argument {name}: expected a value, found {value!r}")
        return super().parse_args(words, namespace)

    def error(self, message: str) -> NoReturn:
        """Prints one line and exits with code 2."""
        text = printable(" ".join(message.split())) + self._near(message)
        self.exit(2, f"{self.prog}: error: {text} (see --help)\n")

    def _near(self, message: str) -> str:
        """The flag that was probably meant, as --schedule.epochs by --epochs; "" if unknown."""
        unknown = re.search(r"^unrecognized arguments:.*?--([\w.-]+)", message, re.ASCII)
        name = unknown[1].replace("-", "_") if unknown else ""
        known = [flag for flag in self._option_string_actions if flag.startswith("--")]
        near = [flag for flag in known if name and f".{flag[2:]}".endswith(f".{name}")]
        return f", is it {near[0]}?" if len(near) == 1 else ""


def run(
    main: Callable[[Sequence[str] | None], int | None], argv: Sequence[str] | None = None
) -> int:
    """Runs `main(argv)`; bad input and full disks become one line on stderr and exit code 2.

    Returns the exit code: 0 on success, 2 for `InputError`, `OSError`, `MemoryError` and a library
    that is missing or broken (`ImportError`), 130 when interrupted.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # less of TensorFlow's start-up messages
    _open_streams()
    try:
        code = main(argv) or 0
        sys.stdout.flush()
        return code
    except InputError as error:
        return _refuse(f"error: {error}")
    except OSError as error:
        where = f"{error.filename}: " if error.filename else _STREAM.get(error.errno, "")
        return _refuse(f"error: {where}{error.strerror or error}")
    except MemoryError:
        return _refuse("error: out of memory")
    except ImportError as error:
        remedy = _MISSING if isinstance(error, ModuleNotFoundError) else ""
        return _refuse(f"error: {' '.join(str(error).split())}{remedy}")
    except KeyboardInterrupt:
        _refuse("interrupted")
        return INTERRUPTED


def _open_streams() -> None:
    """Opens the null device in place of closed standard streams.

    Open ones escape what they cannot encode, such as names of files that are not UTF-8.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _refuse(line: str) -> int:
    """Prints one line on standard error; errors of the stream do not change the exit code."""
    for stream, text in ((sys.stdout, ""), (sys.stderr, printable(line) + "\n")):
        write_or_silence(stream, text)
    return 2


def positive_int(text: str) -> int:
    """argparse type: a count, 1 to `MAX_COUNT`."""
    value = _digits(text.removeprefix("+"))
    if value is None or not 1 <= value <= MAX_COUNT:
        raise argparse.ArgumentTypeError(
            f"expected an integer from 1 to {MAX_COUNT}, found {text!r}"
        )
    return value


def non_negative_int(text: str) -> int:
    """argparse type: an integer >= 0."""
    value = _digits(text)
    if value is None:
        raise argparse.ArgumentTypeError(f"expected an integer from 0 to 10^18, found {text!r}")
    return value


def _digits(text: str) -> int | None:
    """The value of up to 18 ASCII digits; None for any other text."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 18 else None


def integer(text: str) -> int:
    """argparse type: an integer, as `int` reads it, but in ASCII digits without underscores."""
    try:
        return int(_ascii(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected an integer, found {text!r}") from None


def number(text: str) -> float:
    """argparse type: a number, as `float` reads it, but in ASCII digits without underscores."""
    try:
        return float(_ascii(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a number, found {text!r}") from None


def _ascii(text: str) -> str:
    if not text.isascii() or "_" in text:
        raise ValueError(text)
    return text


def finite_float(text: str) -> float:
    """argparse type: a finite number."""
    try:
        value = number(text)
    except argparse.ArgumentTypeError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, found {text!r}")
    return value


def non_negative_float(text: str) -> float:
    """argparse type: a finite number >= 0."""
    value = finite_float(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"expected a number >= 0, found {text!r}")
    return value


def non_negative_floats(text: str) -> tuple[float, ...]:
    """argparse type: numbers >= 0 between commas, such as 0,2."""
    return tuple(non_negative_float(part.strip()) for part in text.split(","))
