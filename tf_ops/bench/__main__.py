"""Benchmark of the ops, and the tables of tf_ops/README.md.

table: against the fastest CPU library, bench.json. growth: over the size of the cloud, growth.json
and growth.png. native: the portable build against the one for this machine, native.json. readme:
writes the tables of the JSON files in tf_ops/docs into the README, without a measurement.
"""

import argparse
import importlib.util
import os
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.files import write_json
from common.flags import ArgumentParser, positive_int, run
from common.progress import progress
from common.provenance import ROOT, processor, provenance
from tf_ops.bench import tables

THREADS = 2
MODES = ("table", "growth", "native", "readme", "serve")  # serve: the process of a build
PEERS = ("fpsample", "pykdtree", "pynanoflann", "shapely", "scipy")


def parse(argv: Sequence[str] | None):
    parser = ArgumentParser(description=__doc__, prog="tf_ops.bench")
    parser.add_argument("mode", choices=MODES, help="benchmark to run")
    parser.add_argument(
        "--kitti_root",
        type=Path,
        default=ROOT / "../shared/kitti",
        help="KITTI tracking data; without it scans are synthesised",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "tf_ops/docs", help="output folder")
    parser.add_argument("--calls", type=positive_int, default=21, help="timed calls per case")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    args = parse(argv)
    if args.mode == "readme":
        return tables.write()
    missing = [name for name in PEERS if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(
            f"{', '.join(missing)} missing; run `make bench`, which installs requirements-bench.txt"
        )
    os.environ.setdefault("OMP_NUM_THREADS", str(THREADS))  # before pykdtree is loaded
    import tensorflow as tf

    tf.config.threading.set_intra_op_parallelism_threads(THREADS)
    from tf_ops.bench import builds, growth

    if args.mode == "serve":
        return builds.serve(args.kitti_root)
    record = moment(args)
    if args.mode == "table":
        report = {"rows": table(args), "provenance": record}
        write_json(args.out / "bench.json", report)
        print(tables.peers_table(report))
    elif args.mode == "native":
        report = {"rows": builds.measure(args.calls, args.kitti_root), "provenance": record}
        write_json(args.out / "native.json", report)
        print(tables.builds_table(report))
    else:
        curves = growth.measure()
        growth.plot(curves, args.out / "growth.png")
        write_json(args.out / "growth.json", {"curves": curves, "provenance": record})


def moment(args: argparse.Namespace) -> dict[str, Any]:
    """Provenance of the measurement."""
    from tf_ops.bench import scans

    return provenance(
        processor=processor(),
        threads=THREADS,
        calls=args.calls,
        scan=scans.scan(args.kitti_root, 15000)[1],
        instructions=os.environ.get("TF_OPS_INSTRUCTIONS", "the widest of this processor"),
        peers={name: metadata.version(name) for name in PEERS},
    )


def table(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows of all cases against the peers."""
    from tf_ops.bench import cases, timing

    chosen = cases.all_cases(args.kitti_root)
    return [
        timing.measure(case, args.calls) for case in progress(chosen, len(chosen), "bench", "case")
    ]


if __name__ == "__main__":
    raise SystemExit(run(main))
