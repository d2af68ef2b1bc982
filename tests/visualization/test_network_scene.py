"""The networks' view of one frame as a scene: arrows, proposals and their detections."""

import base64

import numpy as np

from kitti.objects import Objects
from visualization.association import Neighborhood
from visualization.clip import Clip
from visualization.network_scene import ARROWS, NetworkFrame, network_data, owners
from visualization.sampling import Samplings

BOX = np.array([10.0, 0, -1, 4, 1.8, 1.5, 0])


def unpack(packed) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["data"]), packed["type"])


def frame(kept: int) -> NetworkFrame:
    """Two detections, three proposals, and `kept` points of which every other is background."""
    rng = np.random.default_rng(0)
    points, earlier = (rng.uniform(0, 20, (n, 3)).astype(np.float32) for n in (50, kept))
    boxes = np.stack([BOX, BOX])
    boxes[1, 1] = 8.0
    detections = Objects.from_boxes(7, np.arange(2), boxes, np.array([0.9, 0.5]))
    few = (points[:4],)
    return NetworkFrame(
        t=7,
        points=np.column_stack([points, np.linspace(0, 1, 50)]),
        detections=detections,
        proposals=np.stack([BOX, boxes[1] + 0.1, BOX + 20]).astype(np.float32),
        proposal_scores=np.float32([0.9, 0.8, 0.7]),
        earlier=earlier,
        foreground=np.tile([0.6, 0.2], kept)[:kept],
        displacement=2 * earlier,
        samplings=Samplings(("TRA_SA1",), few, few),
        neighborhood=Neighborhood(points[:5], points[5:9], 2, np.array([1, 1, 3]), 3.0),
    )


def scene(kept: int) -> dict:
    return network_data(
        Clip("0000", range(9), lambda t: None, Objects.empty(), Objects.empty()), frame(kept)
    )


def test_the_number_of_arrows_is_limited():
    for kept, count in ((40, 20), (4000, ARROWS)):
        data = scene(kept)
        start, by = (unpack(data["network"]["arrows"][key]) for key in ("from", "by"))
        assert len(start) == len(by) == 3 * count
        np.testing.assert_array_equal(by, 2 * start)
        moving = {tuple(row) for row in frame(kept).earlier[::2].tolist()}
        assert {tuple(row) for row in start.reshape(-1, 3).tolist()} <= moving
        assert any(f": {count} of {kept // 2}, drawn at random." in note for note in data["notes"])


def test_proposals_are_assigned_to_the_nearest_detection_within_reach():
    network = scene(40)["network"]
    assert unpack(network["proposals"]["owner"]).tolist() == [0, 1, -1]
    assert len(network["group"]["neighbors"]) == 2
    assert owners(frame(1).proposals, np.zeros((0, 7))).tolist() == [-1, -1, -1]
