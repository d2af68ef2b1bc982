"""Configurations as dictionaries: what is wrong is named."""

import dataclasses

import pytest

from common.config import from_dict, to_dict
from common.errors import InputError


@dataclasses.dataclass(frozen=True)
class _Layer:
    width: int
    radii: tuple[float, ...] = (1.0, 2.0)


@dataclasses.dataclass(frozen=True)
class _Config:
    layer: _Layer = dataclasses.field(default_factory=lambda: _Layer(8))
    frozen: bool = False


def test_there_and_back():
    config = _Config(_Layer(4, (0.5,)), True)
    assert from_dict(_Config, to_dict(config)) == config


def test_a_record_older_than_a_field_has_its_default():
    assert from_dict(_Config, {"layer": {"width": 4}}) == _Config(_Layer(4))
    assert from_dict(_Config, {}) == _Config()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"layer": {}}, r"missing fields \['width'\]"),
        ({"layr": {}}, r"unknown fields \['layr'\]"),
        ({"layer": {"width": "4"}}, "width: expected int, found '4'"),
        ({"frozen": 1}, "frozen: expected bool"),
        ([], "expected an object"),
    ],
)
def test_what_does_not_fit_is_named(values, message):
    with pytest.raises(InputError, match=message):
        from_dict(_Config, values, "config.json")
