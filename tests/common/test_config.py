"""Configurations as dictionaries: round trip and errors."""

import dataclasses
from pathlib import Path

import pytest

from common.config import from_dict, parse_json, to_dict
from common.errors import InputError
from models.config import DetectorConfig


@dataclasses.dataclass(frozen=True)
class _Layer:
    width: int
    radii: tuple[float, ...] = (1.0, 2.0)


@dataclasses.dataclass(frozen=True)
class _Config:
    layer: _Layer = dataclasses.field(default_factory=lambda: _Layer(8))
    frozen: bool = False
    name: Path | str | None = None
    rates: tuple[float, ...] = dataclasses.field(default=(0.5,), metadata={"least": 0, "most": 1})


def test_there_and_back():
    config = _Config(_Layer(4, (0.5,)), True)
    assert from_dict(_Config, to_dict(config)) == config


def test_a_record_older_than_a_field_has_its_default():
    assert from_dict(_Config, {"layer": {"width": 4}}) == _Config(_Layer(4))
    assert from_dict(_Config, {}) == _Config()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"layer": {}}, "missing fields width"),
        ({"layr": {}}, r"unknown field 'layr', expected among "),
        ({"layer": {"width": "4"}}, "width: expected int, found '4'"),
        ({"frozen": 1}, "frozen: expected bool"),
        ({"name": "a\0"}, r"name: expected text without NUL or lone surrogates, found 'a\\x00'"),
        ({"name": "\ud800"}, r"name: expected text without NUL .*, found '\\ud800'"),
        ({"name": Path("\0")}, "name: expected text without NUL"),
        ([], "expected an object"),
        ({"layer": {"width": 10**400}}, "width: expected .* found an integer of 1329 bits"),
        ({"layer": {"width": True}}, "width: expected int, found True"),
        ({"layer": {"width": 4, "radii": [10**400]}}, r"radii\[0\]: expected .* 1329 bits"),
        ({"layer": {"width": 4, "radii": [float("nan")]}}, r"radii\[0\]: expected .*nan"),
        ({"layer": {"width": 4, "radii": [1e300]}}, r"radii\[0\]: expected .*1e\+300"),
        ({"layer": {"width": 4, "radii": []}}, "radii: expected 1 to 64 items, found 0"),
        ({"rates": [0.5, 1.5]}, r"rates\[1\]: expected 0 to 1, found 1.5"),
        ({"rates": [-0.5]}, r"rates\[0\]: expected 0 to 1, found -0.5"),
    ],
)
def test_invalid_values_are_named(values, message):
    with pytest.raises(InputError, match=message):
        from_dict(_Config, values, "config.json")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "{", "1" * 5000, "nul", b"\xff", '{"a": 1, "a": 2}']
)
def test_json_that_cannot_be_read_is_one_line(text):
    with pytest.raises(InputError, match=r"^c\.json: expected JSON: ") as error:
        parse_json(text, "c.json")
    assert "\n" not in str(error.value)


def test_fields_that_contradict_each_other_name_the_file():
    values = to_dict(DetectorConfig())
    values["set_upconv"] = values["set_upconv"][:1]
    message = r"a\.npz: set_upconv: expected 3 layers, one fewer than set_abstraction has, found 1"
    with pytest.raises(InputError, match=message):
        from_dict(DetectorConfig, values, "a.npz")
    values = to_dict(DetectorConfig())
    values["box"]["classes"] = ["car", "Cyclist"]
    assert from_dict(DetectorConfig, values).box.classes == ("Car", "Cyclist")
