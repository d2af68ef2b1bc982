"""The calibration command and the list of misses, from end to end on small weights."""

import functools
import json

import numpy as np
import pytest
from helpers import two_cars
from helpers.small_weights import write_weights

from common.errors import InputError
from kitti.sequence import open_sequences
from models.boxes.box_decoding import Clusters, Proposals
from models.config import DecodingConfig
from models.weights import load_networks
from studies import box_misses
from training import calibrate
from training.scoring import score_fit
from training.scoring.box_candidates import CandidateFinder, Candidates

SMALL_GRID = (score_fit.Penalty(0.1, None), score_fit.Penalty(0.1, 1.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Small weights and three drives of two frames."""
    folder = tmp_path_factory.mktemp("calibrate")
    write_weights(folder / "weights")
    for seq in (0, 1, 2):
        two_cars.write_sequence(folder / "data", seq, frames=2)
    return folder


def run(folder, *words) -> None:
    calibrate.main([str(w) for w in ("--weights", folder / "weights", *words)])


def test_a_scorer_is_fitted_stored_and_used(folder, monkeypatch, capsys):
    """Afterwards the same folder of weights gives networks with the scorer."""
    choose = functools.partial(score_fit.choose_penalty, grid=SMALL_GRID)
    monkeypatch.setattr(calibrate, "choose_penalty", choose)
    out = folder / "out"
    data = ("--real_root", folder / "data", "--real_seqs", "0000,0002")
    data += ("--exam_root", folder / "data", "--exam_seqs", "0001")
    run(folder, *data, "--views", 2, "--out", out)
    record = json.loads((out / "calibration.json").read_text())
    assert (out / "reliability.png").read_bytes()[:4] == b"\x89PNG"
    assert set(record["figures"]) == {"real", "exam"}
    found = record["figures"]["real"]
    assert record["run"]["data"] == {"real": ["data/0000", "data/0002"], "exam": ["data/0001"]}
    assert found["frames"] == 2 * 4 and found["boxes"] >= found["right"]
    assert sum(row[0] for row in found["reliability"]) == found["boxes"]
    assert 0 <= found["IoU 0.5"]["after"]["all"] <= 1
    scorer = load_networks(folder / "weights")[2]
    assert scorer.min_score == record["run"]["chosen"]["min_score"]
    assert f"default threshold {scorer.min_score:.3f}" in capsys.readouterr().out


def test_the_list_of_misses(folder, capsys):
    """With a threshold above 1 every vehicle is missed."""
    words = ["--data_root", folder / "data", "--seqs", "0000,0002", "--points", "1"]
    words += ["--weights", folder / "weights", "--score_threshold", "1.1", "--out", folder / "m"]
    box_misses.main([str(word) for word in words])
    record = json.loads((folder / "m" / "box_misses.json").read_text())
    assert len(record["missed"]) == record["vehicles"] > 0
    for row in record["missed"]:
        assert 0 <= row["mask"] <= 1 and row["points"] >= 1 and row["proposals"] >= 0
    assert f"{record['vehicles']} of {record['vehicles']} vehicles" in capsys.readouterr().out
    assert len((folder / "m" / "box_misses.md").read_text().splitlines()) == 4 + record["vehicles"]


def test_a_found_vehicle_is_no_miss():
    """Boxes of score 0.8 and 0.3 on two vehicles of 60 points, and a third of 40 points."""
    iou = np.array([[0.7, 0.0], [0.0, 0.6], [0.0, 0.1]])
    truth = np.array([[x, 0, 0, 4, 2, 2, 0] for x in (10.0, 20.0, 30.0)])
    proposals = Proposals(truth[[0, 1, 1]], None, None)
    clusters = Clusters(None, None, None, None, None, None, proposals)
    points, ignorable = np.array([60, 60, 40]), np.zeros(2, bool)
    frame = Candidates("a", 3, clusters, {}, iou, points, ignorable, truth, np.full(3, 0.5))
    scores = np.array([0.8, 0.3])
    (missed,) = box_misses.misses(frame, scores, 0.4, 50)
    assert missed["range"] == 20 and missed["proposals"] == 2
    assert (missed["IoU"], missed["score"]) == (0.6, 0.3)
    assert box_misses.misses(frame, scores, 0.2, 50) == []
    assert len(box_misses.misses(frame, scores, 0.4, 40)) == 2


@pytest.mark.parametrize("empty", ["real", "simulated", "exam"])
def test_drives_without_scans_are_named(folder, empty):
    """Of the exam they ended in a ValueError; the network does not run for any of them."""
    for seq in (0, 1):
        two_cars.write_sequence(folder / "empty", seq, frames=1, missing=(0,))
    roots = dict.fromkeys(("real", "simulated"), folder / "data") | {empty: folder / "empty"}
    words = [word for kind, root in roots.items() for word in (f"--{kind}_root", root)]
    with pytest.raises(InputError, match=f"--{empty}_root: .* none in empty/0000, empty/0001"):
        run(folder, *words, "--out", folder / "bad")


def test_a_network_without_a_box_is_an_input_error(folder, monkeypatch):
    monkeypatch.setattr(calibrate, "DecodingConfig", lambda: DecodingConfig(min_probability=1.0))
    with pytest.raises(InputError, match="scans in which the detector proposes boxes, found none"):
        run(folder, "--real_root", folder / "data", "--views", 1, "--out", folder / "bad")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "expected --real_root or --simulated_root"),
        (["--real_root", "{data}", "--exam_seqs", "0000"], "expected --exam_root"),
        (["--real_root", "{data}", "--simulated_seqs", "0000"], "--simulated_seqs: expected --sim"),
        (
            ["--simulated_root", "{data}", "--real_seqs", "0000"],
            "--real_seqs: expected --real_root",
        ),
        (["--real_root", "{data}/none"], "none"),
        (["--real_root", "{data}", "--folds", "1"], "--folds: expected at least 2, found 1"),
        (
            ["--real_root", "{data}", "--exam_root", "{data}/../data", "--exam_seqs", "0001"],
            "not fitted on, found 0001 of .* in both",
        ),
    ],
)
def test_bad_flags(folder, words, message):
    words = [word.format(data=folder / "data") for word in words]
    with pytest.raises(InputError, match=message):
        run(folder, *words, "--out", folder / "bad")
    assert not (folder / "bad").exists()


def test_a_scan_without_points_in_the_view_has_no_boxes(folder, tmp_path):
    """Its vehicles have no points, and so do not count."""
    data = two_cars.write_sequence(tmp_path, frames=2)
    behind = np.array([[-5, 0, -1, 0]] * 3, np.float32)
    behind.tofile(data / "training/velodyne/0000/000001.bin")
    detector = load_networks(folder / "weights")[0]
    finder = CandidateFinder(detector, DecodingConfig())
    for frames in finder.find_all(open_sequences(data, [0]), range(2)):
        full, empty = frames
        assert len(full.clusters.boxes) and empty.features == {}
        assert empty.iou.shape == (2, 0) and empty.points.tolist() == [0, 0]
        assert len(empty.scores(None)) == len(empty.ignorable) == 0
        assert len(empty.clusters.proposals.boxes) == 0 and np.isnan(empty.foreground).all()
        boxes = score_fit.scored(frames, [frame.scores(None) for frame in frames], 0.5)
        assert len(boxes.scores) == len(full.clusters.boxes)
        assert score_fit.counted_vehicles(frames) == 2
