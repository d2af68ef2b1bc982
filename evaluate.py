"""Sequences -> boxes -> trajectories -> CLEAR MOT table.

    python evaluate.py --data_root KITTI --seqs 0016-0020 --tracker sort --out results/sort

Runs a tracker on labelled or detected boxes (or takes somebody's result files, --results) and
evaluates it. `--out` gets tracks/00XX.txt, table.md and metrics.json; with `--subset testing` also
submission.zip for the KITTI server.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common import flags
from common.errors import InputError
from evaluation.config import (
    GROUND_TRUTH,
    NETWORK,
    EvaluateConfig,
    parse_names,
    parse_threshold,
)
from evaluation.run import evaluate
from evaluation.submission import SUBMISSION
from evaluation.table import overall_table, threshold_line
from kitti.labels import VEHICLES
from kitti.splits import TEST, parse_sequences
from metrics.protocols import PROTOCOLS
from tracking import TRACKERS

__all__ = ["EvaluateConfig", "evaluate", "main"]


def make_parser() -> flags.ArgumentParser:
    """The command line."""
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("--data_root", type=Path, required=True, help="folder in KITTI's tracking layout")
    add("--subset", default="training", help="training or testing (which has no labels)")
    add("--seqs", help="such as 0016-0020 or 0000,0003 (default: 0016-0020; testing: all)")
    add("--classes", default=",".join(VEHICLES), help="classes tracked; both sides in clear3d")
    add("--detections", help=f"{GROUND_TRUTH}, {NETWORK} or a folder (default: {GROUND_TRUTH})")
    add("--tracker", help=f"one of {', '.join(TRACKERS)} (default: {EvaluateConfig.tracker})")
    add("--weights", type=Path, default=Path("weights"), help="folder of the networks' weights")
    add("--results", type=Path, help="evaluate the result files of this folder, run no tracker")
    add("--displacement", type=flags.non_negative_float, default=0.0, help="metres, at most")
    add("--seed", type=flags.non_negative_int, default=0, help="of the displacement")
    add("--protocol", help=f"of {','.join(PROTOCOLS)} (default: clear3d; testing: none)")
    add("--iou", type=flags.finite_float, default=0.5, help="least 3-D IoU of a match")
    add(
        "--score_threshold",
        help="least mean score of a track, or best (by MOTA of the first --protocol)",
    )
    add("--out", type=Path, default=Path("results/evaluate"), help="folder for the output")
    return parser


def parse_config(argv: Sequence[str] | None = None) -> EvaluateConfig:
    """Flags to configuration; raises InputError for what does not go together."""
    args = make_parser().parse_args(argv)
    if args.results is not None and (args.tracker or args.detections):
        raise InputError("--results runs no tracker: leave out --tracker and --detections")
    threshold = args.score_threshold
    return EvaluateConfig(
        data_root=args.data_root,
        subset=args.subset,
        seqs=None if args.seqs is None else tuple(parse_sequences(args.seqs)),
        classes=parse_names(args.classes),
        detections=args.detections or GROUND_TRUTH,
        tracker=args.tracker or EvaluateConfig.tracker,
        weights=args.weights,
        results=args.results,
        displacement=args.displacement,
        seed=args.seed,
        protocols=None if args.protocol is None else parse_names(args.protocol),
        iou=args.iou,
        score_threshold=None if threshold is None else parse_threshold(threshold),
        out=args.out,
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Evaluates and prints one table."""
    config = parse_config(argv)
    record = evaluate(config)
    figures = {name: record[name] for name in config.protocols}
    if figures:
        print(overall_table(figures) + threshold_line(record["run"]["score_threshold"]), end="")
    print(f"written to {config.out}")
    if config.subset == "testing":
        missing = len(TEST) - len(config.seqs)
        what = f"lacks {missing} of the server's sequences" if missing else "complete"
        print(f"for the KITTI server: {config.out / SUBMISSION} ({what})")


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
