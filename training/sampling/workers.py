"""Worker processes that make samples, for accelerators that are faster than one Python process."""

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

_samples: Callable[[int, int], Any] | None = None  # in each worker
_PR_SET_PDEATHSIG = 1  # Linux: the signal that a process gets when its parent dies


class SampleWorkers:
    """Makes samples in `processes` worker processes; the same samples as in this process.

    Args:
        samples: a picklable (index, position) -> sample, such as those of `sample_sets`.
    """

    def __init__(self, samples: Callable[[int, int], Any], processes: int):
        self._pool = ProcessPoolExecutor(
            processes,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(samples, os.getpid()),
        )

    def __call__(self, index: int, position: int) -> Any:
        """The sample; may be called by several threads at once."""
        return self._pool.submit(_make, index, position).result()

    def close(self) -> None:
        """Ends the workers; calls that wait are cancelled."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _begin(samples: Callable[[int, int], Any], parent: int) -> None:
    global _samples  # noqa: PLW0603 - set once, at the start of each worker
    _samples = samples
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles it and ends the workers
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it died before prctl
        os._exit(1)


def _make(index: int, position: int) -> Any:
    assert _samples is not None
    return _samples(index, position)
