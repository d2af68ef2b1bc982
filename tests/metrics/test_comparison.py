"""Rows sorted into frames, track scores, thresholds."""

import numpy as np
from helpers.metric_cases import random_entry, rows

from kitti.iou import iou_2d
from metrics.comparison import compare, rows_by_frame, track_scores, with_exact_ids


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
