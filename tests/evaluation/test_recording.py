"""Recorded networks replay what the networks said, and know when a recording is not theirs."""

import shutil

import numpy as np
import pytest
import tiny_kitti
from small_weights import write_weights

from common.errors import InputError
from evaluation.config import EvaluateConfig
from evaluation.network import NetworkBoxes
from evaluation.recording import RecordedNetwork, TrueBoxes
from evaluation.scene import Scene
from evaluation.side_by_side import TimedSource, evaluate_recorded
from evaluation.sources import GroundTruthBoxes
from kitti.object_shift import ObjectShift
from kitti.scans import write_scan
from kitti.sequence import Sequence


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    return write_weights(tmp_path_factory.mktemp("weights"))


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Sequence 0001 with scans, but for frame 3."""
    folder = tiny_kitti.make(tmp_path_factory.mktemp("kitti"))
    rng = np.random.default_rng(0)
    for t in (0, 1, 2, 4):
        points = rng.uniform((5, -5, -1.7, 0), (40, 5, 1, 1), (500, 4))
        points[:300, :3] = rng.uniform((18, -0.5, -1.5), (19, 0.5, -1), (300, 3))  # agree on a box
        write_scan(folder / "training" / "velodyne" / "0001" / f"{t:06d}.bin", points)
    return folder


@pytest.fixture
def scene(root):
    return Scene(Sequence(root, 1))


def _same(a, b):
    assert a[0] == b[0] and a[3].keys() == b[3].keys()
    for x, y in ((a[1], b[1]), (a[2], b[2]), *((a[3][k], b[3][k]) for k in a[3])):
        if len(x) or len(y):
            np.testing.assert_array_equal(x, y)


def test_replay_equals_the_networks_and_runs_them_once(scene, weights, tmp_path, monkeypatch):
    recorded = RecordedNetwork(tmp_path, weights)
    ticks = []
    assert recorded.record(scene, lambda: ticks.append(1))
    assert len(ticks) == scene.num_frames == 5
    live = list(NetworkBoxes.load(weights).frames(scene))
    for a, b in zip(recorded.frames(scene), live, strict=True):
        _same(a, b)
    assert any(len(boxes) for _, boxes, _, _ in live)

    def fail(*_):
        raise AssertionError("the networks ran again")

    monkeypatch.setattr(NetworkBoxes, "load", fail)
    again = RecordedNetwork(tmp_path, weights)
    assert not again.record(scene)
    seconds = again.seconds(scene)
    assert seconds.shape == (5, 2)
    assert seconds[1, 1] > 0 and seconds[0, 1] == 0


def test_the_name_depends_on_all_that_matters(root, scene, weights, tmp_path):
    def name(scene=scene, weights=weights, **more):
        return RecordedNetwork(tmp_path, weights, **more).path(scene).name

    other_weights = write_weights(tmp_path / "w", seed=1)
    changed = shutil.copytree(root, tmp_path / "changed")
    scan = changed / "training" / "velodyne" / "0001" / "000002.bin"
    scan.write_bytes(scan.read_bytes()[:-16])
    names = [
        name(),
        name(weights=other_weights),
        name(Scene(Sequence(changed, 1))),
        name(Scene(Sequence(root, 1), ObjectShift(2.0))),
        name(Scene(Sequence(root, 1), ObjectShift(2.0, seed=1))),
        name(boxes=GroundTruthBoxes(("Car",)), boxes_name="gt"),
    ]
    assert len(set(names)) == len(names)
    assert name() == names[0] and all(n.startswith("0001-") for n in names)


def test_a_cut_recording_is_made_again(scene, weights, tmp_path):
    recorded = RecordedNetwork(tmp_path, weights)
    recorded.record(scene)
    path = recorded.path(scene)
    path.write_bytes(path.read_bytes()[:1000])
    assert recorded.record(scene)
    assert len(list(recorded.frames(scene))) == 5


def test_given_boxes_are_recorded_with_the_networks_view(scene, weights, tmp_path):
    truth = GroundTruthBoxes(("Pedestrian",))
    recorded = RecordedNetwork(tmp_path, weights, truth, "gt")
    counts = [len(boxes) for _, boxes, _, _ in recorded.frames(scene)]
    assert counts == [0, 0, 1, 0, 0]
    assert all("displacement" in extras for t, _, _, extras in recorded.frames(scene) if t)


def test_missing_weights_are_named(scene, tmp_path):
    with pytest.raises(InputError, match="expected a checkpoint file"):
        RecordedNetwork(tmp_path, tmp_path / "none").path(scene)


def test_trackers_side_by_side_have_their_times(root, weights, tmp_path):
    recorded = RecordedNetwork(tmp_path / "recordings", weights)
    config = EvaluateConfig(root, seqs=(1,), weights=weights)
    records = {
        name: evaluate_recorded(config, recorded, name, tmp_path / name)
        for name in ("pointtracknet", "sort")
    }
    for name, record in records.items():
        assert record["run"]["config"]["tracker"] == name
        assert (tmp_path / name / "tracks" / "0001.txt").is_file()
        seconds = record["seconds_per_frame"]
        parts = seconds["detect"] + seconds["displacement"] + seconds["tracker"]
        assert seconds["total"] == pytest.approx(parts)
    assert records["pointtracknet"]["seconds_per_frame"]["displacement"] > 0
    assert records["sort"]["seconds_per_frame"]["displacement"] == 0


def test_timed_source_measures_its_reader(scene, monkeypatch):
    clock = iter(range(100))
    monkeypatch.setattr("evaluation.side_by_side.perf_counter", lambda: next(clock))
    timed = TimedSource(GroundTruthBoxes(("Car",)))
    assert len(list(timed.frames(scene))) == 5
    assert (timed.count, timed.seconds_per_frame) == (5, 1.0)  # the clock ticks once a frame


def test_true_boxes_come_with_the_networks_displacement():
    class Labels:
        def frames(self, scene):
            yield 0, "boxes", "scores", {"types": "labelled"}
            yield 1, "boxes", "scores", {"types": "labelled"}

    class Recorded:
        def frames(self, scene):
            yield 0, "found", "low", {"types": "found"}
            yield 1, "found", "low", {"types": "found", "points": 1, "displacement": 2}

    source = TrueBoxes(Recorded())
    source.labelled = Labels()
    first, second = source.frames(None)
    assert first == (0, "boxes", "scores", {"types": "labelled"})
    assert second[3] == {"types": "labelled", "points": 1, "displacement": 2}
