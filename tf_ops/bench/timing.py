"""Medians of alternating calls, so that load of the machine affects both sides.

Each timed call follows an untimed one of the same side; otherwise it would include the cost of the
other side's sleeping or spinning threads and of cold caches.
"""

import time
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from tf_ops.bench.cases import Case  # its peers are packages of the benchmark alone

WARM_UP = 2
LONG_S = 1.0  # a peer is called a second time unless the first call takes longer


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def seconds_when_warm(call: Callable[[], object]) -> float:
    call()
    return seconds(call)


def in_turns(timers: Sequence[Callable[[], float]], calls: int) -> np.ndarray:
    """(calls, timers) results; every other round is reversed, so that no timer is always first."""
    rounds = []
    for i in range(calls):
        order = range(len(timers)) if i % 2 == 0 else reversed(range(len(timers)))
        found = {k: timers[k]() for k in order}
        rounds.append([found[k] for k in range(len(timers))])
    return np.array(rounds)


def probe(peer: Callable[[], object]) -> float:
    """Seconds of a call, for the choice of the fastest peer."""
    first = seconds(peer)
    return first if first > LONG_S else min(first, seconds(peer))


def measure(case: "Case", calls: int) -> dict[str, Any]:
    """One row of the table: median times in milliseconds, and their ratio to the best peer's."""
    for _ in range(WARM_UP):
        case.ours()
    now = datetime.now(timezone.utc).isoformat(timespec="seconds")
    row: dict[str, Any] = {"case": case.name, "batch": case.batch, "goal": case.goal, "time": now}
    probes = {name: probe(peer) for name, peer in case.peers.items()}
    best = min(probes, key=probes.get)
    sides = (case.ours, case.peers[best])
    times = in_turns([partial(seconds_when_warm, call) for call in sides], calls)
    ours, peer = 1e3 * np.median(times, axis=0)
    spread = 1e3 * np.percentile(times, [25, 75], axis=0).T
    return row | {
        "ours_ms": float(ours),
        "ours_quartiles_ms": spread[0].tolist(),
        "peer": best,
        "peer_ms": float(peer),
        "peer_quartiles_ms": spread[1].tolist(),
        "ratio": float(ours / peer),
        "probes_ms": {name: 1e3 * value for name, value in probes.items()},
    }
