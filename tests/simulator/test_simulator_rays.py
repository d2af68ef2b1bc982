"""Rays against shapes whose answer is known in closed form."""

import numpy as np
import pytest

from kitti.calibration import LEVEL_FROM_CAMERA, Calibration
from kitti.camera_view import in_camera_view
from simulator.bodies.convex import FAR, intersect
from simulator.bodies.parts import block, bounding_ball, column, wheel
from simulator.config import SENSOR
from simulator.drives.drive import make_calibration
from simulator.sensor_model.sensor import beam_table, make_rays
from simulator.world.grid import Grid
from simulator.world.roadside import SETTINGS, Site, furnish
from simulator.world.static import StaticWorld, cast_static, make_columns
from simulator.world.terrain import Terrain

HEIGHT = 1.7


@pytest.fixture
def calib() -> Calibration:
    velo = np.zeros((3, 4))
    velo[:, :3] = LEVEL_FROM_CAMERA.T  # the velodyne frame is the level frame
    p2 = np.array([[721.5, 0, 609.6, 0], [0, 721.5, 172.9, 0], [0, 0, 1.0, 0]])
    return Calibration(p2=p2, r0_rect=np.eye(3), tr_velo_to_cam=velo)


@pytest.fixture
def columns(calib):
    rays = make_rays(calib)
    return make_columns(rays.origin + np.float32([0, 0, HEIGHT]), rays.direction)


def flat_points(columns, distance):
    """World points (B, C, 3) at horizontal distances (B, C)."""
    xy = columns.origin[None] + columns.heading[None] * distance[..., None]
    z = columns.height[:, None] + columns.slope * distance
    return np.concatenate([xy, z[..., None]], axis=-1)


def random_rays(rng, rays: int, reach: float = 20.0):
    direction = rng.normal(size=(rays, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return (rng.normal(size=(rays, 3)) - direction * reach), direction


def slab_distance(origin, direction, half):
    """Reference: distance to the box |x| <= half, by slabs in float64; inf where missed."""
    low, high = (-half - origin) / direction, (half - origin) / direction
    enter, leave = np.minimum(low, high).max(axis=1), np.maximum(low, high).min(axis=1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)


def test_intersect_block_is_the_slab_answer():
    rng = np.random.default_rng(0)
    origin, direction = random_rays(rng, 4000)
    half = np.array([1.5, 0.8, 0.6])
    distance, face = intersect(
        block((0, 0, 0), 2 * half)[None].astype(np.float32),
        origin.astype(np.float32),
        direction.astype(np.float32),
    )
    expected = slab_distance(origin, direction, half)
    hit = np.isfinite(expected)
    assert 0.2 < hit.mean() < 0.9
    grazing = np.abs(distance[:, 0] - np.where(hit, expected, FAR)) > 1e-3
    assert grazing.mean() < 0.002  # float32 decides differently at edges only
    points = origin + direction * distance[:, :1]
    seen = hit & ~grazing
    on_face = np.abs(np.abs(points[seen]) - half).min(axis=1)
    assert on_face.max() < 1e-3
    normals = block((0, 0, 0), 2 * half)[face[seen, 0], :3]
    assert ((normals * direction[seen]).sum(axis=1) < 0).all()


def test_intersect_misses_bodies_behind_the_ray():
    planes = block((5, 0, 0), (1, 1, 1))[None].astype(np.float32)
    origin = np.zeros((2, 3), np.float32)
    direction = np.array([[1, 0, 0], [-1, 0, 0]], np.float32)
    distance, _ = intersect(planes, origin, direction)
    np.testing.assert_allclose(distance[:, 0], [4.5, FAR])


@pytest.mark.parametrize(
    "planes", [block((1, 2, 3), (2, 1, 1)), wheel(0, 0, 0, 0.3, 0.2), column(1, 0, 0, 2, 0.3, 0.2)]
)
def test_bounding_ball_holds_every_hit(planes):
    origin, direction = random_rays(np.random.default_rng(1), 5000)
    ball = bounding_ball(planes)
    origin = origin + ball[:3]
    distance, _ = intersect(planes[None].astype(np.float32), *map(np.float32, (origin, direction)))
    hit = distance[:, 0] < FAR
    points = origin[hit] + direction[hit] * distance[hit]
    assert hit.any()
    assert np.linalg.norm(points - ball[:3], axis=1).max() < ball[3] + 1e-3


@pytest.mark.parametrize("grade", [0.0, 0.03, -0.04])
def test_terrain_plane(columns, grade):
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-40, 140, 2.0), np.arange(-99, 99, 2.0)))
    samples = np.column_stack([x, y, grade * x])
    terrain = Terrain(samples, np.ones(len(samples)), (-40, -100), (140, 100), kerb=0.0)
    distance = terrain.cast(columns)
    # A plane z = grade x is met at height / (grade cos(azimuth) - slope).
    fall = grade * columns.heading[None, :, 0] - columns.slope
    expected = columns.height[:, None] / np.where(fall > 0, fall, np.nan)
    inside = expected < 60
    assert inside.sum() > 1000
    points = flat_points(columns, distance)[inside]
    error = np.abs(points[:, 2] - grade * points[:, 0])
    assert error.max() < 0.08 and np.median(error) < 0.02  # the map is smooth, not exact
    assert (distance[inside] < FAR).all()
    assert (distance[fall <= 0] == FAR).all()


def test_kerb_is_a_step(columns):
    samples = np.array([[x, y, 0.0] for x in range(-20, 100, 5) for y in range(-50, 51, 5)])
    terrain = Terrain(samples, np.ones(len(samples)), (-20, -50), (100, 50), kerb=0.12)
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-20, 100, 0.3), np.arange(-4, 4, 0.3)))
    terrain.mark_road(np.column_stack([x, y]))
    distance = terrain.cast(columns)
    points = flat_points(columns, distance)[distance < 25]
    across = np.abs(points[:, 1])
    assert np.abs(points[across < 3.5, 2]).max() < 0.01
    assert np.abs(points[across > 5, 2] - 0.12).max() < 0.01


def test_static_box(columns):
    world = StaticWorld()
    world.add_box(20, 3, 0.4, 6, 4, 0, 3, 0.5)
    hits = cast_static(world, columns, np.random.default_rng(0))
    cos, sin = np.cos(0.4), np.sin(0.4)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    beams, count = columns.slope.shape
    direction = np.concatenate(
        [np.broadcast_to(columns.heading[None], (beams, count, 2)), columns.slope[..., None]], -1
    ).reshape(-1, 3)
    origin = np.broadcast_to(
        np.array([0, 0, -1.5]) + columns.height[:, None, None] * np.array([0, 0, 1.0]),
        (beams, count, 3),
    ).reshape(-1, 3)
    origin = (origin + np.array([columns.origin[0, 0] - 20, columns.origin[0, 1] - 3, 0])) @ turn
    expected = slab_distance(origin, direction @ turn, np.array([3, 2, 1.5])).reshape(beams, count)
    hit = np.isfinite(expected)
    assert hit.sum() > 500
    assert ((hits.distance < FAR) != hit).mean() < 1e-4
    both = hit & (hits.distance < FAR)
    assert np.abs(hits.distance - expected)[both].max() < 0.01


def test_static_sphere(columns):
    world = StaticWorld()
    center, radius = np.array([15.0, -2.0, 1.0]), 2.0
    world.add_ellipsoid(*center[:2], radius, center[2] - radius, center[2] + radius, 0.5)
    distance = cast_static(world, columns, np.random.default_rng(0)).distance
    points = flat_points(columns, distance)[distance < FAR]
    assert len(points) > 300
    assert np.abs(np.linalg.norm(points - center, axis=1) - radius).max() < 0.01
    assert (points[:, 0] < center[0] + 0.1).all()  # the near side


def test_static_cylinder_and_nearest_wins(columns):
    world = StaticWorld()
    world.add_cylinder(12, 0, 0.5, -1, 4, 0.5)
    world.add_box(30, 0, 0, 1, 60, -1, 8, 0.5)
    distance = cast_static(world, columns, np.random.default_rng(0)).distance
    points = flat_points(columns, distance)[distance < FAR]
    near = points[:, 0] < 20
    assert near.sum() > 100
    assert np.abs(np.hypot(points[near, 0] - 12, points[near, 1]) - 0.5).max() < 0.01
    assert np.abs(points[~near, 0] - 29.5).max() < 0.01


def test_static_shapes_may_end_beyond_the_reach(columns):
    world = StaticWorld()
    world.add_box(80, 0, 0, 20, 40, -2, 20, 0.5)
    world.add_cylinder(80, 30, 10, -2, 20, 0.5)
    distance = cast_static(world, columns, np.random.default_rng(0)).distance
    points = flat_points(columns, distance)[distance < FAR]
    assert np.abs(points[np.abs(points[:, 1]) < 20, 0] - 70).max() < 0.01
    assert (np.abs(points[:, 1]) < 20).sum() > 1000 and (points[:, 1] > 22).sum() > 300


def test_windows_are_counted_from_the_street(columns):
    samples = np.array([[x, y, 0.4] for x in range(-20, 100, 5) for y in range(-50, 51, 5)])
    terrain = Terrain(samples, np.ones(len(samples)), (-20, -50), (100, 50), kerb=0.0)
    site = Site(StaticWorld(), terrain, Grid((-20, -50), (100, 50), 0.5, bool))
    path = np.column_stack([np.arange(0.0, 60.0), np.zeros(60)])
    furnish(site, path, 4.0, SETTINGS["city"], np.random.default_rng(0))
    houses = StaticWorld([row for row in site.world.rows if np.isfinite(row[10])])
    hits = cast_static(houses, columns, np.random.default_rng(0))
    panes = (hits.distance < FAR) & (hits.reflectivity == 0)
    height = flat_points(columns, hits.distance)[panes][:, 2] - 0.4
    assert panes.sum() > 1000
    assert height.min() > 1.1 and (np.abs(height % 3.0 - 1.85) < 0.75).all()


def test_soft_shapes_return_from_inside(columns):
    world = StaticWorld()
    world.add_box(15, 0, 0, 6, 6, -1, 3, 0.5, free_path=1.0)
    distance = cast_static(world, columns, np.random.default_rng(0)).distance
    points = flat_points(columns, distance)[distance < FAR]
    assert points[:, 0].min() >= 12 - 0.01 and points[:, 0].max() <= 18 + 0.01
    assert points[:, 0].std() > 0.3


def test_beams_are_as_documented(calib):
    elevation, height = beam_table()
    assert len(elevation) == len(height) == 64
    assert (np.diff(elevation) < 0).all()
    assert np.degrees(elevation[[0, -1]]) == pytest.approx([1.8, -23.9], abs=0.1)
    rays = make_rays(calib, full=True)
    assert rays.direction.shape == (64, round(360 / SENSOR.azimuth_step_deg), 3)
    np.testing.assert_allclose(np.linalg.norm(rays.direction, axis=-1), 1, atol=1e-6)


def test_the_view_has_every_beam_that_the_camera_sees():
    numbers = set()
    for seed in range(12):
        calib = make_calibration(np.random.default_rng(seed))
        every, view = make_rays(calib, full=True), make_rays(calib)
        for distance in (2.0, 4.0, 20.0):
            points = (every.origin + distance * every.direction).reshape(-1, 3)
            seen = in_camera_view(points, calib).reshape(64, -1).any(axis=1)
            assert np.flatnonzero(seen).max() < len(view.elevation)
        numbers.add(len(view.elevation))
    assert min(numbers) >= 45 and max(numbers) <= 56 and len(numbers) > 1


def test_motion_moves_the_origin_along_the_way(calib):
    rays = make_rays(calib, full=True, velocity=(10.0, 0.0, 0.0))
    still = make_rays(calib, full=True)
    shift = rays.origin[0, :, 0] - still.origin[0, :, 0]
    # the head turns clockwise: it has passed the left side before it looks ahead
    np.testing.assert_allclose(shift, 10.0 * rays.time, atol=1e-5)
    assert shift.max() - shift.min() == pytest.approx(10.0 * SENSOR.period_s, rel=0.01)
    np.testing.assert_array_equal(rays.direction_velo, still.direction_velo)
