"""Rows sorted into frames, track scores, thresholds."""

import numpy as np
from helpers.metric_cases import random_entry, rows

from kitti.iou import iou_2d
from metrics.comparison import compare, rows_by_frame, track_scores, with_exact_ids
from metrics.protocols import Entry, evaluated_types


def test_rows_by_frame_keeps_order_and_gives_empty_frames():
    found = rows_by_frame(np.array([2, 0, 2, 5]), 5)
    assert [part.tolist() for part in found] == [[1], [], [0, 2], [], []]


def test_track_scores_are_means_and_missing_scores_count_minus_one():
    box, bbox = [[9, 0, 0, 4, 2, 1.5, 0]] * 4, [[0, 0, 1, 1]] * 4
    tracks = rows("Car", [0, 1, 0, 1], [5, 5, 3, 3], box, bbox, score=[1.0, 4.0, np.nan, 3.0])
    assert track_scores(tracks).tolist() == [2.5, 2.5, 1.0, 1.0]


def test_above_keeps_whole_tracks():
    entry = random_entry(3)
    found = compare("0000", entry.num_frames, entry.truth, entry.results, iou_2d, field="bbox")
    keep = found.above(2.0)
    for track in np.unique(entry.results.track_id):
        assert len(set(keep[entry.results.track_id == track])) == 1
    assert found.above(None).all() and 0 < keep.sum() < len(keep)


def test_ids_beyond_the_integers_of_float64_stay_different():
    box, bbox = [[9, 0, 0, 4, 2, 1.5, 0]] * 4, [[0, 0, 1, 1]] * 4
    tracks = rows("Car", [0, 0, 1, 1], [2**63 - 2, 2**63 - 1, 7, 2**63 - 2], box, bbox)
    assert with_exact_ids(tracks).track_id.tolist() == [1, 2, 0, 1]
    small = rows("Car", [0, 0, 1, 1], [2**53 - 2, -1, 7, 5], box, bbox)
    assert with_exact_ids(small) is small


def test_a_track_that_changes_its_class_is_scored_by_the_rows_that_count():
    box, bbox = [[9, 0, 0, 4, 2, 1.5, 0]] * 4, [[0, 0, 1, 1]] * 4
    kinds = ["Car", "Van", "Van", "Van"]
    tracks = rows(kinds, [0, 1, 0, 1], [5, 5, 3, 3], box, bbox, score=[0.9, 0.1, 0.4, 0.6])
    assert track_scores(tracks).tolist() == [0.5] * 4
    assert track_scores(tracks, ("Car",)).tolist() == [0.9, 0.9, 0.5, 0.5]
    assert evaluated_types("kitti2d", ("Car", "Van")) == ("Car",)
    assert evaluated_types("kitti3d", ("Car", "Van")) == ("Car", "Van")
    assert evaluated_types("clear3d", ("Van",)) == ("Van",)


def test_rows_beyond_the_frames_are_in_no_entry():
    whole = random_entry(3)
    half = Entry("0000", 12, whole.truth, whole.results)
    assert max(half.truth.frame.max(), half.results.frame.max()) < 12
    assert len(half.truth) == np.count_nonzero(whole.truth.frame < 12)
