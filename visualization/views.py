"""What the networks see inside, for Fig. 3 and Fig. 4. Imports TensorFlow."""

from __future__ import annotations

import numpy as np
import tensorflow as tf

from kitti.boxes import points_in_boxes
from models.inference import FrameState, StreamingNetwork
from models.set_upconv import neighbors_within
from tf_ops import farthest_point_sample, gather_point
from visualization.association import Neighborhood
from visualization.sampling import Samplings


def samplings(network: StreamingNetwork, state: FrameState) -> Samplings:
    """TRA_SA1 and TRA_SA3 with the probability filter, and what they were without it.

    Raises:
        ValueError: the frame has no points.
    """
    _check(state)
    config = network.tracker.config
    sizes = [layer.num_points for layer in config.set_abstraction]
    sa1, sa2 = state.encoded.level1.xyz, state.encoded.level2.xyz
    coarse = config.refinement_abstraction.num_points
    filtered = (sa1, _farthest(sa2, coarse))
    plain1 = _farthest(tf.constant(state.sampled[None]), sizes[0])
    plain3 = _farthest(_farthest(plain1, sizes[1]), coarse)
    layers = ("TRA_SA1", "TRA_SA3")
    return Samplings(
        layers, *(tuple(x.numpy()[0] for x in p) for p in (filtered, (plain1, plain3)))
    )


def neighborhood(
    network: StreamingNetwork, previous: FrameState, current: FrameState, boxes: np.ndarray
) -> Neighborhood:
    """The group of one point of t-1: one in the nearest of the boxes that holds points.

    boxes: (M, 7) of frame t-1, level frame.

    Raises:
        ValueError: one of the frames has no points.
    """
    _check(previous)
    _check(current)
    config = network.tracker.config
    before, after = previous.encoded.level2.xyz, current.encoded.level2.xyz
    neighbors = neighbors_within(
        config.association_neighbors, config.association_radius, after, before
    ).numpy()[0]
    points = before.numpy()[0]
    chosen = _on_an_object(points, boxes)
    return Neighborhood(
        points, after.numpy()[0], chosen, neighbors[chosen], config.association_radius
    )


def _on_an_object(points: np.ndarray, boxes: np.ndarray) -> int:
    """Row of a point in the box that holds most points; of the nearest point if none does."""
    owner = points_in_boxes(points, boxes)
    if (owner < 0).all():
        return int(np.argmin(np.linalg.norm(points, axis=1)))
    fullest = np.bincount(owner[owner >= 0]).argmax()
    return int(np.flatnonzero(owner == fullest)[0])


def _farthest(points: tf.Tensor, count: int) -> tf.Tensor:
    return gather_point(points, farthest_point_sample(count, points))


def _check(state: FrameState) -> None:
    if state.encoded is None:
        raise ValueError("the frame has no points")
