"""Tables III and IV: a tracker trained and evaluated for each row and seed.

All rows train on the same stored pairs, on the same frozen detector, with the same schedule; a seed
sets the initial weights and the order of the pairs. The last checkpoint is evaluated: no choice
depends on the evaluated sequences. Each tracker is evaluated on the detector's boxes and on true
ones, at displacement 0 and 2 m (one draw of the object shift; the spread is that of the trainings).
Both tables share a workdir and their common row. It stores trainings, outputs of the detector and
metrics; an interrupted table resumes, and two processes with one workdir share the trainings. A
workdir is refused where settings, networks, scans or the code that measures have changed.
"""

import argparse
import gc
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from common import flags
from common.config import to_dict
from common.config_flags import add_flags, from_flags
from common.errors import InputError
from common.files import locked, write_json
from common.provenance import ROOT, git_commit
from common.steps import key_of
from evaluation.config import GROUND_TRUTH, NETWORK, EvaluateConfig
from evaluation.detections import DetectionProvider, LabelBoxesWithPredictedMotion
from evaluation.network_cache import code_digest, digest_of_data
from evaluation.run import check_writable, evaluate
from evaluation.scene import Scene
from experiments.ablation.table import draw, text_of
from experiments.evaluate_networks import end_point_errors
from experiments.runs import write
from kitti.seqmap import parse_sequences
from models.config import TrackerConfig
from models.weight_files import DETECTOR, SCORER, weights_sha256
from training.config import AugmentationConfig, ScheduleConfig, TrackerTrainingConfig
from training.sampling.data import TrainingData, add_data_flags, open_data

DISTANCES = (0.0, 2.0)
TABLE_FIELDS = ("fusion", "fusion_keeps_features", "fused_features")
MODULES = (
    "training.loop",
    "training.training_run",
    "training.strategies",
    "training.stored_pairs",
    "evaluation.run",
    "experiments.ablation.stored_frames",
)
"""What they import shapes the metrics of a row, as these files do; text and plot do not."""
FILES = (Path(__file__), ROOT / "experiments" / "evaluate_networks.py")


@dataclass(frozen=True)
class Row:
    """A tracker of the table: fields of `TrackerConfig`, and its name in the paper's table."""

    name: str
    tracker: dict[str, Any]
    paper: str | None = None

    @property
    def folder(self) -> str:
        """The folder of its trainings, the same in both tables."""
        tracker = replace(TrackerConfig(), **self.tracker)
        alone = "" if tracker.fusion_keeps_features else "-alone"
        return f"{tracker.fused_features}-{tracker.fusion}{alone}"


@dataclass(frozen=True)
class Ablation:
    """One table: its file name, its title, its rows, and the paper's, name -> MOTA, ..., ML."""

    name: str
    title: str
    rows: tuple[Row, ...]
    paper: dict[str, tuple[float, ...]] = field(default_factory=dict)


def default_config() -> TrackerTrainingConfig:
    """The training of a row: short, on a tracker of a fifth of the points.

    N', the points of SA1 and SA2 and K are 1000, 512, 256 and 32 instead of 5000, 2048, 512 and 64,
    so that K is the same share of the points of SA2.
    """
    sa1, sa2 = TrackerConfig().set_abstraction
    return TrackerTrainingConfig(
        tracker=TrackerConfig(
            num_kept_points=1000,
            set_abstraction=(replace(sa1, num_points=512), replace(sa2, num_points=256)),
            association_neighbors=32,
        ),
        augmentation=AugmentationConfig(object_shift_share=0.7, single_scan_pairs=True),
        schedule=ScheduleConfig(
            epochs=1,
            frames_per_epoch=2000,
            batch_size=4,
            cycle_epochs=1,
            learning_rate_max=1.5e-3,
            frozen_batch_norm_from=0.5,
            keep_checkpoints=1,
        ),
    )


def run_ablation(table: Ablation, doc: str, argv: Sequence[str] | None = None) -> None:
    """Parses the flags, trains and evaluates the rows, writes table and picture."""
    args = parse(table, doc, argv)
    config, data = from_flags(default_config(), args), open_data(args)
    check_writable(args.out)
    settings = check_settings(args, config, data)
    records = measure_rows(table, args, config, data)
    figures = {name: [each["metrics"] for each in found] for name, found in records.items()}
    commits = dict.fromkeys(each["git_commit"] for found in records.values() for each in found)
    paper = {row.name: table.paper[row.paper] for row in table.rows if row.paper}
    text = text_of(figures, paper, config.schedule)
    measured = {"settings": settings, "rows": figures}
    write(args.out, table.name, table.title, text, measured, row_commits=list(commits))
    draw(args.out / f"{table.name}.png", table.title, figures, paper)


def parse(table: Ablation, doc: str, argv: Sequence[str] | None) -> argparse.Namespace:
    """Data, weights, folders, and one flag for each field of the tracker's training."""
    parser = flags.ArgumentParser(description=doc.split("\n", maxsplit=1)[0], epilog=COST)
    add = parser.add_argument
    add_data_flags(parser)
    add("--weights", type=Path, required=True, help="folder of the frozen detector (and its score)")
    add("--workdir", type=Path, required=True, help="trainings, stored outputs, metrics")
    add("--out", type=Path, required=True, help=f"folder of {table.name}.md, .json and .png")
    add("--seeds", type=flags.positive_int, default=3, help="trainings of each row")
    add_flags(parser, default_config())
    args = parser.parse_args(argv)
    if len(args.val_data_root or []) > 1 or len(args.val_seqs or []) > 1:
        raise InputError("--val_data_root, --val_seqs: expected one, on which rows are evaluated")
    args.val_seqs = args.val_seqs or ["0016-0020"]
    tracker = from_flags(default_config(), args).tracker
    for name in TABLE_FIELDS:
        if getattr(tracker, name) != getattr(TrackerConfig(), name):
            raise InputError(f"--tracker.{name}: belongs to the rows of the tables")
    return args


COST = (
    "On two cores, with the defaults: about 9 minutes a row and seed to train, 1 to evaluate; "
    "30 minutes once for the detector's outputs; 4 MB of disk for each pair, 2 for each frame. "
    "Two processes of one thread each, on one workdir, take a sixth less than one of two."
)


def check_settings(
    args: argparse.Namespace, config: TrackerTrainingConfig, data: TrainingData
) -> dict[str, Any]:
    """Settings of all rows; refuses a workdir with rows of other settings."""
    if not (args.weights / DETECTOR).is_file():
        raise InputError("--weights: expected a checkpoint file", args.weights / DETECTOR)
    shared = to_dict(config)
    for name in TABLE_FIELDS:
        del shared["tracker"][name]
    sequences = (*data.training, *data.validation)
    settings = {
        "config": shared,
        "data": data.record(),
        "scans": key_of([digest_of_data(Scene(sequence)) for sequence in sequences]),
        "weights_sha256": weights_sha256(args.weights, (DETECTOR, SCORER)),
        "code": key_of(code_digest(), modules=MODULES, files=FILES),
    }
    path = args.workdir / "settings.json"
    if path.is_file():
        found = json.loads(path.read_text(encoding="utf-8"))
        other = [key for key in settings if settings[key] != found.get(key)]
        if other:
            raise InputError(f"holds rows with another {', '.join(other)}: another --workdir", path)
    write_json(path, settings)
    return settings


def measure_rows(
    table: Ablation, args: argparse.Namespace, config: TrackerTrainingConfig, data: TrainingData
) -> dict[str, list[dict[str, Any]]]:
    """Row -> commit and metrics of each seed; all rows of a seed before the next seed.

    What another process is measuring in the same workdir comes last.
    """
    found: dict[tuple[str, int], dict[str, Any]] = {}
    for wait in (False, True):
        for seed, row in product(range(args.seeds), table.rows):
            if (row.name, seed) in found:
                continue
            with locked(row_folder(row, seed, args) / "lock", wait) as held:
                if held:
                    print(f"{table.name}: {row.name}, seed {seed}", flush=True)
                    found[row.name, seed] = measure_row(row, seed, args, config, data)
    return {row.name: [found[row.name, seed] for seed in range(args.seeds)] for row in table.rows}


def row_folder(row: Row, seed: int, args: argparse.Namespace) -> Path:
    """Training and metrics of a row and seed."""
    return args.workdir / row.folder / f"seed{seed}"


def measure_row(
    row: Row, seed: int, args: argparse.Namespace, config: TrackerTrainingConfig, data: TrainingData
) -> dict[str, Any]:
    """Commit and metrics of a row and seed, from their file or by training and evaluation."""
    folder = row_folder(row, seed, args)
    path = folder / "metrics.json"
    if path.is_file():
        return json.loads(path.read_text(encoding="utf-8"))
    import keras

    commit = git_commit()
    own = replace(
        config,
        tracker=replace(config.tracker, **row.tracker),
        schedule=replace(config.schedule, seed=seed),
    )
    checkpoint = train_row(own, folder, args, config, data)
    record = {"git_commit": commit, "metrics": evaluate_row(checkpoint, folder, args)}
    write_json(path, record)
    keras.utils.clear_session()  # graphs of this row
    gc.collect()
    return record


def train_row(
    own: TrackerTrainingConfig, folder: Path, args, config: TrackerTrainingConfig, data
) -> Path:
    """Trains a row, unless it is trained; returns its last checkpoint."""
    from models.weights import load_detector  # TensorFlow only where it is needed
    from training.checkpoint_folder import CHECKPOINTS, CheckpointFolder
    from training.loop import run_training
    from training.sampling.pipeline import make_order
    from training.stored_pairs import StoredPairsTask, store_pairs
    from training.strategies import make_strategy, seed_everything
    from training.tracker_task import TrackerTask
    from training.training_run import start

    workdir, schedule = folder / "training", own.schedule
    detector, pairs = args.weights / DETECTOR, args.workdir / "pairs"
    task = TrackerTask(config, load_detector(detector), data.training, [])
    size = schedule.batch_size
    order = make_order(task.samples.items, data.pools, 0, size, config.schedule.seed)
    count = schedule.frames_per_epoch or len(task.samples.items)
    with locked(pairs / "lock"):
        store_pairs(task, order, count, pairs)
    seed_everything(schedule.seed, deterministic=False)
    run = start(
        lambda: StoredPairsTask(own, load_detector(detector), pairs, count),
        make_strategy("one"),
        workdir,
        {**data.record(), "pairs": count},
    )
    resume = (workdir / "config.json").is_file()
    try:
        run_training(run, resume)
    finally:
        run.close()
    checkpoints = CheckpointFolder(workdir / CHECKPOINTS)
    return checkpoints.path(checkpoints.steps()[-1])


def evaluate_row(checkpoint: Path, folder: Path, args: argparse.Namespace) -> list[dict[str, Any]]:
    """`clear3d` and end-point error for each kind of boxes and displacement."""
    from experiments.ablation.stored_frames import StoredDetections, store_frames
    from models.boxes.box_score import load_scorer
    from models.inference import StreamingNetwork
    from models.weights import load_detector, load_tracker, network_hash

    detector = load_detector(args.weights / DETECTOR)
    scorer = load_scorer(args.weights, network_hash(detector))
    tracker = load_tracker(checkpoint, detector)
    count = detector.config.num_points  # as the stored pairs
    network = StreamingNetwork(detector, tracker, scorer, min_score=0.0, max_points=count)
    figures = []
    for distance in DISTANCES:
        settings = EvaluateConfig(
            data_root=Path((args.val_data_root or args.data_root)[0]),
            seqs=tuple(parse_sequences(args.val_seqs[0])),
            tracker="pointtracknet_published",  # the rows differ by the displacement alone
            weights=args.weights,
            object_shift=distance,
        )
        scenes = settings.open_scenes()
        frames = args.workdir / "frames" / f"D{distance:g}"
        with locked(frames / "lock"):
            store_frames(network, scenes, frames, f"detector, D = {distance:g} m")
        found = StoredDetections(network, frames)
        errors = np.concatenate([end_point_errors(scene, found) for scene in scenes])
        providers: dict[str, DetectionProvider] = {
            NETWORK: found,
            GROUND_TRUTH: LabelBoxesWithPredictedMotion(found),
        }
        for boxes, provider in providers.items():
            out = folder / f"{boxes}-{distance:g}m"
            record = evaluate(replace(settings, detections=boxes, out=out), provider=provider)
            figures.append(
                {
                    "boxes": boxes,
                    "displacement": distance,
                    "end_point_error": float(errors.mean()) if len(errors) else None,
                    "clear3d": record["clear3d"]["overall"],
                }
            )
    return figures
