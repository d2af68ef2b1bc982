"""Vehicles that the detector misses although many points lie on them, one by one.

    python -m studies.box_misses --data_root KITTI --seqs 0000 --out results/misses

A vehicle is missed if no box of at least the threshold overlaps it by 3-D IoU 0.5. For each missed
one with `--points` points or more: place and size, mean foreground probability of its points,
proposals whose centre lies in it, and IoU and score of the cluster that overlaps it most, before
any threshold; the columns show whether mask, boxes, or score failed. Writes box_misses.md, .json.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.files import write_json, write_text
from common.flags import ArgumentParser, finite_float, positive_int, run
from common.markdown import cell, markdown
from common.provenance import provenance
from experiments.record import data_record
from kitti.boxes import points_in_boxes
from kitti.seqmap import parse_sequences
from kitti.sequence import open_sequences
from models.boxes.box_score import default_min_score, load_scorer
from models.config import DecodingConfig
from models.weight_files import DETECTOR, SCORER, weights_sha256
from models.weights import load_detector, network_hash
from training.scoring.box_candidates import CandidateFinder, Candidates

MIN_IOU = 0.5


def misses(
    frame: Candidates, scores: np.ndarray, min_score: float, min_points: int
) -> list[dict[str, Any]]:
    """The missed vehicles of a frame; scores (K,) are of its clusters."""
    kept = frame.iou[:, scores >= min_score].max(axis=1, initial=0.0) >= MIN_IOU
    rows = []
    for row in np.flatnonzero(~kept & (frame.points >= min_points)):
        box, iou = frame.truth[row], frame.iou[row]
        best = int(iou.argmax()) if iou.max(initial=0.0) > 0 else None
        inside = points_in_boxes(frame.clusters.proposals.boxes[:, :3], box[None]) == 0
        rows.append(
            {
                "drive": "/".join(Path(frame.drive).parts[-2:]),
                "frame": frame.t,
                "range": float(np.hypot(box[0], box[1])),
                "length": float(box[3]),
                "points": int(frame.points[row]),
                "mask": float(frame.foreground[row]),
                "proposals": int(inside.sum()),
                "IoU": 0.0 if best is None else float(iou[best]),
                "score": None if best is None else float(scores[best]),
            }
        )
    return rows


def table(rows: list[dict[str, Any]], command: str) -> str:
    """One line for each missed vehicle, as Markdown."""
    names = ("drive", "frame", "range", "length", "points", "mask", "proposals", "IoU", "score")
    named = ({**row, "drive": Path(row["drive"]).name} for row in rows)
    cells = [[cell(row[name], 2) for name in names] for row in named]
    return markdown(names, cells) + f"\n`{command}`\n"


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the detector, lists missed vehicles, prints and writes the list."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("--data_root", required=True, metavar="DIR", help="labelled scans, KITTI's layout")
    add("--seqs", default="0000", metavar="SEQS", help="such as 0000 or 0016-0020")
    add("--weights", type=Path, default=Path("weights"), help="folder of the networks' weights")
    add("--points", type=positive_int, default=50, help="least points of a vehicle")
    add("--every", type=positive_int, default=1, help="take every n-th frame")
    add("--score_threshold", type=finite_float, help="least score (default: that of the weights)")
    add("--out", type=Path, required=True, help="folder for the list")
    flags = parser.parse_args(argv)
    seqs = parse_sequences(flags.seqs)
    sequences = open_sequences(flags.data_root, seqs)
    detector = load_detector(flags.weights / DETECTOR)
    scorer = load_scorer(flags.weights, network_hash(detector))
    min_score = flags.score_threshold
    if min_score is None:
        min_score = default_min_score(flags.weights)
    (frames,) = CandidateFinder(detector, DecodingConfig()).find_all(sequences, every=flags.every)
    rows = [m for f in frames for m in misses(f, f.scores(scorer), min_score, flags.points)]
    record = provenance(
        min_score=min_score,
        data=[data_record(flags.data_root, seqs)],
        weights_sha256=weights_sha256(flags.weights, (DETECTOR, SCORER)),
    )
    text = table(rows, record["command"])
    total = sum(int((frame.points >= flags.points).sum()) for frame in frames)
    write_text(flags.out / "box_misses.md", text)
    write_json(flags.out / "box_misses.json", {"run": record, "vehicles": total, "missed": rows})
    print(text + f"\n{len(rows)} of {total} vehicles missed at score {min_score:.3f}")


if __name__ == "__main__":
    raise SystemExit(run(main))
