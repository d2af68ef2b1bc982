"""DEEP_SORT's filter noise: its scale on training sequences, beside the paper's Table V.

    python -m studies.deep_sort_noise --data_root KITTI --out results/deep_sort_noise

DEEP_SORT's authors give the noise as a share of the box height in pixels, which has no counterpart
in metres, so its scale is a free parameter. It is the one whose MOTA at D = 2 m with ground-truth
boxes of the training sequences is nearest to the paper's row; validation sequences take no part.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

from common import flags
from common.markdown import markdown
from common.processes import SPAWN, end_with_parent
from common.progress import progress
from evaluation.config import EvaluateConfig
from evaluation.detections import LabelBoxes
from evaluation.tracking_loop import track_scene
from experiments.paper import TABLE5
from experiments.record import measured_with
from experiments.runs import (
    WORKERS,
    add_shift_flags,
    common_fields,
    make_parser,
    mean_and_spread,
    shown,
    write,
)
from metrics.protocols import Entry, evaluate_protocol
from tracking import make_tracker
from tracking.deep_sort import noise_of_scale

SCALES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.55, 0.6, 0.8)  # metres
DISTANCES = (0.0, 2.0)


@dataclass(frozen=True)
class Trial:
    """One evaluation: scale of the noise, D in metres, seed of the shift."""

    scale: float
    distance: float
    seed: int

    def config(self, fields: dict[str, Any]) -> EvaluateConfig:
        """The evaluation with DEEP_SORT's own noise; `fields` as of `common_fields`."""
        shift = {"object_shift": self.distance, "seed": self.seed}
        return EvaluateConfig(tracker="deep_sort", **shift, **fields)


def measure(trial: Trial, fields: dict[str, Any]) -> float | None:
    """MOTA of DEEP_SORT on ground-truth boxes, `clear3d`; None without a labelled box."""
    config = trial.config(fields)
    classes, entries = config.classes, []
    for scene in config.open_scenes():
        tracker = make_tracker("deep_sort", noise=noise_of_scale(trial.scale))
        results = track_scene(scene, LabelBoxes(classes), tracker, classes)
        entries.append(Entry(scene.name, scene.num_frames, scene.objects, results))
    return evaluate_protocol("clear3d", entries, classes=classes)["overall"]["MOTA"]


def main(argv: Sequence[str] | None = None) -> None:
    """Runs every trial, writes deep_sort_noise.md and deep_sort_noise.json."""
    parser = make_parser(__doc__, "0000-0015")
    add_shift_flags(parser)
    args = parser.parse_args(argv)
    fields = common_fields(args)
    trials = [
        Trial(scale, distance, seed)
        for scale, distance in product(SCALES, DISTANCES)
        for seed in range(args.seeds if distance else 1)
    ]
    details = measured_with(trial.config(fields) for trial in trials)
    with ProcessPoolExecutor(WORKERS, SPAWN, initializer=end_with_parent) as pool:
        found = pool.map(measure, trials, [fields] * len(trials))
        motas = list(progress(found, len(trials), "DEEP_SORT's noise", "trials"))
    by_row: dict[tuple[float, float], list[float | None]] = {}
    for trial, mota in zip(trials, motas, strict=True):
        by_row.setdefault((trial.scale, trial.distance), []).append(mota)
    paper = TABLE5["gt"]["DEEP_SORT"]
    means = {scale: mean_and_spread(by_row[scale, DISTANCES[-1]])[0] for scale in SCALES}
    gaps = {s: abs(m - paper[DISTANCES[-1]][0]) for s, m in means.items() if m is not None}
    best = min(gaps, key=gaps.__getitem__, default=None)
    lines = [
        [f"{scale:g} m{' *' * (scale == best)}", *(shown(by_row[scale, d], 3) for d in DISTANCES)]
        for scale in SCALES
    ]
    lines.append(["the paper, on 0016-0020", *(f"{paper[d][0]:.3f}" for d in DISTANCES)])
    text = f"MOTA over {args.seeds} seeds of the object shift; * is nearest to the paper.\n\n"
    text += markdown(["noise of the box", *(f"D = {d:g} m" for d in DISTANCES)], lines)
    figures = [{**asdict(t), "MOTA": mota} for t, mota in zip(trials, motas, strict=True)]
    write(args.out, "deep_sort_noise", "DEEP_SORT's filter noise", text, figures, **details)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
