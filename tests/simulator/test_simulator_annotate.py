"""Labels from rays and projection, and occlusion in a sweep."""

from dataclasses import replace

import numpy as np
import pytest

from kitti.boxes import IMAGE_SIZE, points_in_boxes
from simulator.annotate import label_frame, occlusion_state, truncation_share
from simulator.bodies.kitti_types import make_body
from simulator.drives.drive import make_calibration
from simulator.sensor_model import scan
from simulator.sensor_model.frames import Options, take_sweep
from simulator.sensor_model.scan import Scene
from simulator.world.static import StaticWorld
from simulator.world.terrain import Terrain

CAR = (3.9, 1.6, 1.5)


@pytest.fixture(scope="module")
def calib():
    return make_calibration(np.random.default_rng(0))


def scene(boxes, wall=None) -> Scene:
    samples = np.array([[x, y, -1.65] for x in range(-20, 100, 5) for y in range(-50, 51, 5)])
    terrain = Terrain(samples, np.ones(len(samples)), (-20, -50), (100, 50), kerb=0.0)
    static = StaticWorld()
    if wall is not None:
        static.add_box(*wall, 0.5)
    bodies = [make_body("Car", box[3:6], (index,)) for index, box in enumerate(boxes)]
    return Scene(np.eye(4), np.array(boxes, float).reshape(-1, 7), bodies, static, terrain)


def car(x, y, yaw=0.3):
    return [x, y, -1.65 + 0.75, *CAR, yaw]


def test_vehicle_points_lie_in_their_grown_boxes(calib):
    boxes = [car(12, 3), car(20, -4, 1.5), car(30, 2, -2.0)]
    result = take_sweep(scene(boxes), calib, IMAGE_SIZE, Options(), (1,))
    points = calib.velo_to_level(result.points[:, :3])
    for index, box in enumerate(boxes):
        own = points[result.owner == index]
        assert len(own) > 60
        inside = points_in_boxes(own, np.array([box]), 0.1)
        assert (inside == 0).all()
    ground = points[result.owner == -2]
    assert np.abs(ground[:, 2] + 1.65).max() < 0.1


def test_occlusion_agrees_with_the_share_of_rays_lost(calib):
    lone = take_sweep(scene([car(25, 0)]), calib, IMAGE_SIZE, Options(), (1,))
    assert lone.seen[0] == pytest.approx(lone.rays[0], abs=0.02 * lone.rays[0])
    shares = []
    for edge in (-0.6, 0.0, 0.5, 3.0):  # a wall that comes in from the right
        wall = (12, edge - 10, 0.0, 0.2, 20, -2, 3)
        result = take_sweep(scene([car(25, 0)], wall), calib, IMAGE_SIZE, Options(), (1,))
        hits = (result.owner == 0).sum() / max((lone.owner == 0).sum(), 1)
        share = result.seen[0] / result.rays[0]
        assert share == pytest.approx(hits, abs=0.08)  # rays that were lost are points lost
        shares.append(share)
    assert (np.diff(shares) < 0).all() and shares[-1] == 0
    states = occlusion_state(np.array([1.0, 0.7, 0.2, 0.0]) * 100, np.full(4, 100))
    np.testing.assert_array_equal(states, [0, 1, 2, 2])


def test_a_car_hides_the_car_behind(calib):
    result = take_sweep(scene([car(10, 0, 0), car(18, 0, 0)]), calib, IMAGE_SIZE, Options(), (1,))
    assert result.seen[0] > 0.95 * result.rays[0]
    assert result.seen[1] < 0.5 * result.rays[1]


@pytest.mark.parametrize("options", [Options(), Options(full=True), Options(True, True)])
def test_no_ray_on_a_vehicle_is_left_out(calib, monkeypatch, options):
    boxes = [car(5, 3), car(9, -3.5, 0), car(1, 3, 0), car(-6, -3, 1.5), car(25, 2), car(-14, 4)]
    boxes.append([0, -5, 0.15, 15.0, 2.4, 3.6, 0.0])
    moving = scene(boxes)
    if options.motion_distortion:
        speeds = np.array([[-12, 0, 0], [10, 0, 0], [-14, 1, 0], [0, 5, 0], [20, 0, 0]])
        moving = replace(moving, velocities=np.vstack([speeds, [[-15, 0, 0], [3, 0, 0]]]))
    args = (moving, calib, IMAGE_SIZE, options, (1,), (14.0, 0.0, 0.5))
    found = take_sweep(*args).rays
    monkeypatch.setattr(scan, "_window", lambda *_: (slice(0, 64), slice(0, 10**6)))
    np.testing.assert_array_equal(found, take_sweep(*args).rays)
    assert found.max() > 3000


def test_truncation_share(calib):
    boxes = np.array([car(20, 0), car(6, 5.2, 0), car(-10, 0)])
    share = truncation_share(boxes, calib, IMAGE_SIZE)
    assert share[0] == pytest.approx(0, abs=1e-9)
    assert 0.05 < share[1] < 1
    assert share[2] == 1


def test_label_rows(calib):
    boxes = [car(20, 0), car(30, 5), car(90, 2), car(-10, 0), car(40, -3), car(33, -8), car(69, 0)]
    boxes = np.array(boxes)
    rays, seen = np.full(7, 100), np.array([100, 60, 50, 100, 12, 0, 100])
    rows = label_frame(7, boxes, ["Car"] * 7, np.arange(7), rays, seen, calib, IMAGE_SIZE)
    labelled = rows.of_classes(("Car",))
    np.testing.assert_array_equal(labelled.track_id, [0, 1])
    np.testing.assert_array_equal(labelled.occlusion, [0, 1])
    np.testing.assert_allclose(labelled.boxes, boxes[:2])
    # too far, too hidden, too small: a 2-D box to leave out; behind or never met by a ray: nothing
    ignored = rows.of_classes(("DontCare",))
    assert len(ignored) == 3 and (ignored.track_id == -1).all()
    assert np.isnan(ignored.boxes).all() and np.isfinite(ignored.bbox).all()
    width, height = IMAGE_SIZE
    assert (rows.bbox >= 0).all() and (rows.bbox[:, 2] <= width - 1).all()
    assert (rows.bbox[:, 3] <= height - 1).all()


def test_dark_far_and_grazing_surfaces_return_less(calib):
    near = take_sweep(scene([car(12, 0)]), calib, IMAGE_SIZE, Options(), (1,))
    far = take_sweep(scene([car(60, 0)]), calib, IMAGE_SIZE, Options(), (1,))
    near_share = (near.owner == 0).sum() / near.rays[0]
    far_share = (far.owner == 0).sum() / far.rays[0]
    assert far_share < near_share
    assert near.points[:, 3].min() >= 0 and near.points[:, 3].max() < 1
    distance = np.linalg.norm(far.points[far.owner == -2][:, :3], axis=1)
    # Velodyne's manual promises asphalt to 50 m; single points come back from farther away.
    assert (distance > 60).mean() < 0.02
