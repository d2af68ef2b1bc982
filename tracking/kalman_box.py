"""10-state Kalman filter of a box (AB3DMOT, section III.B), shared by the three baselines.

State (x, y, z, l, w, h, yaw, vx, vy, vz): a box of the level frame and the velocity of its centre
in metres per frame; the state moves with constant velocity, and the measurement is the box.
"""

import math
from dataclasses import dataclass

import numpy as np

STATE, BOX, YAW = 10, 7, 6
POSITION, VELOCITY = slice(0, 3), slice(7, 10)

TRANSITION = np.eye(STATE)
TRANSITION[POSITION, VELOCITY] = np.eye(3)
MEASUREMENT = np.eye(BOX, STATE)


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the filter: metres, radians, metres per frame.

    The defaults are SORT's published setting, which AB3DMOT took over for its 3-D boxes (both:
    initial covariance 10 for the measured part and 10000 for the velocity, process noise 1 and
    0.01, measurement noise 1; here as square roots).
    """

    initial_box: float = 10.0**0.5
    initial_velocity: float = 100.0
    process_box: float = 1.0
    process_velocity: float = 0.1
    measured_position: float = 1.0
    measured_size: float = 1.0
    measured_yaw: float = 1.0

    def initial(self) -> np.ndarray:
        """Covariance (10, 10) of a new track."""
        return np.diag(np.r_[[self.initial_box] * BOX, [self.initial_velocity] * 3] ** 2)

    def process(self) -> np.ndarray:
        """Covariance (10, 10) added in each frame."""
        return np.diag(np.r_[[self.process_box] * BOX, [self.process_velocity] * 3] ** 2)

    def measurement(self) -> np.ndarray:
        """Covariance (7, 7) of a detected box."""
        position, size = [self.measured_position] * 3, [self.measured_size] * 3
        return np.diag(np.r_[position, size, self.measured_yaw] ** 2)


def _wrap(angle: float) -> float:
    """One angle in [-pi, pi); on single numbers ten times faster than `kitti.boxes.wrap_angle`."""
    return (float(angle) + math.pi) % (2 * math.pi) - math.pi


def correct_orientation(yaw: float, measured: float) -> tuple[float, float]:
    """Orientation correction (AB3DMOT, section III.D).

    Detectors often confuse the front and the back of a car: if the two headings differ by more than
    90 degrees, the track's is rotated by 180 degrees. Returns the track's yaw in [-pi, pi) and the
    measured yaw, unwrapped to within 90 degrees of it.
    """
    if abs(_wrap(measured - yaw)) > np.pi / 2:
        yaw += np.pi
    yaw = _wrap(yaw)
    return yaw, yaw + _wrap(measured - yaw)


class KalmanBox:
    """Box and velocity of one object, filtered by filterpy."""

    def __init__(self, box: np.ndarray, noise: Noise):
        from filterpy.kalman import KalmanFilter  # slow to import; only the baselines filter

        self.kalman = KalmanFilter(dim_x=STATE, dim_z=BOX)
        self.kalman.F, self.kalman.H = TRANSITION, MEASUREMENT
        self.kalman.x[:BOX, 0] = box
        self.kalman.P, self.kalman.Q = noise.initial(), noise.process()
        self.kalman.R = noise.measurement()

    @property
    def box(self) -> np.ndarray:
        """(7,) the state's box, yaw in [-pi, pi), sizes never below 1 cm."""
        box = self.kalman.x[:BOX, 0].copy()
        box[3:6] = np.maximum(box[3:6], 0.01)
        box[YAW] = _wrap(box[YAW])
        return box

    def predict(self) -> None:
        """Predicts the next frame, with constant velocity."""
        self.kalman.predict()

    def update(self, box: np.ndarray) -> None:
        """Updates the state with a measured box (7,)."""
        measured = np.array(box, np.float64)
        yaw, measured[YAW] = correct_orientation(self.kalman.x[YAW, 0], measured[YAW])
        self.kalman.x[YAW, 0] = yaw
        self.kalman.update(measured)
        self.kalman.x[YAW, 0] = _wrap(self.kalman.x[YAW, 0])

    def move_frame(self, motion: np.ndarray) -> None:
        """Expresses the state in another level frame; `motion` (4, 4) takes the old to the new."""
        rotation = motion[:3, :3]
        turn = np.eye(STATE)
        turn[POSITION, POSITION] = turn[VELOCITY, VELOCITY] = rotation
        self.kalman.x = turn @ self.kalman.x
        self.kalman.x[POSITION, 0] += motion[:3, 3]
        self.kalman.x[YAW, 0] = _wrap(
            self.kalman.x[YAW, 0] + np.arctan2(rotation[1, 0], rotation[0, 0])
        )
        self.kalman.P = turn @ self.kalman.P @ turn.T

    def squared_mahalanobis(self, boxes: np.ndarray) -> np.ndarray:
        """Squared Mahalanobis distances (M,) of box centres from the prediction."""
        covariance = self.kalman.P[POSITION, POSITION] + self.kalman.R[POSITION, POSITION]
        offset = boxes[:, :3] - self.kalman.x[POSITION, 0]
        return np.einsum("mi,mi->m", offset, np.linalg.solve(covariance, offset.T).T)
