"""Tracks a scene and converts the tracks to rows of a result file."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from evaluation.detections import DetectionProvider
from evaluation.scene import Scene
from kitti.boxes import project_boxes
from kitti.calibration import Calibration
from kitti.objects import Objects
from tracking import FrameContext, LabelMotion, MultiObjectTracker, Tracks, track_frame

NEVER_SEEN = 0.0  # 2-D box of a track that was never in the image; -1 would switch 2-D metrics off


def track_scene(
    scene: Scene,
    provider: DetectionProvider,
    tracker: MultiObjectTracker,
    classes: Sequence[str],
    each_frame: Callable[[], None] = lambda: None,
) -> Objects:
    """Tracks of one scene, a row per reported box.

    Args:
        scene: the sequence.
        provider: its detections.
        tracker: a new one.
        classes: of the labels that give the motion for the upper bound of Algorithm 1.
        each_frame: called after each frame (a progress bar).
    """
    labels = scene.objects.of_classes(classes)
    frames = []
    for detections in provider.frames(scene):
        context = SceneFrame(scene, labels, detections.t)
        frames.append((detections.t, track_frame(tracker, detections, context)))
        each_frame()
    return result_rows(frames, scene.sequence.calib, scene.sequence.image_size)


class SceneFrame(FrameContext):
    """Frame t of a scene: motion of sensor and labels, and image boxes, made on access."""

    def __init__(self, scene: Scene, labels: Objects, t: int):
        self.scene, self.labels, self.t = scene, labels, t

    @property
    def ego_motion(self) -> np.ndarray | None:
        """See `FrameContext`."""
        motions = self.scene.ego_motions
        return None if motions is None else motions[self.t]

    @cached_property
    def label_motion(self) -> LabelMotion:
        """See `FrameContext`."""
        before, now = self.labels.at(self.t - 1), self.labels.at(self.t)
        return LabelMotion(before.boxes, before.track_id, now.boxes, now.track_id)

    def image_boxes(self, boxes: np.ndarray) -> np.ndarray:
        """See `FrameContext`."""
        return project_boxes(boxes, self.scene.sequence.calib, self.scene.sequence.image_size)


def result_rows(
    frames: Sequence[tuple[int, Tracks]], calib: Calibration, image_size: tuple[int, int]
) -> Objects:
    """Rows of (frame number, tracks) in order; 2-D boxes projected with P2 and clipped."""
    rows = Objects.concatenate(
        Objects.from_boxes(t, tracks.ids, tracks.boxes, tracks.scores, kind=tracks.types)
        for t, tracks in frames
    )
    bbox = keep_last_seen(rows.track_id, project_boxes(rows.boxes, calib, image_size))
    return replace(rows, bbox=bbox)


def keep_last_seen(ids: np.ndarray, bbox: np.ndarray) -> np.ndarray:
    """2-D boxes (R, 4) without NaN: a track outside the image keeps its last box inside.

    It therefore still counts as a false alarm; an empty box would be ignored. Rows are in the order
    of frames; `ids` is (R,).
    """
    filled, last = bbox.copy(), {}
    seen = ~np.isnan(bbox).any(axis=1)
    for row, track_id in enumerate(ids.tolist()):
        if seen[row]:
            last[track_id] = row
        else:
            filled[row] = bbox[last[track_id]] if track_id in last else NEVER_SEEN
    return filled
