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
        where = "" if path is None else f"{path}: " if line is None else f"{path}:{line}: "
        super().__init__(where + " ".join(message.split()))
