"""Counts of the CLEAR MOT protocols, and the metrics computed from them."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class Counts:
    """Counts of one sequence, or of several added up.

    Attributes:
        gt: evaluated ground-truth boxes (without ignored ones).
        tp: matched boxes; in `kitti3d` including matched ignored boxes, as in the devkit.
        fp, fn: false alarms and misses.
        ids, frag: identity switches and fragmentations.
        tracks: evaluated ground-truth trajectories.
        mostly_tracked, mostly_lost: numbers of such trajectories among `tracks`.
        similarity: sum of the similarity (IoU) over the `tp` matches.
    """

    gt: int = 0
    tp: int = 0
    fp: int = 0
    fn: int = 0
    ids: int = 0
    frag: int = 0
    tracks: int = 0
    mostly_tracked: int = 0
    mostly_lost: int = 0
    similarity: float = 0.0

    def __add__(self, other: "Counts") -> "Counts":
        return Counts(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def mota(self) -> float | None:
        """1 - (FN + FP + IDS) / GT; None without ground truth."""
        return ratio(self.gt - self.fn - self.fp - self.ids, self.gt)

    def metrics(self) -> dict[str, float | int | None]:
        """The ten published metrics; ratios are fractions, None where they are undefined."""
        return {
            "MOTA": self.mota,
            "MOTP": ratio(self.similarity, self.tp),
            "MT": ratio(self.mostly_tracked, self.tracks),
            "ML": ratio(self.mostly_lost, self.tracks),
            "IDS": self.ids,
            "FRAG": self.frag,
            "TP": self.tp,
            "FP": self.fp,
            "FN": self.fn,
            "GT": self.gt,
        }


@dataclass(frozen=True)
class Outcome:
    """One protocol on one sequence: its counts, and the score of each match in any order."""

    counts: Counts
    matched_scores: np.ndarray


def total(counts: Iterable[Counts]) -> Counts:
    """The sum of counts, for ratios over several sequences."""
    return sum(counts, Counts())


def ratio(numerator: float, denominator: float) -> float | None:
    """A quotient, or None where the denominator is zero."""
    return float(numerator / denominator) if denominator else None
