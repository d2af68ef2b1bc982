"""Readings of the paper's displacement experiment (IV.D): which comes nearest to Table V.

    python -m studies.displacement_readings --data_root KITTI --out results/readings

SORT on level-frame boxes and on image boxes, and DEEP_SORT, on ground-truth boxes shifted by up to
2.0 m, under every reading of `kitti.object_shift`. The nearest reading is the one whose SORT, in
either space, is nearest to the paper's MOTA on the training sequences; the validation sequences
only report its result. SORT has its authors' parameters; DEEP_SORT's filter noise is
fitted (`studies.deep_sort_noise`), so it takes no part in the choice.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from common import flags
from common.errors import InputError
from common.markdown import markdown
from evaluation.config import parse_seqs
from experiments.paper import TABLE5
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_shift_flags,
    common_fields,
    details_of,
    make_parser,
    mean_and_spread,
    measure_rows,
    shown,
    write,
)
from kitti.object_shift import DEFAULT_READING, LENGTHS

DISTANCE = 2.0
PAPER_NAMES = {"sort": "SORT", "sort_image": "SORT", "deep_sort": "DEEP_SORT"}
SPACES = ("sort", "sort_image")
TITLES = {
    "uniform": "length uniform in [0, D], any direction",
    "fixed": "length D, any direction",
    "per_axis": "x and y each uniform in [-D, D]",
    "per_axis_positive": "x and y each uniform in [0, D]",
}
Reading = tuple[str, bool]
Measured = Mapping[tuple[str, bool, str], list[dict[str, Any]]]


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the trackers under every reading, writes displacement_readings.md and .json."""
    parser = make_parser(__doc__, "0000-0015")
    add_shift_flags(parser)
    parser.add_argument("--val_seqs", type=parse_seqs, default="0016-0020", help="shown beside")
    args = parser.parse_args(argv)
    base = Run(tracker="sort", object_shift=DISTANCE, **common_fields(args))
    rows = {
        (length, hold, tracker): replace(base, tracker=tracker, length=length, hold=hold)
        for length in LENGTHS
        for hold in (False, True)
        for tracker in PAPER_NAMES
    }
    training = measure_rows(rows, args.seeds, "readings, training sequences")
    length, hold, space = nearest(training)
    chosen = {key: run for key, run in rows.items() if key[:2] in ((length, hold), DEFAULT_READING)}
    chosen = {key: replace(run, seqs=args.val_seqs) for key, run in chosen.items()}
    validation = measure_rows(chosen, args.seeds, "readings, validation sequences")
    figures = {"training": _figures(training), "validation": _figures(validation)}
    text = (
        f"MOTA at D = {DISTANCE:g} m, ground-truth boxes of {', '.join(args.classes)}, mean ± "
        f"standard deviation over {args.seeds} seeds; * marks the default reading.\n\n"
        + _table("training sequences", training)
        + f"\nNearest to the paper's SORT there: {TRACKER_NAMES[space]}, {_title((length, hold))}. "
        "It and the default on the validation sequences:\n\n"
        + _table("validation sequences", validation)
    )
    title = "Readings of the displacement"
    details = details_of([*rows.values(), *chosen.values()], args.seeds)
    write(args.out, "displacement_readings", title, text, figures, **details)


def nearest(measured: Measured) -> tuple[str, bool, str]:
    """Length, hold and space of the SORT whose mean MOTA is nearest to the paper's.

    Raises:
        InputError: MOTA is undefined, since no object is labelled.
    """
    paper = TABLE5["gt"]["SORT"][DISTANCE][0]
    means = {
        key: mean_and_spread([metrics["MOTA"] for metrics in seeds])[0]
        for key, seeds in measured.items()
        if key[2] in SPACES
    }
    if None in means.values():
        raise InputError("expected labelled boxes of --classes in --seqs, found none")
    gaps = {key: abs(value - paper) for key, value in means.items()}
    return min(gaps, key=gaps.__getitem__)


def _title(reading: Reading) -> str:
    length, hold = reading
    return f"{TITLES[length]}, {'held by an object' if hold else 'fresh in each frame'}"


def _table(sequences: str, measured: Measured) -> str:
    lines = []
    for reading in dict.fromkeys(key[:2] for key in measured):
        cells = [
            shown([metrics["MOTA"] for metrics in measured[(*reading, tracker)]], 3)
            for tracker in PAPER_NAMES
        ]
        lines.append([_title(reading) + " *" * (reading == DEFAULT_READING), *cells])
    paper = [f"{TABLE5['gt'][name][DISTANCE][0]:.3f}" for name in PAPER_NAMES.values()]
    lines.append(["the paper, on 0016-0020", *paper])
    return markdown([sequences, *map(TRACKER_NAMES.__getitem__, PAPER_NAMES)], lines)


def _figures(measured: Measured) -> list[dict[str, Any]]:
    return [
        {"length": length, "hold": hold, "tracker": tracker, "per_seed": seeds}
        for (length, hold, tracker), seeds in measured.items()
    ]


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
