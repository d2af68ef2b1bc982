"""Boxes, displacement and appearance from PointTrackNet's networks. Imports TensorFlow."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from evaluation.scene import Scene
from evaluation.sources import BoxSource, Detected
from kitti.boxes import points_in_boxes
from models.inference import FrameState, StreamingNetwork
from models.weights import load_networks


class NetworkBoxes:
    """The detector's boxes, or another source's boxes with what the networks say about them.

    Each frame passes the detector once; a missing scan gives no boxes and no displacement.

    Args:
        network: detector and tracker.
        boxes: where the boxes come from instead of the detector (ground truth), if given.
    """

    def __init__(self, network: StreamingNetwork, boxes: BoxSource | None = None):
        self.network, self.boxes = network, boxes

    @classmethod
    def load(cls, weights: str | Path, boxes: BoxSource | None = None) -> NetworkBoxes:
        """With the networks in a folder of weights.

        Raises:
            InputError: weights are missing, broken or do not belong together.
        """
        return cls(StreamingNetwork(*load_networks(weights)), boxes)

    def frames(self, scene: Scene) -> Iterator[Detected]:
        """See `BoxSource.frames`."""
        given = None if self.boxes is None else self.boxes.frames(scene)
        previous = None
        for t in range(scene.num_frames):
            points = scene.points(t)
            state = self.network.detect(np.zeros((0, 3)) if points is None else points, t)
            if given is None:
                names = np.array(self.network.detector.config.box.classes)
                found = state.detections
                boxes, scores = found.boxes.astype(np.float64), found.scores.astype(np.float64)
                extras = {"types": names[found.classes]}
            else:
                _, boxes, scores, extras = next(given)
            extras = {**extras, "appearance": pooled_appearance(state, boxes)}
            if previous is not None:
                extras["points"], extras["foreground"] = previous.points, previous.foreground
                extras["displacement"] = self.network.displacement(previous, state)
            yield t, boxes, scores, extras
            previous = state


def pooled_appearance(state: FrameState, boxes: np.ndarray) -> np.ndarray:
    """The mean feature of the kept points in each box, L2-normalised; 0 where there are none.

    state: of the frame; boxes: (M, 7) level frame -> (M, C) float32.
    """
    features = np.zeros((len(boxes), state.features.shape[1]), np.float32)
    owner = points_in_boxes(state.points, boxes) if len(boxes) else np.zeros(0, int)
    for i in range(len(boxes)):
        inside = owner == i
        if inside.any():
            features[i] = state.features[inside].mean(0)
    return features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-9)
