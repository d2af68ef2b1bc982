"""The made-up KITTI folder of tests/evaluation, for the experiments."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

MAKER = Path(__file__).resolve().parent.parent / "evaluation" / "tiny_kitti.py"


@pytest.fixture(scope="session")
def experiment_root(tmp_path_factory) -> Path:
    """Sequences 0000 (two cars, a van) and 0001 (none), with detections."""
    spec = importlib.util.spec_from_file_location("tiny_kitti_for_experiments", MAKER)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.make(tmp_path_factory.mktemp("kitti"))
