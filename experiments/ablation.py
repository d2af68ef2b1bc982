"""Tables III and IV: a tracker trained and evaluated for each value of one choice.

Every row starts from the same seed and sees the same samples in the same order on the same frozen
detector; its last checkpoint is taken, so nothing is chosen on the sequences of the table. Each is
evaluated with the detector's boxes and with the true ones, at displacement 0 and 2 m. A trained
row is skipped the next time, an interrupted one goes on; the networks' outputs are kept too.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from common import flags
from common.config import to_dict
from common.config_flags import add_flags
from common.errors import InputError
from common.files import write_bytes, write_json
from common.markdown import markdown
from evaluation.config import GROUND_TRUTH, NETWORK, EvaluateConfig
from evaluation.detections import DetectionProvider, LabelBoxesWithPredictedMotion
from evaluation.network_cache import CachedPredictions
from evaluation.run import check_writable, evaluate
from experiments.evaluate_networks import end_point_errors
from experiments.paper import ABLATION_COLUMNS
from experiments.runs import write
from kitti.seqmap import parse_sequences
from models.config import DecodingConfig
from training.command_line import configured, defaults, train
from training.config import TrackerTrainingConfig
from training.sampling.data import add_data_flags, open_data

DISTANCES = (0.0, 2.0)
BOXES = {NETWORK: "network boxes", GROUND_TRUTH: "true boxes"}


@dataclass(frozen=True)
class Ablation:
    """One table.

    Attributes:
        name: of its files; title: above it.
        field: of `TrackerConfig`, which the rows differ in.
        rows: name in the paper -> value of the field.
        paper: name -> the paper's numbers (`ABLATION_COLUMNS`).
    """

    name: str
    title: str
    field: str
    rows: dict[str, str]
    paper: dict[str, tuple[float, ...]]


def run_ablation(table: Ablation, doc: str, argv: Sequence[str] | None = None) -> None:
    """Parses the flags, trains and evaluates the rows, writes the table."""
    args = parse(table, doc, argv)
    check_writable(args.out)
    settings = check_settings(table, args)
    figures = {}
    for number, (name, value) in enumerate(table.rows.items(), start=1):
        print(f"{table.name}, row {number} of {len(table.rows)}: {name}", flush=True)
        folder = args.workdir / value
        train_row(table, args, name, folder)
        figures[name] = evaluate_row(args, folder)
    record = {"settings": settings, "rows": figures}
    write(args.out, table.name, table.title, text_of(table, args, figures), record)


def parse(table: Ablation, doc: str, argv: Sequence[str] | None) -> argparse.Namespace:
    """Data, detector, folders, and one flag for each field of the tracker's training."""
    parser = flags.ArgumentParser(description=doc.split("\n", maxsplit=1)[0])
    add = parser.add_argument
    add_data_flags(parser)
    add("--detector", type=Path, required=True, help="checkpoint of the frozen detector")
    add("--workdir", type=Path, required=True, help="trainings, weights and network outputs")
    add("--out", type=Path, required=True, help=f"folder of {table.name}.md and {table.name}.json")
    add("--smoke", action="store_true", help="a few steps a row, to see that it runs")
    add("--deterministic", action="store_true", help="the same bits in every run")
    add("--score_threshold", type=flags.finite_float, help="least score of a box")
    add_flags(parser, TrackerTrainingConfig())
    args = parser.parse_args(argv)
    if len(args.val_data_root or []) > 1 or len(args.val_seqs or []) > 1:
        raise InputError("--val_data_root, --val_seqs: expected one, on which rows are evaluated")
    args.val_seqs = args.val_seqs or ["0016-0020"]
    default = getattr(TrackerTrainingConfig().tracker, table.field)
    if getattr(configured(args, TrackerTrainingConfig()).tracker, table.field) != default:
        raise InputError(f"--tracker.{table.field}: is what the rows differ in")
    return args


def check_settings(table: Ablation, args: argparse.Namespace) -> dict[str, Any]:
    """Settings that all rows share; refuses a workdir whose rows had others."""
    if not args.detector.is_file():
        raise InputError("--detector: expected a checkpoint file", args.detector)
    config = to_dict(configured(args, TrackerTrainingConfig()))
    del config["tracker"][table.field]
    settings = {
        "config": config,
        "data": open_data(args).record(),
        "detector_sha256": hashlib.sha256(args.detector.read_bytes()).hexdigest(),
    }
    path = args.workdir / "settings.json"
    if path.is_file():
        found = json.loads(path.read_text(encoding="utf-8"))
        other = [key for key in settings if settings[key] != found.get(key)]
        if other:
            raise InputError(f"holds rows with another {', '.join(other)}: another --workdir", path)
    write_json(path, settings)
    return settings


def train_row(table: Ablation, args: argparse.Namespace, name: str, folder: Path) -> None:
    """Trains a row to its end, unless that is done: folder/weights holds both networks then."""
    weights, workdir = folder / "weights", folder / "training"
    if (weights / "tracker.npz").is_file():
        return
    row = defaults(TrackerTrainingConfig())
    vars(row).update(vars(args))
    row.workdir, row.resume = workdir, (workdir / "config.json").is_file()
    setattr(row, f"tracker.{table.field}", table.rows[name])
    from models.weights import load_detector
    from training.checkpoint_folder import CheckpointFolder  # TensorFlow only where it is needed
    from training.tracker_task import TrackerTask
    from visualization.training_pictures import tracker_picture

    def task(config, training, validation):
        return TrackerTask(config, load_detector(args.detector), training, validation)

    config = configured(row, TrackerTrainingConfig())
    checkpoints = CheckpointFolder(workdir / "checkpoints", config.schedule.keep_checkpoints)
    if not _at_its_end(checkpoints, config.schedule.epochs) and train(
        row, task, config, tracker_picture
    ):
        raise InputError(f"{name}: the training diverged", workdir)
    last = checkpoints.path(checkpoints.steps()[-1])
    write_bytes(weights / "detector.npz", args.detector.read_bytes())
    write_bytes(weights / "tracker.npz", last.read_bytes())


def _at_its_end(checkpoints, epochs: int) -> bool:
    """Whether the last checkpoint is that of the last epoch, metrics included."""
    from models.checkpoint import load

    steps = checkpoints.steps()
    return bool(steps) and load(checkpoints.path(steps[-1]))[0]["metrics"].get("epoch") == epochs


def evaluate_row(args: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """`clear3d` for either kind of boxes at each displacement, and the end-point error there."""
    cached = CachedPredictions(folder / "network_cache", folder / "weights")
    figures = []
    for distance in DISTANCES:
        config = EvaluateConfig(
            data_root=Path((args.val_data_root or args.data_root)[0]),
            seqs=tuple(parse_sequences(args.val_seqs[0])),
            tracker="pointtracknet",
            weights=folder / "weights",
            object_shift=distance,
        )
        scenes = config.open_scenes()
        cached.fill_all(scenes, f"D = {distance:g} m")
        errors = np.concatenate([end_point_errors(scene, cached) for scene in scenes])
        providers: dict[str, DetectionProvider] = {
            NETWORK: cached,
            GROUND_TRUTH: LabelBoxesWithPredictedMotion(cached),
        }
        for boxes, provider in providers.items():
            chosen = replace(
                config,
                detections=boxes,
                score_threshold=args.score_threshold if boxes == NETWORK else None,
                out=folder / f"{boxes}-{distance:g}m",
            )
            figures.append(
                {
                    "boxes": boxes,
                    "displacement": distance,
                    "end_point_error": float(errors.mean()) if len(errors) else None,
                    "clear3d": evaluate(chosen, provider=provider)["clear3d"]["overall"],
                }
            )
    return figures


def text_of(table: Ablation, args: argparse.Namespace, figures: dict[str, list]) -> str:
    """The paper's columns beside the paper's rows, then MOTA and end-point errors everywhere."""
    lines, wide = [], []
    for name, settings in figures.items():
        first = settings[0]["clear3d"]
        lines.append([name, *(_cell(first[key]) for key in ABLATION_COLUMNS)])
        lines.append([f"paper: {name}", *(_cell(value) for value in table.paper[name])])
        errors = [s["end_point_error"] for s in settings if s["boxes"] == NETWORK]
        wide.append([name, *(_cell(s["clear3d"]["MOTA"]) for s in settings), *map(_cell, errors)])
    columns = [f"{BOXES[s['boxes']]}, {s['displacement']:g} m" for s in settings]
    columns += [f"error, {distance:g} m" for distance in DISTANCES]
    schedule = configured(args, TrackerTrainingConfig()).schedule
    samples = schedule.frames_per_epoch or "all"
    given = args.score_threshold
    least = DecodingConfig().min_score if given is None else given
    return (
        f"Network boxes at 0 m, `clear3d`, IoU 0.5, boxes of score {least:g} "
        f"or more. Each row one training: {schedule.epochs} epochs of {samples} pairs, seed "
        f"{schedule.seed}. The paper's rows are of KITTI's validation sequences.\n\n"
        + markdown(["", *ABLATION_COLUMNS], lines)
        + "\nMOTA with either boxes at both displacements, and the end-point error of the "
        "displacement on foreground points in metres:\n\n" + markdown(["", *columns], wide)
    )


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
