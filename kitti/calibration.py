"""Calibration of one sequence: Velodyne -> camera 0 -> level frame, and into the left image."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import write_text
from common.notes import note
from kitti.calibration_text import read_keys, read_matrix

LEVEL_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from x right, y down, z forward to x forward, y left, z up."""

# Names in the tracking benchmark and in the raw data -> names in the object benchmark.
_ALIASES = {
    **{f"P_rect_0{i}": f"P{i}" for i in range(4)},
    "R_rect": "R0_rect",
    "R_rect_00": "R0_rect",
    "Tr_velo_cam": "Tr_velo_to_cam",
    "Tr_imu_velo": "Tr_imu_to_velo",
}
_WRITTEN = ("P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo")
_WAYMO = "Tr_velo_to_cam_0"
_SHAPES = dict.fromkeys((*_WRITTEN, "Tr", _WAYMO), (3, 4)) | {
    **{"R0_rect": (3, 3), "S_rect_02": (2, 1)},
    **{"R": (3, 3), "T": (3, 1)},
}
_REQUIRED = ("P2", "R0_rect", "Tr_velo_to_cam")
SENSOR_HEIGHT = 1.73
"""Metres of KITTI's Velodyne above the ground."""
MAX_PIXELS = 20_000
"""Of a side of an image: more than any camera has."""
_MAX_NUMBER = 1e6  # metres, pixels
_FOCAL_LENGTHS = (10.0, 20_000.0)  # pixels
_BY_LOWER_CASE = {name.lower(): name for name in (*_SHAPES, *_ALIASES)}
_SHOWN = 12  # keys in a message
_RAW = "the raw data has two files: cat calib_cam_to_cam.txt calib_velo_to_cam.txt > calib.txt"
_MAX_OFFSET = 20.0  # metres between sensors of a car
_ROTATION_TOLERANCE = 1e-2  # KITTI's own matrices are orthonormal to about 1e-7


@dataclass(frozen=True, eq=False)
class Calibration:
    """The matrices of one `calib/00XX.txt`, all float64, lengths in metres, P in pixels.

    Attributes:
        p2: (3, 4) projection of rectified camera 0 into the left colour image.
        r0_rect: (3, 3) rectifying rotation of camera 0.
        tr_velo_to_cam: (3, 4) Velodyne -> (unrectified) camera 0.
        tr_imu_to_velo: (3, 4) GPS/IMU -> Velodyne, or None where the file has none.
        p0, p1, p3: (3, 4) projections into the other images, or None.
        size: width and height of the left colour image in pixels, or None.
    """

    p2: np.ndarray
    r0_rect: np.ndarray
    tr_velo_to_cam: np.ndarray
    tr_imu_to_velo: np.ndarray | None = None
    p0: np.ndarray | None = None
    p1: np.ndarray | None = None
    p3: np.ndarray | None = None
    size: tuple[int, int] | None = None

    @cached_property
    def level_from_velo(self) -> np.ndarray:
        """(4, 4) float64: level frame <- Velodyne frame."""
        transform = np.eye(4)
        transform[:3] = LEVEL_FROM_CAMERA @ self.r0_rect @ self.tr_velo_to_cam
        return transform

    @cached_property
    def image_from_level(self) -> np.ndarray:
        """(3, 4) float64: homogeneous pixels of the left colour image <- level frame."""
        camera_from_level = np.eye(4)
        camera_from_level[:3, :3] = LEVEL_FROM_CAMERA.T
        return self.p2 @ camera_from_level

    def velo_to_level(self, xyz: np.ndarray) -> np.ndarray:
        """(n, 3) points of the Velodyne frame -> (n, 3) float64 in the level frame."""
        return _apply(self.level_from_velo, xyz)

    def level_to_velo(self, xyz: np.ndarray) -> np.ndarray:
        """(n, 3) points of the level frame -> (n, 3) float64 in the Velodyne frame."""
        return _apply(np.linalg.inv(self.level_from_velo), xyz)

    def project_level(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) level points -> uv (n, 2) pixels of the left colour image, depth (n,) metres.

        Depth is measured from that camera; where it is 0 or less, uv is undefined.
        """
        homogeneous = _apply(self.image_from_level, xyz)
        depth = homogeneous[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            return homogeneous[:, :2] / depth[:, None], depth


def _apply(matrix: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    return np.asarray(xyz, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def is_rotation(matrices: np.ndarray) -> np.ndarray:
    """True where (..., 3, 3) matrices are rotations, up to the rounding of a text file."""
    matrices = np.asarray(matrices, np.float64)
    bounded = np.clip(matrices, -2.0, 2.0)  # no larger number is in a rotation, or overflows here
    product = bounded @ np.swapaxes(bounded, -1, -2)
    orthonormal = np.abs(product - np.eye(3)).max(axis=(-1, -2)) <= _ROTATION_TOLERANCE
    return orthonormal & (np.linalg.det(bounded) > 0)


def read_calibration(path: str | Path) -> Calibration:
    """Reads a calibration of the tracking or the object benchmark, or of odometry.

    Keys may be in any case and in any of KITTI's spellings; other keys are ignored. P0, P1, P3,
    Tr_imu_to_velo and S_rect_02 are optional. Odometry's `Tr` (Velodyne -> rectified camera 0)
    replaces R0_rect and Tr_velo_to_cam, the raw data's `R` and `T` replace Tr_velo_to_cam, Waymo's
    P0 and Tr_velo_to_cam_0 replace P2 and Tr_velo_to_cam.

    Raises:
        InputError: a key is missing or repeated, has a wrong number of values, a value is not a
            finite number, or a rotation matrix is invalid.
    """
    found: dict[str, np.ndarray] = {}
    others: list[str] = []
    for number, key, words in read_keys(path):
        name = _BY_LOWER_CASE.get(key.lower(), key)
        name = _ALIASES.get(name, name)
        if name not in _SHAPES:
            others.append(key)
            continue
        if name in found:
            raise InputError(f"{name} is there twice, expected once", path, number)
        found[name] = _matrix(name, words, path, number)
    seen = [*found, *others]
    if not found.get("Tr_imu_to_velo", np.ones(1)).any():
        del found["Tr_imu_to_velo"]  # zeros of a converter that has none
    rotation, offset = found.pop("R", None), found.pop("T", None)
    if rotation is not None and offset is not None:
        found.setdefault("Tr_velo_to_cam", np.hstack([rotation, offset]))
    front = found.pop(_WAYMO, None)
    if front is not None and "P0" in found and "Tr_velo_to_cam" not in found:
        note(f"{path}: the camera is number 0 (P0, {_WAYMO}), which looks ahead in Waymo's data")
        _check_projection("P0", found["P0"], path)
        found |= {"P2": found["P0"], "Tr_velo_to_cam": front}
    size, to_rectified = found.pop("S_rect_02", None), found.pop("Tr", None)
    if to_rectified is not None and "Tr_velo_to_cam" not in found:
        found |= {"R0_rect": np.eye(3), "Tr_velo_to_cam": to_rectified}
    missing = [name for name in _REQUIRED if name not in found]
    if missing:
        expected = f"expected {', '.join(_REQUIRED)} (or P2 and Tr)"
        names = ", ".join(key[:40] for key in seen[:_SHOWN]) + ", ..." * (len(seen) > _SHOWN)
        hint = f"; {_RAW}" if "calib_time" in seen else ""
        raise InputError(
            f"missing key {missing[0]}, {expected}, found {names or 'none'}{hint}", path
        )
    return Calibration(
        **{name.lower(): matrix for name, matrix in found.items()},
        size=None if size is None else (round(float(size[0, 0])), round(float(size[1, 0]))),
    )


def _matrix(name: str, words: list[str], path: str | Path, line: int) -> np.ndarray:
    matrix = read_matrix(name, words, _SHAPES[name], path, line)
    if np.abs(matrix).max() > _MAX_NUMBER:
        raise InputError(
            f"{name}: expected numbers of magnitude {_MAX_NUMBER:.0e} at most", path, line
        )
    if name == "S_rect_02":
        if not 1 <= matrix.min() <= matrix.max() <= MAX_PIXELS:
            expected = f"expected width and height of 1 to {MAX_PIXELS} pixels"
            raise InputError(f"{name}: {expected}", path, line)
        return matrix
    if name.startswith("P"):  # other projections are not used; converters write zeros
        if name == "P2":
            _check_projection(name, matrix, path, line)
        return matrix
    if name == "Tr_imu_to_velo" and not matrix.any():
        return matrix
    if name != "T" and not is_rotation(matrix[:, :3]):
        raise InputError(f"{name}: its left 3x3 block is not a rotation", path, line)
    offset = (matrix if name == "T" else matrix[:, 3:]).ravel()
    if np.abs(offset).max(initial=0.0) > _MAX_OFFSET:
        expected = f"expected an offset of at most {_MAX_OFFSET:.0f} metres"
        raise InputError(f"{name}: {expected}, found {offset}", path, line)
    return matrix


def _check_projection(
    name: str, matrix: np.ndarray, path: str | Path, line: int | None = None
) -> None:
    fault = _fault_of_projection(matrix)
    if fault:
        raise InputError(f"{name}: {fault}", path, line)


def _fault_of_projection(matrix: np.ndarray) -> str:
    """The fault of a (3, 4) projection, expected f 0 cx tx, 0 f cy ty, 0 0 1 tz; "" without one."""
    focal = matrix[[0, 1], [0, 1]]
    if not _FOCAL_LENGTHS[0] <= focal.min() <= focal.max() <= _FOCAL_LENGTHS[1]:
        low, high = _FOCAL_LENGTHS
        return f"expected focal lengths of {low:.0f} to {high:.0f} pixels, found {focal}"
    rows = matrix[:, :3] / [[focal[0]], [focal[1]], [1.0]]
    if np.abs(rows[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] - (0, 0, 0, 0, 1)).max() > _ROTATION_TOLERANCE:
        return "expected rows f 0 cx tx, 0 f cy ty, 0 0 1 tz of a rectified camera"
    if np.abs(matrix[:2, 3] / focal).max() > _MAX_OFFSET:
        return f"expected an offset of at most {_MAX_OFFSET:.0f} metres"
    return ""


def write_calibration(path: str | Path, calib: Calibration) -> None:
    """Writes `calib` in KITTI's layout (keys with colon); absent matrices are omitted."""
    lines = []
    for name in _WRITTEN:
        matrix = getattr(calib, name.lower())
        if matrix is not None:
            lines.append(f"{name}: " + " ".join(f"{value:.12e}" for value in np.ravel(matrix)))
    if calib.size is not None:
        lines.append("S_rect_02: " + " ".join(f"{side:.6e}" for side in calib.size))
    write_text(path, "\n".join(lines) + "\n")


def standard_mounting(sensor_height: float = SENSOR_HEIGHT) -> Calibration:
    """A calibration for scans without one: KITTI's car, mounted without any rotation.

    The Velodyne upright, x ahead, `sensor_height` metres above the ground; the camera 0.27 m in
    front of it and, as on KITTI's car, 1.65 m above the ground.

    Lever arm: Geiger et al., IJRR 2013, figure 3. Lens of the left colour camera: the nominal
    values of KITTI's first recording day (1242 x 375 pixels); they only set which part of
    the scan is used.
    """
    above = sensor_height - SENSOR_HEIGHT + 0.076  # of the camera
    lever_arm = np.array([[-0.004], [-above], [-0.272]])  # metres, camera frame
    return Calibration(
        p2=np.array(
            [[721.5377, 0, 609.5593, 44.86], [0, 721.5377, 172.854, 0.2164], [0, 0, 1, 0.003]]
        ),
        r0_rect=np.eye(3),
        tr_velo_to_cam=np.hstack([LEVEL_FROM_CAMERA.T, lever_arm]),
    )
