"""The weights that ship: they load, find and track simulated vehicles, and look at both frames."""

from pathlib import Path

import numpy as np
import pytest

from evaluation.config import EvaluateConfig
from evaluation.run import evaluate
from kitti.boxes import points_in_boxes
from kitti.iou import iou_3d
from kitti.object_shift import shift_points
from kitti.sequence import open_sequences
from simulator.__main__ import main as simulate
from tracking.assignment import greedy

WEIGHTS = Path(__file__).resolve().parent.parent / "weights"
FRAMES = 16


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    flags = {"split": "val", "sequences": "1", "frames": str(FRAMES), "seed": "5"}
    simulate(["--out", str(folder), *(f"--{name}={value}" for name, value in flags.items())])
    return folder


@pytest.fixture(scope="module")
def sequence(data):
    number = int(next((data / "training" / "label_02").glob("*.txt")).stem)
    return open_sequences(data, [number], "training")[0]


@pytest.fixture(scope="module")
def network():
    from models.inference import StreamingNetwork
    from models.weights import load_networks

    return StreamingNetwork(*load_networks(WEIGHTS))


@pytest.mark.slow
def test_boxes_of_simulated_frames(network, sequence):
    """Recall of the vehicles with at least 50 points, and precision, at 3-D IoU 0.25."""
    hits = vehicles = found = 0
    for t in range(0, FRAMES, 3):
        points = sequence.read_points_level(t)
        truth = sequence.objects.at(t).of_classes(("Car", "Van")).boxes
        boxes = network.detect(points, t).detections.boxes
        owner = points_in_boxes(points, truth)
        counts = np.bincount(owner[owner >= 0], minlength=len(truth))
        iou = iou_3d(truth, boxes)
        rows = [row for row, _ in greedy(-iou, -0.25).pairs]
        hits += int((counts[rows] >= 50).sum())
        vehicles += int((counts >= 50).sum())
        found += len(boxes) - int((counts[rows] < 50).sum())
    assert vehicles >= 10
    assert hits / vehicles >= 0.7
    assert hits / found >= 0.6


@pytest.mark.slow
def test_tracks_of_simulated_frames(data, sequence):
    config = EvaluateConfig(
        data_root=data,
        seqs=(sequence.seq,),
        detections="network",
        tracker="pointtracknet",
        weights=WEIGHTS,
        iou=0.25,
    )
    assert evaluate(config)["clear3d"]["overall"]["MOTA"] >= 0.2


@pytest.mark.slow
def test_an_object_that_moves_in_frame_t_alone_moves_the_prediction(network, sequence):
    """A tracker that ignores frame t would predict the same displacement twice."""
    labels = sequence.objects.at(3).of_classes(("Car", "Van"))
    before, after = (np.array(sequence.read_points_level(t)[:, :3]) for t in (3, 4))
    owner = points_in_boxes(before, labels.boxes)
    counts = np.bincount(owner[owner >= 0], minlength=len(labels))
    track_id = labels.track_id[np.argmax(counts)]
    box = labels.boxes[labels.track_id == track_id]
    then = sequence.objects.at(4)
    moved = shift_points(after, then.boxes[then.track_id == track_id], np.array([[0.0, 1.0]]))
    predicted = []
    for scan in (after, moved):
        previous, current = network.detect(before, 3), network.detect(scan, 4)
        inside = points_in_boxes(previous.points, box) >= 0
        inside &= previous.foreground > 0.5
        predicted.append(network.displacement(previous, current)[inside].mean(0))
    change = predicted[1] - predicted[0]
    assert inside.sum() >= 20
    assert 0.5 < change[1] < 1.5
    assert abs(change[0]) < 0.4
