"""Flags, evaluations over seeds, and written files that experiments and studies share."""

import argparse
import math
import os
import sys
from collections.abc import Hashable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, stdev
from typing import Any, TypeVar

from common import flags
from common.errors import InputError
from common.files import write_json, write_text
from common.processes import SPAWN, end_with_parent
from common.progress import Progress
from common.provenance import provenance
from evaluation.config import GROUND_TRUTH, EvaluateConfig, parse_names, parse_seqs
from evaluation.detections import DetectionProvider, LabelBoxesWithPredictedMotion
from evaluation.network_cache import CachedPredictions
from evaluation.run import check_writable, evaluate
from experiments.record import measured_with
from kitti.object_shift import DEFAULT_READING, ObjectShift

Key = TypeVar("Key", bound=Hashable)

WORKERS = 2
NICE = 5
TRACKER_NAMES = {
    "pointtracknet": "PointTrackNet",
    "pointtracknet_no_probation": "PointTrackNet, no probation",
    "pointtracknet_published": "PointTrackNet, as published",
    "sort": "SORT",
    "sort_image": "SORT, image boxes",
    "deep_sort": "DEEP_SORT",
    "deep_sort_published": "DEEP_SORT, as published",
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


def parse_classes(text: str) -> tuple[str, ...]:
    """argparse type: "car,van" -> ("Car", "Van"), the names as `EvaluateConfig` spells them."""
    try:
        return EvaluateConfig(Path(), classes=parse_names(text)).classes
    except InputError as error:
        message = str(error).removeprefix("--classes: ")
        raise argparse.ArgumentTypeError(message) from error


def add_shift_flags(parser: flags.ArgumentParser) -> None:
    """Adds --classes and --seeds."""
    add = parser.add_argument
    add(
        "--classes",
        type=parse_classes,
        default="Car,Van",
        help="tracked, and evaluated on both sides",
    )
    add("--seeds", type=flags.positive_int, default=5, help="of the object shift")


def add_network_flags(parser: flags.ArgumentParser) -> None:
    """Adds --weights and --network_cache, for the rows that need the networks and scans."""
    add = parser.add_argument
    add("--weights", type=Path, metavar="DIR", help="networks; none: no rows that need them")
    add("--network_cache", type=Path, metavar="DIR", help="their outputs (default: in --out)")


def network_fields(args: argparse.Namespace) -> dict[str, Any]:
    """Fields of `Run` for a row that needs the networks."""
    cache = args.network_cache or args.out / "network_cache"
    return {"weights": args.weights, "network_cache": cache}


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
    """One evaluation of one tracker; fields as in `EvaluateConfig` and `ObjectShift`.

    A run with the networks' boxes, or with their displacement on labelled boxes, takes these from
    the files in `network_cache`.
    """

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
    protocol: str = "clear3d"
    weights: Path = Path("weights")
    network_cache: Path | None = None

    @property
    def config(self) -> EvaluateConfig:
        """The evaluation, but for the reading of the shift."""
        return EvaluateConfig(
            data_root=self.data_root,
            seqs=self.seqs,
            classes=self.classes,
            detections=self.detections,
            tracker=self.tracker,
            object_shift=self.object_shift,
            seed=self.seed,
            score_threshold=self.score_threshold,
            protocols=(self.protocol,),
            weights=self.weights,
        )

    @property
    def shift(self) -> ObjectShift | None:
        """The object shift in this reading, None for none."""
        if not self.object_shift:
            return None
        return ObjectShift(self.object_shift, self.seed, self.length, self.hold)

    @property
    def cached(self) -> CachedPredictions | None:
        """The cached outputs of the networks, None for a run without them."""
        if not self.config.needs_network:
            return None
        return CachedPredictions(self.network_cache, self.weights)


def measure(run: Run) -> dict[str, Any]:
    """The overall metrics of a run."""
    provider: DetectionProvider | None = run.cached
    config = run.config
    if provider is not None and run.detections == GROUND_TRUTH:
        provider = LabelBoxesWithPredictedMotion(provider, config.classes)
    return evaluate(config, run.shift, provider)[run.protocol]["overall"]


def fill_caches(runs: Iterable[Run]) -> None:
    """Runs the networks once for every scene and object shift of the runs that need them."""
    for run in runs:
        if (cached := run.cached) is not None:
            title = f"networks, D = {run.object_shift:g} m, seed {run.seed}"
            cached.fill_all(run.config.open_scenes(run.shift), title)


def measure_all(runs: Iterable[Run], description: str) -> dict[Run, dict[str, Any]]:
    """Metrics of each distinct run, by run; the networks run first, in a separate process."""
    runs = list(dict.fromkeys(runs))
    different = {(run.seqs, run.shift): run for run in runs if run.config.needs_network}
    if different:
        with ProcessPoolExecutor(1, SPAWN, initializer=end_with_parent) as pool:
            pool.submit(fill_caches, list(different.values())).result()
    figures = {}
    with (
        ProcessPoolExecutor(WORKERS, SPAWN, initializer=_quietly) as pool,
        Progress(len(runs), description, "runs") as bar,
    ):
        waiting = {pool.submit(measure, run): run for run in runs}
        for done in as_completed(waiting):
            figures[waiting[done]] = done.result()
            bar.update()
    return {run: figures[run] for run in runs}


def _quietly() -> None:
    """Sets up a worker: no progress display, low priority."""
    end_with_parent()
    os.nice(NICE)
    sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for the life of the process


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


def details_of(rows: Iterable[Run], seeds: int) -> dict[str, Any]:
    """What rows under several seeds are measured with, for `write`: see `measured_with`."""
    return measured_with(run.config for row in rows for run in over_seeds(row, seeds))


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
