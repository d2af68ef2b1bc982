"""Pictures of a validation sample during training."""

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER
from helpers.two_cars import write_sequence

from kitti.sequence import open_sequences
from models.detector import Detector
from training.config import DetectorTrainingConfig, TrackerTrainingConfig
from training.detector_task import DetectorTask
from training.logs import TensorBoard
from training.tracker_task import TrackerTask
from visualization.training_pictures import detector_picture, tracker_picture


@pytest.fixture(scope="module")
def sequences(tmp_path_factory):
    return open_sequences(write_sequence(tmp_path_factory.mktemp("cars")), [0])


def test_the_detector(sequences, tmp_path):
    task = DetectorTask(DetectorTrainingConfig(SMALL_DETECTOR), sequences, sequences)
    figure = detector_picture(task)
    (panel,) = [axes for axes in figure.axes if "foreground probability" in axes.get_title()]
    points, boxes = panel.collections[0].get_offsets(), panel.collections[1].get_segments()
    assert len(points) == SMALL_DETECTOR.num_points
    assert len(boxes) == len(task.validation_samples.frame(0).boxes) == 2
    TensorBoard(tmp_path).picture(1, "birds_eye", figure)
    (events,) = tmp_path.glob("events.*")
    records = [
        tf.compat.v1.Event.FromString(r.numpy()) for r in tf.data.TFRecordDataset(str(events))
    ]
    images = [value for record in records for value in record.summary.value]
    width, height, png = images[0].tensor.string_val[:3]
    size = np.array(figure.get_size_inches() * figure.dpi, int)
    assert [int(width), int(height)] == size.tolist()
    assert png.startswith(b"\x89PNG")


def test_the_tracker(sequences):
    config = TrackerTrainingConfig(SMALL_TRACKER)
    figure = tracker_picture(TrackerTask(config, Detector(SMALL_DETECTOR), sequences, sequences))
    (panel,) = figure.axes
    points, truth, predicted = panel.collections
    assert len(points.get_offsets()) == SMALL_TRACKER.num_kept_points
    assert truth.N == predicted.N
