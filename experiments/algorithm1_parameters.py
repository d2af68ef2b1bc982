"""How Algorithm 1's free parameters were chosen: training sequences, detector boxes, noisy motion.

    python -m experiments.algorithm1_parameters --data_root KITTI --detections DIR --out DIR

The boxes are detections of a file detector; their displacement is the labels' own plus Gaussian
noise in the ground plane, which stands for a network that is not perfect. An object that is lost
has no points in its box, so its displacement is unknown. Writes table.md and metrics.json.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from common.files import write_json, write_text
from common.flags import ArgumentParser, finite_float, non_negative_int, run
from common.progress import progress
from common.provenance import provenance
from kitti.detections import read_detections
from kitti.labels import Objects
from kitti.sequence import Sequence as KittiSequence
from kitti.sequence import open_sequences
from kitti.splits import parse_sequences
from metrics.protocols import Entry, evaluate_protocol
from tracking import TrueDisplacement, assign_label_ids, make_tracker

VEHICLES = ("Car", "Van")
COLUMNS = ("MOTA", "MT", "IDS", "FRAG", "FP", "FN")


@dataclass(frozen=True)
class Trial:
    """One row of the table: standard deviation of the displacement in metres, and parameters."""

    noise: float
    parameters: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        values = [f"{name} = {value}" for name, value in self.parameters.items()]
        return f"{self.noise} m | {', '.join(values) or 'defaults'}"


TRIALS = (
    *(Trial(noise, {"tau": tau}) for noise in (0.0, 0.5) for tau in (0.01, 0.05, 0.1, 0.2, 0.3)),
    *(Trial(0.2, {"max_age": age}) for age in (0, 1, 3, 5, 10)),
    *(Trial(0.2, {"max_age": age, "report_lost": True}) for age in (1, 3)),
    *(Trial(0.2, {"min_hits": hits}) for hits in (2, 3)),
)


def track(
    sequence: KittiSequence, detections: Objects, trial: Trial, rng: np.random.Generator
) -> Objects:
    """Algorithm 1 over one sequence; result rows of class Car."""
    tracker, labels = make_tracker("pointtracknet", **trial.parameters), Objects.empty()
    all_labels, parts = sequence.objects.of_classes(VEHICLES), []
    for t in sequence.frames:
        found, before, labels = detections.at(t), labels, all_labels.at(t)
        true = TrueDisplacement(before.boxes, before.track_id, labels.boxes, labels.track_id)

        def noisy(boxes, ids, true=true):
            motion = true(boxes, ids)
            motion[:, :2] += rng.normal(0.0, trial.noise, (len(motion), 2))
            lost = [one.time_since_update > 1 for one in tracker.life.tracks]
            motion[np.array(lost, bool)] = np.nan
            return motion

        ids = assign_label_ids(found.boxes, labels.boxes, labels.track_id)
        tracker.predict()
        tracks = tracker.update(found.boxes, found.score, ids=ids, box_displacement=noisy, frame=t)
        parts.append(Objects.from_boxes(t, tracks.ids, tracks.boxes, tracks.scores))
    return Objects.concatenate(parts)


def main(argv: Sequence[str] | None = None) -> None:
    """Parses the flags, runs every trial, writes the table."""
    parser = ArgumentParser(prog="algorithm1_parameters.py", description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("--data_root", type=Path, required=True, help="folder in KITTI's tracking layout")
    add("--detections", type=Path, required=True, help="folder of detection files")
    add("--seqs", default="0000,0001,0004,0005,0007,0009,0010,0011,0015", help="sequences")
    add("--min_score", type=finite_float, default=2.0, help="least score of a detection")
    add("--seed", type=non_negative_int, default=0, help="of the noise")
    add("--out", type=Path, required=True, help="folder of the results")
    args = parser.parse_args(argv)
    sequences = open_sequences(args.data_root, parse_sequences(args.seqs), "training")
    found = [read_detections(args.detections / f"{s.name}.txt", s.num_frames) for s in sequences]
    found = [objects[objects.score >= args.min_score] for objects in found]
    rows = []
    for trial in progress(TRIALS, len(TRIALS), "algorithm 1", "trials"):
        entries = []
        for sequence, detections in zip(sequences, found, strict=True):
            rng = np.random.default_rng([args.seed, int(sequence.name)])
            results = track(sequence, detections, trial, rng)
            entries.append(Entry(sequence.name, sequence.num_frames, sequence.objects, results))
        rows.append((trial, evaluate_protocol("clear3d", entries, classes=VEHICLES)["overall"]))
    lines = [f"| displacement noise | parameters | {' | '.join(COLUMNS)} |"]
    lines.append("|---" * (2 + len(COLUMNS)) + "|")
    for trial, figures in rows:
        values = [f"{figures[c]:.4f}" if c in ("MOTA", "MT") else str(figures[c]) for c in COLUMNS]
        lines.append(f"| {trial} | {' | '.join(values)} |")
    write_text(args.out / "table.md", "\n".join(lines) + "\n")
    trials = [{"noise": t.noise, "parameters": t.parameters, "clear3d": f} for t, f in rows]
    config = {name: str(value) for name, value in vars(args).items()}
    write_json(args.out / "metrics.json", {"run": provenance(config=config), "trials": trials})
    print("\n".join(lines))


if __name__ == "__main__":
    raise SystemExit(run(main))
