"""Flags of a dataclass and a file of the same settings: defaults, priority, errors."""

import dataclasses
import json
from pathlib import Path

import pytest

from common.config import to_dict
from common.config_flags import add_flags, from_flags, option
from common.errors import InputError
from common.flags import ArgumentParser, positive_int


@dataclasses.dataclass(frozen=True)
class _Layer:
    width: int = option(8, "channels", least=1)
    radii: tuple[float, ...] = (1.0, 2.0)


@dataclasses.dataclass(frozen=True)
class _Config:
    root: Path = option(dataclasses.MISSING, "folder")
    layer: _Layer = dataclasses.field(default_factory=_Layer)
    count: int = option(1, "of them", positive_int, ("number", "n"))
    threshold: float | str | None = option(None, "a number or best")


def read(*argv: str, config=_Config):
    parser = ArgumentParser(prog="tool")
    add_flags(parser, config)
    return from_flags(config, parser.parse_args(argv))


def test_defaults_flags_and_their_aliases():
    assert read("--root", "x") == _Config(Path("x"))
    found = read("--root", "x", "--layer.radii", "[3]", "--n", "4", "--layer.width", "2")
    assert found == _Config(Path("x"), _Layer(2, (3.0,)), 4)
    assert read("--layer.width", "3", config=_Config(Path("y"))) == _Config(Path("y"), _Layer(3))


@pytest.mark.parametrize("wrapped", [True, False])
def test_a_written_config_is_read_and_flags_override_it(tmp_path, wrapped):
    config = _Config(Path("x"), _Layer(2), 4, "best")
    values = to_dict(config)
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"config": values, "command": "tool"} if wrapped else values))
    assert read("--config", str(path)) == config
    found = read("--config", str(path), "--layer.width", "5", "--number", "6")
    assert found == _Config(Path("x"), _Layer(5), 6, "best")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "config.json: expected JSON"),
        ("[]", "config.json: --: expected an object"),
        ('{"root": "x", "roof": 1}', r"unknown field 'roof', expected among "),
        ('{"root": "x", "layer": {"width": 0}}', "--layer.width: expected 1 to"),
        ('{"root": "x", "layer": 3}', "--layer: expected an object"),
        ('{"root": 3}', "--root: expected Path, found 3"),
        ("{}", "--root: required"),
    ],
)
def test_a_bad_file_is_named(tmp_path, text, message):
    (tmp_path / "config.json").write_text(text)
    with pytest.raises(InputError, match=message):
        read("--config", str(tmp_path / "config.json"))


def test_an_empty_path_is_not_the_working_directory(tmp_path, capsys):
    with pytest.raises(SystemExit):
        read("--root", "")
    assert "--root: expected a value, found ''" in capsys.readouterr().err
    (tmp_path / "config.json").write_text('{"root": ""}')
    with pytest.raises(InputError, match="--root: expected Path, found ''"):
        read("--config", str(tmp_path / "config.json"))


def test_missing_file_and_missing_flag():
    with pytest.raises(InputError, match=r"nowhere\.json: cannot be read"):
        read("--config", "nowhere.json")
    with pytest.raises(InputError, match="--root: required"):
        read()


def test_help_shows_defaults(capsys):
    with pytest.raises(SystemExit):
        read("--help")
    text = " ".join(capsys.readouterr().out.split())
    assert "channels (default: 8)" in text and "folder (required)" in text
    assert "--number INT, --n INT" in text
