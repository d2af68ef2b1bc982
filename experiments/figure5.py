"""Figure 5 of the paper: MOTA of each tracker over the displacement, on true and detected boxes.

    python -m experiments.figure5 --data_root SCANS --seqs 0016,0018 --weights weights --out results

With `--weights` and scans: PointTrackNet with the displacement that its network predicts, and a
second panel on the network's boxes. Without: the baselines and Algorithm 1 with the displacement of
the labels (the paper's "gt_tracking"), on true boxes. The networks run once for each distance and
seed, about 0.25 s a frame. Writes figure5.csv (mean and spread over the seeds), .json and .png.
"""

from collections.abc import Sequence
from pathlib import Path

from common import flags
from common.files import atomic_path, write_json, write_text
from common.markdown import cell
from common.provenance import provenance
from evaluation.config import GROUND_TRUTH, NETWORK
from evaluation.side_by_side import OURS
from experiments.paper import TABLE5
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_network_flags,
    add_shift_flags,
    common_fields,
    details_of,
    make_parser,
    mean_and_spread,
    measure_rows,
    network_fields,
)
from experiments.table5 import UPPER_BOUND

PANELS = {GROUND_TRUTH: "Ground-truth boxes", NETWORK: "The detector's boxes"}
BASELINES = ("ab3dmot", "deep_sort", "sort")
COLORS = {
    "pointtracknet": "tab:red",
    "pointtracknet_no_probation": "tab:pink",
    "ab3dmot": "tab:green",
    "deep_sort": "tab:orange",
    "sort": "tab:blue",
    UPPER_BOUND: "tab:gray",
}
PAPER = {"SORT": "sort", "DEEP_SORT": "deep_sort", "PointTrackNet": "pointtracknet"}
DISTANCES = "0,0.5,1,1.5,2"
HEADER = "boxes,tracker,displacement_m,seeds,mota_mean,mota_std\n"
Curve = list[tuple[float, int, float | None, float]]
"""Distance, seeds, mean (None without a labelled vehicle) and standard deviation of MOTA."""
Curves = dict[tuple[str, str], Curve]
"""(boxes, tracker) -> its curve."""


def main(argv: Sequence[str] | None = None) -> None:
    """Runs every tracker at every distance."""
    parser = make_parser(__doc__)
    add_shift_flags(parser)
    add_network_flags(parser)
    text = "of the object shift, metres, separated by commas"
    parser.add_argument("--distances", type=flags.non_negative_floats, default=DISTANCES, help=text)
    args = parser.parse_args(argv)
    fields, distances = common_fields(args), args.distances
    panels = {GROUND_TRUTH: (*BASELINES, UPPER_BOUND)}
    if args.weights is not None:
        fields |= network_fields(args)
        panels[GROUND_TRUTH] = (*OURS, *BASELINES, UPPER_BOUND)
        panels[NETWORK] = (*OURS, *BASELINES)
    rows = {
        (boxes, tracker, distance): Run(
            tracker=tracker, detections=boxes, object_shift=distance, **fields
        )
        for boxes, trackers in panels.items()
        for tracker in trackers
        for distance in distances
    }
    details = details_of(rows.values(), args.seeds)
    values = measure_rows(rows, args.seeds, "figure 5")
    curves: Curves = {}
    for (boxes, tracker, distance), metrics in values.items():
        mota = mean_and_spread([found["MOTA"] for found in metrics])
        curves.setdefault((boxes, tracker), []).append((distance, len(metrics), *mota))
    figures = [
        {"boxes": boxes, "tracker": tracker, "displacement": distance, "per_seed": metrics}
        for (boxes, tracker, distance), metrics in values.items()
    ]
    write_text(args.out / "figure5.csv", csv_text(curves))
    write_json(args.out / "figure5.json", {"run": provenance(**details), "figures": figures})
    draw(args.out / "figure5.png", curves)
    print(csv_text(curves), end="")


def csv_text(curves: Curves) -> str:
    """One line per boxes, tracker and displacement."""
    return HEADER + "".join(
        f"{boxes},{tracker},{distance:g},{seeds},{cell(mean, 6)},{spread:.6f}\n"
        for (boxes, tracker), curve in curves.items()
        for distance, seeds, mean, spread in curve
    )


def draw(path: Path, curves: Curves) -> None:
    """Plots a panel per kind of boxes: curves with a band over seeds, the paper's values as x."""
    from matplotlib.figure import Figure

    panels = [boxes for boxes in PANELS if any(key[0] == boxes for key in curves)]
    figure = Figure(figsize=(5.2 * len(panels), 4.2), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for boxes, axis in zip(panels, axes, strict=True):
        for (where, tracker), curve in curves.items():
            if where == boxes:
                _curve(axis, tracker, curve)
        paper = TABLE5["gt" if boxes == GROUND_TRUTH else "predicted"]
        for name, ends in paper.items():
            motas, color = [row[0] for row in ends.values()], COLORS[PAPER[name]]
            axis.plot(list(ends), motas, "x", color=color, label=f"paper: {name}")
        axis.set(xlabel="displacement, up to (m)", title=PANELS[boxes])
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    axes[0].set_ylabel("MOTA")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=120, metadata={"Software": None})


def _curve(axis, tracker: str, curve: Curve) -> None:
    defined = [row for row in curve if row[2] is not None]
    if not defined:
        return
    distance, _, mean, spread = zip(*defined, strict=True)
    color = COLORS[tracker]
    style = "o--" if tracker == UPPER_BOUND else "o-"  # drawn last: others may lie under it
    axis.plot(distance, mean, style, ms=4, color=color, label=TRACKER_NAMES[tracker])
    low = [m - s for m, s in zip(mean, spread, strict=True)]
    high = [m + s for m, s in zip(mean, spread, strict=True)]
    axis.fill_between(distance, low, high, color=color, alpha=0.2, linewidth=0)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
