"""The Rerun recording: a file where rerun-sdk is installed, one line of error where it is not."""

import sys

import numpy as np
import pytest
from test_scene import FRAMES, drive, points

from common.errors import InputError
from kitti.objects import Objects
from visualization.clip import Clip
from visualization.rerun_file import load_rerun, write_recording


def test_without_the_package_the_error_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match="pip install rerun-sdk"):
        load_rerun()


def test_the_recording_holds_every_frame(tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    clip = Clip("0016", range(FRAMES), points, Objects.empty(), drive([3, 4]), poses)
    path = write_recording(tmp_path / "a.rrd", clip, {"ours": drive([7]), "none": Objects.empty()})
    data = path.read_bytes()
    assert data[:4] in (b"RRF2", b"RRIO") and len(data) > 10_000
    names = {name.encode() for name in ("points", "labels", "ours", "none")}
    assert all(b"/world/sensor/" + name in data for name in names)
    assert list(tmp_path.iterdir()) == [path]
