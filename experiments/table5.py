"""Table V of the paper: trackers under object shifts, on true and on detected boxes.

    python -m experiments.table5 --data_root KITTI --detections KITTI/detections/pointrcnn_Car \
        --out results/table5

The half with ground-truth boxes: SORT, DEEP_SORT and Algorithm 1 with the labels' displacement
(the paper prints PointTrackNet's predicted displacement there). The other half has PointRCNN's
boxes in the place of the paper's own detector.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from common import flags
from common.markdown import markdown
from evaluation.config import GROUND_TRUTH
from experiments.paper import TABLE5, TABLE5_COLUMNS
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_shift_flags,
    common_fields,
    make_parser,
    measure_rows,
    shown,
    write,
)

TRACKERS = ("sort", "deep_sort", "gt_displacement")
PAPER_NAMES = {"sort": "SORT", "deep_sort": "DEEP_SORT", "gt_displacement": "PointTrackNet"}
DISTANCES = (0.0, 2.0)
DIGITS = {"IDS": 0, "FRAG": 0}
MIN_SCORE = 2.0  # mean score of a track of PointRCNN boxes; as where tau was chosen (tracking/)


def main(argv: Sequence[str] | None = None) -> None:
    """Runs every tracker without and with an object shift, writes table5.md and table5.json."""
    parser = make_parser(__doc__)
    add_shift_flags(parser)
    parser.add_argument("--detections", help="folder of PointRCNN detections; none: no such half")
    args = parser.parse_args(argv)
    fields = common_fields(args)
    halves = {"gt": {"detections": GROUND_TRUTH}}
    if args.detections:
        halves["predicted"] = {"detections": args.detections, "score_threshold": MIN_SCORE}
    rows = {
        (half, tracker, distance): Run(tracker=tracker, object_shift=distance, **boxes, **fields)
        for half, boxes in halves.items()
        for tracker in TRACKERS
        for distance in DISTANCES
    }
    values = measure_rows(rows, args.seeds, "table 5")
    write(args.out, "table5", "Table V", _tables(values, args.seeds), _figures(values))


def _tables(values: dict[tuple, list[dict]], seeds: int) -> str:
    titles = {"gt": "Ground-truth boxes", "predicted": f"PointRCNN boxes, score >= {MIN_SCORE:g}"}
    text = (
        f"Mean ± standard deviation over {seeds} seeds of the object shift, `clear3d`, IoU 0.5.\n"
    )
    for half in dict.fromkeys(key[0] for key in values):
        lines = []
        for (where, tracker, distance), figures in values.items():
            if where == half:
                lines.append([_label(tracker, distance), *our_cells(figures)])
                paper = TABLE5[half][PAPER_NAMES[tracker]][distance]
                lines.append(
                    [f"paper: {PAPER_NAMES[tracker]}, {distance:g} m", *paper_cells(paper)]
                )
        text += f"\n## {titles[half]}\n\n" + markdown(["", *TABLE5_COLUMNS], lines)
    return text


def _label(tracker: str, distance: float) -> str:
    return f"{TRACKER_NAMES[tracker]}, {distance:g} m"


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
        {"boxes": half, "tracker": tracker, "displacement": distance, "per_seed": figures}
        for (half, tracker, distance), figures in values.items()
    ]


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
