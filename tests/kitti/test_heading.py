"""The axis along which a car drives, from what stands beside its way."""

import numpy as np
import pytest
from helpers.street import TURNS, as_seen, drive

from kitti.scans.heading import axis_ahead, find_motion


@pytest.mark.parametrize("speed", [1.0, 3.4])
@pytest.mark.parametrize("ahead", TURNS)
def test_the_axis_ahead(ahead, speed):
    pairs = [(as_seen(drive(t), ahead), as_seen(drive(t + speed), ahead)) for t in (0.0, 5.0)]
    assert axis_ahead(pairs) == ahead


def test_the_distance_is_that_of_the_drive():
    motion = find_motion(drive(0.0), drive(1.4))
    assert motion.dx == pytest.approx(1.4, abs=0.2) and motion.along_x > motion.along_y


def test_what_does_not_tell_says_nothing():
    rng = np.random.default_rng(1)
    clouds = [rng.uniform((5, -25, -1.7), (25, 25, 1), (1200, 3)) for _ in range(2)]
    still = (drive(0.0), drive(0.0))
    few = (drive(0.0)[:900], drive(1.0)[:900])
    assert axis_ahead([]) is axis_ahead([still]) is axis_ahead([few]) is None
    assert axis_ahead([clouds]) is None
