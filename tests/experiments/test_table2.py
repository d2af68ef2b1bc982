"""Table II from end to end on small networks, two settings of N and N'."""

import json

import pytest
from network_cases import SMALL_DETECTOR, SMALL_TRACKER

from common import flags
from experiments import table2


@pytest.mark.slow
def test_table_2_of_small_networks(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("models.config.DetectorConfig", lambda: SMALL_DETECTOR)
    monkeypatch.setattr("models.config.TrackerConfig", lambda: SMALL_TRACKER)
    monkeypatch.setattr(table2, "PAPER", {(128, 48): 0.5, (64, 32): 0.25})
    assert flags.run(table2.main, ["--repeats", "1", "--out", str(tmp_path)]) == 0
    record = json.loads((tmp_path / "table2.json").read_text())
    assert [(row["N"], row["N'"]) for row in record["stream"]] == [(128, 48), (64, 32)]
    assert all(row["seconds"] > 0 for row in record["stream"])
    assert {"ours forward", "plain forward and backward"} <= record["detector"].keys()
    text = (tmp_path / "table2.md").read_text()
    assert "| 128 | 48 |" in text and "| 0.250 |" in text
    assert text in capsys.readouterr().out
