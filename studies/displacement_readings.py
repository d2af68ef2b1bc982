"""Readings of the paper's displacement experiment (IV.D), each beside Table V.

    python -m studies.displacement_readings --data_root KITTI --out results/readings

The default of `kitti.object_shift` is the reading under which SORT's row with ground-truth boxes
at 2.0 m comes nearest to the paper's, among those that disturb a tracker at all: a shift that an
object keeps over all its frames moves its track as a whole, and every tracker stays as at 0 m.
"""

from __future__ import annotations

from collections.abc import Sequence

from common import flags
from common.markdown import markdown
from experiments.paper import TABLE5, TABLE5_COLUMNS
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_shift_flags,
    common_fields,
    make_parser,
    mean_and_spread,
    measure_rows,
    write,
)
from experiments.table5 import PAPER_NAMES, our_cells, paper_cells
from kitti.object_shift import DEFAULT_READING, LENGTHS

DISTANCE = 2.0
TRACKERS = ("sort", "deep_sort")
TITLES = {"uniform": "length uniform in [0, D]", "per_axis": "x and y each uniform in [-D, D]"}


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the trackers under every reading, writes displacement_readings.md and .json."""
    parser = make_parser(__doc__)
    add_shift_flags(parser)
    args = parser.parse_args(argv)
    fields = common_fields(args)
    rows = {
        (length, hold, tracker): Run(
            tracker=tracker, object_shift=DISTANCE, length=length, hold=hold, **fields
        )
        for length in LENGTHS
        for hold in (False, True)
        for tracker in TRACKERS
    }
    values = measure_rows(rows, args.seeds, "readings")
    figures = [
        {"length": length, "hold": hold, "tracker": tracker, "per_seed": per_seed}
        for (length, hold, tracker), per_seed in values.items()
    ]
    text = f"D = {DISTANCE:g} m, ground-truth boxes, {args.seeds} seeds; * marks the default.\n\n"
    write(
        args.out,
        "displacement_readings",
        "Readings of the displacement",
        text + _table(values),
        figures,
    )


def _table(values: dict[tuple, list[dict]]) -> str:
    lines = []
    for (length, hold, tracker), figures in values.items():
        star = " *" if (length, hold) == DEFAULT_READING else ""
        name = f"{TITLES[length]}, {'held' if hold else 'fresh'}{star}: {TRACKER_NAMES[tracker]}"
        gap, _ = mean_and_spread([figure["MOTA"] for figure in figures])
        paper = TABLE5["gt"][PAPER_NAMES[tracker]][DISTANCE]
        lines.append([name, *our_cells(figures), f"{gap - paper[0]:+.3f}"])
    for tracker in TRACKERS:
        paper = TABLE5["gt"][PAPER_NAMES[tracker]][DISTANCE]
        lines.append([f"paper: {PAPER_NAMES[tracker]}", *paper_cells(paper), "+0.000"])
    return markdown(["reading and tracker", *TABLE5_COLUMNS, "MOTA - paper"], lines)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
