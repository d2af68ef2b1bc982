"""Detector training: samples, losses, validation metrics."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from common.config import to_dict
from kitti.iou import iou_3d
from models.boxes.box_coding import decode_boxes, decode_targets
from models.boxes.box_decoding import decode_detections
from models.config import DecodingConfig
from models.detector import BoxPredictions, Detector, DetectorInputs, detector_inputs
from models.losses import detection_losses, quality_loss, total_loss
from models.probability_filter import foreground_probability
from tf_ops import box_iou_3d
from training.config import DetectorTrainingConfig
from training.sampling.sample_sets import DetectorSamples
from training.sampling.samples import DetectorSample, no_augmentation

# The focal loss of the mask is divided by the number of foreground points, as its paper divides by
# the matched anchors; below this share of all points (a batch without vehicles) by that share.
LEAST_FOREGROUND = 0.01
# Background points of at least this foreground probability propose boxes; their quality is 0.
PROPOSING = 0.1


class DetectorBatch(NamedTuple):
    """Input of one training step of the detector."""

    inputs: DetectorInputs
    sample: DetectorSample


def joint(*sums: tf.Tensor) -> list[tf.Tensor]:
    """Sums of this replica -> sums over the joint batch of all replicas."""
    context = tf.distribute.get_replica_context()
    if context is None or context.num_replicas_in_sync == 1:
        return list(sums)
    total = context.all_reduce(tf.distribute.ReduceOp.SUM, tf.stack(sums))
    # no tf.unstack: TensorFlow 2.21 makes tf.maximum(b, 0.01 * a) of its parts a, b to max(b, a)
    return [total[i] for i in range(len(sums))]


class DetectorTask:
    """The detector graph with its losses, equations (2) to (4)."""

    kind = "detector"
    best_metric, best_is_largest = "box_f1_0.5", True

    def __init__(self, config: DetectorTrainingConfig, sequences, validation):
        self.config, self.schedule = config, config.schedule
        self.model = Detector(config.detector)
        self.meta = {"network": to_dict(config.detector)}
        self.auxiliary: dict = {}
        self.samples = DetectorSamples(sequences, config, config.augmentation)
        everywhere = replace(config, query_points=0)  # those of training are chosen by the labels
        self.validation_samples = DetectorSamples(validation, everywhere, no_augmentation())
        self.loss_weights = to_dict(config.loss)
        self.decoding = DecodingConfig()

    def prepare(self, sample: DetectorSample) -> DetectorBatch:
        """Makes the pyramid of indices, in the input pipeline."""
        inputs = detector_inputs(sample.points, self.config.detector, sample.query)
        return DetectorBatch(inputs, sample)

    def losses(self, batch: DetectorBatch, training: bool) -> dict[str, tf.Tensor]:
        """Every term by name and their weighted sum as "loss"; shares of the joint batch."""
        sample = batch.sample
        outputs = self.model(batch.inputs, training=training)
        foreground = tf.cast(sample.foreground, tf.float32) * sample.mask_weights
        all_sum, foreground_sum, box_sum = joint(
            tf.reduce_sum(sample.mask_weights),
            tf.reduce_sum(foreground),
            tf.reduce_sum(sample.box_weights),
        )
        mask_sum = tf.maximum(foreground_sum, LEAST_FOREGROUND * all_sum)
        terms = detection_losses(
            outputs.boxes,
            sample.targets,
            sample.foreground,
            sample.mask_weights,
            sample.box_weights,
            mask_sum,
            box_sum,
            self.config.focal_gamma,
        )
        if self.config.detector.box.quality:
            terms["quality"] = self._quality(outputs.boxes, sample)
        return {"loss": total_loss(terms, self.loss_weights), **terms}

    def _quality(self, boxes: BoxPredictions, sample: DetectorSample) -> tf.Tensor:
        """The quality loss over the points that propose a box, foreground and likely background."""
        box, foreground = self.config.detector.box, sample.foreground > 0
        rows = tf.where(foreground)
        chosen, targets, points = tf.nest.map_structure(
            lambda x: tf.gather_nd(x, rows)[:, tf.newaxis], (boxes, sample.targets, sample.query)
        )
        iou = box_iou_3d(
            tf.stop_gradient(decode_boxes(points, chosen, box)),
            decode_targets(points, targets, box),
        )
        iou = tf.scatter_nd(rows, iou[:, 0, 0], tf.shape(foreground, tf.int64))
        proposing = foreground | (foreground_probability(boxes.mask_logits) >= PROPOSING)
        weights = tf.cast(proposing, tf.float32) * sample.mask_weights
        (total,) = joint(tf.reduce_sum(weights))
        return quality_loss(boxes.quality_logits, iou, tf.math.divide_no_nan(weights, total))

    def validation_step(self, batch: DetectorBatch) -> list[tf.Tensor]:
        """Counts of the mask, and the predictions that are decoded outside the graph."""
        outputs = self.model(batch.inputs, training=False)
        predictions = outputs.boxes
        found = predictions.mask_logits[..., 1] > predictions.mask_logits[..., 0]
        true = batch.sample.foreground > 0
        both = tf.reduce_sum(tf.cast(found & true, tf.float32) * batch.sample.mask_weights)
        either = tf.reduce_sum(tf.cast(found | true, tf.float32) * batch.sample.mask_weights)
        return [both, either, predictions]

    def validate(self, batches) -> dict[str, float]:
        """Mask IoU, box recall and precision over (positions, batch, output of validation_step)."""
        both = either = hits = boxes = found = 0.0
        for indices, batch, (one, other, predictions) in batches:
            both, either = both + float(one), either + float(other)
            query = batch.inputs.query_xyz.numpy()
            decoded = decode_detections(query, predictions, self.config.detector.box, self.decoding)
            for index, detections in zip(indices, decoded, strict=True):
                frame = self.validation_samples.frame(index)
                iou = iou_3d(frame.boxes, detections.boxes)
                hits += np.count_nonzero(iou.max(1, initial=0.0) >= 0.5)
                boxes, found = boxes + len(frame.boxes), found + len(detections.boxes)
        return {
            "mask_iou": both / max(either, 1.0),
            "box_recall_0.5": hits / max(boxes, 1.0),
            "box_precision_0.5": hits / max(found, 1.0),
            "box_f1_0.5": 2 * hits / max(boxes + found, 1.0),
        }
