"""Scored boxes against counts made by hand."""

import numpy as np
import pytest

from metrics.scored_boxes import (
    FALSE_ALARM,
    HIT,
    IGNORED,
    ScoredBoxes,
    best_threshold,
    collect,
    expected_calibration_error,
    outcomes_of,
    reliability,
    threshold_at_precision,
)


def boxes(*rows) -> ScoredBoxes:
    """(score, outcome) rows."""
    scores, outcomes = np.array(rows).T
    return collect([(scores, outcomes.astype(int), np.zeros(len(rows), int))])


def test_the_best_score_takes_the_true_box():
    """Two boxes on vehicle 0, one on vehicle 1 (few points), one in DontCare, one alone."""
    iou = np.array([[0.6, 0.8, 0, 0, 0], [0, 0, 0.7, 0, 0]])
    scores = np.array([0.9, 0.5, 0.6, 0.3, 0.2])
    counted, ignorable = np.array([True, False]), np.array([False, False, False, True, False])
    outcomes, rows = outcomes_of(iou, scores, counted, ignorable, 0.5)
    assert outcomes.tolist() == [HIT, FALSE_ALARM, IGNORED, IGNORED, FALSE_ALARM]
    assert rows.tolist() == [0, -1, 1, -1, -1]


def test_a_match_in_a_dontcare_region_is_a_hit():
    args = (np.array([[0.6]]), np.array([0.5]), np.array([True]), np.array([True]))
    assert outcomes_of(*args, min_iou=0.5)[0].tolist() == [HIT]
    assert outcomes_of(*args, min_iou=0.7)[0].tolist() == [IGNORED]


def test_frames_without_vehicles_or_boxes():
    nothing = np.zeros(0, bool)
    alone = outcomes_of(np.zeros((0, 1)), np.array([0.5]), nothing, np.array([False]), 0.5)[0]
    assert alone.tolist() == [FALSE_ALARM]
    assert outcomes_of(np.zeros((2, 0)), np.zeros(0), np.ones(2, bool), nothing, 0.5)[0].size == 0


def test_threshold_at_precision():
    """Precision from the top: 1, 1/2, 2/3, 3/4, 3/5."""
    found = boxes((0.9, HIT), (0.8, FALSE_ALARM), (0.7, HIT), (0.6, HIT), (0.5, FALSE_ALARM))
    assert threshold_at_precision(found, 0.7) == 0.6
    assert threshold_at_precision(found, 0.9) == 0.9
    assert threshold_at_precision(boxes((0.9, FALSE_ALARM)), 0.9) == np.inf
    assert threshold_at_precision(boxes((0.9, IGNORED), (0.8, FALSE_ALARM)), 0.9) == np.inf


def test_no_boxes_at_all():
    """No frames, or frames without boxes: every threshold is above their scores."""
    frame = np.zeros(0), np.zeros(0, int), np.zeros(0, int)
    for nothing in (collect([]), collect([frame])):
        assert [len(column) for column in nothing] == [0, 0, 0]
        assert nothing.outcomes.dtype == nothing.truth_points.dtype == int
        assert threshold_at_precision(nothing, 0.9) == np.inf
        assert best_threshold([(nothing, 3)]) == np.inf
        assert best_threshold([(nothing, 3), (boxes((0.9, HIT)), 1)]) == 0.9
    assert best_threshold([]) == np.inf


def test_equal_scores_are_taken_together():
    found = boxes((0.9, HIT), (0.5, HIT), (0.5, FALSE_ALARM))
    assert threshold_at_precision(found, 0.9) == 0.9
    assert best_threshold([(boxes((0.5, HIT), (0.5, FALSE_ALARM), (0.4, HIT)), 2)]) == 0.4


def test_the_best_threshold_weighs_groups_by_their_true_boxes():
    """At 0.4 one more hit of 10 in the first group, one more false alarm of 2 in the second."""
    first = boxes((0.9, HIT), (0.4, HIT))
    second = boxes((0.8, HIT), (0.4, FALSE_ALARM), (0.3, IGNORED))
    assert best_threshold([(first, 10), (second, 2)]) == 0.8
    assert best_threshold([(first, 10), (second, 20)]) == 0.4


def test_calibration_error():
    """Bins 0.2 to 0.3: mean 0.25, right 0.5; 0.9 to 1: mean 0.95, right 1."""
    scores, right = np.array([0.2, 0.3 - 1e-9, 0.9, 1.0]), np.array([True, False, True, True])
    found = reliability(scores, right)
    assert found.count.tolist() == [0, 0, 2, 0, 0, 0, 0, 0, 0, 2]
    assert np.isnan(found.score[0]) and found.right[2] == 0.5
    assert expected_calibration_error(found) == pytest.approx((2 * 0.25 + 2 * 0.05) / 4)
