"""Evaluates the networks: box recall and precision, end-point error, MOTA per tracker.

    python -m experiments.evaluate_networks --data_root KITTI --seqs 0000 --out results/networks

Box recall and precision at 3-D IoU 0.25 and 0.5 (also for boxes with 50 or more points), end-point
error of the displacement on foreground points, and MOTA of each tracker on the same boxes and
PointTrackNet's on true boxes, without object shift and with shifts of up to 2 m, the latter as mean
and standard deviation over `--seeds`. Prints a table; writes networks.md and networks.json. The
networks run once for each seed; an interrupted run resumes.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from common.flags import finite_float, positive_int, run
from common.markdown import markdown
from evaluation.config import GROUND_TRUTH, NETWORK, EvaluateConfig
from evaluation.detections import LabelBoxesWithPredictedMotion
from evaluation.network_cache import CachedPredictions
from evaluation.run import evaluate
from evaluation.scene import Scene
from evaluation.side_by_side import OURS, SIDE_BY_SIDE, evaluate_cached
from experiments.record import measured_with
from experiments.runs import make_parser, shown, write
from kitti.ground import fit_ground
from kitti.iou import iou_3d
from kitti.objects import VEHICLES
from kitti.targets import association_displacement, foreground_labels
from metrics.protocols import CLEAR3D
from tracking.assignment import greedy

MIN_IOUS = (0.25, 0.5)
MANY_POINTS = 50


def box_counts(scene: Scene, cached: CachedPredictions, min_score: float) -> dict[str, int]:
    """Matched, labelled and found boxes of a scene, one-to-one by largest IoU, vehicles only."""
    counts = dict.fromkeys(
        [
            "boxes",
            "found",
            "boxes_50",
            *(f"{k}@{i}" for i in MIN_IOUS for k in ("hits", "hits_50")),
        ],
        0,
    )
    for found in cached.frames(scene):
        boxes = found.boxes[found.scores >= min_score]
        truth = scene.objects.at(found.t).of_classes(VEHICLES).boxes
        many = scene.points_in(found.t, truth) >= MANY_POINTS
        counts["boxes"] += len(truth)
        counts["boxes_50"] += int(many.sum())
        counts["found"] += len(boxes)
        iou = iou_3d(truth, boxes)
        for min_iou in MIN_IOUS:
            rows = np.array([row for row, _ in greedy(-iou, -min_iou).pairs], int)
            counts[f"hits@{min_iou}"] += len(rows)
            counts[f"hits_50@{min_iou}"] += int(many[rows].sum())
    return counts


def end_point_errors(scene: Scene, cached: CachedPredictions) -> np.ndarray:
    """(P,) metres: error of the displacement at every kept foreground point above the ground."""
    errors = [np.zeros(0)]
    for found in cached.frames(scene):
        t = found.t
        if found.points is None or not len(found.points):
            continue
        before = scene.objects.at(t - 1).of_classes(VEHICLES)
        now = scene.objects.at(t).of_classes(VEHICLES)
        truth, valid = association_displacement(
            before.boxes, before.track_id, now.boxes, now.track_id
        )
        ground = fit_ground(scene.points(t - 1))
        owner = foreground_labels(found.points, before.boxes, ground)
        inside = (owner >= 0) & np.append(valid, False)[owner]
        errors.append(np.linalg.norm(found.displacement[inside] - truth[owner[inside]], axis=1))
    return np.concatenate(errors)


def on_found_boxes(config: EvaluateConfig) -> list[EvaluateConfig]:
    """Every tracker on the detector's boxes, at each least IoU."""
    protocols = CLEAR3D if config.object_shift else (*CLEAR3D, "kitti3d")  # shifts leave its image
    return [
        replace(config, tracker=tracker, iou=min_iou, protocols=protocols)
        for min_iou in MIN_IOUS
        for tracker in SIDE_BY_SIDE
    ]


def on_true_boxes(config: EvaluateConfig) -> list[EvaluateConfig]:
    """PointTrackNet on labelled boxes."""
    true = replace(config, detections=GROUND_TRUTH, score_threshold=None)
    return [replace(true, tracker=tracker) for tracker in OURS]


def measure(config: EvaluateConfig, cached: CachedPredictions, out: Path) -> dict[str, Any]:
    """All metrics at one object shift and seed; writes the trackers' results to `out`."""
    scenes, distance = config.open_scenes(), config.object_shift
    cached.fill_all(scenes, f"networks, D = {distance:g} m, seed {config.seed}")
    counts = [box_counts(scene, cached, config.min_box_score) for scene in scenes]
    total = {key: sum(c[key] for c in counts) for key in counts[0]}
    metrics: dict[str, Any] = {}
    for i in MIN_IOUS:
        metrics[f"recall@{i}"] = _ratio(total[f"hits@{i}"], total["boxes"])
        metrics[f"recall@{i}, boxes with {MANY_POINTS} points"] = _ratio(
            total[f"hits_50@{i}"], total["boxes_50"]
        )
        metrics[f"precision@{i}"] = _ratio(total[f"hits@{i}"], total["found"])
    errors = np.concatenate([end_point_errors(scene, cached) for scene in scenes])
    metrics["end-point error (m)"] = float(errors.mean()) if len(errors) else None
    found = {
        each: evaluate_cached(each, cached, each.tracker, out / f"{each.tracker}-{each.iou}")
        for each in on_found_boxes(config)
    }
    for protocol in next(iter(found)).protocols:
        title = "" if protocol == "clear3d" else f"{protocol} "
        for each, record in found.items():
            mota = record[protocol]["overall"]["MOTA"]
            metrics[f"{title}MOTA@{each.iou}, {each.tracker}"] = mota
    for each in on_true_boxes(config):
        chosen = replace(each, out=out / f"{each.tracker}-gt")
        record = evaluate(chosen, provider=LabelBoxesWithPredictedMotion(cached))
        metrics[f"MOTA@0.5, {each.tracker} on true boxes"] = record["clear3d"]["overall"]["MOTA"]
    return metrics


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def table(columns: dict[float, list[dict[str, Any]]]) -> str:
    """A column for each distance of the object shift, over the metrics of its seeds."""
    names = next(iter(columns.values()))[0]
    rows = [
        [name, *(shown([run.get(name) for run in runs], 3) for runs in columns.values())]
        for name in names
    ]
    text = markdown(["", *(f"D = {d} m" for d in columns)], rows)
    seeds = max(len(runs) for runs in columns.values())
    if seeds > 1:
        text += f"\nMean ± standard deviation over {seeds} seeds of the object shift.\n"
    return text


def main(argv: Sequence[str] | None = None) -> None:
    """Evaluates, prints, writes."""
    parser = make_parser(__doc__, "0000")
    add = parser.add_argument
    add("--weights", type=Path, default=Path("weights"), metavar="DIR", help="of the networks")
    add("--score_threshold", type=finite_float, help="least score of a box")
    add("--seeds", type=positive_int, default=1, help="of the object shift")
    args = parser.parse_args(argv)
    cached = CachedPredictions(args.out / "network_cache", args.weights)
    configs = [
        EvaluateConfig(
            data_root=args.data_root,
            seqs=args.seqs,
            detections=NETWORK,
            tracker="pointtracknet",
            weights=args.weights,
            object_shift=distance,
            seed=seed,
            score_threshold=args.score_threshold,
        )
        for distance, seeds in ((0.0, 1), (2.0, args.seeds))
        for seed in range(seeds)
    ]
    details = measured_with(
        each for config in configs for each in (*on_found_boxes(config), *on_true_boxes(config))
    )
    columns: dict[float, list[dict[str, Any]]] = {}
    for config in configs:
        out = args.out / f"D{config.object_shift:g}-seed{config.seed}"
        columns.setdefault(config.object_shift, []).append(measure(config, cached, out))
    write(args.out, "networks", "The networks", table(columns), columns, **details)


if __name__ == "__main__":
    raise SystemExit(run(main))
