"""Flags, evaluations over seeds, and written files that experiments and studies share."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Hashable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, stdev
from typing import Any, TypeVar

from common import flags
from common.files import write_json, write_text
from common.progress import Progress
from common.provenance import provenance
from evaluation.config import GROUND_TRUTH, EvaluateConfig, parse_names, parse_seqs
from evaluation.run import check_writable, evaluate
from kitti.object_shift import DEFAULT_READING, ObjectShift

Key = TypeVar("Key", bound=Hashable)

WORKERS = 2
NICE = 5
TRACKER_NAMES = {
    "pointtracknet": "PointTrackNet",
    "pointtracknet_probation": "PointTrackNet, probation of 3",
    "sort": "SORT",
    "deep_sort": "DEEP_SORT",
    "ab3dmot": "AB3DMOT",
    "gt_displacement": "Algorithm 1, label motion",
}


def make_parser(doc: str, seqs: str = "0016-0020") -> flags.ArgumentParser:
    """Parser with --data_root, --seqs and --out, to which a script adds its own flags."""
    parser = flags.ArgumentParser(description=doc.split("\n", maxsplit=1)[0])
    parser.add_argument("--data_root", type=Path, required=True, help="KITTI's tracking layout")
    parser.add_argument("--seqs", type=parse_seqs, default=seqs, help="such as 0016-0020")
    parser.add_argument("--out", type=Path, required=True, help="folder for the files written")
    return parser


def add_shift_flags(parser: flags.ArgumentParser) -> None:
    """Adds --classes and --seeds."""
    add = parser.add_argument
    add("--classes", type=parse_names, default="Car", help="tracked, and evaluated on both sides")
    add("--seeds", type=flags.positive_int, default=5, help="of the object shift")


def common_fields(args: argparse.Namespace) -> dict[str, Any]:
    """Fields of `Run` that the flags give; checks that `--out` can be written."""
    check_writable(args.out)
    return {
        "data_root": args.data_root,
        "seqs": args.seqs,
        "classes": args.classes,
    }


def write(out: Path, name: str, title: str, tables: str, figures: Any, **details: Any) -> None:
    """Prints the tables; writes `name.md` and `name.json`, both with the command that made them.

    details: for the provenance, see `common.provenance`.
    """
    record = provenance(**details)
    write_text(out / f"{name}.md", f"# {title}\n\nMade by `{record['command']}`.\n\n{tables}")
    write_json(out / f"{name}.json", {"run": record, "figures": figures})
    print(tables, end="")


@dataclass(frozen=True)
class Run:
    """One `clear3d` evaluation of one tracker; fields as in `EvaluateConfig`."""

    data_root: Path
    seqs: tuple[int, ...]
    classes: tuple[str, ...]
    tracker: str
    object_shift: float = 0.0
    seed: int = 0
    detections: str = GROUND_TRUTH
    score_threshold: float | None = None
    length: str = DEFAULT_READING[0]
    hold: bool = DEFAULT_READING[1]


def measure(run: Run) -> dict[str, Any]:
    """The overall `clear3d` figures of a run."""
    config = EvaluateConfig(
        data_root=run.data_root,
        seqs=run.seqs,
        classes=run.classes,
        detections=run.detections,
        tracker=run.tracker,
        object_shift=run.object_shift,
        seed=run.seed,
        score_threshold=run.score_threshold,
    )
    shift = None
    if run.object_shift:
        shift = ObjectShift(run.object_shift, run.seed, run.length, run.hold)
    return evaluate(config, shift)["clear3d"]["overall"]


def measure_all(runs: Iterable[Run], description: str) -> dict[Run, dict[str, Any]]:
    """Figures of each distinct run, by run."""
    runs = list(dict.fromkeys(runs))
    figures = {}
    with (
        ProcessPoolExecutor(WORKERS, initializer=os.nice, initargs=(NICE,)) as pool,
        Progress(len(runs), description, "runs") as bar,
    ):
        waiting = {pool.submit(measure, run): run for run in runs}
        for done in as_completed(waiting):
            figures[waiting[done]] = done.result()
            bar.update()
    return {run: figures[run] for run in runs}


def over_seeds(base: Run, seeds: int) -> list[Run]:
    """The same run under several seeds; once without an object shift."""
    return [replace(base, seed=seed) for seed in range(seeds if base.object_shift else 1)]


def measure_rows(
    rows: Mapping[Key, Run], seeds: int, description: str
) -> dict[Key, list[dict[str, Any]]]:
    """Metrics of each row under each seed, by row."""
    over = {key: over_seeds(run, seeds) for key, run in rows.items()}
    found = measure_all((run for runs in over.values() for run in runs), description)
    return {key: [found[run] for run in runs] for key, runs in over.items()}


def mean_and_spread(values: list[float | None]) -> tuple[float | None, float]:
    """Mean and sample standard deviation (0 for a single value); None if one is undefined."""
    if any(value is None for value in values):
        return None, 0.0
    return mean(values), stdev(values) if len(values) > 1 else 0.0


def shown(values: list[float | None], digits: int) -> str:
    """`0.679 ± 0.004`; without a spread for a single value."""
    average, spread = mean_and_spread(values)
    if average is None or math.isnan(average):
        return "-"
    text = f"{average:.{digits}f}"
    return text if len(values) == 1 else f"{text} ± {spread:.{digits}f}"
