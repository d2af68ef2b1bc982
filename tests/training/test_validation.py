"""Figures of validation: those that nothing defines, and those of several data roots."""

from types import SimpleNamespace

import numpy as np
import tensorflow as tf

from common.notes import note
from training import validation
from training.command_line import note_best
from training.config import TrackerTrainingConfig
from training.logs import History
from training.run_state import keep_best
from training.tracker_task import TrackerTask


def validate(foreground) -> dict[str, float]:
    """Figures of one batch whose end-point errors are 0.5, 1.5, ... metres."""
    errors = np.arange(len(foreground), dtype=np.float32) + 0.5
    return TrackerTask.validate(None, [(None, None, (tf.constant(errors), foreground))])


def test_without_foreground_its_error_is_left_out():
    assert validate(tf.constant([0, 0])) == {"epe_background": 1.0}
    assert validate(tf.constant([0, 1, 1])) == {"epe_foreground": 2.0, "epe_background": 0.5}


def test_an_epoch_without_the_figure_does_not_select_a_network(tmp_path, capfd):
    """Neither before nor after the history was read again."""
    note.cache_clear()  # another training in this process may have printed it
    task = SimpleNamespace(
        best_metric="epe_foreground",
        best_is_largest=False,
        validation_samples=SimpleNamespace(items=[(0, 0)]),
        kind="tracker",
        config=TrackerTrainingConfig(),
        meta={},
    )
    run = SimpleNamespace(task=task, started={}, networks={})
    path, saved = tmp_path / "best.npz", []
    for step, error in enumerate([None, 0.4, None, 0.5, 0.3], 1):
        history = History(tmp_path / "history.csv", step)
        metrics = {"epoch": step, "step": step} | ({"epe_foreground": error} if error else {})
        history.add(metrics)
        keep_best(run, SimpleNamespace(best_path=path), history, metrics)
        saved.append(path.exists())
        path.unlink(missing_ok=True)
    assert saved == [True, True, False, False, True]  # at first the last network is kept
    assert "epe_foreground is undefined" in capfd.readouterr().err
    lines = (tmp_path / "history.csv").read_text().splitlines()
    assert lines[0] == "epoch,step,epe_foreground"
    assert lines[1:4] == ["1,1,nan", "2,2,0.4", "3,3,nan"]


def test_data_roots_of_one_name_have_a_column_each(monkeypatch):
    roots = ["a/val", "b/val", "c/other"]
    run = SimpleNamespace(task=SimpleNamespace(validation_samples=SimpleNamespace(roots=roots)))
    monkeypatch.setattr(validation, "_validate_items", lambda _, items: {"f1": float(items[0])})
    assert validation.validate(run) == {"f1": 1.0, "a/val/f1": 0, "b/val/f1": 1, "other/f1": 2}


def test_without_a_sample_there_is_a_note(capfd):
    note.cache_clear()
    data = SimpleNamespace(validation=["0011"])
    for items in ([(0, 1)], []):
        note_best(data, SimpleNamespace(validation_samples=SimpleNamespace(items=items)))
    line = "note: the validation sequences have no adjacent scans: there will be no best.npz"
    assert capfd.readouterr().err.splitlines() == [line]
