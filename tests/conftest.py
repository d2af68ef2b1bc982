"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest
from helpers import tiny_kitti

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def kitti_root() -> Path:
    """The real KITTI data: `KITTI_ROOT`, by default ../shared/kitti; skips where it is absent."""
    path = Path(os.environ.get("KITTI_ROOT", ROOT / "../shared/kitti")).resolve()
    if not (path / "training" / "label_02").is_dir():
        pytest.skip(f"real KITTI data not found at {path}; set KITTI_ROOT")
    return path


@pytest.fixture(scope="session")
def tiny_root(tmp_path_factory) -> Path:
    """A made-up KITTI folder for reading only, see `helpers.tiny_kitti`."""
    return tiny_kitti.make(tmp_path_factory.mktemp("kitti"))
