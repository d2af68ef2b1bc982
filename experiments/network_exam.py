"""What the networks are worth on some sequences: boxes, displacement, and every tracker on them.

    python -m experiments.network_exam --data_root ../shared/kitti --seqs 0000 --out results/exam

Box recall and precision at 3-D IoU 0.25 and 0.5 (also for boxes with 50 or more points), end-point
error of the displacement on foreground points, and MOTA of each tracker on the same boxes
and PointTrackNet's on true boxes, at displacement 0 and 2 m, the latter as mean and standard
deviation over `--seeds` draws. Prints a table; writes exam.md and exam.json. The networks run once
for each draw; an interrupted run goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from common.files import write_json, write_text
from common.flags import ArgumentParser, finite_float, positive_int, run
from common.provenance import provenance
from evaluation.config import EvaluateConfig
from evaluation.detections import LabelBoxesWithPredictedMotion
from evaluation.network_cache import CachedPredictions
from evaluation.run import evaluate
from evaluation.scene import Scene
from evaluation.side_by_side import SIDE_BY_SIDE, displaced_scenes, evaluate_cached
from experiments.runs import shown
from kitti.boxes import points_in_boxes
from kitti.ground import fit_ground
from kitti.iou import iou_3d
from kitti.labels import VEHICLES
from kitti.splits import parse_sequences
from kitti.targets import association_displacement, foreground_labels
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
        points = scene.points(found.t)
        owner = np.zeros(0, int) if points is None else points_in_boxes(points, truth)
        many = np.bincount(owner[owner >= 0], minlength=len(truth)) >= MANY_POINTS
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
    """(P,) metres: error of the displacement at every kept foreground point (ground left out)."""
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


def examine(config: EvaluateConfig, cached: CachedPredictions, out: Path) -> dict[str, Any]:
    """All figures at one displacement and seed; what the trackers gave goes into `out`."""
    scenes, distance = displaced_scenes(config), config.displacement
    cached.fill_all(scenes, f"networks, D = {distance:g} m, seed {config.seed}")
    threshold = float(config.score_threshold or 0.0)
    counts = [box_counts(scene, cached, threshold) for scene in scenes]
    total = {key: sum(c[key] for c in counts) for key in counts[0]}
    figures: dict[str, Any] = {}
    for i in MIN_IOUS:
        figures[f"recall@{i}"] = _ratio(total[f"hits@{i}"], total["boxes"])
        figures[f"recall@{i}, boxes with {MANY_POINTS} points"] = _ratio(
            total[f"hits_50@{i}"], total["boxes_50"]
        )
        figures[f"precision@{i}"] = _ratio(total[f"hits@{i}"], total["found"])
    errors = np.concatenate([end_point_errors(scene, cached) for scene in scenes])
    figures["end-point error (m)"] = float(errors.mean()) if len(errors) else None
    for min_iou in MIN_IOUS:
        for tracker in SIDE_BY_SIDE:
            chosen = replace(config, iou=min_iou)
            record = evaluate_cached(chosen, cached, tracker, out / f"{tracker}-{min_iou}")
            figures[f"MOTA@{min_iou}, {tracker}"] = record["clear3d"]["overall"]["MOTA"]
    chosen = replace(config, detections="gt", score_threshold=None, out=out / "gt")
    record = evaluate(chosen, provider=LabelBoxesWithPredictedMotion(cached))
    figures["MOTA@0.5, pointtracknet on true boxes"] = record["clear3d"]["overall"]["MOTA"]
    return figures


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def table(columns: dict[float, list[dict[str, Any]]], command: str) -> str:
    """A column for each displacement, over the figures of its seeds."""
    seeds = max(len(runs) for runs in columns.values())
    lines = [
        "| | " + " | ".join(f"D = {d} m" for d in columns) + " |",
        "|---|" + "---:|" * len(columns),
    ]
    for name in next(iter(columns.values()))[0]:
        cells = [shown([run[name] for run in runs], 3) for runs in columns.values()]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    if seeds > 1:
        lines += ["", f"Mean ± standard deviation over {seeds} seeds of the displacement."]
    return "\n".join([*lines, "", f"`{command}`", ""])


def main(argv: Sequence[str] | None = None) -> None:
    """Examines, prints, writes."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data_root", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seqs", default="0000", metavar="SEQS")
    parser.add_argument("--weights", type=Path, default=Path("weights"), metavar="DIR")
    parser.add_argument(
        "--score_threshold",
        type=finite_float,
        default=0.0,
        help="least score of a box (recall, precision), least mean of a track",
    )
    parser.add_argument("--seeds", type=positive_int, default=1, help="of the displacement")
    parser.add_argument("--out", type=Path, default=Path("results/exam"), metavar="DIR")
    flags = parser.parse_args(argv)
    cached = CachedPredictions(flags.out / "network_cache", flags.weights)
    columns: dict[float, list[dict[str, Any]]] = {}
    for distance, seeds in ((0.0, 1), (2.0, flags.seeds)):
        for seed in range(seeds):
            config = EvaluateConfig(
                data_root=flags.data_root,
                seqs=tuple(parse_sequences(flags.seqs)),
                detections="network",
                tracker="pointtracknet",
                weights=flags.weights,
                displacement=distance,
                seed=seed,
                score_threshold=flags.score_threshold,
            )
            out = flags.out / f"D{distance:g}-seed{seed}"
            columns.setdefault(distance, []).append(examine(config, cached, out))
    record = provenance(config=config.record())
    text = table(columns, record["command"])
    print(text, end="")
    write_text(flags.out / "exam.md", text)
    write_json(flags.out / "exam.json", {"run": record, "figures": columns})


if __name__ == "__main__":
    raise SystemExit(run(main))
