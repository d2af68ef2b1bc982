"""Tracker training: pairs of frames through a frozen detector, equation (5).

Training takes a pair in both directions, (t-1, t) and (t, t-1): the detector and the tracker's
first layers, which see one frame, serve both. Validation takes the direction (t-1, t).

Equation (5) is applied to the final displacement and to an auxiliary linear head on the association
features, which exists in training alone (deep supervision, Lee et al., AISTATS 2015).
"""

from typing import NamedTuple

import keras
import numpy as np
import tensorflow as tf

from common.config import to_dict
from models.detector import Detector, DetectorInputs, DetectorOutputs, detector_inputs
from models.layers import fold_batch_norm
from models.losses import total_loss, tracking_losses
from models.tracker import EncodedFrame, FusedFeatures, TrackerInputs, TrackingNetwork
from models.weights import network_hash
from training.config import TrackerTrainingConfig
from training.detector_task import joint
from training.sampling.sample_sets import PairSamples
from training.sampling.samples import PairSample, no_augmentation


class PairBatch(NamedTuple):
    """Input of one training step of the tracker: B frames t-1, then their B frames t."""

    inputs: DetectorInputs
    displacement: tf.Tensor  # (2B, N, 3) metres, to the other frame
    foreground: tf.Tensor  # (2B, N) int32


class KeptBatch(NamedTuple):
    """A batch after the frozen detector: B frames t-1, then their B frames t."""

    frames: TrackerInputs  # kept points and features of the 2B frames
    displacement: tf.Tensor  # (2B, N', 3) metres, to the other frame
    foreground: tf.Tensor  # (2B, N') int32


class Prediction(NamedTuple):
    """Displacement (F, M, 3) at some points, the true one, and their foreground (F, M)."""

    xyz: tf.Tensor
    displacement: tf.Tensor
    target: tf.Tensor
    foreground: tf.Tensor

    @classmethod
    def at(
        cls, displacement: tf.Tensor, kept: KeptBatch, rows: tf.Tensor | None = None
    ) -> "Prediction":
        """Adds the targets of the first F frames' kept points, of all or of their `rows` (F, M)."""
        frames = tf.shape(displacement)[0]
        targets = (kept.frames.xyz, kept.displacement, kept.foreground)
        xyz, target, foreground = (x[:frames] for x in targets)
        if rows is not None:
            xyz, target, foreground = (
                tf.gather(x, rows, batch_dims=1) for x in (xyz, target, foreground)
            )
        return cls(xyz, displacement, target, foreground)


def keep(batch: PairBatch, outputs: DetectorOutputs, choose: FusedFeatures) -> KeptBatch:
    """The points and features that a row of Table IV takes, and their targets; no gradients."""
    frames = tf.nest.map_structure(tf.stop_gradient, choose(batch.inputs, outputs))
    displacement, foreground = (
        tf.gather(x, frames.rows, batch_dims=1) for x in (batch.displacement, batch.foreground)
    )
    return KeptBatch(frames, displacement, foreground)


def both_frames(sample):
    """Tensors (B, 2, ...) of a structure -> (2B, ...): B frames t-1, then their B frames t."""
    return tf.nest.map_structure(lambda part: tf.concat(tf.unstack(part, axis=1), 0), sample)


def other_frames(encoded: EncodedFrame) -> EncodedFrame:
    """B frames t-1 and then their B frames t -> the other frame of each: both halves exchanged."""
    return tf.nest.map_structure(lambda x: tf.roll(x, tf.shape(x)[0] // 2, 0), encoded)


def _terms(found: Prediction) -> dict[str, tf.Tensor]:
    positive = tf.cast(found.foreground == 1, tf.float32)
    negative = tf.cast(found.foreground == 0, tf.float32)
    counts = joint(tf.reduce_sum(positive), tf.reduce_sum(negative))
    return tracking_losses(found.displacement, found.target, positive, negative, counts)


class TrackerTask:
    """The tracker graph on a frozen detector, which runs on every augmented pair."""

    kind = "tracker"
    best_metric, best_is_largest = "epe_foreground", False

    def __init__(self, config: TrackerTrainingConfig, detector: Detector, sequences, validation):
        self.config, self.schedule, self.detector = config, config.schedule, detector
        detector.trainable = False
        self.meta = {
            "network": to_dict(config.tracker),
            "detector_sha256": network_hash(detector),
        }
        fold_batch_norm(detector)
        self.model = TrackingNetwork(detector.config, config.tracker)
        self.readout = keras.layers.Dense(3, name="readout")
        self.readout.build((None, self.model.association.channels))
        self.auxiliary = {f"readout/{v.name}": v for v in self.readout.weights}
        self.samples = PairSamples(sequences, config, detector.config, config.augmentation)
        self.validation_samples = PairSamples(
            validation, config, detector.config, no_augmentation()
        )
        alpha, beta, deep = config.loss.alpha, config.loss.beta, config.deep_supervision
        self.loss_weights = {
            "pos": alpha,
            "neg": beta,
            "head_pos": deep * alpha,
            "head_neg": deep * beta,
        }

    def prepare(self, sample: PairSample) -> PairBatch:
        """Makes the detector's pyramids of indices, in the input pipeline."""
        frames = both_frames(sample)
        inputs = detector_inputs(frames.points, self.detector.config)
        return PairBatch(inputs, frames.displacement, frames.foreground)

    def detect(self, batch: PairBatch) -> KeptBatch:
        """Kept points of the 2B frames with features of the frozen detector, and their targets."""
        outputs = self.detector(batch.inputs, training=False)
        return keep(batch, outputs, self.model.fused_features)

    def predict_forward(self, batch: PairBatch) -> Prediction:
        """Predicts from the B frames t-1 to their frames t, as in inference."""
        kept = self.detect(batch)
        encoded = self.model.encode(kept.frames)
        pairs = tf.shape(kept.foreground)[0] // 2
        previous = tf.nest.map_structure(lambda x: x[:pairs], encoded)
        current = tf.nest.map_structure(lambda x: x[pairs:], encoded)
        displacement = self.model.displacement(previous, current)
        return Prediction.at(displacement, kept)

    def predict(self, batch: PairBatch, training: bool) -> tuple[Prediction, Prediction]:
        """Both directions: of the network at the kept points, of the read-out at those of SA2."""
        kept = self.detect(batch)
        encoded = self.model.encode(kept.frames, training)
        association = self.model.associate(encoded, other_frames(encoded), training)
        displacement = self.model.refine(encoded, association, training)
        return (
            Prediction.at(displacement, kept),
            Prediction.at(self.readout(association), kept, encoded.indices.kept_rows),
        )

    def losses(self, batch: PairBatch, training: bool) -> dict[str, tf.Tensor]:
        """The terms of equation (5) and their weighted sum as "loss"; shares of the joint batch."""
        graph, head = (_terms(found) for found in self.predict(batch, training))
        terms = {**graph, **{f"head_{name}": term for name, term in head.items()}}
        return {"loss": total_loss(terms, self.loss_weights), **terms}

    def validation_step(self, batch: PairBatch) -> list[tf.Tensor]:
        """End-point errors (B, N') metres and foreground of the kept points of frames t-1."""
        found = self.predict_forward(batch)
        return [tf.norm(found.displacement - found.target, axis=-1), found.foreground]

    def validate(self, batches) -> dict[str, float]:
        """Mean end-point error on foreground and background points, metres; those that have any."""
        sums, counts = np.zeros(2), np.zeros(2)
        for _, _, (errors, foreground) in batches:
            for label in (0, 1):
                chosen = errors.numpy()[foreground.numpy() == label]
                sums[label] += chosen.sum()
                counts[label] += len(chosen)
        labels = {"epe_foreground": 1, "epe_background": 0}
        return {name: float(sums[i] / counts[i]) for name, i in labels.items() if counts[i]}
