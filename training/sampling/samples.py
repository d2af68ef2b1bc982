"""One training sample of each network, as arrays of fixed shape (NumPy; level frame)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kitti.boxes import points_in_boxes
from kitti.object_shift import ObjectShift, shift_points
from kitti.scans.point_arrays import sample_points
from kitti.targets import association_displacement, foreground_labels, point_displacement
from models.boxes.box_coding import BoxTargets, encode_boxes
from models.config import BoxCodingConfig
from training.config import AugmentationConfig, DetectorTrainingConfig
from training.sampling.augmentation import SceneTransform
from training.sampling.frames import LabelledFrame
from training.sampling.object_bank import ObjectBank
from training.sampling.pasting import paste_objects

MOST_LEFT = 0.25
"""Largest share of its points that a hidden vehicle keeps."""


class DetectorSample(NamedTuple):
    """A scan and the targets of the detector at its query points."""

    points: np.ndarray  # (N, 3) float32
    query: np.ndarray  # (Q, 3) float32
    foreground: np.ndarray  # (Q,) int32
    mask_weights: np.ndarray  # (Q,) float32; 0 on background in DontCare regions
    box_weights: np.ndarray  # (Q,) float32; 0 on background
    targets: BoxTargets  # (Q, ...)


class PairSample(NamedTuple):
    """Two adjacent scans, and the association displacement of the points of each to the other.

    Row 0 is frame t-1 with the displacement to t, row 1 is frame t with the displacement to t-1.
    """

    points: np.ndarray  # (2, N, 3) float32
    displacement: np.ndarray  # (2, N, 3) float32 metres, 0 on background
    foreground: np.ndarray  # (2, N) int32: 1, 0 background, -1 ignored: object not in the other
    # frame, or background in a DontCare region


def no_augmentation() -> AugmentationConfig:
    """Leaves samples as they are."""
    return AugmentationConfig(
        flip=False,
        rotation=0.0,
        scale=0.0,
        height=0.0,
        dropout=0.0,
        object_shift=0.0,
        object_shift_share=0.0,
        pasted_objects=0,
        single_scan_pairs=False,
        hidden_vehicles=0.0,
    )


def shifted(
    frames: Sequence[LabelledFrame], config: AugmentationConfig, rng: np.random.Generator
) -> list[LabelledFrame]:
    """Frames whose objects, in a share of the samples, are shifted as in section IV.D.

    All labelled objects and their points are shifted by `ObjectShift`, anew in each frame.
    """
    seed, chosen = int(rng.integers(2**63)), rng.random() < config.object_shift_share
    if not (chosen and config.object_shift):
        return list(frames)
    all_boxes = [np.concatenate([f.boxes, f.other_boxes]) for f in frames]
    ids = np.concatenate([part for f in frames for part in (f.track_ids, f.other_ids)])
    counts = [len(boxes) for boxes in all_boxes]
    numbers = np.repeat(np.arange(len(frames)), counts)
    model = ObjectShift(config.object_shift, seed)
    offsets = model.of_rows(numbers, ids, np.concatenate(all_boxes))
    result = []
    for frame, boxes, moves in zip(
        frames, all_boxes, np.split(offsets, np.cumsum(counts)[:-1]), strict=True
    ):
        points, moved = shift_points(frame.points, boxes, moves), boxes.copy()
        moved[:, :2] += moves
        vehicles, others = np.split(moved, [len(frame.boxes)])
        result.append(frame._replace(points=points, boxes=vehicles, other_boxes=others))
    return result


def hidden(
    frames: Sequence[LabelledFrame], share: float, rng: np.random.Generator
) -> list[LabelledFrame]:
    """The two frames of a pair, where a share of their vehicles are hidden in one, as by occlusion.

    A hidden vehicle loses all its points but a share uniform in [0, `MOST_LEFT`]; its box stays.
    So the tracker learns where a vehicle goes that it does not see again, rather than to move it
    onto a neighbour. A frame keeps all its points where none would be left.
    """
    if not share:
        return list(frames)
    ids = np.unique(np.concatenate([frame.track_ids for frame in frames]))
    where = np.where(rng.random(len(ids)) < share, rng.integers(2, size=len(ids)), -1)
    left = rng.uniform(0.0, MOST_LEFT, len(ids))
    result = []
    for number, frame in enumerate(frames):
        vehicle = np.searchsorted(ids, frame.track_ids)
        keep = np.where(where[vehicle] == number, left[vehicle], 1.0)
        owner = points_in_boxes(frame.points, frame.boxes)
        kept = rng.random(len(owner)) < np.append(keep, 1.0)[owner]
        result.append(frame.only(kept) if kept.any() else frame)
    return result


def _choose(count: int, n: int, dropout: float, rng: np.random.Generator) -> np.ndarray:
    """Rows of n points out of count, a random share of them (up to dropout) left out first."""
    kept = np.arange(count)
    if dropout > 0 and count > 1:
        keep = max(1, round(count * (1.0 - rng.uniform(0.0, dropout))))
        kept = rng.permutation(count)[:keep]
    return kept[sample_points(kept, n, rng)]


def detector_sample(
    frame: LabelledFrame,
    config: DetectorTrainingConfig,
    augmentation: AugmentationConfig,
    rng: np.random.Generator,
    bank: ObjectBank | None = None,
) -> DetectorSample:
    """A labelled frame -> DetectorSample; rng is the only source of randomness.

    `bank` holds the objects to paste, where `augmentation` enables it.
    """
    (frame,) = shifted([frame], augmentation, rng)
    if bank is not None and augmentation.pasted_objects:
        frame = paste_objects(frame, bank, augmentation.pasted_objects, rng)
    points, boxes = frame.points, frame.boxes
    labels = foreground_labels(points, boxes, frame.ground)
    rows = _choose(len(points), config.detector.num_points, augmentation.dropout, rng)
    transform = SceneTransform.random(augmentation, rng)
    labels, ignored = labels[rows], frame.ignored[rows]
    points, boxes = transform.points(points[rows]), transform.boxes(boxes)
    query, weights = _query_rows(labels, ignored, config.query_points, rng)
    labels = labels[query]
    foreground = labels >= 0
    return DetectorSample(
        points,
        points[query],
        foreground.astype(np.int32),
        weights,
        _box_weights(labels, config.object_balance),
        _targets(points[query], boxes, frame.classes, labels, config.detector.box),
    )


def _query_rows(labels, ignored, count: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Query-point rows and mask weights: each part, if sampled, is re-weighted to its full count.

    labels (N,) object of each point or -1, ignored (N,) bool -> rows (Q,), weights (Q,) float32.
    """
    known = (~ignored | (labels >= 0)).astype(np.float32)
    if not 0 < count < len(labels):
        return np.arange(len(labels)), known
    foreground = rng.permutation(np.flatnonzero(labels >= 0))
    background = rng.permutation(np.flatnonzero(labels < 0))
    most = max(count // 2, count - len(background))
    chosen = foreground[:most]
    rest = background[: count - len(chosen)]
    weights = [
        np.full(len(chosen), len(foreground) / max(len(chosen), 1)),
        np.full(len(rest), len(background) / max(len(rest), 1)),
    ]
    rows = np.concatenate([chosen, rest])
    return rows, (np.concatenate(weights) * known[rows]).astype(np.float32)


def _box_weights(labels: np.ndarray, balance: float) -> np.ndarray:
    """1 / (points of the object)^balance, scaled to a mean of 1 over foreground points."""
    foreground = labels >= 0
    weights = np.zeros(len(labels), np.float32)
    if foreground.any():
        counts = np.bincount(labels[foreground])
        weights[foreground] = counts[labels[foreground]] ** -float(balance)
        weights[foreground] /= weights[foreground].mean()
    return weights


def _targets(points, boxes, classes, labels, config: BoxCodingConfig) -> BoxTargets:
    foreground = np.flatnonzero(labels >= 0)
    owner = labels[foreground]
    encoded = encode_boxes(points[foreground], boxes[owner], classes[owner], config)

    def scatter(values: np.ndarray) -> np.ndarray:
        full = np.zeros((len(points), *values.shape[1:]), values.dtype)
        full[foreground] = values
        return full

    return BoxTargets(*(scatter(values) for values in encoded))


def pair_sample(
    previous: LabelledFrame,
    current: LabelledFrame,
    num_points: int,
    augmentation: AugmentationConfig,
    rng: np.random.Generator,
) -> PairSample:
    """Two frames -> PairSample: the same transform for both, objects shifted anew in each."""
    frames = shifted([previous, current], augmentation, rng)
    transform = SceneTransform.random(augmentation, rng)
    dropout = rng.uniform(0.0, augmentation.dropout)
    scans, boxes, labels, ignored = [], [], [], []
    for frame in hidden(frames, augmentation.hidden_vehicles, rng):
        rows = _choose(len(frame.points), num_points, dropout, rng)
        labels.append(foreground_labels(frame.points, frame.boxes, frame.ground)[rows])
        ignored.append(frame.ignored[rows])
        scans.append(transform.points(frame.points[rows]))
        boxes.append(transform.boxes(frame.boxes))
    ids = (previous.track_ids, current.track_ids)
    there = _displacement_of_points(labels[0], boxes[0], ids[0], boxes[1], ids[1])
    back = _displacement_of_points(labels[1], boxes[1], ids[1], boxes[0], ids[0])
    displacement, foreground = (np.stack(both) for both in zip(there, back, strict=True))
    foreground[(foreground == 0) & np.stack(ignored)] = -1
    return PairSample(np.stack(scans), displacement, foreground)


def _displacement_of_points(owner, boxes, ids, other_boxes, other_ids):
    """Displacement (N, 3) and foreground (N,) of points of boxes `owner` to another frame."""
    displacement, valid = association_displacement(boxes, ids, other_boxes, other_ids)
    foreground = np.where(np.append(valid, False)[owner], 1, -1)
    foreground[owner < 0] = 0
    return point_displacement(owner, displacement), foreground.astype(np.int32)
