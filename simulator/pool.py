"""Jobs over processes. A job is a range of frames of one sequence.

Every frame's bytes depend on the data set's description and on (sequence, frame) alone, so the
result depends neither on the number of processes nor on interruptions. The description counts: the
traffic of a sequence is laid out for its number of frames.
"""

import contextlib
import json
import os
import signal
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from functools import lru_cache
from multiprocessing.synchronize import Event
from pathlib import Path

from common.processes import SPAWN, end_with_parent
from kitti.labels import write_labels
from kitti.scans.scan_files import write_scan
from kitti.seqmap import sequence_name
from simulator.config import SENSOR
from simulator.drivers import DRIVERS
from simulator.plan import Plan, World, part_path, scan_path
from simulator.sensor_model.frames import Options, ego_velocity, take_sweep

Job = tuple[int, list[int]]
"""Sequence number and frames; no frames: the text files alone."""

_stop: Event | None = None  # in each worker: set when the run is interrupted


def run_jobs(plan: Plan, root: Path, jobs: list[Job], processes: int) -> Iterator[None]:
    """Runs the jobs; yields at intervals for a progress display.

    After an interruption each worker finishes its current frame and stops.

    Raises:
        ChildProcessError: a worker process was killed; what it had finished is on disk.
    """
    if processes == 1:
        for seq, frames in jobs:
            for first in range(0, max(len(frames), 1), 10):
                _work(plan, root, seq, frames[first : first + 10])
                yield
        return
    try:
        yield from _in_processes(plan, root, jobs, processes)
    except BrokenProcessPool as error:
        remedy = "(out of memory?); the same command goes on"
        raise ChildProcessError(f"a worker process was killed {remedy}") from error


def _in_processes(plan: Plan, root: Path, jobs: list[Job], processes: int) -> Iterator[None]:
    stop = SPAWN.Event()
    with ProcessPoolExecutor(
        processes, mp_context=SPAWN, initializer=_begin, initargs=(stop,)
    ) as pool:
        with _one_thread_each():
            waiting = {pool.submit(_work, plan, root, seq, frames) for seq, frames in jobs}
        try:
            while waiting:
                done, waiting = wait(waiting, timeout=2.0, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                yield
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started meanwhile use one thread: they share the cores, their matrices are small.

    The pool starts its processes as jobs are submitted.
    """
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _begin(stop: Event) -> None:
    global _stop  # noqa: PLW0603 - set once, at the start of each worker
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles it and sets `stop`
    end_with_parent()


def _work(plan: Plan, root: Path, seq: int, frames: list[int]) -> None:
    world = _world(json.dumps(asdict(plan), sort_keys=True), seq)
    world.write_texts(root / "training", sequence_name(seq), plan.frames[seq])
    for frame in frames:
        if _stop is not None and _stop.is_set():
            return
        result = take_sweep(
            world.scene(frame, plan.options.motion_distortion),
            world.calib,
            world.image_size,
            plan.options,
            (plan.seed, seq, frame),
            ego_velocity(world.poses, frame, SENSOR.period_s),
        )
        rows = world.labels(frame, result)
        if rows is not None:
            write_labels(part_path(root, seq, frame), rows)
        write_scan(scan_path(root, seq, frame), result.points)


@lru_cache(maxsize=2)
def _world(plan_json: str, seq: int) -> World:
    """A sequence's world, built once per process and identical in all of them."""
    fields = json.loads(plan_json)
    fields["options"] = Options(**fields["options"])
    fields["frames"] = {int(key): count for key, count in fields["frames"].items()}
    plan = Plan(**fields)
    return DRIVERS[plan.driver](plan, seq)
