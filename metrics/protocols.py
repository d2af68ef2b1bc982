"""The protocols by name: metrics of several sequences from ground truth and results."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kitti.iou import iou_2d, iou_3d
from kitti.objects import Objects
from metrics.clear3d import clear3d
from metrics.comparison import Comparison, compare
from metrics.counts import Outcome, total
from metrics.hota import hota
from metrics.kitti2d import CleanFrame, clean, kitti2d
from metrics.kitti3d import kitti3d
from metrics.kitti_rules import (
    RULES,
    KittiRules,
    evaluated_classes,
    ignorable_results,
    ignored_truth,
    in_dontcare,
    rules_for,
)
from metrics.recall_sweep import sweep

PROTOCOLS = ("clear3d", "clear3d_dontcare", "kitti2d", "kitti3d", "hota")
CLEAR3D = ("clear3d", "clear3d_dontcare")
"""Protocols over all of `classes`, without further rules of KITTI."""


@dataclass(frozen=True)
class Entry:
    """Truth and results of one sequence, all classes; rows beyond its frames are not evaluated."""

    name: str
    num_frames: int
    truth: Objects
    results: Objects

    def __post_init__(self):
        for name in ("truth", "results"):
            rows = getattr(self, name)
            object.__setattr__(self, name, rows[rows.frame < self.num_frames])


class Clear3d:
    """`clear3d` over sequences; both sides are limited to `classes`.

    With `dontcare`, an unmatched result is no false alarm if most of its image box lies in one of
    the frame's DontCare regions, as in KITTI's protocols.
    """

    def __init__(
        self,
        entries: Sequence[Entry],
        classes: Sequence[str],
        min_iou: float,
        dontcare: bool = False,
    ):
        self.min_iou = min_iou
        self.comparisons = [
            compare(
                entry.name,
                entry.num_frames,
                entry.truth.of_classes(classes),
                entry.results.of_classes(classes),
                iou_3d,
            )
            for entry in entries
        ]
        self.ignorable = [
            in_dontcare(c.results, entry.truth.of_classes(("DontCare",)), c.num_frames)
            if dontcare
            else None
            for c, entry in zip(self.comparisons, entries, strict=True)
        ]

    def outcomes(self, threshold: float | None, _earlier_passes: int = 0) -> list[Outcome]:
        """One outcome per sequence, of the tracks whose mean score reaches `threshold`."""
        return [
            clear3d(c, c.above(threshold), self.min_iou, ignorable)
            for c, ignorable in zip(self.comparisons, self.ignorable, strict=True)
        ]


class KittiProtocol:
    """Base of the protocols with KITTI's ignore rules."""

    def __init__(
        self, entries: Sequence[Entry], space: str, neighbours_may_match: bool, rules: KittiRules
    ):
        """Prepares every sequence.

        Args:
            entries: the sequences.
            space: "2d" or "3d", of the IoU.
            neighbours_may_match: keeps results of a neighbouring class, such as Van.
            rules: of the evaluated class.
        """
        self.rules = rules
        self.cases = [_kitti_case(entry, space, neighbours_may_match, rules) for entry in entries]

    def clean(self) -> dict[str, list[CleanFrame]]:
        """Frames of each sequence after the ignore rules, for `hota`."""
        return {
            c.name: clean(c, c.above(None), ignored, ignorable)
            for c, ignored, ignorable in self.cases
        }


class Kitti2d(KittiProtocol):
    """`kitti2d` over sequences, on image boxes."""

    def __init__(self, entries: Sequence[Entry], rules: KittiRules = RULES):
        super().__init__(entries, "2d", False, rules)

    def outcomes(self, threshold: float | None, _earlier_passes: int = 0) -> list[Outcome]:
        """One outcome per sequence, of the tracks whose mean score reaches `threshold`."""
        return [
            kitti2d(c, c.above(threshold), ignored, ignorable, self.rules)
            for c, ignored, ignorable in self.cases
        ]


class Kitti3d(KittiProtocol):
    """`kitti3d` over sequences; with `space` "2d" AB3DMOT's 2-D evaluation."""

    def __init__(
        self,
        entries: Sequence[Entry],
        min_iou: float,
        space: str = "3d",
        rules: KittiRules = RULES,
    ):
        super().__init__(entries, space, True, rules)
        self.min_iou = min_iou

    def outcomes(self, threshold: float | None, earlier_passes: int = 0) -> list[Outcome]:
        """One outcome per sequence; the threshold is applied as AB3DMOT's evaluator does."""
        return [
            kitti3d(
                c,
                c.above(threshold, earlier_passes),
                ignored,
                ignorable,
                min_iou=self.min_iou,
                rules=self.rules,
            )
            for c, ignored, ignorable in self.cases
        ]


def evaluate_protocol(
    name: str,
    entries: Sequence[Entry],
    *,
    classes: Sequence[str] = ("Car", "Van"),
    min_iou: float = 0.5,
) -> dict[str, Any]:
    """Metrics of one protocol: `{"overall": {...}, "sequences": {"0016": {...}, ...}}`.

    Args:
        name: one of `PROTOCOLS`.
        entries: the sequences; all of their tracks are evaluated.
        classes: those that `clear3d` evaluates; of the KITTI protocols one class with neighbours,
            see `kitti_rules.rules_for`.
        min_iou: least 3-D IoU of a match in `clear3d`, `clear3d_dontcare` and `kitti3d`.

    Raises:
        InputError: the protocol is not defined for `classes`.
    """
    if name not in PROTOCOLS:
        raise ValueError(f"expected one of {PROTOCOLS}, found {name!r}")
    if name == "hota":
        return _hota_metrics(entries, rules_for(name, classes))
    protocol = _clear_protocol(name, entries, classes, min_iou)
    return metrics_of(protocol, entries, over_recall=name == "kitti3d")


def best_threshold(
    name: str, entries: Sequence[Entry], classes: Sequence[str], min_iou: float
) -> float | None:
    """The score threshold of the best MOTA of a protocol (of hota: of `kitti2d`); None: keep all.

    Raises:
        InputError: as `evaluate_protocol`.
    """
    return sweep(_clear_protocol(name, entries, classes, min_iou).outcomes).best_threshold


def evaluated_types(name: str, classes: Sequence[str]) -> tuple[str, ...]:
    """The classes of the result rows that a protocol evaluates (hota as `kitti2d`).

    Raises:
        InputError: as `evaluate_protocol`.
    """
    if name in CLEAR3D:
        return tuple(classes)
    rules = rules_for(name, classes)
    return (rules.evaluated, *(rules.neighbours if name == "kitti3d" else ()))


def _clear_protocol(
    name: str, entries: Sequence[Entry], classes: Sequence[str], min_iou: float
) -> Clear3d | Kitti2d | Kitti3d:
    """The protocol of that name; for hota `kitti2d`."""
    if name in CLEAR3D:
        return Clear3d(entries, classes, min_iou, dontcare=name == "clear3d_dontcare")
    rules = rules_for(name, classes)
    if name == "kitti3d":
        return Kitti3d(entries, min_iou, rules=rules)
    return Kitti2d(entries, rules)


def _kitti_case(entry: Entry, space: str, neighbours_may_match: bool, rules: KittiRules):
    truth = evaluated_classes(entry.truth, rules)
    results = evaluated_classes(entry.results, rules)
    if not neighbours_may_match:
        results = results.of_classes((rules.evaluated,))
    similarity, field = (iou_2d, "bbox") if space == "2d" else (iou_3d, "boxes")
    comparison: Comparison = compare(
        entry.name, entry.num_frames, truth, results, similarity, field=field
    )
    dontcare = entry.truth.of_classes(("DontCare",))
    ignorable = ignorable_results(results, dontcare, entry.num_frames, rules)
    return comparison, ignored_truth(truth, rules), ignorable


def metrics_of(
    protocol: Clear3d | Kitti2d | Kitti3d,
    entries: Sequence[Entry],
    *,
    best: bool = False,
    over_recall: bool = False,
) -> dict[str, Any]:
    """Metrics of a CLEAR protocol over all and per sequence; see `evaluate_protocol`.

    Args:
        protocol: made of `entries`.
        entries: the sequences.
        best: leave out tracks of lower mean score than the recall point of the best overall MOTA.
        over_recall: add sAMOTA, AMOTA, AMOTP and the threshold of the best MOTA to those over all.
    """
    swept = sweep(protocol.outcomes) if best or over_recall else None
    threshold, earlier_passes = (swept.best_threshold, swept.passes) if best else (None, 0)
    counts = [outcome.counts for outcome in protocol.outcomes(threshold, earlier_passes)]
    overall = total(counts).metrics()
    if over_recall:
        overall |= swept.metrics()
    return {
        "overall": overall,
        "sequences": {entry.name: c.metrics() for entry, c in zip(entries, counts, strict=True)},
    }


def _hota_metrics(entries: Sequence[Entry], rules: KittiRules) -> dict[str, Any]:
    """HOTA on image boxes, and on 3-D IoU under names that end in _3D."""
    metrics: dict[str, Any] = {"overall": {}, "sequences": {entry.name: {} for entry in entries}}
    for space, suffix in (("2d", ""), ("3d", "_3D")):
        part = hota(KittiProtocol(entries, space, False, rules).clean())
        metrics["overall"] |= _suffixed(part["overall"], suffix)
        for name, values in part["sequences"].items():
            metrics["sequences"][name] |= _suffixed(values, suffix)
    return metrics


def _suffixed(values: dict[str, Any], suffix: str) -> dict[str, Any]:
    return {name + suffix: value for name, value in values.items()}
