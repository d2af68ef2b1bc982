"""Arrays of any kind that hold a scan."""

from pathlib import Path

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


def test_the_smallest_integer_is_far():
    """Its magnitude is no 16-bit integer."""
    points, dropped = as_points(np.insert(np.rint(POINTS).astype(np.int16), 7, -(2**15), axis=0))
    assert dropped == 1
    np.testing.assert_array_equal(points, np.rint(POINTS))


def test_centimetres_are_refused():
    """They would lie within 1000 m."""
    with pytest.raises(InputError, match=r"expected metres from the scanner, found a median"):
        as_points(POINTS * 20)


def test_a_data_frame_is_read_by_the_names_of_its_columns():
    frame = pd.DataFrame(POINTS[:, [2, 3, 0, 1]], columns=["z", "intensity", "X", "y"])
    np.testing.assert_array_equal(as_points(frame)[0], POINTS.astype(np.float32))
    by_place = pd.DataFrame(POINTS)
    np.testing.assert_array_equal(as_points(by_place)[0], POINTS.astype(np.float32))


class Frame:
    """A data frame that has names, columns and a plain array, as those of Polars and cuDF."""

    def __init__(self, names, array):
        self.columns, self.array = names, array

    def __array__(self, dtype=None, copy=None):
        return self.array

    def __getitem__(self, name):
        return self.array[:, self.columns.index(name)]


class ArrowTable(Frame):
    """Arrow keeps the names elsewhere, and the columns where others keep the names."""

    def __init__(self, names, array):
        super().__init__(names, array)
        self.column_names, self.columns = names, list(array.T)

    def __getitem__(self, name):
        return self.array[:, self.column_names.index(name)]


@pytest.mark.parametrize(
    "kind", [Frame, ArrowTable, lambda names, a: dict(zip(names, a.T, strict=True))]
)
def test_frames_of_any_library_are_read_by_name(kind):
    names = ["t", "reflectance", "Z", "x", " y"]
    points = as_points(kind(names, POINTS[:, [3, 3, 2, 0, 1]]))[0]
    np.testing.assert_array_equal(points, POINTS.astype(np.float32))


@pytest.mark.parametrize(
    ("names", "seen"),
    [
        (["lat", "lon", "alt", "i"], "found lat, lon, alt, i"),
        (["range", "azimuth", "elevation", "x"], "found range, azimuth, elevation, x"),
        ([2, 0, 1, 3], "found 2, 0, 1, 3"),
        ([("p", "x"), ("p", "y"), ("p", "z"), ("i", "")], "found .*'p', 'x'"),
    ],
)
@pytest.mark.parametrize(
    "kind", [Frame, ArrowTable, lambda names, a: pd.DataFrame(a, columns=names)]
)
def test_frames_without_x_y_z_are_refused(kind, names, seen):
    with pytest.raises(InputError, match=rf"expected columns x, y, z \(and intensity\).*{seen}"):
        as_points(kind(names, POINTS))


def test_columns_of_text_are_refused():
    frame = pd.DataFrame(POINTS, columns=list("xyzi")).assign(z="high")
    with pytest.raises(InputError, match="expected columns of numbers, found x, y, z, i: "):
        as_points(frame)


@pytest.mark.parametrize(
    "intensity", ["i", "Intensity", "reflectance", "reflectivity", "remission"]
)
def test_fields_are_read_by_name_in_any_case_and_order(intensity):
    names = ["ring", intensity, "Z", "X", "Y"]
    array = np.zeros(60, [(name, "f8") for name in names])
    for name, column in zip(names[1:], (3, 2, 0, 1), strict=True):
        array[name] = POINTS[:, column]
    np.testing.assert_array_equal(as_points(array)[0], POINTS.astype(np.float32))


@pytest.mark.parametrize(
    ("fields", "seen"),
    [
        ([("a", "f4"), ("b", "f4"), ("c", "f4")], "expected fields x, y, z .*found a, b, c"),
        ([("xyz", "f4", 3), ("i", "f4")], "expected fields x, y, z .*found xyz, i"),
        ([("x", "f4", 2), ("y", "f4"), ("z", "f4")], "found x of type"),
        ([("x", "f4"), ("y", "U3"), ("z", "f4")], "found y of type"),
    ],
)
def test_fields_of_other_names_or_types_are_refused(fields, seen):
    with pytest.raises(InputError, match=seen):
        as_points(np.zeros(30, fields))


def test_a_batch_index_is_no_coordinate():
    batch = np.insert(POINTS, 0, 0.0, axis=1)
    with pytest.raises(InputError, match="found 0 in all of column 1: is it a batch index"):
        as_points(batch)
    np.testing.assert_array_equal(as_points(batch[:, 1:])[0], POINTS.astype(np.float32))


class Message:
    """What is no array, such as a message of ROS."""


@pytest.mark.parametrize(
    ("thing", "seen"),
    [
        ("scans/000000.bin", r"found a path: .*read_scan\('scans/000000.bin'\) reads a file"),
        (Path("000000.bin"), "found a path"),
        (np.zeros((20, 40, 3), np.uint8), "expected points of real numbers, found dtype uint8"),
        (Message(), "found Message, which is no array"),
        ((row for row in POINTS), "found generator, which is no array"),
        ({"points": POINTS}, "expected columns x, y, z .*found points"),
    ],
)
def test_things_that_are_no_array_are_named(thing, seen):
    with pytest.raises(InputError, match=seen):
        as_points(thing)


def test_an_empty_list_holds_no_point():
    points, dropped = as_points([])
    assert (points.shape, dropped) == ((0, 3), 0)
