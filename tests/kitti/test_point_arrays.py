"""Arrays of any kind that hold a scan."""

import numpy as np
import pandas as pd
import pytest

from common.errors import InputError
from kitti.scans.point_arrays import as_points

POINTS = np.random.default_rng(0).uniform(1, 40, (60, 4))


def test_masked_points_are_dropped():
    masked = np.ma.array(POINTS, mask=np.zeros((60, 4), bool))
    masked[7, 1] = np.ma.masked
    points, dropped = as_points(masked)
    assert dropped == 1
    np.testing.assert_array_equal(points, np.delete(POINTS, 7, axis=0).astype(np.float32))
    whole = np.ma.array(np.rint(POINTS).astype(int))
    np.testing.assert_array_equal(as_points(whole)[0], np.rint(POINTS))


@pytest.mark.parametrize(
    "array",
    [
        POINTS.T,
        POINTS[:20].T,
        POINTS[:, :3].T,
        np.moveaxis(POINTS.reshape(6, 10, 4), 2, 0),
        np.pad(POINTS, ((0, 0), (0, 3))).T,  # 7 channels
    ],
)
def test_coordinates_along_the_first_axis_are_refused(array):
    if array.shape[-1] <= 12:
        array = np.concatenate([array] * 4, axis=-1)
    with pytest.raises(InputError, match="transpose it"):
        as_points(array)


def test_other_units_are_refused_with_the_flag():
    with pytest.raises(InputError, match=r"beyond 1000 m \(--scan_scale"):
        as_points(POINTS * 1000)


def test_a_data_frame_is_read_by_the_names_of_its_columns():
    frame = pd.DataFrame(POINTS[:, [2, 3, 0, 1]], columns=["z", "intensity", "X", "y"])
    np.testing.assert_array_equal(as_points(frame)[0], POINTS.astype(np.float32))
    by_place = pd.DataFrame(POINTS)
    np.testing.assert_array_equal(as_points(by_place)[0], POINTS.astype(np.float32))


def test_an_empty_list_holds_no_point():
    points, dropped = as_points([])
    assert (points.shape, dropped) == ((0, 3), 0)
