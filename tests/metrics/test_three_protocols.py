"""Where the protocols disagree: one object's story, digits = matched id, 0 = unmatched."""

import pytest
from helpers.metric_cases import one_object

from metrics.kitti3d import trajectory_counts
from metrics.protocols import evaluate_protocol


@pytest.mark.parametrize(
    ("history", "kitti3d", "kitti2d", "clear3d"),
    [
        ("110022", (0, 1), (1, 1), (1, 1)),
        ("1122", (1, 1), (1, 0), (1, 0)),
        ("10101", (0, 1), (0, 2), (0, 2)),
        ("1212", (3, 3), (3, 0), (3, 0)),
    ],
)
def test_switches_and_fragmentations(history, kitti3d, kitti2d, clear3d):
    other = "0" + history  # an empty frame first changes nothing
    expected = {"kitti3d": kitti3d, "clear3d": clear3d}
    for text in (history, other):
        for name, counts in expected.items():
            figures = evaluate_protocol(name, [one_object(text)])["overall"]
            assert (figures["IDS"], figures["FRAG"]) == counts, (name, text)


@pytest.mark.parametrize(
    ("history", "expected"),
    [("110022", (1, 1)), ("1122", (1, 0)), ("10101", (0, 2)), ("1212", (3, 0))],
)
def test_trackeval_switches_and_fragmentations(history, expected):
    """A second car is always found, so that no frame is without results (TrackEval's quirk)."""
    figures = evaluate_protocol("kitti2d", [with_companion(one_object(history))])["overall"]
    assert (figures["IDS"], figures["FRAG"]) == expected


def test_trackeval_quirk_gap_in_a_frame_without_results_is_no_fragmentation():
    figures = evaluate_protocol("kitti2d", [one_object("10101")])["overall"]
    assert (figures["IDS"], figures["FRAG"], figures["FN"]) == (0, 0, 2)


def test_mostly_tracked_at_exactly_eighty_percent():
    entry = with_companion(one_object("1111111100"))
    at_80 = {
        name: evaluate_protocol(name, [entry])["overall"]
        for name in ("clear3d", "kitti2d", "kitti3d")
    }
    assert at_80["clear3d"]["MT"] == 2 / 2  # motmetrics: >= 80 %
    assert at_80["kitti2d"]["MT"] == at_80["kitti3d"]["MT"] == 1 / 2  # strictly more


def test_ignored_matched_first_frame_counts_as_tracked():
    # 1 ignored + 4 evaluated frames, of which 3 are matched: (1 + 3) / 4 instead of 3 / 4
    assert (
        trajectory_counts([1, 1, 1, 1, -1], [True, False, False, False, False]).mostly_tracked == 1
    )
    assert trajectory_counts([1, 1, 1, -1], [False] * 4).mostly_tracked == 0


def with_companion(entry):
    """The same with a second car, far off, that is found in every frame under id 99."""
    from dataclasses import replace

    import numpy as np

    from kitti.objects import Objects

    shift = np.array([0, 30, 0, 0, 0, 0, 0.0])
    second = replace(entry.truth, boxes=entry.truth.boxes + shift)
    second = replace(second, track_id=np.full(len(second), 99), bbox=second.bbox + 300)
    truth = Objects.concatenate([entry.truth, second])
    found = replace(second, score=np.ones(len(second)))
    return replace(entry, truth=truth, results=Objects.concatenate([entry.results, found]))
