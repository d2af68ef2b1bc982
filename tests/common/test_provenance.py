"""Provenance: JSON-ready, with everything needed to reproduce a result."""

import json
import platform
import subprocess
from importlib.machinery import ModuleSpec

import pytest

from common import provenance


def test_record_is_json_ready_and_complete(monkeypatch):
    monkeypatch.setattr("__main__.__spec__", None)
    monkeypatch.setattr("sys.argv", ["/somewhere/evaluate.py", "--out", "a b"])
    record = provenance.provenance(seed=3, config={"iou": 0.5})
    assert record["command"] == "evaluate.py --out 'a b'"
    assert (record["seed"], record["config"]) == (3, {"iou": 0.5})
    assert {"python", "numpy", "shapely"} <= set(record["versions"])
    assert record["machine"]["cpu_count"] >= 1
    json.dumps(record, allow_nan=False)


@pytest.mark.parametrize("module", ["experiments.table2", "tf_ops.bench.__main__"])
def test_command_of_a_module_names_it_as_python_does(monkeypatch, module):
    monkeypatch.setattr("__main__.__spec__", ModuleSpec(module, None))
    monkeypatch.setattr("sys.argv", ["/somewhere/x.py", "--seqs", "0000"])
    name = module.removesuffix(".__main__")
    assert provenance.command() == f"python -m {name} --seqs 0000"


def test_without_git_the_commit_is_none(monkeypatch):
    def fail(*args, **kwargs):
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "run", fail)
    assert provenance.git_commit() is None


def test_commit_marks_changes(monkeypatch):
    answers = {"--show-cdup": "\n", "HEAD": "abc123\n", "-uno": " M file\n"}

    def run(command, **kwargs):
        return subprocess.CompletedProcess(command, 0, stdout=answers[command[-1]])

    monkeypatch.setattr(subprocess, "run", run)
    assert provenance.git_commit() == "abc123+changes"
    answers["-uno"] = ""
    assert provenance.git_commit() == "abc123"
    answers["--show-cdup"] = "../\n"  # a copy inside the repository of another project
    assert provenance.git_commit() is None


def test_processor_is_named(tmp_path):
    info = tmp_path / "cpuinfo"
    info.write_text("processor\t: 0\nmodel name\t: EPYC: 9\nprocessor\t: 1\nmodel name\t: B\n")
    assert provenance.processor(info) == "EPYC: 9"
    assert provenance.processor(tmp_path / "none") == platform.processor()
