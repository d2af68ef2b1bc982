"""Boxes of the detector on labelled scans, with their features and their IoU with the labels.

Letters: V labelled vehicles, K boxes of a frame, F features.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from common.progress import progress
from kitti.boxes import count_points_in_boxes, points_in_boxes, project_boxes
from kitti.iou import iou_3d
from kitti.sequence import KittiSequence
from metrics.kitti_rules import boxes_in_dontcare
from models.boxes.box_decoding import Clusters, Proposals, cluster
from models.boxes.box_score import BoxScorer
from models.boxes.cluster_features import cluster_features
from models.config import DecodingConfig, DetectorConfig
from models.detector import Detector
from models.inference import detector_pass, sample_scan
from tracking.assignment import greedy
from training.sampling.augmentation import SceneTransform
from training.sampling.frames import frame_list

MIRRORED = SceneTransform(flip=True)


@dataclass(frozen=True)
class Candidates:
    """The boxes of a frame before any threshold, and the labels.

    Attributes:
        drive: data root and sequence, the unit of cross-validation.
        t: frame.
        clusters: K of them.
        features: by name, each (K,) float64; empty where K = 0.
        iou: (V, K) with the labelled vehicles.
        points: (V,) points of the scan inside each vehicle.
        ignorable: (K,) bool, most of the projected box lies in a DontCare region.
        truth: (V, 7) level boxes of the vehicles, objects of the detector's classes.
        foreground: (V,) mean foreground probability of the points inside, NaN without any.
    """

    drive: str
    t: int
    clusters: Clusters
    features: dict[str, np.ndarray]
    iou: np.ndarray
    points: np.ndarray
    ignorable: np.ndarray
    truth: np.ndarray
    foreground: np.ndarray

    def scores(self, scorer: BoxScorer | None) -> np.ndarray:
        """(K,) scores of the boxes; without a scorer their agreement."""
        if scorer is None or not self.features:
            return self.clusters.agreement.astype(np.float64)
        return scorer.scores(self.features)

    def right(self, min_iou: float) -> np.ndarray:
        """(K,) bool: boxes matched with a vehicle one-to-one, largest IoU first."""
        right = np.zeros(self.iou.shape[1], bool)
        right[[column for _, column in greedy(-self.iou, -min_iou).pairs]] = True
        return right


def drive_of(sequence: KittiSequence) -> str:
    """Data root and sequence, unlike those of every other."""
    return f"{sequence.data_root.resolve()}/{sequence.name}"


class CandidateFinder:
    """The detector and the decoding, compiled once.

    Args:
        detector: the network.
        decoding: how points become boxes.
        max_points: of a scan, see `StreamingNetwork`.
    """

    def __init__(self, detector: Detector, decoding: DecodingConfig, max_points: int | None = None):
        self.detector, self.decoding, self.max_points = detector, decoding, max_points
        self._propose = detector_pass(detector, decoding.min_probability)

    def find(self, sequence: KittiSequence, t: int, view: int = 0) -> Candidates:
        """Candidates of a frame with a scan; none where no point is in the camera's view.

        view: chooses the sampled points with t; odd ones are mirrored left to right.
        """
        points, objects = sequence.read_points_level(t)[:, :3], sequence.objects.at(t)
        truth = objects.of_classes(self.detector.config.box.classes).boxes
        regions = objects.of_classes(("DontCare",)).bbox
        if view % 2:
            points, truth = MIRRORED.points(points), MIRRORED.boxes(truth)
        if len(points):
            rng = np.random.default_rng([view, t])
            xyz = sample_scan(points, self.detector.config, self.max_points, rng)
            proposals, likely, _ = self._propose(xyz)
        else:
            xyz, proposals, likely = points[None], *_nothing(self.detector.config)
        clusters, likely = cluster(proposals, self.decoding), np.asarray(likely)
        boxes = MIRRORED.boxes(clusters.boxes) if view % 2 else clusters.boxes
        projected = np.nan_to_num(project_boxes(boxes, sequence.calib, sequence.image_size))
        return Candidates(
            drive=drive_of(sequence),
            t=t,
            clusters=clusters,
            features=cluster_features(clusters, xyz[0], likely) if len(boxes) else {},
            iou=iou_3d(truth, clusters.boxes),
            points=count_points_in_boxes(points, truth),
            ignorable=boxes_in_dontcare(projected, regions),
            truth=truth,
            foreground=_means(xyz[0], likely, truth),
        )

    def find_all(
        self, sequences: list[KittiSequence], views: Iterable[int] = (0,), every: int = 1
    ) -> list[list[Candidates]]:
        """Candidates of every `every`-th frame with a scan, for each view."""
        frames, views = frame_list(sequences)[::every], list(views)
        jobs = [(view, i, t) for view in views for i, t in frames]
        found: list[list[Candidates]] = [[] for _ in views]
        for job, (view, i, t) in enumerate(progress(jobs, len(jobs), "detector", "frames")):
            found[job // len(frames)].append(self.find(sequences[i], t, view))
        return found


def _nothing(config: DetectorConfig) -> tuple[Proposals, np.ndarray]:
    """The proposals and the foreground probability of a scan without points."""
    none, classes = np.zeros(0, np.float32), len(config.box.classes)
    shape = (np.zeros((0, n), np.float32) for n in (7, classes, config.fc1_width))
    boxes, scores, features = shape
    quality = none if config.box.quality else None
    return Proposals(boxes, none, scores, features, quality), none


def _means(points: np.ndarray, values: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    owner = points_in_boxes(points, boxes)
    held = owner >= 0
    with np.errstate(invalid="ignore"):
        count = np.bincount(owner[held], minlength=len(boxes))
        return np.bincount(owner[held], values[held], len(boxes)) / count
