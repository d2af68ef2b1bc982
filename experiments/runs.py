"""Many small evaluations, two at a time: what table 5, figure 5 and the readings are made of."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev
from typing import Any

from common.progress import Progress
from evaluation.config import GROUND_TRUTH, EvaluateConfig
from evaluation.run import evaluate
from kitti.object_shift import DEFAULT_READING, ObjectShift

WORKERS = 2
NICE = 5
TRACKER_NAMES = {
    "sort": "SORT",
    "deep_sort": "DEEP_SORT",
    "ab3dmot": "AB3DMOT",
    "gt_displacement": "Algorithm 1, true displacement",
}


@dataclass(frozen=True)
class Run:
    """One `clear3d` evaluation of one tracker; fields as in `EvaluateConfig`."""

    data_root: Path
    seqs: tuple[int, ...]
    classes: tuple[str, ...]
    tracker: str
    displacement: float = 0.0
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
        displacement=run.displacement,
        seed=run.seed,
        score_threshold=run.score_threshold,
    )
    model = None
    if run.displacement:
        model = ObjectShift(run.displacement, run.seed, run.length, run.hold)
    return evaluate(config, model)["clear3d"]["overall"]


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
    """The same run under several seeds; once where nothing is displaced."""
    fields = {name: getattr(base, name) for name in base.__dataclass_fields__}
    return [Run(**{**fields, "seed": seed}) for seed in range(seeds if base.displacement else 1)]


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
