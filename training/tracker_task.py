"""What training the tracker means: pairs of frames through a frozen detector, equation (5).

A pair is learnt from in both directions, (t-1, t) and (t, t-1): the detector and the tracker's
first layers, which see one frame, serve both. It is validated in its own direction.

Equation (5) is asked twice: of the graph's displacement, and of a linear layer on the association
head's features, which is there in training alone (deep supervision, Lee et al., AISTATS 2015).
"""

from __future__ import annotations

from typing import NamedTuple

import keras
import numpy as np
import tensorflow as tf

from models.box_coding import head_channels
from models.detector import Detector, DetectorInputs, detector_inputs
from models.losses import total_loss, tracking_losses
from models.tracker import (
    Tracker,
    TrackerInputs,
    halves,
    kept_rows,
    swapped,
    tracker_channels,
    tracker_inputs,
)
from training.checkpoint import content_hash
from training.config import TrackerTrainingConfig
from training.detector_task import joint
from training.frames import FrameReader, pair_list
from training.samples import PairSample, make_pair_sample, no_augmentation


class PairBatch(NamedTuple):
    """What a training step of the tracker takes: B frames t-1, then their B frames t."""

    inputs: DetectorInputs
    displacement: tf.Tensor  # (2B, N, 3) metres, to the other frame
    foreground: tf.Tensor  # (2B, N) int32


class Prediction(NamedTuple):
    """Displacement (F, M, 3) at some points, the true one, and their foreground (F, M)."""

    xyz: tf.Tensor
    displacement: tf.Tensor
    target: tf.Tensor
    foreground: tf.Tensor

    @classmethod
    def at(cls, rows: tf.Tensor, displacement: tf.Tensor, batch: PairBatch) -> Prediction:
        """With the targets of the points `rows` (F, M) of the batch's first F frames."""
        frames = tf.shape(rows)[0]
        xyz, target, foreground = (
            tf.gather(x[:frames], rows, batch_dims=1)
            for x in (batch.inputs.query_xyz, batch.displacement, batch.foreground)
        )
        return cls(xyz, displacement, target, foreground)


def _terms(found: Prediction) -> dict[str, tf.Tensor]:
    positive = tf.cast(found.foreground == 1, tf.float32)
    negative = tf.cast(found.foreground == 0, tf.float32)
    counts = joint(tf.reduce_sum(positive), tf.reduce_sum(negative))
    return tracking_losses(found.displacement, found.target, positive, negative, counts)


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
        self.readout = keras.layers.Dense(3, name="readout")
        self.readout.build((None, self.model.association.channels))
        self.auxiliary = self.readout.weights
        classes = detector.config.box.classes
        self.reader, self.items = FrameReader(sequences, classes), pair_list(sequences)
        self.validation_reader = FrameReader(validation, classes)
        self.validation_items = pair_list(validation)
        alpha, beta, deep = config.loss.alpha, config.loss.beta, config.deep_supervision
        self.weights = {
            "pos": alpha,
            "neg": beta,
            "head_pos": deep * alpha,
            "head_neg": deep * beta,
        }

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
        frames = PairSample(*(tf.concat(tf.unstack(part, axis=1), 0) for part in sample))
        inputs = detector_inputs(frames.points, self.detector.config)
        return PairBatch(inputs, frames.displacement, frames.foreground)

    def detect(self, batch: PairBatch) -> tuple[tf.Tensor, TrackerInputs]:
        """The rows (2B, N') that the frozen detector keeps, and what it tells of them."""
        outputs = self.detector(batch.inputs, training=False)
        frames = tracker_inputs(batch.inputs, outputs, self.config.tracker)
        rows = kept_rows(batch.inputs, outputs, self.config.tracker)
        return rows, tf.nest.map_structure(tf.stop_gradient, frames)

    def predict_forward(self, batch: PairBatch) -> Prediction:
        """From the B frames t-1 to their frames t, as the tracker is used."""
        rows, frames = self.detect(batch)
        displacement = self.model.displacement(*halves(self.model.encode(frames)))
        return Prediction.at(rows[: tf.shape(rows)[0] // 2], displacement, batch)

    def predict(self, batch: PairBatch, training: bool) -> tuple[Prediction, Prediction]:
        """In both directions: of the graph at the kept points, of the read-out at those of TSA2."""
        rows, frames = self.detect(batch)
        encoded = self.model.encode(frames, training)
        embedding = self.model.associate(encoded, swapped(encoded), training)
        displacement = self.model.refine(encoded, embedding, training)
        sampled = tf.gather(rows, encoded.rows, batch_dims=1)
        return (
            Prediction.at(rows, displacement, batch),
            Prediction.at(sampled, self.readout(embedding), batch),
        )

    def losses(self, batch: PairBatch, training: bool) -> dict[str, tf.Tensor]:
        """The terms of equation (5) and their weighted sum as "loss"; shares of the joint batch."""
        graph, head = (_terms(found) for found in self.predict(batch, training))
        terms = {**graph, **{f"head_{name}": term for name, term in head.items()}}
        return {"loss": total_loss(terms, self.weights), **terms}

    def validation_step(self, batch: PairBatch) -> list[tf.Tensor]:
        """End-point errors (B, N') metres and foreground of the kept points of frames t-1."""
        found = self.predict_forward(batch)
        return [tf.norm(found.displacement - found.target, axis=-1), found.foreground]

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
