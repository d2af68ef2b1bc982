"""Table VI of the paper, on other data: KITTI's 2-D protocol where labels and scans are at hand.

    python -m experiments.table6 --data_root KITTI --seqs 0000 --weights weights --out results

The paper's row is of KITTI's test server, whose labels are not public. This table measures the
trackers under the same protocol (`kitti2d`: cars, 2-D IoU 0.5, KITTI's ignore rules) on sequences
with labels, so the rows compare with each other and not with the paper's. The networks run once,
about 0.25 s a frame. Writes table6.md and table6.json.
"""

from collections.abc import Sequence

from common import flags
from common.markdown import markdown
from evaluation.config import NETWORK
from evaluation.side_by_side import SIDE_BY_SIDE
from experiments.paper import TABLE5_COLUMNS, TABLE6
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_network_flags,
    common_fields,
    details_of,
    make_parser,
    measure_rows,
    network_fields,
    write,
)
from experiments.table5 import our_cells, paper_cells
from kitti.objects import VEHICLES
from kitti.seqmap import sequence_name


def main(argv: Sequence[str] | None = None) -> None:
    """Evaluates the trackers, prints and writes the table."""
    parser = make_parser(__doc__, "0000")
    add_network_flags(parser)
    parser.set_defaults(classes=VEHICLES)
    args = parser.parse_args(argv)
    if args.weights is None:
        parser.error("argument --weights: expected a folder of weights")
    fields = {**common_fields(args), **network_fields(args)}
    rows = {
        tracker: Run(tracker=tracker, detections=NETWORK, protocol="kitti2d", **fields)
        for tracker in SIDE_BY_SIDE
    }
    details = details_of(rows.values(), 1)
    values = measure_rows(rows, 1, "table 6")
    lines = [[TRACKER_NAMES[tracker], *our_cells(metrics)] for tracker, metrics in values.items()]
    lines.append(["paper: PointTrackNet, test server", *paper_cells(TABLE6)])
    names = ", ".join(map(sequence_name, args.seqs))
    text = (
        f"`kitti2d`, cars, on the detector's boxes of sequence {names}; the paper's row is of "
        "other data: the 29 test sequences, whose labels are not public.\n\n"
    )
    text += markdown(["", *TABLE5_COLUMNS], lines)
    figures = [{"tracker": tracker, "kitti2d": m} for tracker, (m,) in values.items()]
    write(args.out, "table6", "Table VI", text, figures, **details)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
