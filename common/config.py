"""Frozen dataclasses to and from JSON, checked field by field.

A field's metadata may hold `least` and `most`, bounds of its number or of each number in its
tuple, and `least_items` (1) and `most_items` (64) of a tuple of any length.
"""

import contextlib
import dataclasses
import json
import os
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from common.errors import InputError

T = TypeVar("T")

MAX_ITEMS = 64
"""Greatest length of a tuple, unless its field has its own bound."""
_MAX_INT, _MAX_FLOAT = 2**53, 1e15


def parse_json(text: str | bytes, path: str | Path | None = None) -> Any:
    """The value of a JSON text.

    Raises:
        InputError: not JSON, nested too deeply, a number of thousands of digits, or an object with
            a key twice.
    """
    try:
        return json.loads(text, object_pairs_hook=_object)
    except (ValueError, RecursionError) as error:
        raise InputError(f"expected JSON: {error}", path) from error


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made: dict[str, Any] = {}
    for name, value in pairs:
        if name in made:
            raise ValueError(f"the key {_short(name)} is there twice")
        made[name] = value
    return made


def to_dict(config: Any) -> dict[str, Any]:
    """A JSON-ready dictionary of a (nested) dataclass; tuples become lists, paths text."""
    return json.loads(json.dumps(dataclasses.asdict(config), default=str))


def from_dict(
    cls: type[T], values: Any, path: str | Path | None = None, name: str | None = None
) -> T:
    """Builds the dataclass `cls` from a dictionary; unknown or mistyped fields are errors.

    A missing field has its default, since a record may be older than the field; without a default
    it is an error. `name` is the class in errors, "--" for flags.

    Raises:
        InputError: names the field, the value found and the value expected.
    """
    return _convert(cls, values, name or cls.__name__, path, {})


def _convert(
    kind: Any, value: Any, name: str, path: str | Path | None, bounds: Mapping[str, Any]
) -> Any:
    if dataclasses.is_dataclass(kind):
        return _convert_dataclass(kind, value, name, path)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        return _tuple(arguments, value, name, path, bounds)
    if origin is typing.Literal:
        if value not in arguments:
            raise InputError(
                f"{name}: expected one of {list(arguments)}, found {_short(value)}", path
            )
        return value
    if origin in (types.UnionType, typing.Union):
        return _one_of(arguments, value, name, path, bounds)
    if kind in (int, float):
        return _number(kind, value, name, path, bounds)
    if kind in (str, Path) and isinstance(value, str | Path) and not _can_be_a_path(value):
        expected = "expected text without NUL or lone surrogates"
        raise InputError(f"{name}: {expected}, found {_short(value)}", path)
    if kind is Path and isinstance(value, str) and value:
        return Path(value)
    if not isinstance(value, kind):
        raise InputError(f"{name}: expected {kind.__name__}, found {_short(value)}", path)
    return value


def _can_be_a_path(value: str | Path) -> bool:
    """False for text with NUL or with characters that no name of a file encodes."""
    try:
        return b"\0" not in os.fsencode(value)
    except UnicodeEncodeError:
        return False


def _tuple(
    kinds: tuple, value: Any, name: str, path: str | Path | None, bounds: Mapping[str, Any]
) -> tuple:
    if not isinstance(value, (list, tuple)):
        raise InputError(f"{name}: expected a list, found {_short(value)}", path)
    variadic, count = len(kinds) == 2 and kinds[1] is Ellipsis, len(value)
    least = bounds.get("least_items", 1)
    most = bounds.get("most_items", MAX_ITEMS)
    if variadic and not least <= count <= most:
        raise InputError(f"{name}: expected {least} to {most} items, found {count}", path)
    if not variadic and count != len(kinds):
        raise InputError(f"{name}: expected {len(kinds)} items, found {_short(value)}", path)
    return tuple(
        _convert(kinds[0] if variadic else kinds[i], item, f"{name}[{i}]", path, bounds)
        for i, item in enumerate(value)
    )


def _one_of(
    kinds: tuple, value: Any, name: str, path: str | Path | None, bounds: Mapping[str, Any]
) -> Any:
    """Converts to the first kind that accepts the value; the error is that of the last."""
    if value is None and type(None) in kinds:
        return None
    *others, last = [kind for kind in kinds if kind is not type(None)]
    for kind in others:
        with contextlib.suppress(InputError):
            return _convert(kind, value, name, path, bounds)
    return _convert(last, value, name, path, bounds)


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
    where = "" if name == "--" else f"{name}: "
    if unknown:
        expected = f"expected among {', '.join(field.name for field in fields)}"
        raise InputError(f"{where}unknown field {_short(unknown[0])}, {expected}", path)
    if missing:
        raise InputError(f"{where}missing fields {', '.join(missing)}", path)
    bounds = {field.name: field.metadata for field in fields}
    dot = "" if name == "--" else "."
    converted = {
        n: _convert(hints[n], v, f"{name}{dot}{n}", path, bounds[n]) for n, v in value.items()
    }
    try:
        return cls(**converted)
    except InputError as error:  # fields that contradict each other
        if path is None or error.path is not None:
            raise
        raise InputError(str(error), path) from error


def _has_no_default(field: dataclasses.Field) -> bool:
    return field.default is field.default_factory is dataclasses.MISSING
