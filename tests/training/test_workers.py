"""Worker processes make the same samples as this process, and end with it."""

import dataclasses
import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR

from common.errors import InputError
from kitti.sequence import open_sequences
from training.config import AugmentationConfig, DetectorTrainingConfig, TrackerTrainingConfig
from training.sampling.sample_sets import DetectorSamples, PairSamples
from training.sampling.workers import SampleWorkers


def sample_sets(root):
    sequences = open_sequences(root, [0], "training")
    augmentation = AugmentationConfig(pasted_objects=2, object_shift_share=1.0)
    config = dataclasses.replace(DetectorTrainingConfig(SMALL_DETECTOR), augmentation=augmentation)
    yield DetectorSamples(sequences, config, augmentation)
    yield PairSamples(sequences, TrackerTrainingConfig(), SMALL_DETECTOR, augmentation)


def assert_same(found, expected):
    for one, other in zip(tf.nest.flatten(found), tf.nest.flatten(expected), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_pickled_set_makes_the_same_samples(tiny_data):
    for samples in sample_sets(tiny_data):
        expected = samples(1, 7)
        assert_same(pickle.loads(pickle.dumps(samples))(1, 7), expected)
        assert not np.array_equal(samples(1, 8).points, expected.points)


@pytest.mark.slow
def test_two_workers(tiny_data):
    samples = next(sample_sets(tiny_data))
    workers = SampleWorkers(samples, 2)
    try:
        for index, position in ((0, 0), (1, 5), (2, 3)):
            assert_same(workers(index, position), samples(index, position))
    finally:
        workers.close()


def process(index, position):
    time.sleep(0.5)  # so that the other call starts the other worker
    return os.getpid()


@pytest.mark.slow
def test_workers_outlive_the_threads_that_started_them():
    """Those of tf.data end with a data set."""
    workers = SampleWorkers(process, 2)
    try:
        with ThreadPoolExecutor(2) as threads:
            first = set(threads.map(workers, (0, 1), (0, 1)))
        time.sleep(0.5)
        with ThreadPoolExecutor(2) as threads:
            again = set(threads.map(workers, (0, 1), (0, 1)))
        assert again == first and len(first) == 2
    finally:
        workers.close()


SCRIPT = """
import os, sys
from training.sampling.workers import SampleWorkers
def pid(index, position): return os.getpid()
if __name__ == "__main__":
    print(SampleWorkers(pid, 1)(0, 0), flush=True)
    sys.stdin.read()
"""


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    with open(f"/proc/{pid}/stat") as file:
        return file.read().split(")")[1].split()[0] == "Z"


def test_workers_end_when_their_parent_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(SCRIPT)
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    with subprocess.Popen(
        [sys.executable, str(script)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as parent:
        worker = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    deadline = time.monotonic() + 20
    while not gone(worker) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert gone(worker)


def test_a_killed_worker_is_an_input_error():
    """As by the kernel, where memory is short."""
    workers = SampleWorkers(eval, 1)
    try:
        with pytest.raises(InputError, match=r"was killed .out of memory.*: --resume goes on"):
            workers("__import__('os')._exit(9)", {})
    finally:
        workers.close()
