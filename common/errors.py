"""The exception for invalid user input."""

from pathlib import Path


class InputError(ValueError):
    """Invalid user input: a file, a flag, a checkpoint.

    Args:
        message: the value found and the value expected, in one line.
        path: the file at fault, if there is one.
        line: 1-based line number in `path`, if there is one.

    `str()` gives ``path:line: message`` in one line; scripts print it and exit with code 2.
    """

    def __init__(self, message: str, path: str | Path | None = None, line: int | None = None):
        self.path, self.line = path, line
        name = "" if path is None else printable(str(path))
        where = "" if path is None else f"{name}: " if line is None else f"{name}:{line}: "
        super().__init__(where + printable(" ".join(message.split())))


def printable(text: str) -> str:
    """The text with control characters, which a file name may hold, as escapes."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
