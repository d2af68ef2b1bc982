"""Flags of the trainings: values without effect are refused."""

import pytest

import train_det
import train_track
from common.flags import run

BASE = ["--data_root", "x", "--workdir", "y"]


@pytest.mark.parametrize(
    ("main", "words", "message"),
    [
        (train_det, "--augmentation.single_scan_pairs true", "expected False"),
        (train_det, "--augmentation.hidden_vehicles 0.1", "effect on the detector, expected 0.0"),
        (
            train_track,
            "--augmentation.pasted_objects 4",
            "has no effect on the tracker, expected 0",
        ),
        (
            train_track,
            "--tracker.fusion_keeps_features false --tracker.fusion concat",
            "has no effect with --tracker.fusion concat, expected true",
        ),
        (
            train_track,
            "--tracker.fusion_keeps_features false --tracker.fusion none",
            "has no effect with --tracker.fusion none, expected true",
        ),
    ],
    ids=str,
)
def test_values_without_effect_are_refused(main, words, message, capsys):
    words = words.split()
    detector = ["--detector", "z"] if main is train_track else []
    assert run(main.main, [*BASE, *detector, *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"{words[0]}: " in error and message in error
    assert run(main.main, [*BASE, *detector, *words, "--resume"]) == 2  # of an older training
    assert "nothing to resume here" in capsys.readouterr().err
