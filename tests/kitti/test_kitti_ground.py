"""Ground: slopes, crowns, bends and clutter made by hand; the real scans' labelled cars."""

import numpy as np
import pytest

from kitti.ground import GROUND, fit_ground, ground_mask

FLAT = {"x": 0.0, "y": 0.0, "crown": 0.0, "bend": 0.0}
ROUGHNESS = 0.02


def _true_height(shape, x, y):
    """A plane with slopes x and y, a road 12 m wide with a crown, bent along x."""
    crown = shape["crown"] * np.minimum(np.abs(y), 6.0) ** 2
    return -1.65 + shape["x"] * x + shape["y"] * y - crown + shape["bend"] * x**2


def _scene(shape, seed, n=20_000):
    """Points in the camera's cone, walls on both sides, cars; (n, 3), and which are ground."""
    rng = np.random.default_rng(seed)
    reach, bearing = np.exp(rng.uniform(np.log(5), np.log(75), n)), rng.uniform(-0.7, 0.7, n)
    x, y = reach * np.cos(bearing), reach * np.sin(bearing)
    above = np.zeros(n)
    wall = (np.abs(y) > 10) & (rng.uniform(size=n) < 0.8)
    above[wall] = rng.uniform(0.3, 4, wall.sum())
    for centre_x, centre_y in rng.uniform([8, -8], [60, 8], (15, 2)):
        car = (np.abs(x - centre_x) < 2) & (np.abs(y - centre_y) < 0.9)
        above[car] = rng.uniform(0.25, 1.6, car.sum())
    z = _true_height(shape, x, y) + above + rng.normal(0, ROUGHNESS, n)
    return np.stack([x, y, z], axis=1).astype(np.float32), above == 0


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    "change",
    [
        {},
        {"x": 0.1},
        {"x": -0.15, "y": 0.1},
        {"y": 0.06},
        {"crown": 0.003},
        {"bend": 0.001},
        {"x": 0.08, "crown": 0.002, "bend": -0.001},
    ],
)
def test_finds_the_ground_under_clutter(change, seed):
    shape = {**FLAT, **change}
    points, is_ground = _scene(shape, seed)
    model = fit_ground(points)
    mask = ground_mask(points, model)
    assert mask[is_ground].mean() > 0.995
    assert mask[~is_ground].mean() < 0.002
    near = np.hypot(points[:, 0], points[:, 1]) < 50
    error = model.height(points[near, :2]) - _true_height(shape, *points[near, :2].T)
    # The low percentile sits below the mean by about 1.3 times the roughness; a crown adds its own.
    assert np.median(np.abs(error)) < 1.5 * ROUGHNESS + 10 * shape["crown"]
    assert np.percentile(np.abs(error), 99) < 0.12


def test_a_plane_separates_ground_from_a_flat_world():
    """A level threshold would call a third of this slope's road no ground: the fit matters."""
    points, is_ground = _scene({**FLAT, "x": 0.05}, 0)
    flat = points[:, 2] < -1.65 + GROUND.threshold_m
    assert flat[is_ground].mean() < 0.6
    assert ground_mask(points)[is_ground].mean() > 0.995


def test_threshold_is_a_height():
    points, _ = _scene(FLAT, 0)
    model = fit_ground(points)
    (z,) = model.height(np.array([[20.0, 0]]))
    probe = np.array([[20.0, 0, z - 1], [20.0, 0, z + 0.19], [20.0, 0, z + 0.21]])
    assert GROUND.threshold_m == 0.2
    assert ground_mask(probe, model).tolist() == [True, True, False]


def test_stray_points_below_the_road_do_not_pull_it_down():
    points, _ = _scene(FLAT, 0)
    stray = np.random.default_rng(1).choice(len(points), 300, replace=False)
    points[stray, 2] = -5.0
    heights = fit_ground(points).height(points[:, :2])
    assert np.percentile(np.abs(heights + 1.65), 99) < 0.1


@pytest.mark.parametrize("n", [0, 1, 2, 5, 30])
def test_few_points_give_a_finite_model(n):
    points = np.random.default_rng(n).uniform(-5, 5, (n, 4)).astype(np.float32)
    model = fit_ground(points)
    assert np.isfinite(model.height(np.array([[0.0, 0], [500, -500]]))).all()
    assert ground_mask(points).shape == (n,)


def test_one_row_of_cells_and_far_outliers():
    line = np.stack([np.linspace(1, 60, 600), np.zeros(600), np.full(600, -1.65)], axis=1)
    heights = fit_ground(line).height(line[:, :2])
    np.testing.assert_allclose(heights, -1.65, atol=0.01)
    far = np.concatenate([line, [[1e6, -1e6, 300.0]]])
    np.testing.assert_allclose(fit_ground(far).height(line[:, :2]), heights)


def test_same_points_same_model_in_any_order():
    points, _ = _scene({**FLAT, "x": 0.05}, 3, n=3000)
    shuffled = np.random.default_rng(0).permutation(points)
    where = np.array([[10.0, 0], [40, 5]])
    np.testing.assert_allclose(fit_ground(points).height(where), fit_ground(shuffled).height(where))


@pytest.mark.real
def test_real_scans(kitti_root):
    """Every fourth real scan: the model passes under the labelled cars, not through them."""
    from kitti.boxes import points_in_boxes
    from kitti.objects import VEHICLES
    from kitti.sequence import KittiSequence

    sequence = KittiSequence(kitti_root, 0)
    off, flagged, rest = [], [], []
    for t in range(0, sequence.num_frames, 4):
        points, cars = sequence.read_points_level(t), sequence.objects.at(t).of_classes(VEHICLES)
        model = fit_ground(points)
        bottom = cars.boxes[:, 2] - cars.boxes[:, 5] / 2
        off.append(bottom - model.height(cars.boxes[:, :2]))
        index = points_in_boxes(points, cars.boxes)
        inside = index >= 0
        above_bottom = points[inside, 2] - bottom[index[inside]]
        mask = ground_mask(points, model)
        flagged.append(np.stack([above_bottom, mask[inside]], axis=1))
        rest.append(mask.mean())
    off, flagged = np.concatenate(off), np.concatenate(flagged)
    assert abs(np.median(off)) < 0.08
    assert np.percentile(np.abs(off), 90) < 0.15
    assert 0.35 < np.mean(rest) < 0.65  # about half of a camera-cropped scan is road
    height, is_ground = flagged.T
    assert 0.02 < is_ground.mean() < 0.12  # of the points in boxes
    assert is_ground[height < 0.1].mean() > 0.9
    assert is_ground[height > 0.3].mean() < 0.005
