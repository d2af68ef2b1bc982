"""What training the tracker means: pairs of frames through a frozen detector, equation (5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from models.box_coding import head_channels
from models.detector import Detector, DetectorInputs, detector_inputs
from models.losses import total_loss, tracking_losses
from models.tracker import Tracker, kept_rows, tracker_channels, tracker_inputs
from training.checkpoint import content_hash
from training.config import TrackerTrainingConfig
from training.detector_task import joint
from training.frames import FrameReader, pair_list
from training.samples import PairSample, make_pair_sample, no_augmentation


class PairBatch(NamedTuple):
    """What a training step of the tracker takes."""

    previous: DetectorInputs
    current: DetectorInputs
    displacement: tf.Tensor  # (B, N, 3) metres
    foreground: tf.Tensor  # (B, N) int32


class TrackerTask:
    """The tracker graph on a frozen detector, which sees every augmented pair afresh."""

    kind = "tracker"
    best_figure, best_is_largest = "epe_foreground", False

    def __init__(self, config: TrackerTrainingConfig, detector: Detector, sequences, validation):
        self.config, self.schedule, self.detector = config, config.schedule, detector
        detector.trainable = False
        self.meta = {"detector_sha256": content_hash(detector.weights)}
        channels = tracker_channels(
            config.tracker, detector.config, head_channels(detector.config.box)
        )
        self.model = Tracker(channels, config.tracker)
        classes = detector.config.box.classes
        self.reader, self.items = FrameReader(sequences, classes), pair_list(sequences)
        self.validation_reader = FrameReader(validation, classes)
        self.validation_items = pair_list(validation)
        self.weights = {"pos": config.loss.alpha, "neg": config.loss.beta}

    def make(self, index: int, position: int) -> PairSample:
        """The sample of a pair at a position of the endless order of samples."""
        epoch = position // len(self.items)
        return make_pair_sample(
            self.reader,
            self.items[index],
            epoch,
            index,
            self.config,
            self.detector.config.num_points,
            self.config.augmentation,
        )

    def make_validation(self, index: int, _position: int) -> PairSample:
        """A sample without augmentation; the same whenever it is asked for."""
        return make_pair_sample(
            self.validation_reader,
            self.validation_items[index],
            0,
            index,
            self.config,
            self.detector.config.num_points,
            no_augmentation(),
        )

    def prepare(self, sample: PairSample) -> PairBatch:
        """Makes the detector's pyramids of indices, in the input pipeline."""
        config = self.detector.config
        return PairBatch(
            detector_inputs(sample.previous, config),
            detector_inputs(sample.current, config),
            sample.displacement,
            sample.foreground,
        )

    def predict(self, batch: PairBatch, training: bool):
        """Predicted and true displacement, and foreground, of the kept points of frame t-1."""
        outputs = [self.detector(x, training=False) for x in (batch.previous, batch.current)]
        config = self.config.tracker
        frames = [
            tf.nest.map_structure(tf.stop_gradient, tracker_inputs(x, y, config))
            for x, y in zip((batch.previous, batch.current), outputs, strict=True)
        ]
        predicted = self.model(frames[0], frames[1], training=training)
        rows = kept_rows(batch.previous, outputs[0], config)
        target = tf.gather(batch.displacement, rows, batch_dims=1)
        return predicted, target, tf.gather(batch.foreground, rows, batch_dims=1)

    def losses(self, batch: PairBatch, training: bool) -> dict[str, tf.Tensor]:
        """The terms of equation (5) and their weighted sum as "loss"; shares of the joint batch."""
        predicted, target, foreground = self.predict(batch, training)
        positive = tf.cast(foreground == 1, tf.float32)
        negative = tf.cast(foreground == 0, tf.float32)
        counts = joint(tf.reduce_sum(positive), tf.reduce_sum(negative))
        terms = tracking_losses(predicted, target, positive, negative, counts)
        return {"loss": total_loss(terms, self.weights), **terms}

    def validation_step(self, batch: PairBatch) -> list[tf.Tensor]:
        """End-point errors (B, N') metres and foreground of the kept points."""
        predicted, target, foreground = self.predict(batch, training=False)
        return [tf.norm(predicted - target, axis=-1), foreground]

    def validate(self, batches) -> dict[str, float]:
        """Mean end-point error on foreground and background points, metres."""
        sums, counts = np.zeros(2), np.zeros(2)
        for _, _, (errors, foreground) in batches:
            for label in (0, 1):
                chosen = errors.numpy()[foreground.numpy() == label]
                sums[label] += chosen.sum()
                counts[label] += len(chosen)
        mean = sums / np.maximum(counts, 1)
        return {"epe_foreground": float(mean[1]), "epe_background": float(mean[0])}
