"""Intermediate outputs of the networks, for Fig. 3 and Fig. 4. Imports TensorFlow."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import tensorflow as tf

from kitti.boxes import points_in_boxes
from kitti.objects import Objects
from models.boxes.box_decoding import Proposals, propose
from models.detector import detector_inputs
from models.inference import FrameState, StreamingNetwork
from models.set_upconv import neighbors_within
from models.weights import load_networks
from tf_ops import farthest_point_sample, gather_point
from visualization.association import Neighborhood
from visualization.clip import Clip
from visualization.network_scene import NetworkFrame
from visualization.sampling import Samplings


def foreground_points(clip: Clip, weights: Path) -> Callable[[int], np.ndarray | None]:
    """Frame -> (N, 4) the input points of the detector and their foreground probability, or None.

    Raises:
        InputError: weights are missing or broken.
    """
    network = StreamingNetwork(*load_networks(weights))

    def points(t: int) -> np.ndarray | None:
        scan = clip.scan(t)
        if not len(scan):
            return None
        state = network.detect(scan, t)
        return np.column_stack([state.sampled, state.probability])

    return points


def samplings(network: StreamingNetwork, state: FrameState) -> Samplings:
    """TRA_SA1 and TRA_SA3 with the probability filter, and without it.

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
    """The group of one point of t-1: one in the box that holds most points of SA2, if any does.

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


def network_frame(
    network: StreamingNetwork, previous: FrameState, current: FrameState, boxes: np.ndarray, t: int
) -> NetworkFrame:
    """The data of the scene of frame t; `boxes` (M, 7) are the true ones of frame t-1.

    Raises:
        ValueError: one of the frames has no points.
    """
    _check(current)
    proposals = _proposals(network, current)
    found = current.detections
    classes = np.array(network.detector.config.box.classes)
    return NetworkFrame(
        t=t,
        points=np.column_stack([current.sampled, current.probability]),
        detections=Objects.from_boxes(
            t, np.arange(len(found.boxes)), found.boxes, found.scores, kind=classes[found.classes]
        ),
        proposals=proposals.boxes.numpy(),
        proposal_scores=proposals.probability.numpy(),
        earlier=previous.points,
        foreground=previous.foreground,
        displacement=network.displacement(previous, current),
        samplings=samplings(network, current),
        neighborhood=neighborhood(network, previous, current, boxes),
    )


def _proposals(network: StreamingNetwork, state: FrameState) -> Proposals:
    """The boxes of the points that may be foreground, before suppression."""
    config, xyz = network.detector.config, tf.constant(state.sampled)
    outputs = network.detector(detector_inputs(xyz[None], config), training=False)
    predictions = tf.nest.map_structure(lambda x: x[0], outputs.boxes)
    return propose(xyz, predictions, config.box, network.decoding.min_probability)


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
