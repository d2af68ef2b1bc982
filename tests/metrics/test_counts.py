"""Counts add up, and ratios are divided once."""

from metrics.counts import Counts, total


def test_metrics_follow_from_the_counts():
    counts = Counts(
        gt=10,
        tp=7,
        fp=2,
        fn=3,
        ids=1,
        frag=4,
        tracks=4,
        mostly_tracked=2,
        mostly_lost=1,
        similarity=5.6,
    )
    assert counts.metrics() == {
        "MOTA": 1 - (3 + 2 + 1) / 10,
        "MOTP": 5.6 / 7,
        "MT": 2 / 4,
        "ML": 1 / 4,
        "IDS": 1,
        "FRAG": 4,
        "TP": 7,
        "FP": 2,
        "FN": 3,
        "GT": 10,
    }


def test_without_ground_truth_ratios_are_none_and_counts_stay():
    figures = Counts(fp=3).metrics()
    assert [figures[key] for key in ("MOTA", "MOTP", "MT", "ML")] == [None] * 4
    assert (figures["FP"], figures["GT"]) == (3, 0)


def test_false_alarms_of_an_empty_sequence_count_in_the_sum():
    overall = total(
        [Counts(gt=10, tp=10, tracks=1, mostly_tracked=1, similarity=10.0), Counts(fp=2)]
    )
    assert overall.metrics()["MOTA"] == 1 - 2 / 10
    assert total([]) == Counts()
