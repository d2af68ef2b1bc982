"""query_ball_point, knn_point, three_nn against NumPy, index by index."""

import itertools

import numpy as np
import pytest
import tensorflow as tf
from helpers import ops_reference as reference

from tf_ops import knn_point, query_ball_point, three_nn

InvalidArgument = tf.errors.InvalidArgumentError

SIZES = ((1, 1), (2, 5), (16, 17), (33, 1), (40, 300), (300, 40), (700, 90))


def pair(kind: str, points: int, queries: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and queries; every other query is one of the points."""
    xyz1 = reference.cloud(kind, 2, points)
    xyz2 = reference.cloud(kind, 2, queries, seed=1)
    xyz2[:, ::2] = xyz1[:, np.arange(len(xyz2[0, ::2])) % points]
    return xyz1, xyz2


@pytest.mark.parametrize("kind", reference.KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_knn_matches_numpy(kind, size):
    xyz1, xyz2 = pair(kind, *size)
    rows = reference.squared_distances(xyz2, xyz1)
    for k in (1, 2, 3, 4, 7, 16, 17, 64, 200):
        dist2, index = knn_point(k, xyz1, xyz2)
        expected_index, expected = reference.smallest(k, rows)
        np.testing.assert_array_equal(index, expected_index)
        np.testing.assert_array_equal(dist2, expected)


@pytest.mark.parametrize("kind", reference.KINDS)
@pytest.mark.parametrize("k", [8, 64, 600])
def test_knn_in_a_deep_tree(kind, k):
    xyz1, xyz2 = pair(kind, 5000, 50)
    dist2, index = knn_point(k, xyz1, xyz2)
    expected_index, expected = reference.smallest(k, reference.squared_distances(xyz2, xyz1))
    np.testing.assert_array_equal(index, expected_index)
    np.testing.assert_array_equal(dist2, expected)


@pytest.mark.parametrize("k", [3, 8, 17, 64])
def test_knn_where_only_the_last_neighbour_ties(k):
    query = np.zeros((1, 1, 3), np.float32)
    for seed in range(20):
        xyz = reference.cloud("random", 1, 300, seed=seed)
        order = np.argsort(reference.squared_distances(query, xyz)[0, 0], kind="stable")
        xyz[0, order[k]] = xyz[0, order[k - 1]]
        expected_index, expected = reference.smallest(k, reference.squared_distances(query, xyz))
        dist2, index = knn_point(k, xyz, query)
        np.testing.assert_array_equal(index, expected_index)
        np.testing.assert_array_equal(dist2, expected)


@pytest.mark.parametrize("size", [1, 60, 2000])
@pytest.mark.parametrize("scale", [3e18, 1e30, 3e37])
def test_knn_of_distances_that_overflow(size, scale):
    """No, few or all squared distances are finite; those at infinity tie and go by index."""
    xyz1 = reference.cloud("random", 2, size) * np.float32(scale)
    xyz2 = np.concatenate([xyz1[:, ::40], -xyz1[:, :3]], 1)
    with np.errstate(over="ignore"):
        rows = reference.squared_distances(xyz2, xyz1)
    for k in (3, 8, 16, 17, 40, 200):
        dist2, index = knn_point(k, xyz1, xyz2)
        expected_index, expected = reference.smallest(k, rows)
        np.testing.assert_array_equal(index, expected_index)
        np.testing.assert_array_equal(dist2, expected)


@pytest.mark.parametrize("k", [1, 3, 16, 17, 64])
def test_knn_without_any_finite_distance(k):
    points, queries = np.full((1, 500, 3), 1e30, np.float32), np.full((1, 2, 3), -1e30, np.float32)
    dist2, index = knn_point(k, points, queries)
    assert np.isinf(dist2).all()
    np.testing.assert_array_equal(index, np.tile(np.arange(k), (1, 2, 1)))


@pytest.mark.parametrize("kind", reference.KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_three_nn_matches_numpy(kind, size):
    points, queries = pair(kind, *size)
    dist2, index = three_nn(queries, points)
    expected_index, expected = reference.smallest(3, reference.squared_distances(queries, points))
    np.testing.assert_array_equal(index, expected_index)
    np.testing.assert_array_equal(dist2, expected)


def test_three_nn_gives_squares():
    dist2, index = three_nn([[[0.0, 0, 0]]], [[[2.0, 0, 0], [0, 3, 0], [0, 0, 1]]])
    assert dist2.numpy().tolist() == [[[1.0, 4.0, 9.0]]]
    assert index.numpy().tolist() == [[[2, 0, 1]]]


@pytest.mark.parametrize("kind", reference.KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_ball_query_matches_numpy(kind, size):
    xyz1, xyz2 = pair(kind, *size)
    for radius, nsample in itertools.product((0.01, 0.5, 1.0, 2.0, 100.0), (1, 8, 64)):
        index, count = query_ball_point(radius, nsample, xyz1, xyz2)
        expected, expected_count = reference.query_ball_point(radius, nsample, xyz1, xyz2)
        np.testing.assert_array_equal(index, expected)
        np.testing.assert_array_equal(count, expected_count)


def test_ball_query_radius_is_exclusive_and_empty_balls_hold_the_nearest():
    points = np.array([[[3, 0, 0], [1, 0, 0], [0.5, 0, 0], [0, 0.25, 0]]], np.float32)
    queries = np.array([[[0, 0, 0], [9, 0, 0]]], np.float32)
    index, count = query_ball_point(1.0, 4, points, queries)
    # Point 1 lies at the radius itself; the second query's nearest point is point 0.
    assert index.numpy().tolist() == [[[2, 3, 2, 2], [0, 0, 0, 0]]]
    assert count.numpy().tolist() == [[2, 0]]


@pytest.mark.real
def test_neighbours_in_a_real_scan(kitti_root):
    path = kitti_root / "training" / "velodyne" / "0000" / "000120.bin"
    xyz1 = np.fromfile(path, np.float32).reshape(1, -1, 4)[:, :15000, :3]
    xyz2 = xyz1[:, ::50]
    index, count = query_ball_point(1.0, 32, xyz1, xyz2)
    expected, expected_count = reference.query_ball_point(1.0, 32, xyz1, xyz2)
    np.testing.assert_array_equal(index, expected)
    np.testing.assert_array_equal(count, expected_count)
    rows = reference.squared_distances(xyz2, xyz1)
    for k in (3, 8, 64):
        np.testing.assert_array_equal(knn_point(k, xyz1, xyz2)[1], reference.smallest(k, rows)[0])
    np.testing.assert_array_equal(three_nn(xyz2, xyz1)[1], reference.smallest(3, rows)[0])


EMPTY = {
    "no batch": ((0, 5, 3), (0, 4, 3)),
    "no queries": ((2, 5, 3), (2, 0, 3)),
    "no points, no queries": ((2, 0, 3), (2, 0, 3)),
}


@pytest.mark.parametrize("shapes", EMPTY.values(), ids=EMPTY.keys())
def test_empty(shapes):
    points, queries = (np.zeros(shape, np.float32) for shape in shapes)
    rows = queries.shape[:2]
    assert [t.shape for t in query_ball_point(1.0, 3, points, queries)] == [(*rows, 3), rows]
    for k in (3, 30):
        assert [t.shape for t in knn_point(k, points, queries)] == [(*rows, k)] * 2
    assert [t.shape for t in three_nn(queries, points)] == [(*rows, 3)] * 2


CALLS = {
    "query_ball_point": lambda points, queries: query_ball_point(1.0, 3, points, queries),
    "knn_point": lambda points, queries: knn_point(3, points, queries),
    "knn_point, many": lambda points, queries: knn_point(30, points, queries),
    "three_nn": lambda points, queries: three_nn(queries, points),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS.keys())
class TestErrors:
    """Inputs that every neighbour op refuses."""

    def test_queries_without_points(self, call):
        with pytest.raises(InvalidArgument, match="no points to choose from"):
            call(np.zeros((1, 0, 3), np.float32), np.zeros((1, 2, 3), np.float32))

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
    @pytest.mark.parametrize("which", [0, 1])
    def test_not_finite(self, call, bad, which):
        clouds = [reference.cloud("random", 1, 40), reference.cloud("random", 1, 30)]
        clouds[which][0, 21, 0] = bad
        with pytest.raises(InvalidArgument, match=r"xyz[12]\[0, 21, 0\] is -?(nan|inf)"):
            call(*clouds)

    def test_different_batches(self, call):
        with pytest.raises(InvalidArgument, match=r"batch size [12], received \[[12],5,3\]"):
            call(np.zeros((1, 5, 3), np.float32), np.zeros((2, 5, 3), np.float32))

    def test_wrong_width(self, call):
        with pytest.raises(InvalidArgument, match=r"\(B, N, 3\), received \[1,5,2\]"):
            call(np.zeros((1, 5, 2), np.float32), np.zeros((1, 5, 3), np.float32))


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan])
def test_bad_radius(radius):
    with pytest.raises(InvalidArgument, match="radius must be positive and finite"):
        query_ball_point(radius, 3, np.zeros((1, 5, 3)), np.zeros((1, 5, 3)))
