"""`pip install -e .` in a fresh environment, offline; then the library in another folder."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import pointtracknet
from common.provenance import ROOT

DEVELOPMENT = {"tensorboard", "pytest", "pytest-xdist", "hypothesis", "ruff", "clang-format"}
LEFT_OUT = (".*", "__pycache__", "data", "results", "runs", "tests", "docs", "*.egg-info")
PROGRAM = """
import numpy as np
import pointtracknet, tf_ops
from pointtracknet import Tracker

points = np.random.default_rng(0).uniform((5, -5, -1.7, 0), (40, 5, 1, 1), (3000, 4))
tracks = Tracker.load().update(points.astype(np.float32))
print(tracks.boxes.shape == (len(tracks.ids), 7), pointtracknet.__file__, tf_ops.__file__)
"""


def _run(*command, cwd: Path, **variables: str) -> str:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | variables
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_library_runs_in_another_folder(tmp_path):
    pytest.importorskip("setuptools", reason="pip builds the editable package with setuptools")
    checkout, other = tmp_path / "checkout", tmp_path / "other project"
    shutil.copytree(ROOT, checkout, ignore=shutil.ignore_patterns(*LEFT_OUT))
    other.mkdir()
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / "bin" / "python"
    packages = _run(
        python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=other
    )
    installed = sysconfig.get_path("purelib")  # TensorFlow, pip and setuptools, as they are here
    Path(packages.strip(), "installed.pth").write_text(installed)
    flags = ("--quiet", "--no-index", "--no-build-isolation", "--no-deps")
    _run(python, "-m", "pip", "install", *flags, "-e", checkout, cwd=other)
    shape, *files = _run(python, "-c", PROGRAM, cwd=other, TF_CPP_MIN_LOG_LEVEL="3").split()
    assert shape == "True"
    assert [Path(file).is_relative_to(checkout) for file in files] == [True, True]


@pytest.mark.slow
def test_make_completes_an_environment_without_pip(tmp_path):
    """An interrupted `python -m venv` leaves one; the interpreter's path holds a space."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("requirements.txt", "requirements-lock.txt"):
        (tmp_path / name).touch()
    venv.create(tmp_path / ".venv", with_pip=False)
    python = tmp_path / "my python"
    python.symlink_to(sys._base_executable)
    _run("make", "venv", f"PYTHON={python}", cwd=tmp_path)
    assert _run(tmp_path / ".venv/bin/python", "-m", "pip", "--version", cwd=tmp_path)


def test_make_names_the_package_of_debian_that_makes_environments(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("requirements.txt", "requirements-lock.txt"):
        (tmp_path / name).touch()
    python = tmp_path / "python"  # as Debian's without python3-venv: it cannot run -m venv
    python.write_text('#!/bin/sh\ntest "$1" = -c\n')
    python.chmod(0o755)
    command = ["make", "-C", str(tmp_path), "venv", f"PYTHON={python}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and "sudo apt install python3-venv" in done.stderr


def _requirements(file: str) -> list[Requirement]:
    """The lines of a file of requirements that count for the running Python."""
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    found = [Requirement(line) for line in lines if re.match(r"\w", line)]
    return [each for each in found if each.marker is None or each.marker.evaluate()]


def _brought_along(requirements: list[Requirement]) -> set[str]:
    """Canonical names of installed packages and of all that they require, at any depth."""
    names, waiting = set(), [(canonicalize_name(r.name), *sorted(r.extras)) for r in requirements]
    while waiting:
        package = waiting.pop()
        if package in names:
            continue
        names.add(package)
        for each in map(Requirement, metadata.requires(package[0]) or ()):
            extras = [{"extra": extra} for extra in ("", *package[1:])]
            if each.marker is None or any(map(each.marker.evaluate, extras)):
                waiting.append((canonicalize_name(each.name), *sorted(each.extras)))
    return {name for name, *_ in names}


def test_every_installed_package_is_pinned():
    pinned = {canonicalize_name(each.name) for each in _requirements("requirements-lock.txt")}
    assert _brought_along(_requirements("requirements.txt")) - pinned == set()


def test_the_package_has_the_requirements_of_make():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (block,) = re.findall(r"^dependencies = \[(.*?)^\]", text, re.DOTALL | re.MULTILINE)
    installed = (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines()
    needed = {line for line in installed if re.match(r"\w", line)} - DEVELOPMENT - {"setuptools"}
    assert set(re.findall(r'"([\w-]+)', block)) == needed


def test_a_weights_folder_of_the_working_directory_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert pointtracknet.default_weights() == ROOT / "weights"
    (tmp_path / "weights").mkdir()
    assert pointtracknet.default_weights() == ROOT / "weights"  # of another project, it seems
    (tmp_path / "weights" / "detector.npz").touch()
    assert pointtracknet.default_weights().resolve() == tmp_path / "weights"
