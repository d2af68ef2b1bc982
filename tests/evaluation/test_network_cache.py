"""The cache replays the networks' outputs, and its files are named by all they depend on."""

import shutil
from dataclasses import fields

import numpy as np
import pytest
from helpers import tiny_kitti
from helpers.small_weights import write_weights

from common.errors import InputError
from evaluation import network_cache
from evaluation.config import EvaluateConfig
from evaluation.detections import (
    LabelBoxes,
    LabelBoxesWithPredictedMotion,
    NetworkDetections,
    with_motion,
)
from evaluation.network_cache import CachedPredictions
from evaluation.scene import Scene
from evaluation.side_by_side import TimedDetections, evaluate_cached
from kitti.object_shift import ObjectShift
from kitti.scans.scan_files import write_scan
from kitti.sequence import KittiSequence
from tracking import FrameDetections


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
    return Scene(KittiSequence(root, 1))


def _same(a, b):
    assert a.t == b.t
    for field in fields(a)[1:]:
        x, y = getattr(a, field.name), getattr(b, field.name)
        assert (x is None) == (y is None)
        if x is not None and (len(x) or len(y)):
            np.testing.assert_array_equal(x, y)


def test_replay_equals_the_networks_and_runs_them_once(scene, weights, tmp_path, monkeypatch):
    cached = CachedPredictions(tmp_path, weights)
    ticks = []
    assert cached.fill(scene, lambda: ticks.append(1))
    assert len(ticks) == scene.num_frames == 5
    live = list(NetworkDetections.load(weights).frames(scene))
    for a, b in zip(cached.frames(scene), live, strict=True):
        _same(a, b)
    assert any(len(found) for found in live)

    def fail(*_):
        raise AssertionError("the networks ran again")

    monkeypatch.setattr(NetworkDetections, "load", fail)
    again = CachedPredictions(tmp_path, weights)
    assert not again.fill(scene)
    seconds = again.seconds(scene)
    assert seconds.shape == (5, 3)
    assert seconds[1, 1] > 0 and seconds[0, 1] == 0


def test_the_name_depends_on_all_that_matters(root, scene, weights, tmp_path):
    def name(scene=scene, weights=weights):
        return CachedPredictions(tmp_path, weights).path(scene).name

    other_weights = write_weights(tmp_path / "w", seed=1)
    changed = shutil.copytree(root, tmp_path / "changed")
    scan = changed / "training" / "velodyne" / "0001" / "000002.bin"
    scan.write_bytes(scan.read_bytes()[:-16])
    names = [
        name(),
        name(weights=other_weights),
        name(Scene(KittiSequence(root, 1, image_size=(640, 360)))),
        name(Scene(KittiSequence(changed, 1))),
        name(Scene(KittiSequence(root, 1), ObjectShift(2.0))),
        name(Scene(KittiSequence(root, 1), ObjectShift(2.0, seed=1))),
    ]
    assert len(set(names)) == len(names)
    assert name() == names[0] and all(n.startswith("0001-") for n in names)


def test_the_name_depends_on_ops_and_versions(scene, weights, tmp_path, monkeypatch):
    def name():
        network_cache.code_digest.cache_clear()
        return CachedPredictions(tmp_path, weights).path(scene).name

    names = [name()]
    (tmp_path / "other.so").write_bytes(b"ops")
    monkeypatch.setenv("TF_OPS_LIBRARY", str(tmp_path / "other.so"))
    names.append(name())
    monkeypatch.setattr(network_cache.metadata, "version", lambda package: "1.0")
    names.append(name())
    monkeypatch.undo()
    assert len(set(names)) == 3 and name() == names[0]


def test_a_cut_file_is_made_again(scene, weights, tmp_path):
    cached = CachedPredictions(tmp_path, weights)
    cached.fill(scene)
    path = cached.path(scene)
    path.write_bytes(path.read_bytes()[:1000])
    assert cached.fill(scene)
    assert len(list(cached.frames(scene))) == 5


def test_given_boxes_get_the_networks_motion(scene, weights):
    truth = LabelBoxes(("Pedestrian",))
    frames = list(NetworkDetections.load(weights, truth).frames(scene))
    assert [len(found) for found in frames] == [0, 0, 1, 0, 0]
    assert all(found.displacement is not None for found in frames if found.t)


def test_missing_weights_are_named(scene, tmp_path):
    with pytest.raises(InputError, match="expected a checkpoint file"):
        CachedPredictions(tmp_path, tmp_path / "none").path(scene)


def test_trackers_side_by_side_have_their_times(root, weights, tmp_path):
    cached = CachedPredictions(tmp_path / "cache", weights)
    config = EvaluateConfig(root, seqs=(1,), weights=weights)
    records = {
        name: evaluate_cached(config, cached, name, tmp_path / name)
        for name in ("pointtracknet", "sort", "deep_sort")
    }
    for name, record in records.items():
        assert record["run"]["config"]["tracker"] == name
        assert (tmp_path / name / "tracks" / "0001.txt").is_file()
        seconds = record["seconds_per_frame"]
        names = ("detect", "displacement", "appearance", "tracker")
        parts = sum(seconds[name] for name in names)
        assert seconds["total"] == pytest.approx(parts)
    assert records["pointtracknet"]["seconds_per_frame"]["displacement"] > 0
    for name in ("sort", "deep_sort"):
        assert records[name]["seconds_per_frame"]["displacement"] == 0
    for name in ("pointtracknet", "sort"):
        assert records[name]["seconds_per_frame"]["appearance"] == 0
    assert records["deep_sort"]["seconds_per_frame"]["appearance"] > 0


def test_timed_source_measures_its_reader(scene, monkeypatch):
    clock = iter(range(100))
    monkeypatch.setattr("evaluation.side_by_side.perf_counter", lambda: next(clock))
    timed = TimedDetections(LabelBoxes(("Car",)))
    assert len(list(timed.frames(scene))) == 5
    assert (timed.count, timed.seconds_per_frame) == (5, 1.0)  # the clock ticks once a frame


def test_labelled_boxes_come_with_the_predicted_motion(scene):
    box = np.array([[10.0, 0, 0, 4, 2, 1.5, 0]])

    class Predicted:
        def frames(self, scene):
            yield FrameDetections(0, box, [0.5])
            points = np.ones((2, 3))
            for t in range(1, 5):
                yield FrameDetections(t, box, [0.5], points=points, displacement=2 * points)

    provider = LabelBoxesWithPredictedMotion(Predicted(), ("Pedestrian",))
    first, _, third, *_ = provider.frames(scene)
    assert (len(first), len(third), third.types.tolist()) == (0, 1, ["Pedestrian"])
    assert first.points is None and (third.displacement == 2).all()


@pytest.mark.parametrize("ids", [None, np.array([4])])
def test_boxes_of_files_have_the_networks_mask_and_labelled_ones_none(ids):
    box, points = np.array([[10.0, 0, 0, 4, 2, 1.5, 0]]), np.ones((2, 3))
    motion = FrameDetections(1, box, [0.5], points=points, displacement=points, mask=points)
    found = with_motion(FrameDetections(1, box, [0.9], label_ids=ids), motion)
    assert found.scores.tolist() == [0.9] and (found.displacement == 1).all()
    assert (found.mask is None) == (ids is not None)
