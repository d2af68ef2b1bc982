"""Table 5, figure 5, the readings and AB3DMOT's table on a made-up folder; the paper's numbers."""

import json
import math
import re
from dataclasses import replace

import pytest

from common.errors import InputError
from experiments import ab3dmot, figure5, table5
from experiments.paper import AB3DMOT, AB3DMOT_COLUMNS, TABLE5, TABLE5_COLUMNS
from experiments.runs import Run, mean_and_spread, measure, over_seeds, shown
from studies import displacement_readings


def arguments(root, out, *more) -> list[str]:
    return [
        str(value) for value in ("--data_root", root, "--seqs", "0000-0001", "--out", out, *more)
    ]


def test_mean_and_sample_spread():
    assert mean_and_spread([1.0, 3.0]) == (2.0, math.sqrt(2.0))
    assert mean_and_spread([0.5]) == (0.5, 0.0)
    assert mean_and_spread([0.5, None]) == (None, 0.0)
    assert shown([0.25, 0.75], 2) == "0.50 ± 0.35"
    assert (shown([7], 0), shown([None], 3)) == ("7", "-")


def test_a_run_leaves_out_tracks_below_the_threshold(tiny_root):
    run = Run(tiny_root, (0,), ("Car",), "sort")
    assert measure(run)["TP"] > 0
    assert measure(replace(run, score_threshold=2.0))["TP"] == 0  # labels have score 1


def test_a_run_without_object_shift_needs_no_seeds(tiny_root):
    base = Run(tiny_root, (0,), ("Car",), "sort")
    assert len(over_seeds(base, 5)) == 1
    moved = Run(tiny_root, (0,), ("Car",), "sort", object_shift=1.0)
    assert [run.seed for run in over_seeds(moved, 3)] == [0, 1, 2]


def test_held_shifts_leave_a_tracker_as_it_was(tiny_root):
    def mota(**displaced):
        return measure(Run(tiny_root, (0,), ("Car",), "sort", **displaced))["MOTA"]

    assert mota(object_shift=2.0, hold=True) == mota()
    assert mota(object_shift=2.0) < mota()


def test_table5_has_a_row_of_ours_above_each_of_the_papers(tiny_root, tmp_path):
    detections = ("--detections", tiny_root / "detections")
    table5.main(arguments(tiny_root, tmp_path, "--seeds", 2, *detections))
    rows = [
        line
        for line in (tmp_path / "table5.md").read_text().splitlines()
        if re.search(r", \d m ", line)
    ]
    assert len(rows) == 2 * 2 * 3 * 2  # halves, displacements, trackers, ours and the paper's
    assert [row.startswith("| paper: ") for row in rows] == [False, True] * 12
    figures = json.loads((tmp_path / "table5.json").read_text())
    assert "versions" in figures["run"]
    per_seed = {(f["tracker"], f["displacement"]): len(f["per_seed"]) for f in figures["figures"]}
    assert per_seed["sort", 0.0] == 1 and per_seed["sort", 2.0] == 2


def test_readings_mark_the_default_once_per_tracker(tiny_root, tmp_path):
    displacement_readings.main(arguments(tiny_root, tmp_path, "--seeds", 1))
    text = (tmp_path / "displacement_readings.md").read_text()
    assert text.count(" *: ") == len(displacement_readings.TRACKERS)
    assert "held: SORT" in text and "fresh: DEEP_SORT" in text


def test_figure5_writes_curve_and_picture(tiny_root, tmp_path):
    more = ("--seeds", 1, "--distances", "0,2")
    figure5.main(arguments(tiny_root, tmp_path, *more))
    lines = (tmp_path / "figure5.csv").read_text().splitlines()
    assert lines[0] + "\n" == figure5.HEADER and len(lines) == 1 + 3 * 2
    assert "gt_displacement,2,1,1.000000,0.000000" in lines
    assert (tmp_path / "figure5.png").read_bytes().startswith(b"\x89PNG")


def test_ab3dmot_table_stands_beside_the_published_rows(tiny_root, tmp_path):
    more = ("--detections", tiny_root / "detections")
    ab3dmot.main(arguments(tiny_root, tmp_path, *more))
    text = (tmp_path / "ab3dmot.md").read_text()
    assert "no poses/" in text and "0.8647" in text
    assert text.count("| published, ") == 4


@pytest.mark.parametrize("text", ["", "a", "0,,1", "-1", "nan", "1e9"])
def test_bad_distances(text):
    with pytest.raises(InputError, match="--distances"):
        figure5.parse_distances(text)


def test_papers_numbers_are_consistent():
    """In each of the paper's rows MOTA falls with D; AB3DMOT's follow from their counts."""
    assert all(
        len(row) == len(TABLE5_COLUMNS)
        for half in TABLE5.values()
        for m in half.values()
        for row in m.values()
    )
    assert all(m[2.0][0] < m[0.0][0] for half in TABLE5.values() for m in half.values())
    for row in AB3DMOT.values():
        counts = dict(zip(AB3DMOT_COLUMNS, row, strict=True))
        errors = counts["FP"] + counts["FN"] + counts["IDS"]
        assert counts["MOTA"] == pytest.approx(1 - errors / 8379, abs=6e-5)
