"""Scans in another axis order, unit or mounting: an error, or a note."""

import numpy as np
import pytest

from common.errors import InputError
from common.notes import note
from kitti.calibration import standard_mounting
from kitti.camera_view import check_view, describe_image_size, spreads_sideways

SIZE = (1242, 375)


def street(count: int = 20_000) -> np.ndarray:
    """(n, 3): a road 1.73 m below the scanner, and walls and cars beside it."""
    rng = np.random.default_rng(0)
    x = rng.choice((-1, 1), count) * rng.gamma(2, 10, count)
    road = rng.random(count) < 0.6
    y = np.where(road, rng.uniform(-6, 6, count), rng.choice((-1, 1), count) * 7.0)
    z = np.where(road, rng.normal(-1.73, 0.02, count), rng.uniform(-1.7, 1.5, count))
    return np.column_stack([x, y, z])


@pytest.fixture(autouse=True)
def _no_earlier_notes():
    note.cache_clear()


def check(points: np.ndarray) -> tuple[int, int]:
    return check_view([points], standard_mounting(), SIZE)


def test_scans_without_points_are_refused():
    with pytest.raises(InputError, match="the scans have no points, so there is no return"):
        check_view([np.zeros((0, 3))] * 2, standard_mounting(), SIZE)
    check_view([np.zeros((0, 3)), street()], standard_mounting(), SIZE)


def test_a_street_is_taken_without_a_word(capsys):
    seen, total = check(street())
    assert 0.2 < seen / total < 0.6
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("order", "signs", "message"),
    [
        (
            (1, 2, 0),
            (-1, -1, 1),
            r"the points spread .* and .* m upwards: expected x ahead",
        ),
        ((2, 1, 0), (1, 1, 1), r"the points spread .* and .* m upwards"),
        ((0, 2, 1), (1, 1, 1), r"the points spread .* and .* m upwards"),
        ((0, 1, 2), (1, -1, -1), r"flat side of the scene is above the camera: expected .* z up"),
    ],
)
def test_a_scene_that_does_not_lie_is_refused(order, signs, message):
    with pytest.raises(InputError, match=message):
        check(street()[:, order] * signs)


@pytest.mark.parametrize(
    ("unit", "behind"), [(1.0, True), (1.0, False), (180 / np.pi, True)], ids=str
)
def test_polar_coordinates_are_refused(unit, behind):
    x, y, z = (street() if behind else street()[street()[:, 0] > 1]).T
    distance = np.sqrt(x * x + y * y + z * z)
    polar = np.column_stack([distance, unit * np.arctan2(y, x), unit * np.arcsin(z / distance)])
    with pytest.raises(InputError, match="the points look like range, azimuth, elevation"):
        check(polar)


def test_the_points_of_one_car_are_not_polar():
    check(np.random.default_rng(0).uniform((5, -3, -1.6), (9, 3, 0), (300, 3)))


@pytest.mark.parametrize("scale", [0.04, 10, 100])
def test_another_unit_is_refused(scale):
    with pytest.raises(InputError, match=r"a median range of .* m: expected .* metres"):
        check(street() * scale)


def test_points_at_the_origin_are_no_returns(capsys):
    assert check(np.concatenate([street(), np.zeros((90_000, 3))])) == check(street())
    assert capsys.readouterr().err == ""


def test_a_scene_turned_sideways_is_known():
    assert not spreads_sideways(street())
    assert spreads_sideways(street()[:, [1, 0, 2]])
    assert not spreads_sideways(street(900)[:, [1, 0, 2]])


def test_a_scene_in_another_unit_is_noted(capsys):
    check(street() * 3.28)
    assert "the road seems to lie 5." in capsys.readouterr().err


def test_nothing_but_points_at_the_origin_is_refused():
    with pytest.raises(InputError, match="all of 50 points lie at the origin"):
        check(np.zeros((50, 3)))


def test_few_points_or_no_scene_are_not_judged(capsys):
    rng = np.random.default_rng(0)
    check(rng.uniform((5, -5, -1), (40, 5, 1.5), (5000, 3)))
    check(rng.uniform((5, -5, -30), (10, 5, 30), (900, 3)))
    assert capsys.readouterr().err == ""


def test_other_pixels_upwards_are_another_camera():
    calib = standard_mounting()
    assert describe_image_size(calib) == (SIZE, "KITTI's camera")
    p2 = calib.p2.copy()
    p2[1, 1] /= 2
    other = type(calib)(p2, calib.r0_rect, calib.tr_velo_to_cam)
    assert describe_image_size(other) == ((1219, 346), "twice the principal point of P2")
