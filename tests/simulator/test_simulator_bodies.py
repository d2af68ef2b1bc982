"""Bodies fill their boxes, and rays end on their surfaces."""

import numpy as np
import pytest

from simulator.bodies.convex import FAR, cast_body
from simulator.bodies.kitti_types import draw_size, make_body
from simulator.bodies.parts import Part, assemble, block, side_planes
from simulator.bodies.vehicles import CLOTH
from simulator.config import SIZES

KINDS = {
    "Car": (3.9, 1.6, 1.5),
    "Van": (5.0, 1.9, 2.2),
    "Truck": (9.0, 2.5, 3.2),
    "Tram": (15.0, 2.4, 3.6),
    "Misc": (2.8, 1.4, 1.7),
    "Pedestrian": (0.7, 0.6, 1.7),
    "Person": (0.8, 0.6, 1.26),
    "Cyclist": (1.75, 0.57, 1.72),
}
GROWN = 0.1  # metres: mirrors stand out of KITTI's boxes


def hits_on(body, size, rays: int = 20000):
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(rays, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin = (rng.random((rays, 3)) - 0.5) * size - 25 * direction
    origin, direction = origin.astype(np.float32), direction.astype(np.float32)
    hits = cast_body(body, origin, direction, rng)
    met = hits.distance < FAR
    return origin[met] + direction[met] * hits.distance[met, None], hits


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_points_lie_in_the_box_and_on_the_surface(kind, seed):
    size = np.array(KINDS[kind])
    body = make_body(kind, size, (seed,))
    points, hits = hits_on(body, size)
    assert (np.abs(points) < size / 2 + GROWN).all()
    # A point on a part's surface violates none of its planes and meets one.
    outside = (points @ body.planes[..., :3].reshape(-1, 3).T).reshape(len(points), *(
        body.planes.shape[:2]
    )) - body.planes[None, ..., 3]  # fmt: skip
    depth = np.abs(outside.max(axis=2)).min(axis=1)
    assert depth.max() < 5e-3
    assert (hits.outline <= hits.distance).all()


@pytest.mark.parametrize("kind", ["Car", "Van", "Truck", "Tram"])
def test_vehicles_fill_their_boxes(kind):
    size = np.array(KINDS[kind])
    for seed in range(4):
        points, _ = hits_on(make_body(kind, size, (seed,)), size)
        reach = np.percentile(np.abs(points), 99.9, axis=0)
        assert (reach > size / 2 - 0.2).all()


def test_cars_have_bonnet_and_glass():
    size = np.array(KINDS["Car"])
    body = make_body("Car", size, (3,))
    points, hits = hits_on(body, size, 60000)
    nose = points[points[:, 0] > 0.4 * size[0]]
    assert nose[:, 2].max() < 0.2  # the bonnet is low
    assert points[:, 2].max() > 0.6
    swallowed = (hits.distance < FAR) & (hits.reflectivity == 0)
    through = (hits.outline < FAR) & (hits.distance == FAR)
    assert swallowed.sum() > 500 and through.sum() > 100


def test_minibuses_have_rear_windows_and_delivery_vans_none():
    size = np.array(KINDS["Van"])
    origin = np.tile(np.float32([-20, 0, 0.27 * size[2]]), (4000, 1))
    direction = np.tile(np.float32([1, 0, 0]), (4000, 1))
    shares = []
    for seed in range(12):
        body = make_body("Van", size, (seed,))
        hits = cast_body(body, origin, direction, np.random.default_rng(0))
        shares.append((hits.reflectivity == 0).mean())
    shares = np.array(shares)
    assert set(shares > 0) == {True, False}
    assert shares[shares > 0].min() > 0.5


def test_seats_behind_glass_have_their_own_incidence():
    lean = np.pi / 3
    pane = [[np.sin(lean), 0, np.cos(lean), 1.0], [-1, 0, 0, 3.0], [0, 0, -1, 1.5]]
    cabin = Part(np.vstack([pane, side_planes(2.0)]), 0.5, gloss=3.0, glass=(0,))
    body = assemble([cabin, Part(block((-1, 0, 0), (1, 2, 2)), CLOTH, interior=True)])
    origin = np.tile(np.float32([10, 0, 0]), (2000, 1))
    direction = np.tile(np.float32([-1, 0, 0]), (2000, 1))
    hits = cast_body(body, origin, direction, np.random.default_rng(0))
    inside = (hits.distance > hits.outline) & (hits.distance < FAR)
    assert inside.sum() > 500
    np.testing.assert_allclose(hits.distance[inside], 10.5)
    np.testing.assert_allclose(hits.cosine[inside], 1.0, rtol=1e-6)
    np.testing.assert_allclose(hits.cosine[~inside], np.sin(lean) ** 4, rtol=1e-5)


def test_a_seed_makes_one_body():
    first, again, other = (make_body("Car", KINDS["Car"], (seed,)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.planes, again.planes)
    np.testing.assert_array_equal(first.reflectivity, again.reflectivity)
    assert not np.array_equal(first.reflectivity, other.reflectivity)


@pytest.mark.parametrize("kind", ["Car", "Van", "Truck", "Pedestrian", "Cyclist"])
def test_sizes_have_the_fitted_moments(kind):
    fit = getattr(SIZES, kind.lower())
    rng = np.random.default_rng(0)
    sizes = np.array([draw_size(kind, rng) for _ in range(1500)])
    assert (sizes >= fit.low).all() and (sizes <= fit.high).all()
    # the limits [low, high] shift the mean slightly
    assert (np.abs(sizes.mean(axis=0) - fit.mean) < 0.35 * np.array(fit.std)).all()
    assert (sizes.std(axis=0) > 0.6 * np.array(fit.std)).all()
