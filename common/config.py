"""Frozen dataclasses to and from JSON and command-line flags, checked field by field.

A field's metadata may hold `least` and `most`, bounds of its number or of each number in its tuple.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from common.errors import InputError

T = TypeVar("T")

MAX_ITEMS = 64
"""Of a tuple of any length."""
_MAX_INT, _MAX_FLOAT = 2**53, 1e15


def parse_json(text: str | bytes, path: str | Path | None = None) -> Any:
    """The value of a JSON text.

    Raises:
        InputError: not JSON, nested too deeply, or a number of thousands of digits.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"expected JSON: {error}", path) from error


def to_dict(config: Any) -> dict[str, Any]:
    """A JSON-ready dictionary of a (nested) dataclass; tuples become lists."""
    return json.loads(json.dumps(dataclasses.asdict(config)))


def from_dict(cls: type[T], values: Any, path: str | Path | None = None) -> T:
    """Builds the dataclass `cls` from a dictionary; unknown or mistyped fields are errors.

    A field that is not there has its default: a record may be older than the field. Without a
    default it is an error.

    Raises:
        InputError: names the field, what was found and what was expected.
    """
    return _convert(cls, values, cls.__name__, path, {})


def _convert(
    kind: Any, value: Any, name: str, path: str | Path | None, bounds: Mapping[str, Any]
) -> Any:
    if dataclasses.is_dataclass(kind):
        return _convert_dataclass(kind, value, name, path)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        if not isinstance(value, (list, tuple)):
            raise InputError(f"{name}: expected a list, found {_short(value)}", path)
        variadic = len(arguments) == 2 and arguments[1] is Ellipsis
        if not variadic and len(value) != len(arguments):
            raise InputError(
                f"{name}: expected {len(arguments)} items, found {_short(value)}", path
            )
        if variadic and not 1 <= len(value) <= MAX_ITEMS:
            raise InputError(f"{name}: expected 1 to {MAX_ITEMS} items, found {len(value)}", path)
        kinds = [arguments[0]] * len(value) if variadic else arguments
        return tuple(
            _convert(k, v, f"{name}[{i}]", path, bounds)
            for i, (k, v) in enumerate(zip(kinds, value, strict=True))
        )
    if origin is typing.Literal:
        if value not in arguments:
            raise InputError(
                f"{name}: expected one of {list(arguments)}, found {_short(value)}", path
            )
        return value
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in arguments:
            return None
        inner = next(a for a in arguments if a is not type(None))
        return _convert(inner, value, name, path, bounds)
    if kind in (int, float):
        return _number(kind, value, name, path, bounds)
    if not isinstance(value, kind):
        raise InputError(f"{name}: expected {kind.__name__}, found {_short(value)}", path)
    return value


def _number(
    kind: type, value: Any, name: str, path: str | Path | None, bounds: Mapping[str, Any]
) -> int | float:
    largest = _MAX_INT if kind is int else _MAX_FLOAT
    least, most = bounds.get("least", -largest), bounds.get("most", largest)
    if isinstance(value, bool) or not isinstance(value, (int, kind)):
        raise InputError(f"{name}: expected {kind.__name__}, found {_short(value)}", path)
    if not least <= value <= most:  # neither does NaN
        raise InputError(f"{name}: expected {least} to {most}, found {_short(value)}", path)
    return kind(value)


def _short(value: Any) -> str:
    """The value for a message, cut to a readable length."""
    if isinstance(value, int) and abs(value) >= 10**20:
        return f"an integer of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _convert_dataclass(cls: type, value: Any, name: str, path: str | Path | None) -> Any:
    if isinstance(value, cls):
        return value
    if not isinstance(value, dict):
        raise InputError(f"{name}: expected an object, found {_short(value)}", path)
    hints = typing.get_type_hints(cls)
    fields = dataclasses.fields(cls)
    unknown = sorted(set(value) - {field.name for field in fields})
    missing = [f.name for f in fields if f.name not in value and _has_no_default(f)]
    if unknown or missing:
        raise InputError(f"{name}: unknown fields {unknown}, missing fields {missing}", path)
    bounds = {field.name: field.metadata for field in fields}
    return cls(
        **{n: _convert(hints[n], v, f"{name}.{n}", path, bounds[n]) for n, v in value.items()}
    )


def _has_no_default(field: dataclasses.Field) -> bool:
    return field.default is field.default_factory is dataclasses.MISSING


def add_flags(parser: argparse.ArgumentParser, config: Any, prefix: str = "") -> None:
    """Adds one flag per field of the dataclass instance `config`, its value as the default.

    Nested dataclasses give dotted names (``--detector.num_points``); tuples are written as JSON.
    The field's ``metadata["help"]`` is the help text.
    """
    hints = typing.get_type_hints(type(config))
    for field in dataclasses.fields(config):
        value, name = getattr(config, field.name), prefix + field.name
        if dataclasses.is_dataclass(value):
            add_flags(parser, value, name + ".")
            continue
        parser.add_argument(
            f"--{name}",
            type=_parser_of(hints[field.name]),
            default=value,
            metavar=_metavar(hints[field.name]),
            help=field.metadata.get("help", " "),
        )


def from_flags(config: T, flags: argparse.Namespace, prefix: str = "") -> T:
    """`config` with the values that the flags of `add_flags` were given.

    Raises:
        InputError: a value that the field's type does not allow.
    """
    values = _flag_values(config, vars(flags), prefix)
    return from_dict(type(config), values)


def _flag_values(config: Any, flags: dict[str, Any], prefix: str) -> dict[str, Any]:
    values = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        values[field.name] = (
            _flag_values(value, flags, f"{prefix}{field.name}.")
            if dataclasses.is_dataclass(value)
            else flags[prefix + field.name]
        )
    return values


def _metavar(kind: Any) -> str:
    if typing.get_origin(kind) is typing.Literal:
        return "|".join(str(a) for a in typing.get_args(kind))
    return getattr(kind, "__name__", "VALUE").upper() if isinstance(kind, type) else "JSON"


def _parser_of(kind: Any) -> Any:
    if kind in (int, float, str):
        return kind
    if kind is bool:
        return _parse_bool
    if typing.get_origin(kind) is typing.Literal:
        return str
    return _parse_json


def _parse_bool(text: str) -> bool:
    if text not in ("true", "false"):
        raise argparse.ArgumentTypeError(f"expected true or false, found {text!r}")
    return text == "true"


def _parse_json(text: str) -> Any:
    try:
        return parse_json(text)
    except InputError:
        return text
