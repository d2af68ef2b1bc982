"""Bird's-eye plots of a validation sample during training: truth green, network blue.

The argument is a training task (`training.task.TrainingTask`).
"""

import numpy as np
import tensorflow as tf
from matplotlib.figure import Figure

from models.boxes.box_decoding import decode_detections
from models.probability_filter import foreground_probability
from visualization.drawing import birds_eye_axes, draw_boxes


def detector_picture(task) -> Figure:
    """Foreground probability of every point, labelled and decoded boxes of the first sample."""
    figure, panel = _birds_eye("foreground probability; boxes: truth green, network blue")
    batch = _first_batch(task)
    outputs = task.model(batch.inputs, training=False)
    probability = foreground_probability(outputs.boxes.mask_logits).numpy()[0]
    xyz = batch.inputs.query_xyz.numpy()
    panel.scatter(xyz[0, :, 0], xyz[0, :, 1], c=probability, s=0.5, cmap="coolwarm", vmin=0, vmax=1)
    frame = task.validation_samples.frame(0)
    draw_boxes(panel, frame.boxes, "green", linewidth=1)
    found = decode_detections(xyz, outputs.boxes, task.config.detector.box, task.decoding)[0]
    draw_boxes(panel, found.boxes, "blue", linewidth=1)
    return figure


def tracker_picture(task) -> Figure:
    """Association displacement of every tenth foreground point of the first sample."""
    title = "association displacement of foreground points: truth green, network blue"
    figure, panel = _birds_eye(title)
    found = task.predict_forward(_first_batch(task))
    xyz, predicted, target, foreground = (x.numpy()[0] for x in found)
    panel.scatter(xyz[:, 0], xyz[:, 1], s=0.5, color="lightgrey")
    chosen = np.flatnonzero(foreground == 1)[::10]
    for values, color in ((target, "green"), (predicted, "blue")):
        panel.quiver(
            xyz[chosen, 0],
            xyz[chosen, 1],
            values[chosen, 0],
            values[chosen, 1],
            color=color,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.0015,
        )
    return figure


def _birds_eye(title: str):
    figure = Figure(figsize=(9, 7), layout="constrained")
    panel = figure.subplots()
    birds_eye_axes(panel)
    panel.set_title(title)
    return figure, panel


def _first_batch(task):
    sample = task.validation_samples(0, 0)
    return task.prepare(tf.nest.map_structure(lambda x: tf.convert_to_tensor(x)[None], sample))
