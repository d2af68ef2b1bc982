"""Both networks overfit a fixed batch: losses, targets, decoding and gradients agree."""

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER

from kitti.iou import iou_3d
from kitti.objects import Objects
from kitti.sequence import open_sequences
from metrics.protocols import Entry, evaluate_protocol
from models.boxes.box_decoding import decode_detections
from models.detector import Detector
from tracking import FrameContext, FrameDetections, LabelMotion, make_tracker, track_frame
from training import loop
from training.config import DetectorTrainingConfig, ScheduleConfig, TrackerTrainingConfig
from training.detector_task import DetectorTask
from training.sampling.samples import no_augmentation
from training.strategies import make_strategy
from training.tracker_task import TrackerTask
from training.training_run import start

COUNT, STEPS = 4, 400
SCHEDULE = ScheduleConfig(
    frozen_batch_norm_from=1.0,
    epochs=1,
    frames_per_epoch=COUNT * STEPS,
    batch_size=COUNT,
    cycle_epochs=1,
    learning_rate_max=0.01,
    validation_frames=0,
)


class Fixed:
    """The same COUNT samples again and again."""

    def __init__(self, samples, items):
        self.samples, self.items = samples, items[:COUNT]

    def __call__(self, index, _position):
        return self.samples[index]


def learn_one_batch(make_task, workdir):
    """Trains on the first COUNT samples, each always the same; returns (task, that batch)."""

    def fixed():
        task = make_task()
        task.samples = Fixed([task.samples(i, 0) for i in range(COUNT)], task.samples.items)
        task.validation_samples.roots = []
        return task

    tf.keras.utils.set_random_seed(0)
    run = start(fixed, make_strategy("one"), workdir, {})
    loop.run_training(run)
    batch = tf.nest.map_structure(lambda *x: tf.stack(x), *run.task.samples.samples)
    return run.task, run.task.prepare(batch)


def detections(task, batch):
    """Decoded boxes of the batch's frames."""
    predictions = task.validation_step(batch)[2]
    return decode_detections(
        batch.inputs.query_xyz, predictions, task.config.detector.box, task.decoding
    )


def mota(sequence, frames) -> float:
    """MOTA at IoU 0.5 of Algorithm 1 on the boxes of each frame, with the true displacement."""
    tracker, rows, before = make_tracker("gt_displacement"), [], sequence.objects.at(0)
    for t, found in enumerate(frames):
        now = sequence.objects.at(t)
        context = FrameContext()
        context.label_motion = LabelMotion(before.boxes, before.track_id, now.boxes, now.track_id)
        label_ids = now.track_id[iou_3d(found.boxes, now.boxes).argmax(1)]
        labelled = FrameDetections(t, found.boxes, found.scores, label_ids=label_ids)
        tracks = track_frame(tracker, labelled, context)
        rows.append(Objects.from_boxes(t, tracks.ids, tracks.boxes, tracks.scores))
        before = now
    truth = Objects.concatenate([sequence.objects.at(t) for t in range(len(frames))])
    entry = Entry("0000", len(frames), truth, Objects.concatenate(rows))
    return evaluate_protocol("clear3d", [entry])["overall"]["MOTA"]


@pytest.mark.slow
def test_four_frames_are_overfitted(tiny_data, tmp_path):
    """The loss falls to near zero, every box is found, and tracked without a mistake."""
    sequences = open_sequences(tiny_data, [0], "training")
    config = DetectorTrainingConfig(
        SMALL_DETECTOR, augmentation=no_augmentation(), schedule=SCHEDULE
    )
    task, batch = learn_one_batch(lambda: DetectorTask(config, sequences, sequences), tmp_path)
    terms = task.losses(batch, training=False)
    assert float(terms["loss"] - terms["quality"]) < 0.02  # equations (2) and (3)
    assert float(terms["quality"]) < 0.02
    figures = task.validate([(range(COUNT), batch, task.validation_step(batch))])
    assert figures["mask_iou"] > 0.98
    assert figures["box_recall_0.5"] == figures["box_precision_0.5"] == 1.0
    assert mota(sequences[0], detections(task, batch)) == 1.0


@pytest.mark.slow
def test_a_batch_of_pairs_is_learnt_to_5_cm(tiny_data, tmp_path):
    """Foreground and background, in the mean over the kept points."""
    sequences = open_sequences(tiny_data, [0], "training")
    config = TrackerTrainingConfig(
        SMALL_TRACKER,
        augmentation=no_augmentation(),
        schedule=SCHEDULE,
    )
    tf.keras.utils.set_random_seed(1)  # an untrained mask that keeps points of vehicles
    detector = Detector(SMALL_DETECTOR)
    task, batch = learn_one_batch(
        lambda: TrackerTask(config, detector, sequences, sequences), tmp_path
    )
    error, foreground = (x.numpy() for x in task.validation_step(batch))
    assert (foreground == 1).sum() > 20
    assert error[foreground == 1].mean() < 0.05
    assert error[foreground == 0].mean() < 0.05
    # without motion between the frames the same points move less: frame t is used
    still = tf.nest.map_structure(lambda x: tf.concat([x[:COUNT], x[:COUNT]], 0), batch.inputs)
    predicted = task.predict_forward(batch).displacement.numpy()
    moved = predicted - task.predict_forward(batch._replace(inputs=still)).displacement.numpy()
    assert np.linalg.norm(moved, axis=-1)[foreground == 1].mean() > 0.05
