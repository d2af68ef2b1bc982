"""Parameters of the decoding of per-point predictions into boxes (models/boxes/box_decoding.py).

    python -m studies.decoding_parameters --data_root DIR --seqs 0011 --weights FILE --out DIR

Runs the detector once over frames of a held-out training sequence, on the points that it gets in
tracking, and decodes with one parameter changed at a time. The metric is 1 - (misses + false
boxes) / true boxes at 3-D IoU 0.5: MOTA without identity switches. The least score is the best of a
sweep. Writes decoding_parameters.md and .json.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tensorflow as tf

from common.flags import non_negative_float, non_negative_int, positive_int, run
from common.markdown import markdown
from common.progress import progress
from evaluation.scene import Scene, open_scenes
from experiments.record import data_record
from experiments.runs import make_parser, write
from kitti.iou import iou_3d
from kitti.object_shift import ObjectShift
from kitti.objects import VEHICLES
from metrics.scored_boxes import HIT, outcomes_of
from models.boxes.box_decoding import decode_detections
from models.config import DecodingConfig
from models.detector import BoxPredictions, detector_inputs
from models.inference import sample_scan
from models.probability_filter import foreground_probability
from models.weight_files import weights_sha256
from models.weights import load_detector

TRIALS: dict[str, tuple] = {
    "min_probability": (0.2, 0.3, 0.4, 0.5, 0.6),
    "cell": (0.3, 0.5, 1.0),
    "proposals_per_cell": (10, 20, 40, 80),
    "nms_iou": (0.02, 0.1, 0.2),
    "vote_iou": (0.3, 0.4, 0.5, 0.6),
    "score_prior": (0.0, 2.0, 4.0, 8.0, 16.0),
}
LEAST_SCORES = np.arange(0.0, 0.8, 0.025)
MIN_IOU = 0.5
COLUMNS = ("accuracy", "recall", "precision", "min_score")


class Frame(NamedTuple):
    """Predictions at the likely foreground points of one frame, and its labelled boxes."""

    query: np.ndarray  # (1, Q, 3) metres, level frame
    predictions: BoxPredictions  # (1, Q, ...)
    truth: np.ndarray  # (M, 7) level boxes of vehicles


def predict(detector, detect, points: np.ndarray, truth: np.ndarray, rng) -> Frame:
    """One frame through the detector; points below every trial's min_probability are dropped."""
    xyz = sample_scan(points, detector.config, None, rng)
    found = tf.nest.map_structure(lambda x: x.numpy(), detect(xyz))
    probability = foreground_probability(tf.constant(found.mask_logits)).numpy()[0]
    likely = probability >= min(TRIALS["min_probability"])
    kept = tf.nest.map_structure(lambda x: x[:, likely], found)
    return Frame(xyz[:, likely], kept, truth)


def frames_of(scenes: list[Scene], detector, every: int, seed: int) -> list[Frame]:
    """Every `every`-th frame with a scan."""
    specification = [tf.TensorSpec([1, None, 3], tf.float32)]

    @tf.function(input_signature=specification, jit_compile=False)
    def detect(xyz):
        return detector(detector_inputs(xyz, detector.config), training=False).boxes

    chosen = [(s, t) for s in scenes for t in s.frames[::every]]
    frames = []
    for scene, t in progress(chosen, len(chosen), "detector", "frames"):
        points, truth = scene.points(t), scene.objects.at(t).of_classes(VEHICLES).boxes
        if points is not None and len(points):
            rng = np.random.default_rng([seed, int(scene.name), t])
            frames.append(predict(detector, detect, points, truth, rng))
    return frames


def score(frames: list[Frame], box, config: DecodingConfig) -> dict[str, float]:
    """Recall, precision and accuracy at the least score that gives the best accuracy."""
    total, hits, scores = 0, [], []
    everything = dataclasses.replace(config, min_score=0.0)
    for frame in frames:
        found = decode_detections(frame.query, frame.predictions, box, everything)[0]
        total += len(frame.truth)
        hits.append(_hits(frame.truth, found.boxes))
        scores.append(found.scores)
    hit, value = np.concatenate(hits), np.concatenate(scores)
    best = {"accuracy": -np.inf}
    for least in LEAST_SCORES:
        kept = value >= least
        right, found = int(hit[kept].sum()), int(kept.sum())
        accuracy = 1 - (total - right + found - right) / max(total, 1)
        if accuracy > best["accuracy"]:
            recall, precision = right / max(total, 1), right / max(found, 1)
            best = {
                "accuracy": accuracy,
                "recall": recall,
                "precision": precision,
                "min_score": float(least),
            }
    return best


def _hits(truth: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """(K,) bool: boxes, best first, that match a true box one-to-one."""
    falling, counted = -np.arange(len(boxes)), np.ones(len(truth), bool)
    ignorable = np.zeros(len(boxes), bool)
    return outcomes_of(iou_3d(truth, boxes), falling, counted, ignorable, MIN_IOU)[0] == HIT


def main(argv: Sequence[str] | None = None) -> None:
    """Parses the flags, decodes with every trial, writes the table."""
    parser = make_parser(__doc__, "0011")
    add = parser.add_argument
    add("--weights", type=Path, default=Path("weights/detector.npz"), help="detector checkpoint")
    add("--every", type=positive_int, default=5, help="take every n-th frame")
    shift = ("--object_shift", "--displacement")
    add(*shift, type=non_negative_float, default=0.0, help="of objects, at most, metres")
    add("--seed", type=non_negative_int, default=0, help="of sampling and object shift")
    args = parser.parse_args(argv)
    shift = ObjectShift(args.object_shift, args.seed) if args.object_shift else None
    scenes = open_scenes(args.data_root, args.seqs, shift=shift)
    detector = load_detector(args.weights)
    frames = frames_of(scenes, detector, args.every, args.seed)
    default, rows = DecodingConfig(), []
    trials: list[tuple[str, Any]] = [(n, v) for n, values in TRIALS.items() for v in values]
    for name, value in progress(trials, len(trials), "decoding", "trials"):
        config = dataclasses.replace(default, **{name: value})
        rows.append((name, value, score(frames, detector.config.box, config)))
    figures = [{"parameter": name, "value": value, **best} for name, value, best in rows]
    details = {
        "data": [data_record(args.data_root, args.seqs)],
        "weights_sha256": weights_sha256(args.weights.parent, [args.weights.name]),
    }
    write(args.out, "decoding_parameters", "Decoding", _table(default, rows), figures, **details)


def _table(default: DecodingConfig, rows) -> str:
    lines = []
    for name, value, best in rows:
        star = " *" if value == getattr(default, name) else ""
        metrics = (f"{best[key]:.3f}" for key in COLUMNS)
        lines.append([name, f"{value}{star}", *metrics])
    header = ["parameter", "value", *COLUMNS[:-1], "at min_score"]
    return markdown(header, lines) + "\n* the default.\n"


if __name__ == "__main__":
    raise SystemExit(run(main))
