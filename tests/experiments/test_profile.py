"""The profile by block from end to end on small networks."""

import json

import pytest
from helpers.small_weights import write_weights

from common import flags
from experiments import profile


@pytest.mark.slow
def test_profile_of_small_networks(tmp_path, capsys):
    weights = str(write_weights(tmp_path / "weights"))
    argv = ["--repeats", "1", "--batch", "1", "--weights", weights, "--out", str(tmp_path)]
    assert flags.run(profile.main, argv) == 0
    parts = json.loads((tmp_path / "profile.json").read_text())["figures"]["parts"]
    stream = parts["streamed frame"]
    wanted = {"read the scan", "SA1", "FP4", "decoding", "encode", "association", "refinement"}
    assert wanted | {"matching, Algorithm 1"} <= stream.keys()
    assert all(block["seconds"] > 0 for block in stream.values())
    training = parts["detector's training step, per frame of 1"]
    assert training["FP4"]["flops"] == pytest.approx(3 * stream["FP4"]["flops"])
    steps = parts["a whole training step of 1"]
    assert steps["detector, a frame"]["flops"] == pytest.approx(
        sum(block["flops"] for block in training.values())
    )
    assert steps["tracker, a pair"]["seconds"] > 0
    assert "| association " in capsys.readouterr().out
