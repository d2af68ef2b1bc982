"""farthest_point_sample and gather_point against NumPy, index by index."""

import numpy as np
import pytest
import tensorflow as tf
from helpers import ops_reference as reference

from tf_ops import farthest_point_sample, gather_point

InvalidArgument = tf.errors.InvalidArgumentError

# Around the sizes of a block (16), a leaf (32), a group of leaves (512), and past two levels.
SIZES = (1, 2, 15, 16, 17, 33, 100, 512, 513, 1000)


@pytest.mark.parametrize("kind", reference.KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_farthest_points_match_numpy(kind, size):
    xyz = reference.cloud(kind, 2, size)
    npoint = min(size + 3, 300)
    index = farthest_point_sample(npoint, xyz).numpy()
    np.testing.assert_array_equal(index, reference.farthest_point_sample(npoint, xyz))


@pytest.mark.parametrize("kind", reference.KINDS)
def test_farthest_points_of_a_deep_tree(kind):
    xyz = reference.cloud(kind, 1, 9000)
    index = farthest_point_sample(64, xyz).numpy()
    np.testing.assert_array_equal(index, reference.farthest_point_sample(64, xyz))


def test_huge_coordinates_overflow_without_harm():
    xyz = reference.cloud("random", 1, 200) * np.float32(3e37)
    with np.errstate(over="ignore"):
        expected = reference.farthest_point_sample(20, xyz)
    np.testing.assert_array_equal(farthest_point_sample(20, xyz).numpy(), expected)


def test_ties_go_to_the_lowest_index():
    square = np.array([[[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]], np.float32)
    # From the corner, points 1 and 4 are equally far; then 2 and 3.
    assert farthest_point_sample(4, square).numpy().tolist() == [[0, 1, 2, 3]]


def test_more_samples_than_points_repeat_the_first():
    assert farthest_point_sample(4, [[[0.0, 0, 0], [1, 0, 0]]]).numpy().tolist() == [[0, 1, 0, 0]]


def test_batches_are_independent():
    xyz = reference.cloud("random", 5, 300)
    together = farthest_point_sample(40, xyz).numpy()
    alone = np.concatenate([farthest_point_sample(40, xyz[b : b + 1]) for b in range(5)])
    np.testing.assert_array_equal(together, alone)


@pytest.mark.real
def test_farthest_points_of_a_real_scan(kitti_root):
    path = kitti_root / "training" / "velodyne" / "0000" / "000120.bin"
    xyz = np.fromfile(path, np.float32).reshape(1, -1, 4)[:, :15000, :3]
    index = farthest_point_sample(512, xyz).numpy()
    np.testing.assert_array_equal(index, reference.farthest_point_sample(512, xyz))


def test_empty_batch():
    assert farthest_point_sample(4, np.zeros((0, 7, 3), np.float32)).shape == (0, 4)


def test_no_points_is_an_error():
    with pytest.raises(InvalidArgument, match="no points to choose from"):
        farthest_point_sample(4, np.zeros((1, 0, 3), np.float32))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_not_finite_is_an_error(bad):
    xyz = reference.cloud("random", 2, 50)
    xyz[1, 17, 2] = bad
    with pytest.raises(InvalidArgument, match=r"xyz\[1, 17, 2\] is -?(nan|inf)"):
        farthest_point_sample(4, xyz)


def test_wrong_shape_is_an_error():
    with pytest.raises(InvalidArgument, match=r"\(B, N, 3\), received \[1,5,4\]"):
        farthest_point_sample(4, np.zeros((1, 5, 4), np.float32))


@pytest.mark.parametrize("npoint", [0, -1])
def test_npoint_below_one_is_an_error(npoint):
    with pytest.raises((InvalidArgument, ValueError), match="npoint"):
        farthest_point_sample(npoint, np.zeros((1, 5, 3), np.float32))


@pytest.mark.parametrize("dtype", [tf.float32, tf.float16, tf.bfloat16])
def test_gather_point(dtype):
    points = tf.cast(reference.cloud("random", 2, 9), dtype)
    index = np.array([[0, 8, 8], [3, 1, 0]], np.int32)
    gathered = gather_point(points, index)
    assert gathered.dtype == dtype
    np.testing.assert_array_equal(gathered, reference.group(points.numpy(), index))
