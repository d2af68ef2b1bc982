"""What one evaluation is asked to do, checked before anything is read or written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from common.errors import InputError
from kitti.objects import CLASSES, VEHICLES, class_name
from kitti.splits import TEST, VAL
from metrics.kitti_rules import rules_for
from metrics.protocols import BEST, PROTOCOLS
from tracking import TRACKERS

GROUND_TRUTH = "gt"
NETWORK = "network"


@dataclass(frozen=True)
class EvaluateConfig:
    """One run of evaluate.py; the fields are its flags.

    Attributes:
        data_root: folder in KITTI's tracking layout.
        subset: "training" or "testing" (no labels: only result files are written).
        seqs: sequence numbers; None for the paper's validation split, or all of testing.
        classes: what is tracked, and what `clear3d` is limited to on both sides; the other
            protocols evaluate one class at a time.
        detections: "gt", "network", or a folder of detections in AB3DMOT's layout.
        tracker: of `tracking.TRACKERS`.
        weights: folder with detector.npz and tracker.npz, where the networks are needed.
        results: folder of result files to be evaluated; no tracker runs then.
        displacement: every object is shifted by up to this many metres (section IV.D).
        seed: of the displacement.
        protocols: of `metrics.protocols.PROTOCOLS`; None for clear3d, in testing for none.
        iou: least 3-D IoU of a match in clear3d and kitti3d.
        score_threshold: least mean score of a track, "best" for that of the best MOTA in the first
            of the protocols, or None.
        out: folder for the output; None writes nothing.
    """

    data_root: Path
    subset: str = "training"
    seqs: tuple[int, ...] | None = None
    classes: tuple[str, ...] = VEHICLES
    detections: str = GROUND_TRUTH
    tracker: str = "gt_displacement"
    weights: Path = Path("weights")
    results: Path | None = None
    displacement: float = 0.0
    seed: int = 0
    protocols: tuple[str, ...] | None = None
    iou: float = 0.5
    score_threshold: float | str | None = None
    out: Path | None = None

    def __post_init__(self):
        testing = self.subset == "testing"
        if self.seqs is None:
            object.__setattr__(self, "seqs", TEST if testing else VAL)
        if self.protocols is None:
            object.__setattr__(self, "protocols", () if testing else ("clear3d",))
        _among("--subset", [self.subset], ("training", "testing"))
        object.__setattr__(self, "classes", tuple(class_name(name) for name in self.classes))
        _among("--classes", self.classes, [name for name in CLASSES if name != "DontCare"])
        _among("--tracker", [self.tracker], TRACKERS)
        _among("--protocol", self.protocols, PROTOCOLS)
        for name in self.protocols:
            if name != "clear3d":
                rules_for(name, self.classes)
        if self.score_threshold == BEST and not self.protocols:
            raise InputError("--score_threshold best is that of a --protocol, found none")
        if not 0 < self.iou <= 1:
            raise InputError(f"--iou: expected above 0 and at most 1, found {self.iou}")
        if not 0 <= self.displacement < math.inf:
            raise InputError(f"--displacement: expected metres >= 0, found {self.displacement}")
        if not 0 <= self.seed < 2**63:
            raise InputError(f"--seed: expected 0 <= seed < 2**63, found {self.seed}")
        if testing:
            self._check_testing()
        self._check_displacement()

    def _check_testing(self):
        if self.protocols:
            raise InputError("--subset testing has no labels: --protocol cannot be evaluated")
        if self.results is not None:
            raise InputError("--subset testing has no labels: --results cannot be evaluated")
        if self.detections == GROUND_TRUTH:
            raise InputError(
                f"--subset testing has no labels: --detections is {NETWORK} or a folder"
            )
        if self.tracker == "gt_displacement":
            raise InputError("--subset testing has no labels: choose another --tracker")
        if self.displacement:
            raise InputError("--subset testing has no labels: objects cannot be displaced")

    def _check_displacement(self):
        in_image = [name for name in self.protocols if name != "clear3d"]
        if self.displacement and in_image:
            raise InputError(
                f"--displacement moves objects away from their image: {','.join(in_image)} "
                "cannot be evaluated, only clear3d"
            )

    @property
    def needs_network(self) -> bool:
        """Whether the networks run: for their boxes or for their displacement."""
        return self.results is None and (
            self.detections == NETWORK or self.tracker == "pointtracknet"
        )

    def record(self) -> dict[str, Any]:
        """The fields as JSON-ready values."""
        fields = asdict(self)
        paths = {
            key: str(value) if isinstance(value, Path) else value for key, value in fields.items()
        }
        return {key: list(v) if isinstance(v, tuple) else v for key, v in paths.items()}


def _among(flag: str, found: Sequence[str], known: Sequence[str]) -> None:
    for name in found:
        if name not in known:
            raise InputError(f"{flag}: expected among {','.join(known)}, found {name!r}")
    if len(set(found)) < len(found) or (not found and flag == "--classes"):
        raise InputError(f"{flag}: expected each name once, found {','.join(found)!r}")


def parse_names(text: str) -> tuple[str, ...]:
    """ "Car,Van" -> ("Car", "Van")."""
    return tuple(part.strip() for part in text.split(","))


def parse_threshold(text: str) -> float | str:
    """A finite number or "best"."""
    if text == BEST:
        return BEST
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"--score_threshold: expected a number or {BEST!r}, found {text!r}")
    return value
