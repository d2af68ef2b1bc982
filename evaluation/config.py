"""Evaluation settings, validated on construction."""

import argparse
from collections.abc import Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path

from common.config_flags import option
from common.errors import InputError
from common.flags import finite_float, non_negative_float, non_negative_int
from evaluation.scene import Scene, open_scenes
from kitti.camera_view import parse_image_size
from kitti.object_shift import MAX_DISTANCE, ObjectShift
from kitti.objects import CLASSES, VEHICLES, class_name
from kitti.seqmap import MAX_SEQ, TEST, VAL, parse_sequences
from metrics.kitti_rules import rules_for
from metrics.protocols import CLEAR3D, PROTOCOLS
from models.boxes.box_score import default_min_score
from tracking import PREDICTED_MOTION, TRACKERS

GROUND_TRUTH = "gt"
NETWORK = "network"
BEST = "best"
"""--score_threshold of the best MOTA, see docs/EVALUATION.md."""


def parse_names(text: str) -> tuple[str, ...]:
    """ "Car,Van" -> ("Car", "Van")."""
    return tuple(part.strip() for part in text.split(","))


def parse_threshold(text: str) -> float | str:
    """argparse type: a finite number or "best"."""
    if text == BEST:
        return BEST
    try:
        return finite_float(text)
    except argparse.ArgumentTypeError:
        message = f"expected a number or {BEST!r}, found {text!r}"
        raise argparse.ArgumentTypeError(message) from None


def parse_seqs(text: str) -> tuple[int, ...]:
    """argparse type: "0016-0020" or "0000,0003"."""
    try:
        return tuple(parse_sequences(text))
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


@dataclass(frozen=True)
class EvaluateConfig:
    """Settings of evaluate.py, one flag per field.

    `seqs` None becomes the paper's validation split, or all of testing; `protocols` None becomes
    clear3d, in testing none; `out` None writes nothing.
    """

    data_root: Path = option(MISSING, "folder in KITTI's tracking layout")
    subset: str = option("training", "training or testing (which has no labels)")
    seqs: tuple[int, ...] | None = option(
        None, "such as 0016-0020 or 0000,0003 (default: 0016-0020; testing: all)", parse_seqs
    )
    classes: tuple[str, ...] = option(
        VEHICLES, "tracked; both sides in clear3d, the other protocols take one each", parse_names
    )
    detections: str = option(GROUND_TRUTH, f"{GROUND_TRUTH}, {NETWORK} or a folder of files")
    tracker: str = option("gt_displacement", f"one of {', '.join(TRACKERS)}")
    weights: Path = option(Path("weights"), "folder of the networks' weights")
    image_size: str | None = option(
        None, "of the camera, such as 1242x375 (default: from the calibration)"
    )
    results: Path | None = option(None, "evaluate the result files of this folder, run no tracker")
    object_shift: float = option(
        0.0,
        "every object is shifted at random by up to this many metres (section IV.D)",
        non_negative_float,
        ("object_shift", "displacement"),
        least=0.0,
        most=MAX_DISTANCE,
    )
    seed: int = option(0, "of the object shift", non_negative_int, least=0, most=2**63 - 1)
    protocols: tuple[str, ...] | None = option(
        None,
        f"of {','.join(PROTOCOLS)} (default: clear3d; testing: none)",
        parse_names,
        ("protocol",),
        least_items=0,
    )
    iou: float = option(
        0.5, "least 3-D IoU of a match in clear3d, clear3d_dontcare, kitti3d", finite_float
    )
    score_threshold: str | float | None = option(
        None,
        "least score of a box (default: network boxes that of the weights, others none); of "
        "--results, least mean score of a track; best: of a track, by MOTA of the first --protocol",
        parse_threshold,
    )
    out: Path | None = option(None, "folder for the output (default: results/evaluate)")

    def __post_init__(self):
        testing = self.subset == "testing"
        if self.seqs is None:
            object.__setattr__(self, "seqs", TEST if testing else VAL)
        if self.protocols is None:
            object.__setattr__(self, "protocols", () if testing else ("clear3d",))
        if len(set(self.seqs)) < len(self.seqs) or not all(0 <= s <= MAX_SEQ for s in self.seqs):
            expected = f"expected numbers from 0 to {MAX_SEQ}, each once"
            raise InputError(f"--seqs: {expected}, found {list(self.seqs)}")
        _among("--subset", [self.subset], ("training", "testing"))
        object.__setattr__(self, "classes", tuple(class_name(name) for name in self.classes))
        _among("--classes", self.classes, [name for name in CLASSES if name != "DontCare"])
        _among("--tracker", [self.tracker], TRACKERS)
        _among("--protocol", self.protocols, PROTOCOLS)
        for name in self.protocols:
            if name not in CLEAR3D:
                rules_for(name, self.classes)
        if self.score_threshold == BEST and not self.protocols:
            raise InputError("--score_threshold best is that of a --protocol, found none")
        if self.image_size is not None:
            parse_image_size(self.image_size)
        if not 0 < self.iou <= 1:
            raise InputError(f"--iou: expected above 0 and at most 1, found {self.iou}")
        ObjectShift(self.object_shift, self.seed)  # raises where one is out of range
        if isinstance(self.score_threshold, str) and self.score_threshold != BEST:
            found = repr(self.score_threshold)
            raise InputError(f"--score_threshold: expected a number or {BEST!r}, found {found}")
        if testing:
            self._check_testing()
        self._check_object_shift()

    @property
    def shift(self) -> ObjectShift | None:
        """The object shift, None for none."""
        return ObjectShift(self.object_shift, self.seed) if self.object_shift else None

    def open_scenes(self, shift: ObjectShift | None = None) -> list[Scene]:
        """The sequences as scenes, under the given shift or that of the settings."""
        size = None if self.image_size is None else parse_image_size(self.image_size)
        return open_scenes(self.data_root, self.seqs, self.subset, shift or self.shift, size)

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
        if self.object_shift:
            raise InputError("--subset testing has no labels: objects cannot be shifted")

    def _check_object_shift(self):
        in_image = [name for name in self.protocols if name not in CLEAR3D]
        if self.object_shift and in_image:
            raise InputError(
                f"--object_shift moves objects away from their image: {','.join(in_image)} "
                f"cannot be evaluated, only {','.join(CLEAR3D)}"
            )

    @property
    def min_box_score(self) -> float | None:
        """Least score of a box that is tracked; None for all."""
        if self.results is not None:
            return None
        if isinstance(self.score_threshold, float | int):
            return float(self.score_threshold)
        return default_min_score(self.weights) if self.detections == NETWORK else None

    @property
    def min_track_score(self) -> float | str | None:
        """Least mean score of a track that is evaluated: a number, "best", or None for all."""
        if self.score_threshold == BEST or self.results is not None:
            return self.score_threshold
        return None

    @property
    def needs_network(self) -> bool:
        """True if the networks run, for their boxes or for their displacement."""
        return self.results is None and (
            self.detections == NETWORK or self.tracker in PREDICTED_MOTION
        )


def _among(flag: str, found: Sequence[str], known: Sequence[str]) -> None:
    for name in found:
        if name not in known:
            raise InputError(f"{flag}: expected among {','.join(known)}, found {name!r}")
    if len(set(found)) < len(found) or (not found and flag == "--classes"):
        raise InputError(f"{flag}: expected each name once, found {','.join(found)!r}")
