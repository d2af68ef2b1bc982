"""A few frames in KITTI's layout: ground, and two cars seen as points on their sides."""

from pathlib import Path

import numpy as np

from kitti.calibration import Calibration, write_calibration
from kitti.labels import write_labels
from kitti.objects import Objects
from kitti.scans.scan_files import write_scan

CALIB = Calibration(
    p2=np.array([[720.0, 0, 610, 0], [0, 720.0, 173, 0], [0, 0, 1, 0]]),
    r0_rect=np.eye(3),
    tr_velo_to_cam=np.array([[0, -1.0, 0, 0], [0, 0, -1.0, 0], [1.0, 0, 0, 0]]),
)
SIZE = np.array([3.9, 1.6, 1.5])
GROUND = -1.7


def boxes_at(t: int) -> np.ndarray:
    """(2, 7) level boxes in frame t: one drives on by 0.8 m a frame, one is parked."""
    height = GROUND + SIZE[2] / 2
    return np.array(
        [[12 + 0.8 * t, 3, height, *SIZE, 0.1], [18, -4, height, *SIZE, 1.5]], np.float64
    )


def side_points(box: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) points on the upper sides of a box."""
    unit = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 2, count)
    unit[np.arange(count), axis] = np.sign(unit[np.arange(count), axis]) * 0.49
    local = unit * box[3:6]
    local[:, 2] = np.abs(local[:, 2]) * 0.98
    c, s = np.cos(box[6]), np.sin(box[6])
    turned = [c * local[:, 0] - s * local[:, 1], s * local[:, 0] + c * local[:, 1], local[:, 2]]
    return np.stack(turned, -1) + box[:3]


def write_sequence(root: Path, seq: int = 0, frames: int = 4, missing: tuple[int, ...] = ()):
    """Writes sequence `seq` under root/training; returns root."""
    rng = np.random.default_rng(seq)
    name, folder, rows = f"{seq:04d}", root / "training", []
    for sub in ("velodyne/" + name, "label_02", "calib"):
        (folder / sub).mkdir(parents=True, exist_ok=True)
    for t in range(frames):
        ground = np.stack(
            [rng.uniform(6, 30, 300), rng.uniform(-10, 10, 300), np.full(300, GROUND)], -1
        )
        boxes = boxes_at(t)
        points = np.concatenate([ground, *(side_points(box, 80, rng) for box in boxes)])
        rows.append(Objects.from_boxes(t, np.arange(2), boxes))
        if t not in missing:
            scan = np.concatenate([CALIB.level_to_velo(points), np.zeros((len(points), 1))], -1)
            write_scan(folder / "velodyne" / name / f"{t:06d}.bin", scan.astype(np.float32))
    write_labels(folder / "label_02" / f"{name}.txt", Objects.concatenate(rows))
    write_calibration(folder / "calib" / f"{name}.txt", CALIB)
    return root
