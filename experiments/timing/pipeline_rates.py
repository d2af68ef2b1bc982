"""Samples a second out of the input pipeline alone, over CPU cores and worker processes."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial

from kitti.sequence import KittiSequence

START_SECONDS = 12.0  # until all workers have started and the buffers are full
TIMED_SECONDS = 5.0
ENDLESS = 10**6  # more steps than are taken
TIMES = 100  # that a sequence stands in a training's data: its frames are never in memory


def pipeline_rates(networks, sequence: KittiSequence) -> list[dict[str, float]]:
    """A row for each number of cores and of worker processes, of batches that nobody trains on.

    Cores are doubled up to all that this process may use. Workers: none (threads of this process),
    half as many as cores, and as many. Samples are those of the default training configuration,
    each read from its file.
    """
    from training.config import DetectorTrainingConfig, ScheduleConfig, TrackerTrainingConfig
    from training.detector_task import DetectorTask
    from training.tracker_task import TrackerTask

    detector, tracker, _ = networks
    schedule, data = ScheduleConfig(batch_size=4), ([sequence] * TIMES, [])
    detection = DetectorTrainingConfig(detector=detector.config, schedule=schedule)
    tracking = TrackerTrainingConfig(tracker=tracker.config, schedule=schedule)
    tasks = {
        "detector samples": partial(DetectorTask, detection, *data),
        "tracker pairs": partial(TrackerTask, tracking, detector, *data),
    }
    rows = []
    for cores in doubled(len(os.sched_getaffinity(0))):
        with limited_to(cores):
            for workers in sorted({0, max(1, cores // 2), cores}):
                rates = {name: _samples_a_second(task, workers) for name, task in tasks.items()}
                rows.append({"cores": cores, "workers": workers, **rates})
    return rows


def doubled(last: int) -> list[int]:
    """1, 2, 4, ... below `last`, and `last`."""
    return [2**i for i in range((last - 1).bit_length())] + [last]


@contextmanager
def limited_to(cores: int) -> Iterator[None]:
    """All threads of this process, and what they start, on this number of cores."""
    everything = os.sched_getaffinity(0)
    _set_affinity(set(sorted(everything)[:cores]))
    try:
        yield
    finally:
        _set_affinity(everything)


def _set_affinity(cores: set[int]) -> None:
    for thread in os.listdir("/proc/self/task"):
        with suppress(ProcessLookupError):  # it has ended
            os.sched_setaffinity(int(thread), cores)


def _samples_a_second(make_task: Callable, workers: int) -> float:
    from training.loop import training_data
    from training.strategies import make_strategy
    from training.training_run import start

    with tempfile.TemporaryDirectory() as folder:
        run = start(make_task, make_strategy("one"), folder, {}, workers=workers)
        try:
            batches = iter(training_data(run, 0, ENDLESS))
            _take(batches, START_SECONDS if workers else TIMED_SECONDS)
            count, seconds = _take(batches, TIMED_SECONDS)
        finally:
            run.close()
    return count * run.order.batch_size / seconds


def _take(batches: Iterator, seconds: float) -> tuple[int, float]:
    """Takes batches for some seconds, at least one; their number and the time that they took."""
    begin, count = time.perf_counter(), 0
    while count == 0 or time.perf_counter() - begin < seconds:
        next(batches)
        count += 1
    return count, time.perf_counter() - begin
