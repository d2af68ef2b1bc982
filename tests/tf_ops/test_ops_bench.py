"""The benchmark: tables made from its files, the choice of the best peer, the length of curves."""

import json
import time

import numpy as np
import pytest

from tf_ops.bench import tables


def report(**row):
    provenance = {"processor": "CPU", "threads": 2, "calls": 21, "scan": "a scan"}
    return {"rows": [row], "provenance": provenance | {"time_utc": "now", "git_commit": "abc"}}


def test_the_readme_has_the_tables_of_the_files():
    text = tables.README.read_text(encoding="utf-8")
    assert {match[2] for match in tables.PLACE.finditer(text)} == set(tables.TABLES)
    assert tables.filled(text) == text


def test_a_table_is_put_between_its_marks(tmp_path):
    row = report(case="op", batch=8, ours_ms=1.0, peer="p", peer_ms=3.0, ratio=1 / 3, goal=0.5)
    (tmp_path / "bench.json").write_text(json.dumps(row))
    text = tables.filled("a\n<!-- table: bench -->\nold\n<!-- end -->\nb\n", tmp_path)
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    assert ["op", "8", "1.00", "p", "3.00", "0.33", "0.5"] in cells and "old" not in text
    assert "CPU, 2 threads each, medians of 21 alternating calls" in text
    assert "now to now, commit abc" in text
    assert text.startswith("a\n") and text.endswith("<!-- end -->\nb\n")


def test_builds_side_by_side():
    row = report(case="op", batch=1, portable_ms=2.0, native_ms=1.5, ratio=0.75)
    lines = tables.builds_table(row).splitlines()
    cells = [cell.strip() for cell in lines[2].split("|")[1:-1]]
    assert cells == ["op", "1", "2.00", "1.50", "0.75"]


def test_ours_is_compared_with_the_best_peer():
    pytest.importorskip("fpsample", reason="requirements-bench.txt is not installed")
    from tf_ops.bench import cases, timing

    peers = {"slow": lambda: time.sleep(0.03), "fast": lambda: time.sleep(0.01)}
    row = timing.measure(cases.Case("op", 1, lambda: time.sleep(0.001), peers, 0.5), calls=5)
    assert row["peer"] == "fast" and set(row["probes_ms"]) == set(peers)
    assert row["ratio"] == row["ours_ms"] / row["peer_ms"] < 1
    assert row["ours_ms"] >= 1 and row["peer_ms"] >= 10


def test_a_curve_ends_where_it_takes_too_long(monkeypatch):
    pytest.importorskip("fpsample", reason="requirements-bench.txt is not installed")
    from tf_ops.bench import growth

    monkeypatch.setattr(growth, "LIMIT_MS", 5.0)
    clouds = [np.zeros((size, 3), np.float32) for size in (1, 12, 15, 20)]
    times = growth.curve(lambda xyz: lambda: time.sleep(1e-3 * len(xyz)), clouds)
    assert len(times) == 3 and times[0] < 5 < times[1]
