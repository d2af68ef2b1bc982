"""Imports go one way: README's floors, and the folders without TensorFlow."""

import ast
import re
from pathlib import Path

import pytest

from common.provenance import ROOT

ROWS = re.findall(r"^\| (\d) \| `([\w*.]+)/?` \|", (ROOT / "README.md").read_text(), re.MULTILINE)
FLOORS = {name: int(floor) for floor, name in ROWS}


def sources(folder: str) -> list[Path]:
    return sorted(ROOT.glob(folder if folder == "*.py" else f"{folder}/**/*.py"))


def imported(path: Path) -> set[str]:
    """Top-level names of all imports of a file, those inside functions too."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            names.add(node.module.split(".")[0])
        elif isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
    return names


def test_every_package_has_a_floor():
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    assert packages == set(FLOORS) - {"*.py"}


@pytest.mark.parametrize("folder", FLOORS)
def test_a_folder_imports_only_from_lower_floors(folder):
    scripts = {path.stem: FLOORS["*.py"] for path in sources("*.py")}
    floors = {name: floor for name, floor in {**FLOORS, **scripts}.items() if name != folder}
    if folder == "*.py":  # scripts use pointtracknet.py
        floors.pop("pointtracknet")
    upward = {
        f"{path.relative_to(ROOT)} imports {name}"
        for path in sources(folder)
        for name in imported(path)
        if floors.get(name, -1) >= FLOORS[folder]
    }
    assert not upward


@pytest.mark.parametrize("folder", ["kitti", "simulator", "tracking", "metrics"])
def test_no_tensorflow_below_the_networks(folder):
    for path in sources(folder):
        assert not imported(path) & {"tensorflow", "keras", "tf_ops", "models"}, path
