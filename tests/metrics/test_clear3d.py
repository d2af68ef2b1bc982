"""`clear3d` against motmetrics on IoU computed box by box with shapely."""

from dataclasses import replace

import motmetrics
import numpy as np
import pytest
from helpers.devkit_reference import iou
from helpers.metric_cases import random_entry, rows

from kitti.boxes import camera_from_level
from kitti.objects import Objects
from metrics.clear3d import clear3d, row_errors
from metrics.protocols import Clear3d, Entry, evaluate_protocol

CLASSES = ("Car", "Van")


def reference(entry: Entry, min_iou: float) -> dict:
    """motmetrics' own summary of one sequence."""
    truth, results = entry.truth.of_classes(CLASSES), entry.results.of_classes(CLASSES)
    accumulator = motmetrics.MOTAccumulator()
    for t in range(entry.num_frames):
        g, r = truth.at(t), results.at(t)
        a, b = (np.stack(camera_from_level(o.boxes), axis=1) for o in (g, r))
        distance = np.array([[1 - iou(p, q) for q in b] for p in a]).reshape(len(a), len(b))
        distance[distance > 1 - min_iou] = np.nan
        accumulator.update(g.track_id, r.track_id, distance, frameid=t)
    names = motmetrics.metrics.motchallenge_metrics
    return motmetrics.metrics.create().compute(accumulator, metrics=names, return_dataframe=False)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("min_iou", [0.25, 0.5])
def test_equals_motmetrics(seed, min_iou):
    entry = random_entry(seed, objects=8)
    expected = reference(entry, min_iou)
    figures = evaluate_protocol("clear3d", [entry], min_iou=min_iou)["overall"]
    assert figures["IDS"] == expected["num_switches"]
    assert figures["FRAG"] == expected["num_fragmentations"]
    assert (figures["FP"], figures["FN"]) == (
        expected["num_false_positives"],
        expected["num_misses"],
    )
    tracks = expected["num_unique_objects"]
    assert figures["MT"] == expected["mostly_tracked"] / tracks
    assert figures["ML"] == expected["mostly_lost"] / tracks
    assert figures["MOTA"] == pytest.approx(expected["mota"], abs=1e-12)
    assert figures["MOTP"] == pytest.approx(1 - expected["motp"], abs=1e-9)


def test_dontcare_regions_excuse_unmatched_results_alone():
    """Of four unmatched results one is mostly in the region; a match in it counts as ever."""
    solid = [[20, y, 0, 4, 2, 1.5, 0] for y in (-8, -4, 0, 4, 8)]
    image = [
        [300, 100, 350, 200],  # 51 % in the region
        [400, 100, 450, 200],  # half in the other, not more
        [500, 100, 560, 110],  # flat, which KITTI's own protocols would excuse
        [600, 100, 650, 200],  # outside
        [310, 100, 360, 200],  # matched
    ]
    nowhere = np.full((2, 7), np.nan)
    regions = rows("DontCare", [0, 0], -1, nowhere, [[324.5, 0, 390, 300], [425, 0, 480, 300]])
    car = rows("Car", [0], 4, [solid[4]], [image[4]])
    results = rows("Car", [0] * 5, [1, 2, 3, 4, 5], solid, image, score=1.0)
    entry = Entry("0000", 1, Objects.concatenate([regions, car]), results)
    plain = evaluate_protocol("clear3d", [entry])["overall"]
    excused = evaluate_protocol("clear3d_dontcare", [entry])["overall"]
    assert (plain["FP"], excused["FP"]) == (4, 3)
    assert excused["TP"] == plain["TP"] == 1


@pytest.mark.parametrize("seed", range(4))
def test_without_dontcare_regions_both_are_the_same(seed):
    entry = random_entry(seed, objects=8)
    plain = evaluate_protocol("clear3d", [entry])["overall"]
    excused = evaluate_protocol("clear3d_dontcare", [entry])["overall"]
    assert excused["FP"] <= plain["FP"]
    assert {**excused, "FP": 0, "MOTA": 0} == {**plain, "FP": 0, "MOTA": 0}
    bare = replace(entry, truth=entry.truth[entry.truth.type != "DontCare"])
    assert evaluate_protocol("clear3d_dontcare", [bare])["overall"] == plain


def test_the_cases_hold_every_kind_of_event():
    entries = [random_entry(seed, objects=8, name=f"{seed:04d}") for seed in range(4)]
    figures = evaluate_protocol("clear3d", entries, min_iou=0.25)["overall"]
    assert min(figures[key] for key in ("TP", "FP", "FN", "IDS", "FRAG")) > 5


def test_sums_over_sequences_with_one_empty():
    parts = [random_entry(1, name="0000"), random_entry(2, name="0001")]
    empty = Entry(
        "0017", 5, parts[0].truth[:0], rows("Car", [2], 1, [[9, 0, 0, 4, 2, 1, 0]], [[0] * 4])
    )
    figures = evaluate_protocol("clear3d", [*parts, empty])
    each = figures["sequences"]
    for key in ("IDS", "FRAG", "TP", "FP", "FN", "GT"):
        assert figures["overall"][key] == sum(part[key] for part in each.values())
    assert each["0017"]["MOTA"] is None and each["0017"]["FP"] == 1
    counts = figures["overall"]
    errors = counts["FN"] + counts["FP"] + counts["IDS"]
    assert figures["overall"]["MOTA"] == pytest.approx(1 - errors / counts["GT"], abs=1e-15)
    matched = [part["MOTP"] * part["TP"] for part in each.values() if part["TP"]]
    assert counts["MOTP"] == pytest.approx(sum(matched) / counts["TP"], abs=1e-12)


def test_both_sides_are_limited_to_the_classes():
    entry = random_entry(5)
    cars = evaluate_protocol("clear3d", [entry], classes=("Car",))["overall"]
    assert cars["GT"] == (entry.truth.type == "Car").sum()
    assert cars["TP"] + cars["FP"] == (entry.results.type == "Car").sum()


def test_gate_includes_the_threshold_itself():
    box = [[10, 0, 0, 4, 2, 1.5, 0]]
    moved = [[10 + 4 / 3, 0, 0, 4, 2, 1.5, 0]]  # IoU = (8/3) / (16/3) = 1/2
    truth, result = (
        rows("Car", [0], 1, box, [[0] * 4]),
        rows("Car", [0], 1, moved, [[0] * 4], score=1),
    )
    found = {
        least: evaluate_protocol("clear3d", [Entry("0000", 1, truth, result)], min_iou=least)
        for least in (0.5 - 1e-9, 0.5 + 1e-9)
    }
    assert [part["overall"]["TP"] for part in found.values()] == [1, 0]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kept_share", [1.0, 0.7])
def test_errors_by_row_add_up_to_the_counts(seed, kept_share):
    comparison = Clear3d([random_entry(seed, objects=8)], CLASSES, 0.25).comparisons[0]
    keep = np.random.default_rng(seed).random(len(comparison.results)) < kept_share
    counts = clear3d(comparison, keep, 0.25).counts
    errors = row_errors(comparison, keep, 0.25)
    sums = (errors.missed.sum(), errors.false_alarm.sum(), errors.switched.sum())
    assert sums == (counts.fn, counts.fp, counts.ids)
    assert min(sums) > 0
    assert (errors.matched_id >= 0).sum() == counts.tp
    assert not (errors.false_alarm & errors.switched).any()
    assert keep[errors.false_alarm | errors.switched].all()


def test_errors_name_the_rows():
    """Frame 0: a match. Frame 1: another id, a switch. Frame 2: the result is far off."""
    box = [10.0, 0, 0, 4, 2, 1.5, 0]
    far = [40.0, 0, 0, 4, 2, 1.5, 0]
    truth = Objects.from_boxes(np.arange(3), 7, np.tile(box, (3, 1)))
    results = Objects.from_boxes(np.arange(3), [1, 2, 2], [box, box, far], 1.0)
    comparison = Clear3d([Entry("0000", 3, truth, results)], CLASSES, 0.5).comparisons[0]
    errors = row_errors(comparison, np.ones(3, bool), 0.5)
    assert errors.missed.tolist() == [False, False, True]
    assert errors.false_alarm.tolist() == [False, False, True]
    assert errors.switched.tolist() == [False, True, False]
    assert errors.matched_id.tolist() == [7, 7, -1]
