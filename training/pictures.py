"""A bird's-eye plot of the network's outputs for a validation sample."""

from __future__ import annotations

import numpy as np
import tensorflow as tf
from matplotlib.figure import Figure

from models.box_decoding import decode_detections
from models.probability_filter import foreground_probability
from visualization.drawing import birds_eye_axes, draw_boxes


def birds_eye(task):
    """A matplotlib figure of the first validation sample: points, truth (green), network (blue)."""
    figure = Figure(figsize=(9, 7), layout="constrained")
    panel = figure.subplots()
    sample = task.validation_samples(0, 0)
    batch = task.prepare(tf.nest.map_structure(lambda x: tf.convert_to_tensor(x)[None], sample))
    if task.kind == "detector":
        _detector_panel(panel, task, batch)
    else:
        _tracker_panel(panel, task, batch)
    birds_eye_axes(panel)
    return figure


def _detector_panel(panel, task, batch) -> None:
    outputs = task.model(batch.inputs, training=False)
    probability = foreground_probability(outputs.boxes.mask_logits).numpy()[0]
    xyz = batch.inputs.query_xyz.numpy()
    panel.scatter(xyz[0, :, 0], xyz[0, :, 1], c=probability, s=0.5, cmap="coolwarm", vmin=0, vmax=1)
    frame = task.validation_samples.frame(0)
    draw_boxes(panel, frame.boxes, "green", linewidth=1)
    found = decode_detections(xyz, outputs.boxes, task.config.detector.box, task.decoding)[0]
    draw_boxes(panel, found.boxes, "blue", linewidth=1)
    panel.set_title("foreground probability; boxes: truth green, network blue")


def _tracker_panel(panel, task, batch) -> None:
    found = task.predict_forward(batch)
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
    panel.set_title("association displacement of foreground points: truth green, network blue")
