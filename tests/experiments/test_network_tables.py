"""Tables V and VI and Figure 5 with the rows that need the networks: they run once for all."""

import json

import pytest
from helpers import two_cars
from helpers.small_weights import write_weights

from evaluation.network_cache import CachedPredictions
from experiments import figure5, table5, table6
from models.config import DecodingConfig


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Sequence 0000 with three frames, and small weights beside it."""
    folder = tmp_path_factory.mktemp("network_tables")
    two_cars.write_sequence(folder, 0, frames=3)
    write_weights(folder / "weights")
    return folder


@pytest.mark.slow
def test_networks_run_once(root, tmp_path):
    common = ["--data_root", root, "--seqs", "0000", "--out", tmp_path / "tables"]
    common += ["--weights", root / "weights", "--network_cache", tmp_path / "cache"]
    words = [str(word) for word in common]
    table5.main([*words, "--seeds", "2"])
    files = sorted((tmp_path / "cache").iterdir())
    assert len(files) == 3  # without a shift, and one for each seed
    before = [path.stat().st_mtime_ns for path in files]
    figure5.main([*words, "--seeds", "2", "--distances", "0,2"])
    table6.main(words)
    assert [path.stat().st_mtime_ns for path in sorted((tmp_path / "cache").iterdir())] == before

    def read(name):
        return json.loads((tmp_path / "tables" / f"{name}.json").read_text())["figures"]

    rows = {(f["boxes"], f["tracker"], f["displacement"]): f["per_seed"] for f in read("table5")}
    true, found = "Ground-truth boxes of Car and Van", "The detector's boxes, Car and Van"
    assert {key[0] for key in rows} == {true, found}
    assert rows[true, "pointtracknet_no_probation", 2.0][0]["FN"] == 0
    assert len(rows[found, "sort", 2.0]) == 2
    curves = {(f["boxes"], f["tracker"], f["displacement"]): f["per_seed"] for f in read("figure5")}
    assert curves["gt", "pointtracknet", 2] == rows[true, "pointtracknet", 2.0]
    assert curves["network", "ab3dmot", 0] == rows[found, "ab3dmot", 0.0]
    assert [f["tracker"] for f in read("table6")] == list(table6.SIDE_BY_SIDE)
    for name in ("table5", "table6", "figure5"):
        run = json.loads((tmp_path / "tables" / f"{name}.json").read_text())["run"]
        assert set(run["weights_sha256"]) == {"detector.npz", "tracker.npz"}
        assert [part["sequences"] for part in run["data"]] == [{"0000": 3}]
        found = [c for c in run["configs"] if c["detections"] == "network"]
        assert found and all(c["min_box_score"] == DecodingConfig().min_score for c in found)
    text = (tmp_path / "tables" / "table6.md").read_text()
    assert "paper: PointTrackNet, test server" in text and "0.6823" not in text.split("paper")[0]


def test_table6_needs_weights(root, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        table6.main(["--data_root", str(root), "--seqs", "0000", "--out", str(tmp_path)])
    assert stopped.value.code == 2 and "--weights" in capsys.readouterr().err


def test_a_run_reads_the_cache_of_its_weights(root, tmp_path):
    networks = {"weights": root / "weights", "network_cache": tmp_path}
    run = table6.Run(root, (0,), ("Car",), "sort", detections="network", **networks)
    assert run.config.needs_network and isinstance(run.cached, CachedPredictions)
    assert table6.Run(root, (0,), ("Car",), "sort").cached is None
