"""Both networks on a stream of scans: each frame passes the detector once (section III)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import tensorflow as tf

from kitti.boxes import points_in_boxes
from kitti.scans.point_arrays import sample_points
from models.boxes.box_decoding import (
    Clusters,
    Detections,
    Proposals,
    best_first,
    cluster,
    propose,
)
from models.boxes.box_score import BoxScorer
from models.boxes.cluster_features import cluster_features
from models.config import DecodingConfig, DetectorConfig
from models.detector import Detector, DetectorInputs, DetectorOutputs, detector_inputs
from models.layers import fold_batch_norm
from models.probability_filter import foreground_probability
from models.tracker import EncodedFrame, TrackerInputs, TrackingNetwork

ALL_POINTS = 4 / 3
"""Times N: the most points of a scan that inference takes; a scan of KITTI has 16000 to 20500."""
SEED = 0  # of the sampling of points, with the number of the frame
COMPILED = {"jit_compile": False, "autograph": False}
"""Of `tf.function`: the control flow is Python's alone, and AutoGraph would slow the first call."""


@dataclass(frozen=True, eq=False)
class FrameState:
    """Outputs of the networks for one frame, for the association with the next frame."""

    points: np.ndarray  # (N', 3) float32 level frame: the kept points
    foreground: np.ndarray  # (N',) float32: foreground probability of the kept points
    features: np.ndarray  # (N', C) float32: their features (pooled for appearance)
    detections: Detections
    probability: np.ndarray  # (n,) foreground probability of the sampled points
    sampled: np.ndarray  # (n, 3) float32 level frame: the input points of the detector
    encode: Callable[[], EncodedFrame] | None = None  # None for a frame without points

    @cached_property
    def encoded(self) -> EncodedFrame | None:
        """The frame after the tracker's SA1 and SA2, at the first use; it serves two pairs."""
        return None if self.encode is None else self.encode()


def detector_pass(
    detector: Detector,
    min_probability: float,
    choose: Callable[[DetectorInputs, DetectorOutputs], Any] = lambda inputs, outputs: (),
) -> Callable[[np.ndarray], tuple[Proposals, tf.Tensor, Any]]:
    """The detector's pass over one frame, compiled.

    Takes xyz (1, N, 3); returns the proposals, the foreground probability (N,), and what `choose`
    takes from the inputs and outputs of the detector.
    """

    def run(xyz):
        inputs = detector_inputs(xyz, detector.config)
        outputs = detector(inputs, training=False)
        boxes = tf.nest.map_structure(lambda x: x[0], outputs.boxes)
        found = propose(xyz[0], boxes, detector.config.box, min_probability, outputs.fc1[0])
        return found, foreground_probability(boxes.mask_logits), choose(inputs, outputs)

    return tf.function(run, input_signature=[tf.TensorSpec([1, None, 3], tf.float32)], **COMPILED)


def sample_scan(
    points: np.ndarray, config: DetectorConfig, max_points: int | None, rng: np.random.Generator
) -> np.ndarray:
    """(n, >=3) points -> (1, count, 3) float32 of them in random order, for inference.

    All of them, a choice of `max_points` (None: `ALL_POINTS` N), or repeats up to N. Training takes
    N = 15000 (section IV.B), a choice in each epoch. All points of a scan raise the recall at IoU
    0.5 and precision 0.9 on real drives by 0.07, docs/DEVIATIONS.md. In random order, as in
    training: a ball query takes the first points it finds.
    """
    least = config.num_points
    most = max_points or int(ALL_POINTS * least)
    rows = sample_points(points, max(least, min(len(points), most)), rng)
    return np.ascontiguousarray(points[rows, :3], np.float32)[None]


def box_scores(
    clusters: Clusters, scorer: BoxScorer | None, points: np.ndarray, probability: np.ndarray
) -> np.ndarray:
    """(K,) scores of the clusters of a frame: the scorer's, or without one their agreement.

    points (N, 3), the input of the detector, and their foreground probability (N,).
    """
    if scorer is None or not len(clusters.boxes):
        return clusters.agreement
    return scorer.scores(cluster_features(clusters, points, probability))


class StreamingNetwork:
    """Detector and tracker, batch normalisation folded and compiled once, fed frame by frame.

    Args:
        detector, tracker, scorer: as `models.weights.load_networks` gives them; without a scorer
            boxes are scored by agreement.
        min_score: least score of a box; None: the scorer's, without one that of `decoding`.
        max_points: of a scan that enter the detector, at least its N; None: `ALL_POINTS` N.
    """

    def __init__(
        self,
        detector: Detector,
        tracker: TrackingNetwork,
        scorer: BoxScorer | None = None,
        *,
        min_score: float | None = None,
        max_points: int | None = None,
    ):
        self.detector, self.tracker, self.scorer = detector, tracker, scorer
        self.decoding = DecodingConfig()
        default = self.decoding.min_score if scorer is None else scorer.min_score
        self.min_score = default if min_score is None else min_score
        self.max_points = max_points
        fold_batch_norm(detector)
        fold_batch_norm(tracker)
        least = self.decoding.min_probability
        self._detect = detector_pass(detector, least, tracker.fused_features)
        self._encode = tf.function(tracker.encode, **COMPILED)
        self._associate = tf.function(tracker.displacement, **COMPILED)

    def sample(self, points: np.ndarray, t: int) -> np.ndarray:
        """(n, >=3) points -> (1, count, 3) in an order fixed by t, see `sample_scan`."""
        rng = np.random.default_rng([SEED, t])
        return sample_scan(points, self.detector.config, self.max_points, rng)

    def detect(self, points: np.ndarray, t: int = 0) -> FrameState:
        """The detector's pass over one scan.

        Args:
            points: (n, >=3) float, level frame, metres, camera crop; n may be 0.
            t: frame number; it fixes which points are sampled, and in which order.

        Returns:
            FrameState; without points its arrays are empty and `encoded` is None. The tracker
            encodes the frame at the first use: other trackers do not need it.

        Raises:
            ValueError: points of another shape, or not finite.
        """
        points = np.asarray(points, np.float32)
        if points.ndim != 2 or points.shape[1] < 3:
            raise ValueError(f"expected points of shape (n, >=3), found {points.shape}")
        if not np.isfinite(points).all():
            raise ValueError("expected finite points")
        if not len(points):
            return _nothing()
        xyz = self.sample(points, t)
        proposals, probability, frame = self._detect(xyz)
        probability = probability.numpy()
        return FrameState(
            frame.xyz.numpy()[0],
            probability[frame.rows.numpy()[0]],
            frame.features.numpy()[0],
            self.boxes(proposals, probability, xyz[0]),
            probability,
            xyz[0],
            lambda: self._encode(frame),
        )

    def boxes(
        self, proposals: Proposals, probability: np.ndarray, points: np.ndarray
    ) -> Detections:
        """Decoded and scored proposals of a frame, best first.

        points (N, 3), the input of the detector, and their foreground probability (N,).
        """
        clusters = cluster(proposals, self.decoding)
        scores = box_scores(clusters, self.scorer, points, probability)
        return best_first(clusters, scores, self.min_score)

    def restored(
        self, points: np.ndarray, foreground: np.ndarray, features: np.ndarray, found: Detections
    ) -> FrameState:
        """A frame from stored outputs of `detect`: kept points, their features and boxes.

        Its `probability` and `sampled` are those of the kept points alone.
        """
        rows = np.zeros((1, len(points)), np.int32)  # among the N points; the tracker needs none
        frame = TrackerInputs(*map(tf.constant, (rows, points[None], features[None])))
        encode = (lambda: self._encode(frame)) if len(points) else None
        return FrameState(points, foreground, features, found, foreground, points, encode)

    def displacement(self, previous: FrameState, current: FrameState) -> np.ndarray:
        """Association displacement (N', 3) float32, metres, of the points of the earlier frame.

        Unknown, and 0 here, where one of the frames has no points.
        """
        if previous.encoded is None or current.encoded is None:
            return np.zeros_like(previous.points)
        return self._associate(previous.encoded, current.encoded).numpy()[0]

    def appearance(self, state: FrameState, boxes: np.ndarray) -> np.ndarray:
        """The mean feature of the kept points in each box, L2-normalised; 0 for an empty box.

        boxes: (M, 7) level frame, of the frame of `state` -> (M, C) float32.
        """
        features = np.zeros((len(boxes), state.features.shape[1]), np.float32)
        owner = points_in_boxes(state.points, boxes) if len(boxes) else np.zeros(0, int)
        for i in range(len(boxes)):
            inside = owner == i
            if inside.any():
                features[i] = state.features[inside].mean(0)
        return features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-9)


def _nothing() -> FrameState:
    empty, nothing = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    none = Detections(np.zeros((0, 7), np.float32), nothing, np.zeros(0, np.int32))
    return FrameState(empty, nothing, empty[:, :1], none, nothing, empty)
