"""The README: its tables are the files', its links exist, its commands are what scripts take."""

import importlib
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from small_weights import write_weights

from common import flags
from common.errors import InputError
from common.provenance import ROOT
from experiments.readme_tables import filled
from kitti.scans import write_scan

README = (ROOT / "README.md").read_text(encoding="utf-8")
PYTHON = ".venv/bin/python"


def _commands() -> list[str]:
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line.strip()]


def test_tables_are_those_of_docs_tables():
    assert filled(README, ROOT / "docs" / "tables") == README


def test_a_table_is_put_in_and_its_title_left_out(tmp_path):
    (tmp_path / "a-b.md").write_text("# Title\n\n| x |\n|---|\n| 1 |\n\n## Part\n")
    text = (
        "before\n<!-- table: a-b -->\nold\n<!-- end -->\nafter <!-- table: none -->\n<!-- end -->"
    )
    expected = "before\n<!-- table: a-b -->\n| x |\n|---|\n| 1 |\n\n**Part**\n<!-- end -->\n"
    assert filled(text, tmp_path).startswith(expected)
    assert "No figures here yet: `python -m experiments.none` measures them." in filled(
        text, tmp_path
    )
    with pytest.raises(InputError, match="expected <!-- end -->"):
        filled("<!-- table: a -->\n", tmp_path)


def test_a_table_that_is_not_there_names_an_experiment():
    for name in re.findall(r"No figures here yet: `python -m experiments\.(\w+)`", README):
        assert (ROOT / "experiments" / f"{name}.py").is_file()


def test_links_and_pictures_exist():
    links = re.findall(r"\]\(([^)#\s]+)\)", README)
    missing = [link for link in links if not link.startswith("http") and not (ROOT / link).exists()]
    assert len(links) > 10 and missing == []


def test_every_folder_of_code_has_its_line():
    rooms = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert {room for room in rooms if f"`{room}/`" not in README} == set()


class _Parsed(Exception):  # noqa: N818
    """The flags were understood."""


@pytest.mark.parametrize("command", [c for c in _commands() if PYTHON in c])
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


def test_make_targets_of_the_readme_exist():
    targets = {word for c in _commands() if c.startswith("make") for word in c.split()[1:]}
    makefile = (ROOT / "Makefile").read_text()
    assert targets and all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets)


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
