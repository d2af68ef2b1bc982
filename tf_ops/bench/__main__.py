"""Measures the ops, and puts the tables into tf_ops/README.md.

table: against the best CPU library, bench.json. growth: over the size of the cloud, growth.json and
growth.png. native: the portable build against that for this machine, native.json. readme: measures
nothing, writes the tables of the JSON files in tf_ops/docs into the README.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.files import write_json
from common.flags import ArgumentParser, positive_int, run
from common.progress import progress
from common.provenance import ROOT, provenance
from tf_ops.bench import tables

THREADS = 2
WHAT = ("table", "growth", "native", "readme", "serve")  # serve: one build's process of `native`
PEERS = ("fpsample", "pykdtree", "pynanoflann", "shapely", "scipy")


def parse(argv: Sequence[str] | None):
    parser = ArgumentParser(description=__doc__, prog="tf_ops.bench")
    parser.add_argument("what", choices=WHAT, help="what to measure")
    parser.add_argument(
        "--kitti_root",
        type=Path,
        default=ROOT / "../shared/kitti",
        help="KITTI tracking data; without it scans are synthesised",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "tf_ops/docs", help="output folder")
    parser.add_argument("--calls", type=positive_int, default=21, help="timed calls of each")
    parser.add_argument(
        "--group",
        choices=("all", "one", "batch", "large", "other"),
        default="all",
        help="measure these rows of the table, keep the others of its file",
    )
    parser.add_argument("--name", default="bench", help="name of the table's JSON file")
    parser.add_argument("--ours_only", action="store_true", help="leave the peers out")
    return parser.parse_args(argv)


def machine() -> str:
    """The processor's name where the system tells it."""
    info = Path("/proc/cpuinfo")
    names = [
        line.partition(":")[2].strip()
        for line in (info.read_text().splitlines() if info.is_file() else ())
        if line.startswith("model name")
    ]
    return names[0] if names else platform.processor()


def main(argv: Sequence[str] | None = None) -> None:
    args = parse(argv)
    if args.what == "readme":
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

    if args.what == "serve":
        return builds.serve(args.kitti_root)
    record = moment(args)
    if args.what == "table":
        report = {"rows": table(args), "provenance": record}
        write_json(args.out / f"{args.name}.json", report)
        print(tables.peers_table(report))
    elif args.what == "native":
        report = {"rows": builds.measure(args.calls, args.kitti_root), "provenance": record}
        write_json(args.out / "native.json", report)
        print(tables.builds_table(report))
    else:
        curves = growth.measure()
        growth.plot(curves, args.out / "growth.png")
        write_json(args.out / "growth.json", {"curves": curves, "provenance": record})


def moment(args: argparse.Namespace) -> dict[str, Any]:
    """What the figures depend on."""
    from tf_ops.bench import scans

    return provenance(
        processor=machine(),
        threads=THREADS,
        calls=args.calls,
        scan=scans.scan(args.kitti_root, 15000)[1],
        instructions=os.environ.get("TF_OPS_INSTRUCTIONS", "the widest of this processor"),
        peers={name: metadata.version(name) for name in PEERS},
    )


def table(args: argparse.Namespace) -> list[dict[str, Any]]:
    """The rows of the table against the peers; of groups not measured now, those of the file."""
    from tf_ops.bench import cases, timing

    chosen = [
        (name, case)
        for name in (cases.GROUPS if args.group == "all" else [args.group])
        for case in cases.group(name, args.kitti_root)
    ]
    rows = [
        {"group": name, **timing.measure(case, args.calls, args.ours_only)}
        for name, case in progress(chosen, len(chosen), "bench", "case")
    ]
    path = args.out / f"{args.name}.json"
    before = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    rows += [row for row in before if row["group"] not in {name for name, _ in chosen}]
    return sorted(rows, key=lambda row: cases.GROUPS.index(row["group"]))


if __name__ == "__main__":
    raise SystemExit(run(main))
