"""Measures the ops: `table` against the best CPU library, `growth` over the size of the cloud.

Writes bench.json, or growth.json and growth.png, into --out; `table` also prints itself.
"""

from __future__ import annotations

import importlib.util
import os
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.files import write_json
from common.flags import ArgumentParser, positive_int, run
from common.progress import progress
from common.provenance import ROOT, provenance

THREADS = 2
GROUPS = ("one", "batch", "other")  # one cloud; eight clouds; boxes and features
PEERS = ("fpsample", "pykdtree", "pynanoflann", "shapely", "scipy")


def parse(argv: Sequence[str] | None):
    parser = ArgumentParser(description=__doc__, prog="tf_ops.bench")
    parser.add_argument("what", choices=("table", "growth"), help="what to measure")
    parser.add_argument(
        "--kitti_root",
        type=Path,
        default=ROOT / "../shared/kitti",
        help="KITTI tracking data; without it scans are synthesised",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "tf_ops/docs", help="output folder")
    parser.add_argument("--calls", type=positive_int, default=21, help="timed calls of each")
    parser.add_argument(
        "--group", choices=("all", *GROUPS), default="all", help="measure these rows of the table"
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


def print_table(rows: list[dict[str, Any]]) -> None:
    print("| op | batch | ours, ms | best peer | its ms | ratio | goal |")
    print("|---|---|---|---|---|---|---|")
    for row in rows:
        peer = (
            "| - | - | - |"
            if "peer" not in row
            else (f"| {row['peer']} | {row['peer_ms']:.2f} | {row['ratio']:.2f} |")
        )
        print(f"| {row['case']} | {row['batch']} | {row['ours_ms']:.2f} {peer} {row['goal']} |")


def main(argv: Sequence[str] | None = None) -> None:
    args = parse(argv)
    missing = [name for name in PEERS if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(
            f"{', '.join(missing)} missing; run `make bench`, which installs requirements-bench.txt"
        )
    os.environ.setdefault("OMP_NUM_THREADS", str(THREADS))  # before pykdtree is loaded
    import tensorflow as tf

    tf.config.threading.set_intra_op_parallelism_threads(THREADS)
    from tf_ops.bench import cases, growth, scans, timing

    record = provenance(
        processor=machine(),
        threads=THREADS,
        calls=args.calls,
        scan=scans.scan(args.kitti_root, 15000)[1],
        instructions=os.environ.get("TF_OPS_INSTRUCTIONS", "the widest of this processor"),
        peers={
            name: importlib.import_module(name).__version__
            if hasattr(importlib.import_module(name), "__version__")
            else None
            for name in PEERS
        },
    )
    if args.what == "table":
        chosen = list(cases.group(args.group, args.kitti_root))
        rows = [
            timing.measure(case, args.calls, args.ours_only)
            for case in progress(chosen, len(chosen), "bench", "case")
        ]
        print_table(rows)
        write_json(args.out / f"{args.name}.json", {"rows": rows, "provenance": record})
    else:
        curves = growth.measure()
        growth.plot(curves, args.out / "growth.png")
        write_json(args.out / "growth.json", {"curves": curves, "provenance": record})


if __name__ == "__main__":
    raise SystemExit(run(main))
