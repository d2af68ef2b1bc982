"""evaluate.py on one sequence."""

import json

import evaluate


def run(root, out, *argv) -> dict:
    """Sequence 0000; returns metrics.json."""
    arguments = ["--data_root", root, "--seqs", "0000", "--out", out, *argv]
    assert evaluate.main([str(value) for value in arguments]) is None
    return json.loads((out / "metrics.json").read_text())
