"""Fits the box scorer on candidates of real and simulated drives, cross-validated by drive.

Letters: S boxes, F features.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from common.errors import InputError
from metrics.scored_boxes import ScoredBoxes, collect, outcomes_of
from models.boxes.box_score import BoxScorer
from models.boxes.cluster_features import FC1
from training.scoring.box_candidates import Candidates
from training.scoring.logistic import LogisticModel, fit_logistic, log_loss

RIGHT_IOU = 0.5  # a score is the probability of at least this 3-D IoU
MIN_POINTS = 10  # of a vehicle that counts in recall


class Penalty(NamedTuple):
    """L2 penalties of the regression; `fc1` is None to leave these features out."""

    plain: float
    fc1: float | None


GRID = tuple(
    Penalty(plain, None if factor is None else plain * factor)
    for plain, factor in product((0.003, 0.01, 0.03), (None, 50.0, 10.0))
)


@dataclass(frozen=True)
class Domain:
    """Candidates of one kind of scans, real or simulated.

    Attributes:
        frames: of every view; a frame counts once for each.
    """

    frames: list[Candidates]

    def drives(self) -> list[str]:
        """Names, sorted."""
        return sorted({frame.drive for frame in self.frames})


class Samples(NamedTuple):
    """Boxes of the frames of a domain; boxes in DontCare regions are left out unless right."""

    values: np.ndarray  # (S, F)
    right: np.ndarray  # (S,) bool
    drive: np.ndarray  # (S,) names


def feature_names(domains: Sequence[Domain], penalty: Penalty) -> list[str]:
    """Names of the features that are used, in the order of the columns."""
    names = next((f.features for d in domains for f in d.frames if f.features), None)
    if names is None:
        raise InputError("expected scans in which the detector proposes boxes, found none")
    return [name for name in names if penalty.fc1 is not None or not name.startswith(FC1)]


def samples(frames: Sequence[Candidates], names: Sequence[str]) -> Samples:
    """The boxes of some frames as rows."""
    values, right, drive = [np.zeros((0, len(names)))], [np.zeros(0, bool)], []
    for frame in frames:
        if frame.features:
            matched = frame.right(RIGHT_IOU)
            rows = matched | ~frame.ignorable
            values.append(np.stack([frame.features[name] for name in names], -1)[rows])
            right.append(matched[rows])
            drive += [frame.drive] * int(rows.sum())
    return Samples(np.concatenate(values), np.concatenate(right), np.array(drive, object))


class ScoreFit:
    """Regressions on the drives of several domains, which weigh alike."""

    def __init__(self, domains: Sequence[Domain], penalty: Penalty):
        self.domains, self.names = domains, feature_names(domains, penalty)
        self._samples = [samples(d.frames, self.names) for d in domains]
        factor = [penalty.fc1 if name.startswith(FC1) else penalty.plain for name in self.names]
        self._penalty = np.array(factor, float)

    def fit(self, held_out: Sequence[str] = ()) -> LogisticModel:
        """The regression on all drives but those held out."""
        values, right, weight = [], [], []
        for part in self._samples:
            rows = ~np.isin(part.drive, held_out)
            values.append(part.values[rows])
            right.append(part.right[rows])
            weight.append(np.full(rows.sum(), 1 / max(rows.sum(), 1)))
        return fit_logistic(*map(np.concatenate, (values, right, weight)), self._penalty)

    def scores(self, model: LogisticModel, frame: Candidates) -> np.ndarray:
        """(K,) probabilities of a frame's boxes."""
        if not frame.features:
            return np.zeros(0)
        return model.probability(np.stack([frame.features[name] for name in self.names], -1))

    def cross_validated(self, folds: int) -> list[list[np.ndarray]]:
        """(K,) scores of each domain and frame by a regression fitted without its drive.

        Raises:
            InputError: a domain has a single drive.
        """
        fold = {}
        for domain in self.domains:
            drives = domain.drives()
            if len(drives) < 2:
                raise InputError(f"expected two or more drives to validate on, found {drives}")
            fold |= {drive: number % folds for number, drive in enumerate(drives)}
        used = range(max(fold.values()) + 1)
        models = [self.fit([d for d, number in fold.items() if number == k]) for k in used]
        return [
            [self.scores(models[fold[frame.drive]], frame) for frame in domain.frames]
            for domain in self.domains
        ]

    def scorer(self, detector_sha256: str, min_score: float) -> BoxScorer:
        """The regression on all drives, ready to be stored."""
        model = self.fit()
        rows = (tuple(map(float, x)) for x in (model.mean, model.scale, model.weight))
        return BoxScorer(detector_sha256, min_score, model.bias, tuple(self.names), *rows)


def scored(
    frames: Sequence[Candidates], scores: Sequence[np.ndarray], min_iou: float
) -> ScoredBoxes:
    """The boxes of all frames with their outcomes; vehicles of few points are ignored."""
    parts = []
    for frame, value in zip(frames, scores, strict=True):
        counted = frame.points >= MIN_POINTS
        outcomes, rows = outcomes_of(frame.iou, value, counted, frame.ignorable, min_iou)
        points = np.append(frame.points, 0)[rows]
        parts.append((value, outcomes, points))
    return collect(parts)


def counted_vehicles(frames: Sequence[Candidates], low: int = MIN_POINTS, high: float = np.inf):
    """Number of labelled vehicles that have at least `low` and fewer than `high` points."""
    return int(sum(((f.points >= low) & (f.points < high)).sum() for f in frames))


def counted_boxes(
    frames: Sequence[Candidates], scores: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Scores (S,) and whether the box is right (S,) bool, of the boxes that `samples` takes."""
    parts = [(np.zeros(0), np.zeros(0, bool))]
    for frame, value in zip(frames, scores, strict=True):
        right = frame.right(RIGHT_IOU)
        rows = right | ~frame.ignorable
        parts.append((value[rows], right[rows]))
    found, right = map(np.concatenate, zip(*parts, strict=True))
    return found, right


def choose_penalty(
    domains: Sequence[Domain], folds: int, grid: Sequence[Penalty] = GRID
) -> tuple[Penalty, dict[str, float]]:
    """The penalty of least cross-validated log loss (mean over domains), and all losses."""
    losses = {}
    for penalty in grid:
        found = ScoreFit(domains, penalty).cross_validated(folds)
        pairs = zip(domains, found, strict=True)
        losses[penalty] = float(np.mean([log_loss(*counted_boxes(d.frames, s)) for d, s in pairs]))
    best = min(losses, key=losses.__getitem__)
    return best, {f"plain {p.plain:g}, FC1 {p.fc1}": loss for p, loss in losses.items()}
