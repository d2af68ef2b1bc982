"""Runs a tracker over a scene and puts its tracks into rows of a result file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from evaluation.scene import Scene
from evaluation.sources import BoxSource, motion_of
from kitti.boxes import project_boxes
from kitti.labels import Objects
from tracking import (
    TrueDisplacement,
    assign_label_ids,
    geometric_appearance,
    make_tracker,
)

NEVER_SEEN = 0.0  # 2-D box of a track that was never in the image; -1 would switch 2-D figures off


def track_scene(
    scene: Scene,
    source: BoxSource,
    tracker_name: str,
    classes: tuple[str, ...],
    each_frame: Callable[[], None] = lambda: None,
) -> Objects:
    """Tracks of one scene, a row per reported box, 2-D boxes projected with P2 and clipped.

    Args:
        scene: what is tracked.
        source: its boxes.
        tracker_name: of `tracking.make_tracker`; a new tracker with ids from 0.
        classes: of the labels that tell the true displacement.
        each_frame: called after each frame (a progress bar).
    """
    tracker = make_tracker(tracker_name)
    cues = Cues(tracker_name, scene, classes)
    parts: list[tuple[np.ndarray, ...]] = []
    type_of: dict[int, str] = {}
    for t, boxes, scores, extras in source.frames(scene):
        tracker.predict()
        tracks = tracker.update(boxes, scores, frame=t, **cues.at(t, boxes, extras))
        for track_id, row in zip(tracks.ids.tolist(), tracks.detections.tolist(), strict=True):
            if row >= 0:
                type_of[track_id] = str(extras["types"][row])
        types = np.array([type_of[track_id] for track_id in tracks.ids.tolist()], "<U16")
        parts.append((np.full(len(tracks), t), tracks.ids, tracks.boxes, tracks.scores, types))
        each_frame()
    return _rows(scene, parts)


def _rows(scene: Scene, parts: list[tuple[np.ndarray, ...]]) -> Objects:
    if not sum(len(part[0]) for part in parts):
        return Objects.empty()
    frame, ids, boxes, scores, types = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    bbox = project_boxes(boxes, scene.sequence.calib, scene.sequence.image_size)
    bbox = keep_last_seen(ids, bbox)
    return Objects.from_boxes(frame, ids, boxes, scores, kind=types, bbox=bbox)


def keep_last_seen(ids: np.ndarray, bbox: np.ndarray) -> np.ndarray:
    """2-D boxes (R, 4) without NaN: a track outside the image keeps the box it had last.

    So it stays the false alarm that it is (an empty box would be ignored), as where a tracker
    passes on its detections' 2-D boxes. Rows are in the order of frames; `ids` is (R,).
    """
    filled, last = bbox.copy(), {}
    seen = ~np.isnan(bbox).any(axis=1)
    for row, track_id in enumerate(ids.tolist()):
        if seen[row]:
            last[track_id] = row
        else:
            filled[row] = bbox[last[track_id]] if track_id in last else NEVER_SEEN
    return filled


class Cues:
    """What a tracker is told besides boxes and scores: each tracker its own.

    `gt_displacement` gets the labels' true motion, `deep_sort` an appearance vector where the
    source or a scan gives one, `ab3dmot` the sensor's motion where poses exist, `pointtracknet`
    the network's points and displacements.
    """

    def __init__(self, tracker_name: str, scene: Scene, classes: tuple[str, ...]):
        self.scene = scene
        makers = {
            "gt_displacement": self._true_motion,
            "deep_sort": self._appearance,
            "ab3dmot": self._ego_motion,
            "pointtracknet": self._predicted_motion,
        }
        self._make = makers.get(tracker_name, lambda *_: {})
        self._labels = scene.objects.of_classes(classes)
        self._before = Objects.empty()

    def at(self, t: int, boxes: np.ndarray, extras: dict[str, Any]) -> dict[str, Any]:
        """Keyword arguments for `Tracker.update` in frame t; frames come in order."""
        return self._make(t, boxes, extras)

    def _true_motion(self, t, boxes, extras):
        now, before = self._labels.at(t), self._before
        self._before = now
        ids = extras.get("label_ids")
        return {
            "box_displacement": TrueDisplacement(
                before.boxes, before.track_id, now.boxes, now.track_id
            ),
            "ids": assign_label_ids(boxes, now.boxes, now.track_id) if ids is None else ids,
        }

    def _appearance(self, t, boxes, extras):
        if "appearance" in extras:
            return {"appearance": extras["appearance"]}
        points = self.scene.points(t)
        return {} if points is None else {"appearance": geometric_appearance(points, boxes)}

    def _ego_motion(self, t, _boxes, _extras):
        motions = self.scene.ego_motions
        return {} if motions is None else {"ego_motion": motions[t]}

    def _predicted_motion(self, _t, _boxes, extras):
        return motion_of(extras)
