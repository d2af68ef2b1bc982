"""The score of a box: the probability that it is right at 3-D IoU 0.5 (a choice of ours).

A logistic regression on the features of the box's cluster. `python -m training.calibrate` fits it
on labelled scans for one detector; it is stored beside the detector as scorer.json.

Letters: K boxes, F features.
"""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from common.config import from_dict, parse_json, to_dict
from common.errors import InputError
from common.files import read_bytes, write_json
from common.notes import report
from models.config import DecodingConfig

FILE_NAME = "scorer.json"
FORMAT = 1
LARGEST = 700.0  # logit whose exponential is still finite
MIN_SCALE = 1e-9
MANY = {"most_items": 1000}  # two for each channel of FC1, and some


@dataclass(frozen=True)
class BoxScorer:
    """A logistic regression on standardised features, and the threshold chosen for its scores.

    Attributes:
        detector_sha256: content hash of the detector whose boxes it scores.
        min_score: the default least score of a box that is kept.
        bias: logit of a box whose features are all at their means.
        features: F names, see `models.boxes.cluster_features`.
        mean, scale, weight: F values each; scale is positive, weight is of the scaled feature.
        format: of the file.
    """

    detector_sha256: str
    min_score: float
    bias: float
    features: tuple[str, ...] = field(metadata=MANY)
    mean: tuple[float, ...] = field(metadata=MANY)
    scale: tuple[float, ...] = field(metadata=MANY)
    weight: tuple[float, ...] = field(metadata=MANY)
    format: int = FORMAT

    def scores(self, features: Mapping[str, np.ndarray]) -> np.ndarray:
        """Features by name, each (K,) -> (K,) float64 probabilities.

        Raises:
            InputError: the scorer needs a feature that is not among them.
        """
        unknown = [name for name in self.features if name not in features]
        if unknown:
            raise InputError(f"{FILE_NAME}: unknown feature {unknown[0]!r}")
        values = np.array([features[name] for name in self.features]).T
        mean, scale, weight = self._arrays
        logits = (values - mean) / scale @ weight + self.bias
        return 1 / (1 + np.exp(-np.clip(logits, -LARGEST, LARGEST)))

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        return tuple(np.array(values) for values in (self.mean, self.scale, self.weight))


def save_scorer(folder: str | Path, scorer: BoxScorer) -> Path:
    """Writes scorer.json into a folder of weights; returns its path."""
    path = Path(folder) / FILE_NAME
    write_json(path, to_dict(scorer))
    return path


def default_min_score(folder: str | Path) -> float:
    """Least score of a box of these weights: that of scorer.json, without one the decoding's."""
    path = Path(folder) / FILE_NAME
    if not os.path.lexists(path):
        return DecodingConfig().min_score
    return _read(path).min_score


def load_scorer(folder: str | Path, detector_sha256: str) -> BoxScorer | None:
    """The scorer in a folder of weights; None, with a note on stderr, without one.

    Raises:
        InputError: broken, of another format, or fitted for another detector.
    """
    path = Path(folder) / FILE_NAME
    if not os.path.lexists(path):
        report(f"{path}: not found, boxes are scored by agreement")
        return None
    scorer = _read(path)
    if scorer.detector_sha256 != detector_sha256:
        raise InputError("this scorer was fitted for another detector", path)
    return scorer


def _read(path: Path) -> BoxScorer:
    """Reads and checks the file; raises InputError."""
    values = parse_json(read_bytes(path), path)
    scorer: BoxScorer = from_dict(BoxScorer, values, path)
    count = len(scorer.features)
    if scorer.format != FORMAT:
        raise InputError(f"expected scorer format {FORMAT}, found {scorer.format}", path)
    if not count == len(scorer.mean) == len(scorer.scale) == len(scorer.weight):
        raise InputError(f"expected {count} means, scales and weights", path)
    numbers = (scorer.bias, *scorer.mean, *scorer.scale, *scorer.weight)
    if not all(map(math.isfinite, numbers)) or min(scorer.scale, default=1.0) < MIN_SCALE:
        expected = f"expected finite numbers and positive scales of at least {MIN_SCALE}"
        raise InputError(expected, path)
    if not 0 <= scorer.min_score <= 1:
        raise InputError(f"min_score: expected within [0, 1], found {scorer.min_score}", path)
    return scorer
