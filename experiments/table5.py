"""Table V of the paper: trackers under object shifts, on true and on detected boxes.

    python -m experiments.table5 --data_root KITTI --detections KITTI/detections/pointrcnn_Car \
        --out results/table5
    python -m experiments.table5 --data_root SCANS --seqs 0016,0018 --weights weights --out results

Needs labels alone: SORT (on 3-D boxes and, as in its paper, on image boxes), DEEP_SORT, AB3DMOT,
and Algorithm 1 with the displacement of the labels, an upper bound. With `--weights` and scans:
PointTrackNet with the displacement its network predicts, and all trackers on the network's boxes.
PointRCNN's boxes are of cars, so their table, and a second one of true boxes, is of Car alone.
Mean and standard deviation over `--seeds` of the object shift. Writes table5.md and table5.json.
Without networks it takes minutes; the networks run once for each seed, about 0.25 s a frame.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from common import flags
from common.markdown import markdown
from evaluation.config import GROUND_TRUTH, NETWORK, parse_names
from experiments.paper import TABLE5, TABLE5_COLUMNS
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_network_flags,
    add_shift_flags,
    common_fields,
    details_of,
    make_parser,
    measure_rows,
    network_fields,
    shown,
    write,
)
from tracking import PREDICTED_MOTION, TRACKERS

BASELINES = ("sort", "sort_image", "deep_sort", "deep_sort_published", "ab3dmot")
UPPER_BOUND = "gt_displacement"
DISPLACEMENT = {UPPER_BOUND: "of the labels", **dict.fromkeys(PREDICTED_MOTION, "predicted")}
DISTANCES = (0.0, 2.0)
DIGITS = {"IDS": 0, "FRAG": 0}
MIN_SCORE = 2.0  # of a PointRCNN box; as where tau was chosen (tracking/)


@dataclass(frozen=True)
class Part:
    """A part of the table: its boxes, its trackers, and the corresponding part of the paper's."""

    title: str
    paper: str
    trackers: tuple[str, ...]
    fields: dict[str, Any] = field(default_factory=dict)


def main(argv: Sequence[str] | None = None) -> None:
    """Runs every tracker without and with an object shift, writes table5.md and table5.json."""
    parser = make_parser(__doc__)
    add_shift_flags(parser)
    add_network_flags(parser)
    parser.add_argument("--detections", help="folder of PointRCNN detections; none: no such part")
    text = f"of tracking/factory.py, beside PointTrackNet (default: {','.join(BASELINES)})"
    add = parser.add_argument
    add("--baselines", type=_trackers, default=BASELINES, metavar="NAMES", help=text)
    args = parser.parse_args(argv)
    fields, parts = common_fields(args), parts_of(args)
    rows = {
        (part.title, tracker, distance): Run(
            tracker=tracker, object_shift=distance, **{**fields, **part.fields}
        )
        for part in parts
        for tracker in part.trackers
        for distance in DISTANCES
    }
    details = details_of(rows.values(), args.seeds)
    values = measure_rows(rows, args.seeds, "table 5")
    text = _tables(parts, values, args.seeds)
    write(args.out, "table5", "Table V", text, _figures(values), **details)


def _trackers(text: str) -> tuple[str, ...]:
    """argparse type: names of trackers between commas."""
    names = parse_names(text)
    if unknown := [name for name in names if name not in TRACKERS]:
        expected = f"expected trackers among {','.join(TRACKERS)}"
        raise argparse.ArgumentTypeError(f"{expected}, found {unknown[0]!r}")
    return names


def parts_of(args) -> list[Part]:
    """The parts of the table selected by the flags."""
    classes = " and ".join(args.classes)
    networks, others = {}, (*args.baselines, UPPER_BOUND)
    trackers = others
    if args.weights is not None:
        networks, trackers = network_fields(args), (*PREDICTED_MOTION, *others)
    parts = [Part(f"Ground-truth boxes of {classes}", "gt", trackers, networks)]
    if networks:
        boxes = {**networks, "detections": NETWORK}
        parts.append(Part(f"The detector's boxes, {classes}", "predicted", trackers, boxes))
    if args.detections:
        cars = {"classes": ("Car",)}
        if args.classes != cars["classes"]:
            true = {**cars, "detections": GROUND_TRUTH}
            parts.append(Part("Ground-truth boxes of Car", "gt", others, true))
        found = {**cars, "detections": args.detections, "score_threshold": MIN_SCORE}
        title = f"PointRCNN's boxes of Car, score of at least {MIN_SCORE:g}"
        parts.append(Part(title, "predicted", others, found))
    return parts


def _tables(parts: list[Part], values: dict[tuple, list[dict]], seeds: int) -> str:
    text = (
        f"Mean ± standard deviation over {seeds} seeds of the object shift, `clear3d`, IoU 0.5. "
        "The displacement of Algorithm 1 is predicted by the network, or taken from the labels: "
        "an upper bound, with which the paper's predicted one does not compare.\n"
    )
    for part in parts:
        lines = [
            [
                f"{TRACKER_NAMES.get(tracker, tracker)}, {distance:g} m",
                DISPLACEMENT.get(tracker, "-"),
                *our_cells(values[part.title, tracker, distance]),
            ]
            for tracker in part.trackers
            for distance in DISTANCES
        ]
        for name, row in TABLE5[part.paper].items():
            used = "predicted" if name == "PointTrackNet" else "-"
            lines += [[f"paper: {name}, {d:g} m", used, *paper_cells(row[d])] for d in DISTANCES]
        columns = ["", "displacement", *TABLE5_COLUMNS]
        text += f"\n## {part.title}\n\n" + markdown(columns, lines)
    return text


def our_cells(figures: list[dict[str, Any]]) -> list[str]:
    """The six columns over the seeds."""
    return [shown([f[key] for f in figures], DIGITS.get(key, 3)) for key in TABLE5_COLUMNS]


def paper_cells(values: Sequence[float]) -> list[str]:
    """The six columns as printed."""
    return [
        f"{value:.{DIGITS.get(key, 3)}f}" for key, value in zip(TABLE5_COLUMNS, values, strict=True)
    ]


def _figures(values: dict[tuple, list[dict]]) -> list[dict[str, Any]]:
    return [
        {"boxes": part, "tracker": tracker, "displacement": distance, "per_seed": figures}
        for (part, tracker, distance), figures in values.items()
    ]


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
