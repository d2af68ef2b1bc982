"""The documents: tables are the files', links exist, commands have flags that scripts accept."""

import importlib
import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from helpers.documents import PYTHON, commands, documents
from helpers.small_weights import write_weights

from common import flags
from common.errors import InputError
from common.provenance import ROOT, provenance
from experiments import readme_tables
from experiments.readme_tables import TABLES, filled, record_line, summary
from kitti.scans.scan_files import write_scan
from tf_ops.bench import tables as bench

README = (ROOT / "README.md").read_text(encoding="utf-8")


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT))


EACH_DOCUMENT = pytest.mark.parametrize("path", documents(), ids=_name)


@pytest.mark.parametrize("path", readme_tables.documents(), ids=_name)
def test_tables_are_those_of_docs_tables(path):
    text = path.read_text(encoding="utf-8")
    assert filled(text, TABLES, path.name) == text


def test_every_document_with_a_table_is_filled():
    marked = {path for path in documents() if "<!-- table:" in path.read_text(encoding="utf-8")}
    marked.remove(bench.README)  # filled by tf_ops.bench
    assert marked and marked <= set(readme_tables.documents())


def test_a_table_is_put_in_and_its_title_left_out(tmp_path):
    (tmp_path / "a-b.md").write_text("# Title\n\n| x |\n|---|\n| 1 |\n\n## Part\n")
    text = (
        "before\n<!-- table: a-b -->\nold\n<!-- end -->\nafter <!-- table: none -->\n<!-- end -->"
    )
    expected = "before\n<!-- table: a-b -->\n| x |\n|---|\n| 1 |\n\n**Part**\n<!-- end -->\n"
    assert filled(text, tmp_path).startswith(expected)
    assert "Not measured yet; the command above makes it." in filled(text, tmp_path)
    with pytest.raises(InputError, match=r"README\.md: expected <!-- end -->"):
        filled("<!-- table: a -->\n", tmp_path)


def test_the_record_of_a_table_takes_the_place_of_its_command(tmp_path):
    made = {**provenance(), "time_utc": "2026-01-02T03:04:05+00:00", "command": "python -m x"}
    made |= {"git_commit": "0123456789abcdef+changes", "versions": {}}
    made["versions"] = {"python": "3.11.7", "tensorflow": "2.21.0"}
    made["machine"] = {"cpu_count": 2, "processor": "", "architecture": "x86_64"}
    line = (
        "*Measured 2026-01-02, commit 0123456 with uncommitted changes, 2 CPU cores (x86_64), "
        "Python 3.11.7, TensorFlow 2.21.0:* `python -m x`"
    )
    assert record_line(made) == line
    (tmp_path / "a.md").write_text("# A\n\nMade by `python -m x`.\n\nWords.\n\n`python -m x`\n")
    (tmp_path / "a.json").write_text(json.dumps({"run": made}))
    found = filled("<!-- table: a -->\n<!-- end -->", tmp_path)
    assert found == f"<!-- table: a -->\nWords.\n\n{line}\n<!-- end -->"


def _exam(ours: float | None, others: float | None) -> dict[str, list[dict[str, float | None]]]:
    mota = {"pointtracknet": ours, "sort": others, "deep_sort": others, "ab3dmot": 0.1}
    boxes = {f"MOTA@0.5, {name}": value for name, value in mota.items()}
    return {distance: [boxes, boxes] for distance in ("0.0", "2.0")}


def test_the_summary_names_the_trackers_that_are_ahead():
    text = summary(_exam(0.5, 0.25), _exam(0.5, 0.75))
    ours = next(line for line in text.splitlines() if line.startswith("| PointTrackNet"))
    assert re.findall(r"-?\d\.\d{3}", ours) == ["0.500", "0.000"] * 4 + ["0.738", "0.647"]
    assert text.endswith(
        "**PointTrackNet loses to** SORT 0.750, DEEP_SORT 0.750 (ours 0.500; real, D = 0 m); "
        "SORT 0.750, DEEP_SORT 0.750 (ours 0.500; real, D = 2 m).\n"
    )
    exam = _exam(0.5, 0.25)
    rules = {"kitti3d MOTA@0.5, pointtracknet": 0.3, "kitti3d MOTA@0.5, ab3dmot": 0.4}
    exam["0.0"] = [{**figures, **rules} for figures in exam["0.0"]]
    assert summary(_exam(0.5, 0.25), exam).endswith(
        "AB3DMOT 0.400 (ours 0.300; real, D = 0 m, by KITTI's rules `kitti3d`).\n"
    )
    assert "No baseline is ahead" in summary(_exam(0.5, 0.2), _exam(0.5, 0.3))
    assert "No baseline is ahead" in summary(_exam(0.5, 0.2), _exam(0.5, 0.5))
    undefined = summary(_exam(0.5, 0.2), _exam(None, None))  # no labelled vehicle
    assert "No baseline is ahead" in undefined and " - " in undefined


def test_a_table_that_is_not_there_stands_below_its_command():
    for path in documents():
        for section in path.read_text(encoding="utf-8").split("\n## "):
            command, found, _ = section.partition("Not measured yet; the command above")
            assert not found or "```sh" in command, section.splitlines()[0]


@EACH_DOCUMENT
def test_links_and_pictures_exist(path):
    links = re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8"))
    missing = []
    for link in links:
        if not link.startswith("http"):
            file, _, anchor = link.partition("#")
            target = path.parent / file if file else path
            if not target.exists() or (anchor and anchor not in _anchors(target)):
                missing.append(link)
    assert missing == []


def _anchors(path: Path) -> set[str]:
    """As GitHub makes them of the headings."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_readme_is_short_and_every_folder_of_code_has_its_line():
    assert len(README.splitlines()) <= 180
    rooms = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    assert {room for room in rooms if f"`{room}/`" not in README} == set()


def test_files_that_contributing_names_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`((?:\w+/)+\w+\.\w+)`", text))
    assert len(names) > 10
    assert {name for name in names if not (ROOT / name).is_file()} == set()


class _Parsed(Exception):  # noqa: N818
    """The flags were understood."""


@pytest.mark.parametrize("command", [c.text for c in commands() if c.is_python])
def test_scripts_take_the_commands_flags(command, monkeypatch):
    real = flags.ArgumentParser.parse_args

    def parse_and_stop(self, *args, **kwargs):
        real(self, *args, **kwargs)
        raise _Parsed

    monkeypatch.setattr(flags.ArgumentParser, "parse_args", parse_and_stop)
    words = shlex.split(command.removesuffix("&"))
    words = words[words.index(PYTHON) + 1 :]
    if words[0] == "-m":
        name, argv = words[1], words[2:]
        name = f"{name}.__main__" if name == "simulator" else name
    else:
        name, argv = words[0].removesuffix(".py"), words[1:]
    with pytest.raises(_Parsed):
        importlib.import_module(name).main(argv)


def test_make_targets_of_the_documents_exist():
    lines = [c.text for c in commands() if c.text.startswith("make")]
    targets = {word for line in lines for word in line.split()[1:] if "=" not in word}
    makefile = (ROOT / "Makefile").read_text()
    assert {"demo", "test"} <= targets and all(
        re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets
    )


@pytest.mark.slow
def test_the_library_example_runs(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(code.strip().splitlines()) <= 10
    write_weights(tmp_path / "weights")
    rng = np.random.default_rng(0)
    for t in range(2):
        points = rng.uniform((5, -5, -1.7, 0), (40, 5, 1, 1), (300, 4))
        write_scan(tmp_path / "DIR" / f"{t:06d}.bin", points)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert Path("DIR").is_dir()
