"""A made-up KITTI folder of two short sequences, 0000 with cars and a van, 0001 without any."""

from pathlib import Path

import numpy as np

from kitti.boxes import camera_from_level, project_boxes
from kitti.calibration import Calibration, write_calibration
from kitti.labels import write_labels
from kitti.objects import Objects
from kitti.seqmap import write_seqmap

FRAMES = {0: 12, 1: 5}
CALIB = Calibration(
    p2=np.array([[720.0, 0, 610, 45], [0, 720, 173, 0.2], [0, 0, 1, 0.003]]),
    r0_rect=np.eye(3),
    tr_velo_to_cam=np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0]]),
)


def make(root: Path) -> Path:
    """Writes calibration, labels, a seqmap and detections below `root`; returns it."""
    for name in ("calib", "label_02"):
        (root / "training" / name).mkdir(parents=True)
    (root / "detections").mkdir()
    for seq, objects in ((0, vehicles()), (1, pedestrian())):
        write_calibration(root / "training" / "calib" / f"{seq:04d}.txt", CALIB)
        write_labels(root / "training" / "label_02" / f"{seq:04d}.txt", objects)
        cars = objects.of_classes(("Car",))
        (root / "detections" / f"{seq:04d}.txt").write_text(detection_text(cars))
    write_seqmap(root, "training", FRAMES)
    return root


def vehicles() -> Objects:
    """Two cars and a van that move steadily through all frames of sequence 0000."""
    parts = []
    for track_id, (kind, y) in enumerate((("Car", -4.0), ("Car", 0.0), ("Van", 4.0))):
        frame = np.arange(FRAMES[0])
        x = 15.0 + 3 * track_id + 0.4 * frame
        rest = np.tile([y, 0.0, 4.0, 1.8, 1.5, 0.1], (len(frame), 1))
        parts.append(labels(kind, frame, track_id, np.column_stack([x, rest])))
    return Objects.concatenate(parts)


def pedestrian() -> Objects:
    """Sequence 0001: one pedestrian in one frame, no vehicle."""
    return labels("Pedestrian", np.array([2]), 0, np.array([[9, 0, 0, 0.6, 0.6, 1.7, 0.0]]))


def labels(kind: str, frame: np.ndarray, track_id: int, boxes: np.ndarray) -> Objects:
    """Fully visible label rows."""
    rows = Objects.from_boxes(frame, track_id, boxes, kind=kind, bbox=project_boxes(boxes, CALIB))
    return Objects(**{**vars(rows), "truncation": rows.frame * 0, "occlusion": rows.frame * 0})


def detection_text(objects: Objects) -> str:
    """Rows as detections in AB3DMOT's layout, score 5."""
    camera = np.stack(camera_from_level(objects.boxes), axis=1)
    lines = []
    for frame, bbox, row in zip(objects.frame, objects.bbox, camera, strict=True):
        numbers = ",".join(f"{value:.4f}" for value in [*bbox, 5.0, *row, 0.0])
        lines.append(f"{frame},2,{numbers}\n")
    return "".join(lines)
