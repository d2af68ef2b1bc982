"""The main job in one command: data, networks, four trackers on the same boxes, table, pictures.

    python demo.py --out results/demo

Without --data_root a few held-out sequences of the simulator's own traffic are made first. What is
done is skipped the next time, and an interrupted demo goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common import flags
from common.errors import InputError
from evaluation.config import parse_threshold
from experiments.demonstration import DemoConfig, run_demo
from kitti.splits import parse_sequences


def parse_displacements(text: str) -> tuple[float, ...]:
    """ "0,2" -> (0.0, 2.0), metres."""
    return tuple(flags.non_negative_float(part.strip()) for part in text.split(","))


def parse_config(argv: Sequence[str] | None = None) -> DemoConfig:
    """Flags to configuration; raises InputError for what does not go together."""
    default = DemoConfig()
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("--out", type=Path, default=default.out, help="folder for everything that is made")
    add("--weights", type=Path, default=default.weights, help="folder of the networks' weights")
    add("--sequences", type=flags.positive_int, help=f"simulated ones ({default.sequences})")
    add("--frames", type=flags.positive_int, help=f"of each simulated one ({default.frames})")
    add("--data_root", type=Path, help="own data in KITTI's tracking layout, not simulated")
    add("--seqs", help="of --data_root, such as 0000 or 0016-0020")
    add("--displacements", type=parse_displacements, default="0,2", help="metres; 0 comes first")
    add("--iou", type=flags.finite_float, default=default.iou, help="least 3-D IoU of a match")
    add(
        "--score_threshold",
        default=str(default.score_threshold),
        help="least mean score of a track, or best",
    )
    args = parser.parse_args(argv)
    if (args.data_root is None) != (args.seqs is None):
        raise InputError("--data_root and --seqs go together")
    if args.data_root is not None and (args.sequences or args.frames):
        raise InputError("--sequences and --frames are for simulated data: leave out --data_root")
    return DemoConfig(
        out=args.out,
        weights=args.weights,
        sequences=args.sequences or default.sequences,
        frames=args.frames or default.frames,
        data_root=args.data_root,
        seqs=() if args.seqs is None else tuple(parse_sequences(args.seqs)),
        displacements=args.displacements,
        iou=args.iou,
        score_threshold=parse_threshold(args.score_threshold),
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the demo; prints the table and where everything is."""
    run_demo(parse_config(argv))


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
