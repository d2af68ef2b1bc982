"""Small KITTI folders for the tests of kitti/."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from kitti.calibration import Calibration, write_calibration

# The same examples in every run, and no failure because the machine was busy.
settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")


@pytest.fixture(scope="session")
def calib() -> Calibration:
    """A made-up calibration: KITTI-like focal length, a slightly turned and shifted Velodyne."""
    p2 = np.array([[720.0, 0, 610, 45], [0, 720, 173, 0.2], [0, 0, 1, 0.003]])
    a = 0.01
    r0 = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1.0]])
    velo = np.array([[0.0, -1, 0, 0.01], [0, 0, -1, -0.08], [1, 0, 0, -0.27]])
    return Calibration(p2=p2, r0_rect=r0, tr_velo_to_cam=velo)


@pytest.fixture
def kitti_folder(tmp_path: Path, calib: Calibration):
    """Returns make(rows, seq=0): writes calibration and labels, gives data_root."""

    def make(rows: list[str], seq: int = 0) -> Path:
        for name in ("label_02", "calib"):
            (tmp_path / "training" / name).mkdir(parents=True, exist_ok=True)
        label = tmp_path / "training" / "label_02" / f"{seq:04d}.txt"
        label.write_text("".join(row + "\n" for row in rows))
        write_calibration(tmp_path / "training" / "calib" / f"{seq:04d}.txt", calib)
        return tmp_path

    return make
