"""SORT's own Kalman filter (Bewley et al. 2016, section III.B), for boxes in the image.

State (u, v, s, r, du, dv, ds): centre in pixels, area, aspect ratio (constant), and velocities per
frame.
"""

import numpy as np

from tracking.kalman_box import Noise

STATE, MEASURED = 7, 4
TRANSITION = np.eye(STATE)
TRANSITION[0, 4] = TRANSITION[1, 5] = TRANSITION[2, 6] = 1.0
MEASUREMENT = np.eye(MEASURED, STATE)
RATIO_AND_AREA_NOISE = 10.0  # times the variance of the centre; SORT's published setting
AREA_VELOCITY_NOISE = 0.01  # times the process variance of the other velocities; likewise


class KalmanImage:
    """One object's image box (x1, y1, x2, y2) in pixels and its velocity."""

    def __init__(self, box: np.ndarray, noise: Noise):
        from filterpy.kalman import KalmanFilter  # slow to import; only the baselines filter

        self.kalman = KalmanFilter(dim_x=STATE, dim_z=MEASURED)
        self.kalman.F, self.kalman.H = TRANSITION, MEASUREMENT
        self.kalman.x[:MEASURED, 0] = _measure(box)
        box_std, velocity_std = [noise.initial_box] * MEASURED, [noise.initial_velocity] * 3
        self.kalman.P = np.diag(np.r_[box_std, velocity_std] ** 2)
        box_std, velocity_std = [noise.process_box] * MEASURED, [noise.process_velocity] * 3
        self.kalman.Q = np.diag(np.r_[box_std, velocity_std] ** 2)
        self.kalman.Q[-1, -1] *= AREA_VELOCITY_NOISE
        self.kalman.R = np.eye(MEASURED) * noise.measured_position**2
        self.kalman.R[2:, 2:] *= RATIO_AND_AREA_NOISE

    @property
    def box(self) -> np.ndarray:
        """(4,) the state's box, at least 1 pixel in area."""
        u, v, area, ratio = self.kalman.x[:MEASURED, 0]
        width = np.sqrt(max(area, 1.0) * max(ratio, 1e-3))
        height = max(area, 1.0) / width
        return np.array([u - width / 2, v - height / 2, u + width / 2, v + height / 2])

    def predict(self) -> None:
        """Predicts the next frame; the area does not shrink below 0."""
        if self.kalman.x[2, 0] + self.kalman.x[6, 0] <= 0:
            self.kalman.x[6, 0] = 0.0
        self.kalman.predict()

    def update(self, box: np.ndarray) -> None:
        """Updates the state with a measured box (4,)."""
        self.kalman.update(_measure(box))


def _measure(box: np.ndarray) -> np.ndarray:
    width, height = box[2] - box[0], box[3] - box[1]
    return np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, width * height, width / height])
