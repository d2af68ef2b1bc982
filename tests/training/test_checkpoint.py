"""Checkpoints: complete or absent, checked before anything is assigned."""

import pickle

import keras
import numpy as np
import pytest

from common.errors import InputError
from models import checkpoint
from training.checkpoint_folder import CheckpointFolder
from training.learning_rate import CyclicalLearningRate
from training.logs import History

META = {"kind": "detector", "config": {"a": 1}, "step": 3}


def variables(seed=0):
    rng = np.random.default_rng(seed)
    shapes = [("kernel", (3, 4)), ("bias", (4,))]
    return {n: keras.Variable(rng.normal(size=s).astype("f4"), name=n) for n, s in shapes}


def test_round_trip(tmp_path):
    path, old, new = tmp_path / "a.npz", variables(0), variables(1)
    checkpoint.save(path, META, model=old)
    meta, arrays = checkpoint.load(path)
    assert {k: meta[k] for k in META} == META
    checkpoint.restore(path, arrays, model=new)
    assert checkpoint.content_hash(old) == checkpoint.content_hash(new)
    assert checkpoint.content_hash(variables(1)) != checkpoint.content_hash(new)


@pytest.mark.parametrize("damage", ["empty", "truncated", "flipped", "text", "foreign", "folder"])
def test_broken_files_are_named(tmp_path, damage):
    path = tmp_path / "a.npz"
    checkpoint.save(path, META, model=variables())
    data = path.read_bytes()
    if damage == "folder":
        path.unlink()
        path.mkdir()
    elif damage == "foreign":
        np.savez(path, x=np.zeros(3))
    else:
        middle = len(data) // 2
        path.write_bytes(
            {
                "empty": b"",
                "truncated": data[:middle],
                "text": b"hello",
                "flipped": data[:200] + bytes([data[200] ^ 255]) + data[201:],
            }[damage]
        )
    with pytest.raises(InputError, match=r"a\.npz"):
        checkpoint.load(path)


def test_nothing_in_a_file_is_executed(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("executed",))

    path = tmp_path / "a.npz"
    np.savez(path, meta=np.array([Bomb()], dtype=object))
    with pytest.raises(InputError, match="not a whole checkpoint"):
        checkpoint.load(path)
    path.write_bytes(pickle.dumps({"meta": 1}))
    with pytest.raises(InputError, match="not a whole checkpoint"):
        checkpoint.load(path)


def test_other_shapes_are_refused_and_nothing_is_assigned(tmp_path):
    path = tmp_path / "a.npz"
    checkpoint.save(path, META, model=variables(0))
    _, arrays = checkpoint.load(path)
    others = {**variables(1), "bias": keras.Variable(np.zeros(5, "f4"), name="bias")}
    before = np.asarray(others["kernel"].value)
    message = r"model/bias: expected numbers of shape \(5,\), found float32 of shape \(4,\)"
    with pytest.raises(InputError, match=message):
        checkpoint.restore(path, arrays, model=others)
    np.testing.assert_array_equal(others["kernel"].value, before)
    renamed = {"kernel": others["kernel"], "offset": variables(1)["bias"]}
    with pytest.raises(InputError, match="model/offset missing, model/bias unknown"):
        checkpoint.restore(path, arrays, model=renamed)
    np.testing.assert_array_equal(others["kernel"].value, before)


def test_values_that_are_not_finite_are_refused(tmp_path):
    bad = variables()
    bad["bias"].assign([1, 2, np.inf, 4])
    checkpoint.save(tmp_path / "a.npz", META, model=bad)
    _, arrays = checkpoint.load(tmp_path / "a.npz")
    with pytest.raises(InputError, match="finite"):
        checkpoint.restore(tmp_path / "a.npz", arrays, model=variables())


def test_values_beyond_the_variables_type_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    checkpoint.save(path, META, model=variables())
    _, arrays = checkpoint.load(path)
    arrays["model/bias"] = arrays["model/bias"].astype("f8") * 1e300
    with pytest.raises(InputError, match="model/bias: expected finite values of float32"):
        checkpoint.restore(path, arrays, model=variables())


def test_the_last_few_epochs_are_kept(tmp_path):
    """Of ten steps each; a checkpoint within an epoch stays until the next one is there."""
    folder = CheckpointFolder(tmp_path, keep=2, steps_per_epoch=10)
    kept = []
    for step in (5, 10, 20, 24, 27, 30, 35):
        folder.save(step, META, model=variables())
        kept.append(folder.steps())
    assert kept[:4] == [[5], [10], [10, 20], [10, 20, 24]]
    assert kept[4:] == [[10, 20, 27], [20, 30], [20, 30, 35]]
    assert checkpoint.load(folder.path(30))[0]["step"] == 30


def test_a_failed_save_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.npz"
    checkpoint.save(path, META, model=variables())
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        checkpoint.save(path, {**META, "x": float("nan")}, model=variables(1))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]


def test_cyclical_learning_rate_by_hand():
    rate = CyclicalLearningRate(1e-4, 1e-3, cycle_steps=8)
    found = [float(rate(step)) for step in (0, 2, 4, 6, 8, 12)]
    assert found == pytest.approx([1e-4, 5.5e-4, 1e-3, 5.5e-4, 1e-4, 1e-3])


def test_history_drops_rows_after_the_checkpoint(tmp_path):
    history = History(tmp_path / "history.csv")
    for epoch in (1, 2, 3):
        history.add({"epoch": epoch, "step": 10 * epoch, "loss": 1.0 / epoch})
    again = History(tmp_path / "history.csv", last_step=20)
    assert [row["epoch"] for row in again.rows] == [1, 2]
    again.plot(tmp_path / "curves.png")
    assert (tmp_path / "curves.png").stat().st_size > 1000


def test_a_history_that_is_none(tmp_path):
    (tmp_path / "history.csv").write_text("epoch,step\none,two\n")
    with pytest.raises(InputError, match="not a training history"):
        History(tmp_path / "history.csv", 5)


@pytest.mark.parametrize("columns", ["epoch,loss", "step,loss"])
def test_a_history_without_its_counts(tmp_path, columns):
    (tmp_path / "history.csv").write_text(f"{columns}\n1,2\n")
    with pytest.raises(InputError, match=r"history\.csv:1: expected columns epoch and step"):
        History(tmp_path / "history.csv", 5)
    (tmp_path / "history.csv").write_text("epoch,step\n1,nan\n")
    with pytest.raises(InputError, match="expected whole numbers"):
        History(tmp_path / "history.csv", 5)


def test_a_long_training_keeps_its_history(tmp_path):
    """A step of seven digits in six would lie after the checkpoint."""
    History(tmp_path / "history.csv").add({"epoch": 7, "step": 1234567, "loss": 0.1234567})
    again = History(tmp_path / "history.csv", last_step=1234567)
    assert again.rows == [{"epoch": 7, "step": 1234567, "loss": 0.123457}]
    again.add({"epoch": 8, "step": 1234568})
    lines = (tmp_path / "history.csv").read_text().splitlines()
    assert lines == ["epoch,step,loss", "7,1234567,0.123457", "8,1234568,nan"]


def test_a_save_removes_what_killed_ones_left(tmp_path):
    for name in (".step-00000003-abcdefgh.npz", ".best-12345678.npz", ".other-12345678.npz"):
        (tmp_path / name).touch()
    (tmp_path / "best.npz").touch()
    CheckpointFolder(tmp_path).save(4, META, model=variables())
    left = {".other-12345678.npz", "best.npz", "step-00000004.npz"}
    assert {path.name for path in tmp_path.iterdir()} == left
