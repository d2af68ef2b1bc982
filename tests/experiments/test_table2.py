"""Table II from end to end on small networks, two settings of N and N'."""

import json
import os

import pytest
from helpers.small_weights import write_weights

from common import flags
from experiments import table2
from experiments.timing import pipeline_rates


def test_cores_are_doubled_and_all_threads_limited():
    assert [pipeline_rates.doubled(n) for n in (1, 2, 3, 16)] == [
        [1],
        [1, 2],
        [1, 2, 3],
        [1, 2, 4, 8, 16],
    ]
    everything = os.sched_getaffinity(0)
    with pipeline_rates.limited_to(1):
        for thread in os.listdir("/proc/self/task"):
            assert len(os.sched_getaffinity(int(thread))) == 1
    assert os.sched_getaffinity(0) == everything


@pytest.mark.slow
def test_table_2_of_small_networks(tmp_path, monkeypatch, capsys):
    weights = write_weights(tmp_path / "weights")
    monkeypatch.setattr(table2, "ALL_POINTS", (128, 48))
    monkeypatch.setattr(table2, "PAPER", {(64, 32): 0.25})
    monkeypatch.setattr(pipeline_rates, "START_SECONDS", 0.0)
    monkeypatch.setattr(pipeline_rates, "TIMED_SECONDS", 0.2)
    monkeypatch.setattr(pipeline_rates, "doubled", lambda last: [1])
    assert (
        flags.run(
            table2.main, ["--repeats", "1", "--weights", str(weights), "--out", str(tmp_path)]
        )
        == 0
    )
    record = json.loads((tmp_path / "table2.json").read_text())["figures"]
    assert [(row["N"], row["N'"]) for row in record["stream"]] == [(128, 48), (64, 32)]
    assert all(row["seconds"] > 0 for row in record["stream"])
    wanted = {"ours forward", "plain forward and backward"}
    wanted |= {"step of training, input pipeline included"}
    wanted |= {"import to first boxes of pointtracknet.Tracker (s)"}
    assert wanted <= record["detector"].keys()
    rates = record["samples a second out of the input pipeline"]
    assert [(row["cores"], row["workers"]) for row in rates] == [(1, 0), (1, 1)]
    assert min(row["detector samples"] for row in rates) > 0
    assert min(row["tracker pairs"] for row in rates) > 0
    text = (tmp_path / "table2.md").read_text()
    tables = text.split("\n\n", 2)[2]
    assert tables in capsys.readouterr().out
    words = " ".join(tables.split())
    assert "| 128 | 48 |" in words and "| 0.250 |" in words and "| - |" in words
