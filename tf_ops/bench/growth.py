"""Time over the size of the cloud, N from 1,000 to 1,000,000, for the ops and their peers."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf
from matplotlib.figure import Figure

import tf_ops
from common.files import atomic_path
from common.progress import progress
from tf_ops.bench import peers, scans
from tf_ops.bench.timing import seconds

SIZES = tuple(round(n) for n in np.logspace(3, 6, 7))
QUERIES = 2048
BUDGET_S = 0.3  # per curve and size; at least one call
LIMIT_MS = 500.0  # a curve ends after two sizes that take longer

Curve = Callable[[np.ndarray], Callable[[], object]]


def curves() -> dict[str, dict[str, Curve]]:
    """Panel -> name -> function from a cloud to the call to be timed."""

    def ours(op):
        def make(xyz):
            points = tf.constant(xyz[None])
            queries = tf.constant(xyz[None, :QUERIES])
            return lambda: op(len(xyz), points, queries)

        return make

    def peer(knn):
        return lambda xyz: partial(knn, xyz[None], xyz[None, :QUERIES])

    return {
        "farthest_point_sample, N / 8 of N": {
            "ours": ours(lambda n, points, _: tf_ops.farthest_point_sample(n // 8, points)),
            **{
                f"fpsample h={h}": lambda xyz, h=h: partial(peers.fps(h), xyz[None], len(xyz) // 8)
                for h in peers.HEIGHTS
            },
        },
        f"query_ball_point, r = 1, 32 of N for {QUERIES}": {
            "ours": ours(
                lambda _, points, queries: tf_ops.query_ball_point(1, 32, points, queries)
            ),
            "scipy": peer(partial(peers.ball_scipy, 1.0)),
        },
        f"knn_point, k = 8 of N for {QUERIES}": {
            "ours": ours(lambda _, points, queries: tf_ops.knn_point(8, points, queries)),
            **{name: peer(partial(knn, 8)) for name, knn in peers.KNN.items()},
        },
    }


def repeated(call: Callable[[], object]) -> float:
    """Median time in ms of the calls within the budget; the first counts only if alone."""
    first = seconds(call)
    calls = int(np.clip(BUDGET_S / max(first, 1e-6), 0, 21))
    return 1e3 * float(np.median([seconds(call) for _ in range(calls)] or [first]))


def curve(make: Curve, clouds: list[np.ndarray]) -> list[float]:
    """Times in ms for the clouds in order of size, up to the limit."""
    times: list[float] = []
    for xyz in clouds:
        if times and min(times[-2:]) > LIMIT_MS:  # two in a row: not a passing stall
            break
        times.append(repeated(make(xyz)))
    return times


def measure() -> list[dict[str, Any]]:
    """A list of {panel, name, sizes, times in ms}."""
    clouds = [scans.synthesised_scan(size) for size in SIZES]
    jobs = [
        (panel, name, make) for panel, names in curves().items() for name, make in names.items()
    ]
    results = []
    for panel, name, make in progress(jobs, len(jobs), "growth", "curve"):
        times = curve(make, clouds)
        results.append({"panel": panel, "name": name, "sizes": SIZES[: len(times)], "ms": times})
    return results


def plot(results: list[dict[str, Any]], path: Path) -> None:
    """Log-log plot, a panel for each op."""
    panels = list(dict.fromkeys(result["panel"] for result in results))
    figure = Figure(figsize=(4.2 * len(panels), 3.6), layout="tight")
    axes = figure.subplots(1, len(panels), squeeze=False)
    for axis, panel in zip(axes[0], panels, strict=True):
        for result in (r for r in results if r["panel"] == panel):
            mine = result["name"] == "ours"
            axis.loglog(
                result["sizes"],
                result["ms"],
                "o-" if mine else ".--",
                linewidth=2.2 if mine else 1.2,
                label=result["name"],
            )
        axis.set(title=panel, xlabel="N", ylabel="ms")
        axis.title.set_size(9)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=90)
