"""Steps are done once for a key, again when key or output is gone, never when they failed."""

import pytest

from common.steps import Steps, key_of


def test_a_step_is_done_once_for_each_key(tmp_path):
    output, calls = tmp_path / "out.txt", []

    def make():
        calls.append(1)
        output.write_text("x")

    run = Steps(tmp_path).run
    assert run("a", "1", [output], make) and not run("a", "1", [output], make)
    assert not Steps(tmp_path).run("a", "1", [output], make)  # remembered on disk
    assert run("a", "2", [output], make) and run("b", "2", [output], make)
    output.unlink()
    assert run("a", "2", [output], make)
    assert len(calls) == 4


def test_a_failed_step_is_not_done(tmp_path):
    steps = Steps(tmp_path)

    def fail():
        raise RuntimeError("no")

    with pytest.raises(RuntimeError):
        steps.run("a", "1", [], fail)
    assert steps.run("a", "1", [], lambda: None)


def test_an_interrupted_step_is_not_done_under_its_former_key(tmp_path):
    """It may have replaced a part of the outputs."""
    steps, output = Steps(tmp_path), tmp_path / "out.txt"

    def interrupted():
        output.write_text("half of 2")
        raise KeyboardInterrupt

    steps.run("a", "1", [output], lambda: output.write_text("1"))
    with pytest.raises(KeyboardInterrupt):
        steps.run("a", "2", [output], interrupted)
    assert steps.run("a", "1", [output], lambda: output.write_text("1"))


def test_a_spoilt_memory_counts_as_none(tmp_path):
    (tmp_path / "steps.json").write_text("{")
    assert Steps(tmp_path).run("a", "1", [], lambda: None)


def test_key_depends_on_values_and_code():
    keys = {
        key_of(1),
        key_of(2),
        key_of(1, modules=["common.errors"]),
        key_of(1, modules=["kitti.iou"]),
    }
    assert len(keys) == 4 and key_of(1, "a") == key_of(1, "a")
