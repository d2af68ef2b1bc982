"""Counts of a data set: `python -m kitti.stats --data_root DIR [--json]`.

Frames, adjacent pairs, trajectories and boxes per class and for Car + Van, per sequence and in all.
"""

import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from common import flags
from kitti.objects import CLASSES, VEHICLES, Objects
from kitti.seqmap import parse_sequences
from kitti.sequence import KittiSequence, labelled_sequences, open_sequences

VEHICLE_NAME = "+".join(VEHICLES)
LABELLED = tuple(name for name in CLASSES if name != "DontCare")

Counts = dict[str, Any]


def count_objects(objects: Objects, classes: Sequence[str]) -> dict[str, int]:
    """Trajectories (distinct track ids) and boxes of `classes` in one sequence."""
    chosen = objects.of_classes(classes)
    return {"trajectories": len(np.unique(chosen.track_id)), "boxes": len(chosen)}


def count_sequence(sequence: KittiSequence) -> Counts:
    """All counts of one sequence; `pairs` are adjacent frames, `scans` the existing scan files."""
    names = [name for name in LABELLED if (sequence.objects.type == name).any()]
    classes = {name: count_objects(sequence.objects, (name,)) for name in names}
    return {
        "frames": len(sequence.frames),
        "pairs": len(sequence.pairs(scans=False)),
        "scans": sum(map(sequence.has_scan, sequence.frames)),
        "classes": {**classes, VEHICLE_NAME: count_objects(sequence.objects, VEHICLES)},
    }


def add_up(parts: Iterable[Counts]) -> Counts:
    """Sums over sequences; ids are unique within a sequence, so trajectories add up."""
    parts = list(parts)
    total: Counts = {key: sum(part[key] for part in parts) for key in ("frames", "pairs", "scans")}
    classes: dict[str, dict[str, int]] = {}
    for name in (*LABELLED, VEHICLE_NAME):
        found = [part["classes"][name] for part in parts if name in part["classes"]]
        if found:
            classes[name] = {key: sum(f[key] for f in found) for key in found[0]}
    return {**total, "classes": classes}


def count_dataset(sequences: Iterable[KittiSequence]) -> Counts:
    """{"overall": counts, "sequences": {"0000": counts, ...}}."""
    each = {sequence.name: count_sequence(sequence) for sequence in sequences}
    return {"overall": add_up(each.values()), "sequences": each}


def table(counts: Counts) -> str:
    """A text table: a row per sequence, trajectories / boxes per class."""
    names = list(counts["overall"]["classes"])
    rows = [["seq", "frames", "pairs", "scans", *names]]
    for label, part in [*counts["sequences"].items(), ("all", counts["overall"])]:
        cells = [part["classes"].get(name) for name in names]
        shown = [f"{c['trajectories']}/{c['boxes']}" if c else "-" for c in cells]
        rows.append([label, *(str(part[key]) for key in ("frames", "pairs", "scans")), *shown])
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows]
    return "\n".join([*lines, "classes: trajectories/boxes"])


def main(argv: Sequence[str] | None = None) -> None:
    """Prints the counts of the training subset."""
    parser = flags.ArgumentParser(prog="python -m kitti.stats", description=__doc__.split("\n")[0])
    parser.add_argument("--data_root", required=True, help="folder in KITTI's tracking layout")
    parser.add_argument("--seqs", help="such as 0016-0020 or 0000,0003; all by default")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args(argv)
    seqs = parse_sequences(args.seqs) if args.seqs else labelled_sequences(args.data_root)
    counts = count_dataset(open_sequences(args.data_root, seqs))
    print(json.dumps(counts, indent=2) if args.json else table(counts))


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
