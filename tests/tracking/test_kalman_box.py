"""The Kalman filter against numbers worked out by hand, and the orientation correction."""

import numpy as np
import pytest

from kitti.boxes import wrap_angle
from tracking.kalman_box import KalmanBox, Noise, correct_orientation

BOX = np.array([10.0, 2.0, -1.0, 4.0, 1.8, 1.5, 0.3])


def test_first_prediction_and_update_in_closed_form():
    noise = Noise(
        initial_box=2.0,
        initial_velocity=3.0,
        process_box=0.5,
        process_velocity=0.25,
        measured_position=1.5,
        measured_size=0.7,
    )
    kalman_box = KalmanBox(BOX, noise)
    kalman_box.predict()
    # one coordinate p with its velocity v: P = [[2^2 + 3^2 + 0.5^2, 3^2], [3^2, 3^2 + 0.25^2]]
    p_pp, p_pv, p_vv = 4 + 9 + 0.25, 9.0, 9 + 0.0625
    covariance = kalman_box.kalman.P
    assert covariance[0, 0] == pytest.approx(p_pp)
    assert covariance[0, 7] == pytest.approx(p_pv)
    assert covariance[7, 7] == pytest.approx(p_vv)
    measured = BOX.copy()
    measured[0] += 1.0
    measured[3] += 0.2
    kalman_box.update(measured)
    # gain = P H' / (P_pp + R), residual 1
    innovation = p_pp + 1.5**2
    assert kalman_box.box[0] == pytest.approx(10.0 + p_pp / innovation)
    assert kalman_box.kalman.x[7, 0] == pytest.approx(p_pv / innovation)
    assert kalman_box.kalman.P[0, 0] == pytest.approx(p_pp * (1 - p_pp / innovation))
    assert kalman_box.kalman.P[7, 7] == pytest.approx(p_vv - p_pv**2 / innovation)
    # sizes have no velocity: P = 2^2 + 0.5^2, R = 0.7^2
    assert kalman_box.box[3] == pytest.approx(4.0 + 0.2 * 4.25 / (4.25 + 0.49))


def test_constant_velocity_is_learnt():
    kalman_box = KalmanBox(BOX, Noise())
    velocity = np.array([1.2, -0.3, 0.05])
    for step in range(1, 40):
        kalman_box.predict()
        kalman_box.update(np.r_[BOX[:3] + step * velocity, BOX[3:]])
    assert kalman_box.kalman.x[7:, 0] == pytest.approx(velocity, abs=1e-3)
    kalman_box.predict()
    assert kalman_box.box[:3] == pytest.approx(BOX[:3] + 40 * velocity, abs=1e-2)


@pytest.mark.parametrize(
    ("yaw", "measured", "corrected"),
    [
        (0.1, 0.3, 0.1),  # 0.2 apart: nothing to correct
        (0.1, 0.3 + np.pi, 0.1 - np.pi),  # back and front confused: the track turns round
        (3.1, -3.1, 3.1),  # 0.083 apart across the cut at pi: nothing to correct
        (-3.1, 0.0, np.pi - 3.1),  # 3.1 apart: turned, 0.0416 apart
    ],
)
def test_orientation_correction(yaw, measured, corrected):
    turned, unwrapped = correct_orientation(yaw, measured)
    assert turned == pytest.approx(corrected)
    assert abs(unwrapped - turned) <= np.pi / 2
    assert wrap_angle(unwrapped - measured) == pytest.approx(0.0, abs=1e-12)


def test_flipped_detection_turns_the_state_instead_of_averaging():
    kalman_box = KalmanBox(BOX, Noise())
    for _ in range(3):
        kalman_box.predict()
        kalman_box.update(np.r_[BOX[:6], wrap_angle(BOX[6] + np.pi)])
    assert kalman_box.box[6] == pytest.approx(wrap_angle(0.3 + np.pi))


def test_yaw_is_filtered_across_the_cut():
    kalman_box = KalmanBox(np.r_[BOX[:6], np.pi - 0.02], Noise())
    kalman_box.predict()
    kalman_box.update(np.r_[BOX[:6], -np.pi + 0.02])
    assert abs(kalman_box.box[6]) > np.pi - 0.021


def test_move_frame_rotates_position_velocity_and_yaw():
    kalman_box = KalmanBox(BOX, Noise())
    kalman_box.kalman.x[7:, 0] = [1.0, 0.0, 0.0]
    kalman_box.kalman.P[0, 0] = 7.0
    quarter = np.eye(4)
    quarter[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    quarter[:3, 3] = [5.0, 6.0, 7.0]
    kalman_box.move_frame(quarter)
    # (10, 2, -1) turned by 90 degrees is (-2, 10, -1), then shifted
    assert kalman_box.box[:3] == pytest.approx([3.0, 16.0, 6.0])
    assert kalman_box.kalman.x[7:, 0] == pytest.approx([0.0, 1.0, 0.0])
    assert kalman_box.box[6] == pytest.approx(0.3 + np.pi / 2)
    assert kalman_box.kalman.P[1, 1] == pytest.approx(7.0)


def test_squared_mahalanobis_distance_of_the_centre():
    noise = Noise(initial_box=2.0, measured_position=1.5)
    kalman_box = KalmanBox(BOX, noise)
    others = np.array([BOX, BOX + np.array([3.0, 4.0, 0, 0, 0, 0, 0])])
    # covariance (2^2 + 1.5^2) I, distance 5: 25 / 6.25 = 4
    assert kalman_box.squared_mahalanobis(others) == pytest.approx([0.0, 4.0])
    assert kalman_box.squared_mahalanobis(others[:0]).shape == (0,)
