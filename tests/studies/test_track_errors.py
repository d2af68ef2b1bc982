"""The list of tracking errors, against a case made by hand."""

import json

import numpy as np
import pytest
from helpers import tiny_kitti

from common import flags
from kitti.labels import write_results
from kitti.objects import Objects
from studies import track_errors as module


def test_kinds_follow_from_the_matches_of_the_same_id():
    frame, ids = np.array([0, 1, 2, 3, 4, 1]), np.array([3, 3, 3, 3, 3, 8])
    wrong = np.array([True, False, True, False, True, True])
    found = module.kinds(frame, ids, wrong)
    assert found.tolist() == ["before", "", "between", "", "after", "never"]
    assert module.kinds(frame, ids, ~wrong).tolist()[1::2] == ["between", "between", ""]


@pytest.fixture
def folder(tmp_path):
    """The first car of the tiny sequence from frame 2 to 8, without 5, under a new id from 6 on;
    one box far off before it and one of a track without a match; the others are right."""
    truth = tiny_kitti.vehicles()
    car, others = truth.track_id == 0, truth.track_id > 0
    frame = truth.frame
    first = car & (frame >= 2) & (frame <= 8) & (frame != 5)
    rows = np.concatenate([np.flatnonzero(first), np.flatnonzero(others), [0, 0]])
    ids = np.where(frame[rows] < 6, 5, 7)
    ids = np.where(others[rows], truth.track_id[rows], ids)
    ids[-2:], boxes = (5, 9), truth.boxes[rows]
    boxes[-2:, 0] += 20.0, 30.0
    results = Objects.from_boxes(frame[rows], ids, boxes, 0.5, bbox=truth.bbox[rows])
    write_results(tmp_path / "tracks" / "0000.txt", results)
    return tmp_path


def test_errors_of_result_files(folder, tiny_root, capsys):
    words = ["--data_root", str(tiny_root), "--results", str(folder / "tracks")]
    assert flags.run(module.main, [*words, "--out", str(folder / "errors")]) == 0
    (found,) = json.loads((folder / "errors" / "track_errors.json").read_text())["figures"]
    assert found["false alarms"] == {"before": 1, "never": 1}
    assert found["false alarms outside DontCare"] == found["false alarms"]
    assert found["misses"] == {"before": 2, "between": 1, "after": 3}
    assert found["switches"] == [
        {"switch in": "0000", "frame": 6, "label": 0, "from": 5, "to": 7, "frames since": 2}
    ]
    assert [(t["track"], t["frames"], t["boxes"]) for t in found["tracks"]] == [
        (5, "0-4", 4),
        (9, "0-0", 1),
    ]
    text = (folder / "errors" / "track_errors.md").read_text()
    tables = text.split("\n\n", 2)[2]
    assert tables in capsys.readouterr().out
    assert [line.split()[-2] for line in tables.splitlines()[2:5]] == ["2", "2", "6"]


def test_results_under_an_object_shift_are_compared_with_shifted_labels(folder, tiny_root):
    words = ["--data_root", str(tiny_root), "--results", str(folder / "tracks")]
    words += ["--object_shift", "2", "--out", str(folder / "errors")]
    assert flags.run(module.main, words) == 0
    (found,) = json.loads((folder / "errors" / "track_errors.json").read_text())["figures"]
    assert sum(found["misses"].values()) > 6


def test_a_missing_result_file_is_one_line(tiny_root, tmp_path, capsys):
    words = ["--data_root", str(tiny_root), "--results", str(tmp_path), "--out", str(tmp_path)]
    assert flags.run(module.main, words) == 2
    assert str(tmp_path / "0000.txt") in capsys.readouterr().err
