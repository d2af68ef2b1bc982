"""The documents for users, and the commands in them."""

import re
from pathlib import Path
from typing import NamedTuple

from common.provenance import ROOT

PYTHON = ".venv/bin/python"
BLOCKS = re.compile(r"^```(sh|python)\n(.*?)^```", re.DOTALL | re.MULTILINE)


class Command(NamedTuple):
    """A line of an sh block."""

    document: str  # relative to the root
    text: str

    @property
    def is_python(self) -> bool:
        """Whether it runs a script or a module of the project."""
        return PYTHON in self.text and "-m pip" not in self.text


def documents() -> list[Path]:
    """In the order in which their commands are run."""
    folders = ("tracking", "weights", "simulator", "tf_ops")
    return [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *(ROOT / folder / "README.md" for folder in folders),
    ]


def commands() -> list[Command]:
    """Every command once, where it occurs first."""
    found = {}
    for path in documents():
        for language, block in BLOCKS.findall(path.read_text(encoding="utf-8")):
            lines = re.sub(r" *\\\n *", " ", block).splitlines()  # continued ones are one
            for line in lines if language == "sh" else ():
                if line.strip():
                    found.setdefault(line, Command(str(path.relative_to(ROOT)), line))
    return list(found.values())
