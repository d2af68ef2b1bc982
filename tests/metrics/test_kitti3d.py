"""`kitti3d` against the literal reference of the devkit's rules, on the same files."""

import numpy as np
import pytest
from helpers.devkit_reference import evaluate, naive_sum, over_recall, read
from helpers.metric_cases import random_entry, rows

from kitti.iou import iou_3d
from kitti.labels import read_labels, read_results, write_labels, write_results
from kitti.objects import Objects
from metrics.comparison import compare
from metrics.protocols import Entry, Kitti3d, evaluate_protocol, metrics_of

COUNTS = ("TP", "FP", "FN", "GT", "IDS", "FRAG")


def through_files(folder, entry: Entry):
    """(read by the project, read by the reference) after writing `entry`."""
    labels, results = folder / f"gt{entry.name}.txt", folder / f"{entry.name}.txt"
    write_labels(labels, entry.truth)
    write_results(results, entry.results)
    n = entry.num_frames
    ours = Entry(entry.name, n, read_labels(labels, n), read_results(results, n))
    return ours, (read(labels, scored=False), read(results, scored=True))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("min_iou", [0.25, 0.5, 0.7])
def test_equals_the_reference(tmp_path, seed, min_iou):
    ours, theirs = through_files(tmp_path, random_entry(seed, objects=4))
    figures = evaluate_protocol("kitti3d", [ours], min_iou=min_iou)["overall"]
    expected = evaluate(*theirs, min_iou)
    assert {key: figures[key] for key in COUNTS} == {key: expected[key] for key in COUNTS}
    if expected["GT"]:
        errors = expected["FN"] + expected["FP"] + expected["IDS"]
        assert figures["MOTA"] == pytest.approx(1 - errors / expected["GT"], abs=1e-9)
        assert figures["MT"] == pytest.approx(expected["MT"] / expected["tracks"], abs=1e-9)
        assert figures["ML"] == pytest.approx(expected["ML"] / expected["tracks"], abs=1e-9)
    if expected["TP"]:
        assert figures["MOTP"] == pytest.approx(expected["sum"] / expected["TP"], abs=1e-9)


def test_the_cases_hold_every_kind_of_event(tmp_path):
    entries = [random_entry(seed, objects=4, name=f"{seed:04d}") for seed in range(6)]
    overall = evaluate_protocol("kitti3d", entries, min_iou=0.25)["overall"]
    assert min(overall[key] for key in COUNTS) > 5
    evaluated = evaluate_protocol("kitti3d", entries, min_iou=0.25)["overall"]["GT"]
    assert evaluated < sum(int((e.truth.type == "Car").sum()) for e in entries)  # some are ignored


@pytest.mark.parametrize("seed", [21, 22])
def test_figures_over_recall_equal_the_reference(tmp_path, seed):
    made = [random_entry(seed + 50 * k, frames=12, objects=3, name=f"{k:04d}") for k in range(3)]
    ours, theirs = zip(*(through_files(tmp_path, entry) for entry in made), strict=True)
    figures = evaluate_protocol("kitti3d", ours, min_iou=0.25)["overall"]
    expected = over_recall(*zip(*theirs, strict=True), 0.25)
    for key in ("sAMOTA", "AMOTA", "AMOTP"):
        assert figures[key] == pytest.approx(expected[key], abs=1e-9), key
    best_mota, best_threshold = expected["best"]
    assert figures["best_MOTA"] == pytest.approx(best_mota, abs=1e-9)
    assert figures["best_threshold"] == pytest.approx(best_threshold, abs=1e-9)
    at_best = metrics_of(Kitti3d(ours, 0.25), ours, best=True)["overall"]
    assert {key: at_best[key] for key in COUNTS} == {
        key: expected["at best"][key] for key in COUNTS
    }
    assert at_best["TP"] < figures["TP"]  # the threshold does drop tracks


def test_sequence_without_cars_gives_null_and_its_false_alarms_count():
    full = random_entry(0)
    empty = Entry("0017", 25, full.truth[full.truth.type == "Pedestrian"], full.results)
    alone = evaluate_protocol("kitti3d", [full])["overall"]
    both = evaluate_protocol("kitti3d", [full, empty])
    only = both["sequences"]["0017"]
    assert [only[key] for key in ("MOTA", "MOTP", "MT", "ML")] == [None] * 4
    assert only["FP"] > 0 and both["overall"]["FP"] == alone["FP"] + only["FP"]
    nothing = evaluate_protocol("kitti3d", [empty])["overall"]
    assert [nothing[key] for key in ("sAMOTA", "AMOTA", "AMOTP", "MOTA")] == [None] * 4


def test_no_results_at_all():
    truth = random_entry(0).truth
    figures = evaluate_protocol("kitti3d", [Entry("0000", 25, truth, Objects.empty())])["overall"]
    assert (figures["MOTA"], figures["FN"], figures["MOTP"]) == (0.0, figures["GT"], None)
    assert figures["ML"] == 1.0 and figures["sAMOTA"] == 0.0


def test_means_of_means_can_fall_below_the_threshold_that_is_the_tracks_own_score():
    """AB3DMOT's evaluator does so; its published counts depend on it."""

    def mean(score: float) -> float:
        return naive_sum([score] * 51) / 51

    score = next(s for s in np.linspace(3, 4, 1000).tolist() if mean(mean(s)) < mean(s))
    frames = np.arange(51)
    box, bbox = [[20, 0, 0, 4, 2, 1.5, 0]] * 51, [[0, 0, 100, 100]] * 51
    tracks = rows("Car", frames, 3, box, bbox, score=score)
    found = compare("0000", 51, tracks, tracks, iou_3d)
    own = mean(score)
    assert found.above(own).all()
    assert not found.above(own, earlier_passes=1).any()
