"""Worker processes that make samples, for accelerators that are faster than one Python process."""

import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from common.errors import InputError
from common.processes import SPAWN, end_with_parent

_samples: Callable[[int, int], Any] | None = None  # in each worker


class SampleWorkers:
    """Makes samples in `processes` worker processes; the same samples as in this process.

    Args:
        samples: a picklable (index, position) -> sample, such as those of `sample_sets`.
    """

    def __init__(self, samples: Callable[[int, int], Any], processes: int):
        self._pool = ProcessPoolExecutor(processes, SPAWN, _begin, (samples,))

    def __call__(self, index: int, position: int) -> Any:
        """The sample; may be called by several threads at once.

        Raises:
            InputError: a worker process was killed.
        """
        try:
            return self._pool.submit(_make, index, position).result()
        except BrokenProcessPool as error:
            raise InputError(
                "a worker process that makes samples was killed (out of memory?): "
                "--resume goes on, perhaps with fewer --workers"
            ) from error

    def close(self) -> None:
        """Ends the workers; calls that wait are cancelled."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _begin(samples: Callable[[int, int], Any]) -> None:
    global _samples  # noqa: PLW0603 - set once, at the start of each worker
    _samples = samples
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles it and ends the workers
    end_with_parent()


def _make(index: int, position: int) -> Any:
    assert _samples is not None
    return _samples(index, position)
