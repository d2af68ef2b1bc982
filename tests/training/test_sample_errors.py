"""A broken scan met within a training is the error of that file, not one of TensorFlow."""

import numpy as np
import pytest
import tensorflow as tf
from helpers.detector_run import SHORT, detector_run
from helpers.two_cars import write_sequence

from common.errors import InputError
from training import loop
from training.sampling.pipeline import SampleErrors, dataset

BROKEN = (
    r"0000/{:06d}\.bin: expected a positive multiple of 16 bytes, found 101 \(float32 x,y,z,i\)$"
)


@pytest.fixture
def data(tmp_path):
    return write_sequence(tmp_path / "data", frames=5)


def spoil(data, t: int) -> None:
    (data / f"training/velodyne/0000/{t:06d}.bin").write_bytes(bytes(101))


def batches(make):
    rows = [np.array([i, i + 1]) for i in (0, 2, 4)]
    return dataset(make, lambda sample: sample, lambda: zip(rows, rows, strict=True), 2)


def test_the_exception_of_a_sample_is_raised_again():
    def make(index, position):
        if index == 3:
            raise InputError("found a hole", "scan 3", 7)
        return np.float32(index)

    errors = SampleErrors()
    found = []
    with pytest.raises(InputError) as caught, errors.raised():
        for batch in batches(errors.kept(make)):
            found += batch.numpy().tolist()
    assert found == [0, 1]
    assert (str(caught.value), caught.value.line) == ("scan 3:7: found a hole", 7)


def test_other_errors_of_tensorflow_stay():
    errors = SampleErrors()
    with pytest.raises(tf.errors.InvalidArgumentError), errors.raised():
        tf.debugging.assert_equal(1, 2)


def test_a_broken_scan_in_the_middle_of_an_epoch(data, tmp_path):
    run = detector_run(data, tmp_path / "run", SHORT)
    last = run.order.batch(1)[1]
    assert last not in run.order.batch(0)
    spoil(data, last)
    with pytest.raises(InputError, match=BROKEN.format(last)):
        loop.run_training(run)


def test_a_broken_scan_of_the_validation(data, tmp_path, monkeypatch):
    monkeypatch.setattr(loop, "_epoch", lambda *_: {})
    run = detector_run(data, tmp_path / "run", SHORT)
    spoil(data, 4)  # the validation takes frames 0 and 4
    with pytest.raises(InputError, match=BROKEN.format(4)):
        loop.run_training(run)
