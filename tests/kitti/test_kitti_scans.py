"""Scans: files, the camera's crop, drawing points."""

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import InputError
from kitti.camera_view import in_camera_view
from kitti.scans.point_arrays import sample_points
from kitti.scans.scan_files import read_points, read_scan, write_scan


def test_round_trip(tmp_path):
    points = np.random.default_rng(0).uniform(size=(7, 4)).astype(np.float32)
    write_scan(tmp_path / "0.bin", points)
    again = read_scan(tmp_path / "0.bin")
    assert again.dtype == np.float32
    assert again.flags.writeable
    np.testing.assert_array_equal(again, points)


def test_write_refuses_other_shapes(tmp_path):
    with pytest.raises(ValueError, match=r"\(n, 4\)"):
        write_scan(tmp_path / "0.bin", np.zeros((5, 3)))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("size", [1, 15, 17, 40])
def test_truncated(tmp_path, size):
    (tmp_path / "0.bin").write_bytes(b"\x00" * size)
    with pytest.raises(
        InputError, match=rf"multiple of 16 bytes, found {size} \(float32 x,y,z,i\)"
    ):
        read_scan(tmp_path / "0.bin")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_points_without_a_return_are_dropped_with_a_note(tmp_path, capsys, value):
    points = np.arange(20, dtype=np.float32).reshape(5, 4)
    points[3, 1] = value
    for name in ("0.bin", "1.bin"):
        write_scan(tmp_path / name, points)
        np.testing.assert_array_equal(read_scan(tmp_path / name), points[[0, 1, 2, 4]])
    assert capsys.readouterr().err.count("note: ") == 1
    write_scan(tmp_path / "2.bin", np.full((5, 4), value, np.float32))
    with pytest.raises(InputError, match=r"2\.bin: expected finite points, found none among 5"):
        read_scan(tmp_path / "2.bin")


@pytest.mark.parametrize(
    ("dtype", "factor", "end"),
    [
        (np.float64, 1, r"it looks like float64 x,y,z,i"),
        (np.float32, 1000, r"found a median range of [\d.e+]+"),
        (np.uint8, 0, r"found 401 \(float32 x,y,z,i\)"),
    ],
)
def test_a_data_set_in_another_layout_gets_no_flags_of_track_py(tmp_path, dtype, factor, end):
    """Its programs do not have them."""
    points = np.random.default_rng(0).uniform([3, -9, -2, 0], [40, 9, 1, 1], (100, 4))
    points[:, :3] *= factor
    data = points.astype(dtype).tobytes() + (b"" if factor else b"0")
    (tmp_path / "0.bin").write_bytes(data)
    with pytest.raises(InputError, match=r"track\.py"):
        read_points(tmp_path / "0.bin")
    with pytest.raises(InputError, match=rf"0\.bin: expected .*{end}$") as caught:
        read_scan(tmp_path / "0.bin")
    assert caught.value.path == tmp_path / "0.bin"


def test_directory_or_missing(tmp_path):
    with pytest.raises(InputError, match="directory"):
        read_scan(tmp_path)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_scan(tmp_path / "0.bin")


def test_camera_view(calib):
    in_front = [20.0, 0, 0]
    behind, left, above, below = [-20.0, 0, 0], [5.0, 20, 0], [5.0, 0, 10], [5.0, 0, -1.6]
    points = np.array([in_front, behind, left, above, below])
    assert in_camera_view(points, calib).tolist() == [True, False, False, False, False]
    # 720 * y / 20 + 610 = 1241 at y = -17.5: the image's right edge.
    edge = np.array([[20.0, -17.4, 0], [20.0, -17.6, 0]])
    assert in_camera_view(edge, calib).tolist() == [True, False]
    assert in_camera_view(edge, calib, image_size=(1300, 375)).all()
    lens = np.array([[0.05, -0.01, 0], [0.2, -0.01, 0]])  # before the lens, nearer than MIN_DEPTH
    assert in_camera_view(lens, calib).tolist() == [False, True]


@given(count=st.integers(1, 40), n=st.integers(0, 60), seed=st.integers(0, 9))
def test_sampling(count, n, seed):
    points = np.zeros((count, 4))
    index = sample_points(points, n, np.random.default_rng(seed))
    assert index.shape == (n,)
    used = np.unique(index)
    assert len(used) == min(n, count)  # no repeats while there are enough, then every point
    assert used.min(initial=0) >= 0
    assert used.max(initial=0) < count
    again = sample_points(points, n, np.random.default_rng(seed))
    np.testing.assert_array_equal(index, again)


def test_sampling_from_nothing():
    with pytest.raises(ValueError, match="from none"):
        sample_points(np.zeros((0, 4)), 3, np.random.default_rng(0))


@pytest.mark.real
def test_real_scans_lie_in_the_image(kitti_root):
    from kitti.sequence import KittiSequence

    sequence = KittiSequence(kitti_root, 0)
    for t in (0, 77, 153):
        everything = sequence.read_points_level(t, crop=False)
        cropped = sequence.read_points_level(t)
        assert everything.dtype == np.float32
        assert len(cropped) > 0.999 * len(everything)  # the files are cropped already
        assert 15_000 < len(everything) < 25_000
