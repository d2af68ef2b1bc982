"""Table II from end to end on small networks, two settings of N and N'."""

import json

import pytest
from small_weights import write_weights

from common import flags
from experiments import table2


@pytest.mark.slow
def test_table_2_of_small_networks(tmp_path, monkeypatch, capsys):
    weights = write_weights(tmp_path / "weights")
    monkeypatch.setattr(table2, "PAPER", {(128, 48): 0.5, (64, 32): 0.25})
    assert (
        flags.run(
            table2.main, ["--repeats", "1", "--weights", str(weights), "--out", str(tmp_path)]
        )
        == 0
    )
    record = json.loads((tmp_path / "table2.json").read_text())
    assert [(row["N"], row["N'"]) for row in record["stream"]] == [(128, 48), (64, 32)]
    assert all(row["seconds"] > 0 for row in record["stream"])
    wanted = {"ours forward", "plain forward and backward"}
    wanted |= {"step of training, input pipeline included"}
    assert wanted <= record["detector"].keys()
    text = (tmp_path / "table2.md").read_text()
    assert "| 128 | 48 |" in text and "| 0.250 |" in text
    assert text in capsys.readouterr().out
