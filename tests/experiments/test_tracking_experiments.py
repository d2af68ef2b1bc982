"""Table 5, figure 5, the readings and AB3DMOT's table on a made-up folder; the paper's numbers."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from common.errors import InputError
from common.flags import run
from experiments import ab3dmot, figure5, table5
from experiments.paper import AB3DMOT, AB3DMOT_COLUMNS, TABLE5, TABLE5_COLUMNS
from experiments.runs import (
    TRACKER_NAMES,
    Run,
    add_shift_flags,
    make_parser,
    mean_and_spread,
    measure,
    over_seeds,
    shown,
)
from kitti.object_shift import LENGTHS
from studies import deep_sort_noise, displacement_readings
from tracking import FrameDetections
from tracking.deep_sort import DeepSortParameters, noise_of_scale


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


def test_classes_are_named_in_any_case_and_checked_at_once(tiny_root, tmp_path, capsys):
    parser = make_parser("")
    add_shift_flags(parser)
    argv = arguments(tiny_root, tmp_path / "out", "--classes", "car")
    args = parser.parse_args(argv)
    assert args.classes == parser.parse_args([*argv, "--classes", "Car"]).classes == ("Car",)
    args.weights, args.detections, args.baselines = None, "detections", ("sort",)
    assert [part.title for part in table5.parts_of(args)] == [
        "Ground-truth boxes of Car",
        "PointRCNN's boxes of Car, score of at least 2",
    ]
    trial, fields = deep_sort_noise.Trial(0.3, 0.0, 0), {"data_root": tiny_root, "seqs": (0,)}
    motas = [deep_sort_noise.measure(trial, {**fields, "classes": (c,)}) for c in ("car", "Car")]
    assert motas[0] == motas[1] > 0
    with pytest.raises(SystemExit):
        parser.parse_args([*argv, "--classes", "Car,Vam"])
    assert "--classes: expected among Car,Van" in capsys.readouterr().err


def test_label_boxes_of_a_run_are_of_its_classes_in_any_case(tiny_root, monkeypatch):
    class Motion:
        """The networks' outputs: no boxes, no motion."""

        def frames(self, scene):
            for t in scene.frames:
                yield FrameDetections(t, np.zeros((0, 7)), np.zeros(0))

    monkeypatch.setattr(Run, "cached", Motion())
    assert measure(Run(tiny_root, (0,), ("car",), "sort"))["TP"] > 0


def test_held_shifts_leave_a_tracker_as_it_was(tiny_root):
    def mota(**displaced):
        return measure(Run(tiny_root, (0,), ("Car",), "sort", **displaced))["MOTA"]

    assert mota(object_shift=2.0, hold=True) == mota()
    assert mota(object_shift=2.0) < mota()


def test_table5_has_parts_for_both_classes_beside_the_papers_rows(tiny_root, tmp_path):
    detections = ("--detections", tiny_root / "detections")
    table5.main(arguments(tiny_root, tmp_path, "--seeds", 2, *detections))
    text = (tmp_path / "table5.md").read_text()
    titles = re.findall(r"^## (.*)$", text, re.MULTILINE)
    assert titles == [
        "Ground-truth boxes of Car and Van",
        "Ground-truth boxes of Car",
        "PointRCNN's boxes of Car, score of at least 2",
    ]
    rows = [line for line in text.splitlines() if re.search(r", \d m ", line)]
    assert len(rows) == 3 * 2 * (6 + 3)  # parts, displacements, trackers and the paper's
    used = {row.split("|")[1].split(",")[0].strip(): row.split("|")[2].strip() for row in rows}
    assert used["Algorithm 1"] == "of the labels" and used["paper: PointTrackNet"] == "predicted"
    figures = json.loads((tmp_path / "table5.json").read_text())
    assert "versions" in figures["run"]
    configs = figures["run"]["configs"]
    assert [c["object_shift"] for c in configs] == [0.0, 2.0] * 3  # parts
    assert configs[-1]["min_box_score"] == table5.MIN_SCORE
    per_seed = {(f["tracker"], f["displacement"]): f["per_seed"] for f in figures["figures"]}
    assert len(per_seed["sort", 0.0]) == 1 and len(per_seed["sort_image", 2.0]) == 2
    assert per_seed["gt_displacement", 0.0][0]["IDS"] == 0


def test_table5_compares_the_trackers_that_are_named(tiny_root, tmp_path, monkeypatch, capsys):
    monkeypatch.delitem(TRACKER_NAMES, "sort")  # as of a tracker that is new in tracking/factory.py
    words = ("--seeds", 1, "--baselines", "sort,ab3dmot")
    table5.main(arguments(tiny_root, tmp_path, *words))
    figures = json.loads((tmp_path / "table5.json").read_text())["figures"]
    assert [f["tracker"] for f in figures[::2]] == ["sort", "ab3dmot", "gt_displacement"]
    assert "| sort, 0 m " in (tmp_path / "table5.md").read_text()
    with pytest.raises(SystemExit):
        table5.main(arguments(tiny_root, tmp_path, "--baselines", "sort,yours"))
    assert "found 'yours'" in capsys.readouterr().err


def test_readings_mark_the_default_and_choose_on_training_sequences(tiny_root, tmp_path):
    argv = arguments(tiny_root, tmp_path, "--seeds", 1, "--val_seqs", "0001")
    displacement_readings.main(argv)
    text = (tmp_path / "displacement_readings.md").read_text()
    assert "fresh in each frame *" in text and "held by an object" in text
    figures = json.loads((tmp_path / "displacement_readings.json").read_text())["figures"]
    assert len(figures["training"]) == 2 * len(LENGTHS) * len(displacement_readings.PAPER_NAMES)
    assert {f["per_seed"][0]["GT"] for f in figures["training"]} != {
        f["per_seed"][0]["GT"] for f in figures["validation"]
    }


def test_nearest_reading_is_that_of_sort_in_either_space():
    def row(mota):
        return [{"MOTA": mota}]

    measured = {
        ("uniform", False, "sort"): row(0.04),
        ("uniform", False, "sort_image"): row(0.35),
        ("per_axis_positive", False, "sort_image"): row(0.57),
        ("per_axis", False, "deep_sort"): row(0.601),
    }
    assert displacement_readings.nearest(measured) == ("per_axis_positive", False, "sort_image")


def test_deep_sort_noise_default_is_a_scale_of_the_study(tiny_root, tmp_path):
    argv = arguments(tiny_root, tmp_path, "--seeds", 2, "--classes", "Car")
    deep_sort_noise.main(argv)
    assert (tmp_path / "deep_sort_noise.md").read_text().count(" m * ") == 1
    chosen = DeepSortParameters().noise
    assert chosen == noise_of_scale(chosen.process_box)
    assert chosen.process_box in deep_sort_noise.SCALES


def test_figure5_writes_curve_and_picture(tiny_root, tmp_path):
    more = ("--seeds", 1, "--distances", "0,2")
    figure5.main(arguments(tiny_root, tmp_path, *more))
    lines = (tmp_path / "figure5.csv").read_text().splitlines()
    assert lines[0] + "\n" == figure5.HEADER and len(lines) == 1 + 4 * 2
    assert lines[-1] == "gt,gt_displacement,2,1,1.000000,0.000000"  # drawn last
    assert (tmp_path / "figure5.png").read_bytes().startswith(b"\x89PNG")
    figures = json.loads((tmp_path / "figure5.json").read_text())["figures"]
    assert len(figures) == len(lines) - 1


def test_without_a_labelled_vehicle_mota_is_a_dash(tiny_root, tmp_path, capsys):
    argv = arguments(tiny_root, tmp_path, "--seqs", "0001", "--seeds", 1)
    figure5.main([*argv, "--distances", "0"])
    lines = (tmp_path / "figure5.csv").read_text().splitlines()
    assert lines[1:] and all(line.endswith(",0,1,-,0.000000") for line in lines[1:])
    assert (tmp_path / "figure5.png").is_file()
    deep_sort_noise.main(argv)
    assert "*" not in (tmp_path / "deep_sort_noise.md").read_text().split("\n\n", 3)[3]
    with pytest.raises(InputError, match="expected labelled boxes of --classes"):
        displacement_readings.nearest({("uniform", False, "sort"): [{"MOTA": None}]})


def test_the_upper_bound_is_drawn_dashed_over_the_curves_under_it():
    axis = Figure().subplots()
    curve = [(0.0, 1, 0.5, 0.0), (1.0, 1, None, 0.0), (2.0, 1, 0.25, 0.0)]
    for tracker in ("pointtracknet", "gt_displacement"):
        figure5._curve(axis, tracker, curve)
    assert [line.get_linestyle() for line in axis.lines] == ["-", "--"]
    assert axis.lines[0].get_xdata().tolist() == [0.0, 2.0]  # without the undefined one


def test_ab3dmot_table_stands_beside_the_published_rows(tiny_root, tmp_path):
    more = ("--detections", tiny_root / "detections")
    ab3dmot.main(arguments(tiny_root, tmp_path, *more))
    text = (tmp_path / "ab3dmot.md").read_text()
    assert "no poses/" in text and "0.8647" in text
    assert text.count("| published, ") == 4


@pytest.mark.parametrize("text", ["", "a", "0,,1", "-1", "nan", "1e9"])
def test_bad_distances(tiny_root, tmp_path, text, capsys):
    argv = arguments(tiny_root, tmp_path / "out", "--distances", text)
    with pytest.raises(SystemExit) as stopped:
        raise SystemExit(run(figure5.main, argv))
    assert stopped.value.code == 2
    assert re.search("--distances|--object_shift", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


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
