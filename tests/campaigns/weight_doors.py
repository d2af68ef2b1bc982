"""Damaged files of weights: a door is a function of a folder and a random generator."""

import io
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path

import keras
import numpy as np

from campaigns.file_doors import write_damaged
from campaigns.mutations import damaged, damaged_points
from common.config import to_dict
from models import checkpoint
from models.boxes.box_score import BoxScorer, load_scorer, save_scorer
from models.config import DetectorConfig
from models.weights import read_network
from training.config import DetectorTrainingConfig


@cache
def _weights() -> dict[str, bytes]:
    """A checkpoint of a small layer and a scorer, by file name."""
    scorer = BoxScorer("abc", 0.4, 0.5, ("votes", "range"), (2.0, 0.3), (1.0, 0.2), (1.5, -0.5))
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        meta = {
            "kind": "detector",
            "network": to_dict(DetectorConfig()),
            "config": to_dict(DetectorTrainingConfig()),
        }
        checkpoint.save(root / "detector.npz", meta, model=_variables())
        save_scorer(root, scorer)
        return {path.name: path.read_bytes() for path in root.iterdir()}


def _variables() -> dict[str, keras.Variable]:
    return {n: keras.Variable(np.ones(s, "f4"), name=n) for n, s in (("a", (3, 4)), ("b", (4,)))}


def checkpoints(folder: Path, rng: np.random.Generator) -> None:
    """Checkpoints: damaged bytes, damaged meta in a whole archive, and other arrays."""
    path, good = folder / "detector.npz", _weights()["detector.npz"]
    if rng.random() < 0.4:
        write_damaged(path, good, rng)
    else:
        with np.load(io.BytesIO(good)) as file:
            arrays = {name: file[name] for name in file.files}
        if rng.random() < 0.7:
            arrays["meta"] = np.frombuffer(damaged(arrays["meta"].tobytes(), rng), np.uint8)
        else:
            name = ("model/a", "model/b")[rng.integers(2)]
            kind = ("f8", "i1", "c8", "U3", "?")[rng.integers(5)]
            values = damaged_points(rng, 5).ravel()[: rng.integers(0, 13)]
            with np.errstate(invalid="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                arrays[name] = (values.reshape(3, 4) if len(values) == 12 else values).astype(kind)
        with path.open("wb") as file:
            np.savez(file, **arrays)
    _, _, arrays = read_network(path, "detector")
    checkpoint.restore(path, arrays, model=_variables())


def scorers(folder: Path, rng: np.random.Generator) -> None:
    """The file of the boxes' scores: accepted ones give probabilities."""
    write_damaged(folder / "scorer.json", _weights()["scorer.json"], rng)
    scorer = load_scorer(folder, "abc")
    scores = scorer.scores({"votes": np.array([1.0, 9.0]), "range": np.array([0.1, 2.0])})
    assert ((scores >= 0) & (scores <= 1)).all()


WEIGHT_DOORS: tuple[Callable[[Path, np.random.Generator], None], ...] = (checkpoints, scorers)
