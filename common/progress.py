"""Progress with an ETA: a bar on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from tqdm import tqdm

from common.notes import report

T = TypeVar("T")


class Progress:
    """A bar (tqdm) on a terminal; elsewhere a plain line at most every `interval` seconds.

    Use as a context manager; `update(n, **metrics)` moves it and shows the named metrics.
    Writes to standard error, so standard output stays clean for results.
    """

    def __init__(
        self,
        total: int,
        description: str,
        unit: str = "it",
        initial: int = 0,
        interval: float = 10.0,
    ):
        self.total, self.description, self.unit = total, description, unit
        self.done = self.initial = initial
        self.interval, self.start, self.last = interval, time.monotonic(), time.monotonic()
        self.metrics: dict[str, Any] = {}
        self.bar = None
        if sys.stderr.isatty():
            self.bar = tqdm(
                total=total, desc=description, unit=unit, initial=initial, dynamic_ncols=True
            )

    def update(self, n: int = 1, **metrics: Any) -> None:
        """Moves on by `n` units; `metrics` are shown beside the bar."""
        self.done += n
        self.metrics.update(metrics)
        if self.bar is not None:
            if metrics:
                self.bar.set_postfix(self.metrics, refresh=False)
            self.bar.update(n)
        elif time.monotonic() - self.last >= self.interval or self.done == self.total:
            self.last = time.monotonic()
            report(self._line())

    def _line(self) -> str:
        elapsed = time.monotonic() - self.start
        rate = (self.done - self.initial) / elapsed if elapsed > 0 else 0.0
        eta = tqdm.format_interval((self.total - self.done) / rate) if rate > 0 else "?"
        metrics = "".join(f" {name}={value}" for name, value in self.metrics.items())
        return (
            f"{self.description}: {self.done}/{self.total} {self.unit}, {rate:.2f}/s, "
            f"ETA {eta}{metrics}"
        )

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *exc: object) -> None:
        if self.bar is not None:
            self.bar.close()


def progress(items: Iterable[T], total: int, description: str, unit: str = "it") -> Iterator[T]:
    """Yields `items` while showing a `Progress` over `total` of them."""
    with Progress(total, description, unit) as bar:
        for item in items:
            yield item
            bar.update()
