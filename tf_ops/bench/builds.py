"""The portable build against the one for this machine, in two alternating processes.

Both register the same ops and cannot be loaded into one process. The process of each build reads
the number of a case, calls it once and prints the time, so that load of the machine affects both.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import InputError
from common.progress import progress
from common.provenance import ROOT

BUILDS = {name: ROOT / f"tf_ops/build/{name}/libtf_ops.so" for name in ("portable", "native")}
WARM_UP = 3


def serve(kitti_root: Path) -> None:
    """Prints the names of the cases, then a time in seconds for each number read."""
    from tf_ops.bench import cases, timing

    chosen = cases.all_cases(kitti_root)
    print("\t".join(f"{case.name}\t{case.batch}" for case in chosen), flush=True)
    for line in sys.stdin:
        print(timing.seconds_when_warm(chosen[int(line)].ours), flush=True)


@contextmanager
def server(library: Path, kitti_root: Path) -> Iterator[subprocess.Popen]:
    command = [sys.executable, "-m", "tf_ops.bench", "serve", "--kitti_root", str(kitti_root)]
    environment = {**os.environ, "TF_OPS_LIBRARY": str(library)}
    process = subprocess.Popen(
        command, env=environment, cwd=ROOT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        yield process
    finally:
        process.stdin.close()
        process.wait()


def measure(calls: int, kitti_root: Path) -> list[dict[str, Any]]:
    """Rows of {case, batch, portable_ms, native_ms, ratio}: medians of `calls` calls."""
    for name, library in BUILDS.items():
        if not library.is_file():
            raise InputError(f"{name} build missing; run `make ops NATIVE=1 && make ops`", library)
    with ExitStack() as stack:
        servers = [stack.enter_context(server(path, kitti_root)) for path in BUILDS.values()]
        lines = [process.stdout.readline().rstrip("\n") for process in servers]
        names = lines[0].split("\t")
        cases = list(zip(names[::2], names[1::2], strict=True))
        return [
            _row(servers, number, name, int(batch), calls)
            for number, (name, batch) in enumerate(progress(cases, len(cases), "bench", "case"))
        ]


def _row(servers, number: int, name: str, batch: int, calls: int) -> dict[str, Any]:
    from tf_ops.bench import timing

    times = timing.in_turns([partial(_time, s, number) for s in servers], WARM_UP + calls)
    portable, native = 1e3 * np.median(times[WARM_UP:], axis=0)
    return {
        "case": name,
        "batch": batch,
        "portable_ms": float(portable),
        "native_ms": float(native),
        "ratio": float(native / portable),
    }


def _time(process: subprocess.Popen, number: int) -> float:
    process.stdin.write(f"{number}\n")
    process.stdin.flush()
    return float(process.stdout.readline())
