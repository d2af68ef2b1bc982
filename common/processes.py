"""Worker processes that end with their parent, however that ends."""

import multiprocessing
import os
import threading

SPAWN = multiprocessing.get_context("spawn")
"""A process forked beside TensorFlow's threads may deadlock."""


def end_with_parent() -> None:
    """In a worker process, which it ends as soon as its parent is gone; an `initializer` of pools.

    A worker of a pool would else wait for work for ever. Not by Linux's PR_SET_PDEATHSIG, which
    kills it with the thread that started it.
    """
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
