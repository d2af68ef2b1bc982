"""Figure 5 of the paper: MOTA of each tracker over the displacement, ground-truth boxes.

    python -m experiments.figure5 --data_root KITTI --out results/figure5

Writes figure5.csv (mean and spread over the seeds) and figure5.png.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common import flags
from common.errors import InputError
from common.files import atomic_path, write_text
from experiments.paper import TABLE5
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_shift_flags,
    common_fields,
    make_parser,
    mean_and_spread,
    measure_rows,
)

TRACKERS = ("gt_displacement", "deep_sort", "sort")
DISTANCES = "0,0.5,1,1.5,2"
HEADER = "tracker,displacement_m,seeds,mota_mean,mota_std\n"
Curve = list[tuple[float, int, float, float]]


def main(argv: Sequence[str] | None = None) -> None:
    """Runs every tracker at every distance."""
    parser = make_parser(__doc__)
    add_shift_flags(parser)
    parser.add_argument("--distances", default=DISTANCES, help="metres, separated by commas")
    args = parser.parse_args(argv)
    fields, distances = common_fields(args), parse_distances(args.distances)
    rows = {
        (tracker, distance): Run(tracker=tracker, object_shift=distance, **fields)
        for tracker in TRACKERS
        for distance in distances
    }
    curves: dict[str, Curve] = {tracker: [] for tracker in TRACKERS}
    for (tracker, distance), metrics in measure_rows(rows, args.seeds, "figure 5").items():
        mota = mean_and_spread([found["MOTA"] for found in metrics])
        curves[tracker].append((distance, len(metrics), *mota))
    write_text(args.out / "figure5.csv", csv_text(curves))
    draw(args.out / "figure5.png", curves)
    print(csv_text(curves), end="")


def parse_distances(text: str) -> list[float]:
    """ "0,0.5" -> [0.0, 0.5]; InputError unless metres >= 0."""
    try:
        distances = [float(part) for part in text.split(",")]
    except ValueError:
        distances = []
    if not distances or not all(0 <= distance < 1e3 for distance in distances):
        raise InputError(f"--distances: expected metres such as 0,1,2, found {text!r}")
    return distances


def csv_text(curves: dict[str, Curve]) -> str:
    """One line per tracker and displacement."""
    return HEADER + "".join(
        f"{tracker},{distance:g},{seeds},{mean:.6f},{spread:.6f}\n"
        for tracker, curve in curves.items()
        for distance, seeds, mean, spread in curve
    )


def draw(path: Path, curves: dict[str, Curve]) -> None:
    """The curves with their spread, and the paper's end points as crosses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    for tracker, curve in curves.items():
        distance, _, mean, spread = zip(*curve, strict=True)
        axes.errorbar(
            distance, mean, spread, capsize=3, marker="o", ms=4, label=TRACKER_NAMES[tracker]
        )
    for name, ends in TABLE5["gt"].items():
        axes.plot(list(ends), [row[0] for row in ends.values()], "x", label=f"paper: {name}")
    axes.set(xlabel="displacement, up to (m)", ylabel="MOTA", title="Ground-truth boxes")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
