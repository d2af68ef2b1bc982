"""Command-line flags of frozen dataclasses, and `--config FILE` that holds the same settings.

One flag per field; a nested dataclass gives dotted names (`--detector.num_points`). FILE is JSON:
the fields, or a record with the fields under "config", as the scripts write it (config.json). A
flag overrides the file.
"""

import argparse
import dataclasses
import json
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from common.config import from_dict, parse_json
from common.errors import InputError
from common.files import read_bytes
from common.flags import integer, number

T = TypeVar("T")
_MISSING = dataclasses.MISSING


def option(
    default: Any,
    text: str,
    parse: Callable[[str], Any] | None = None,
    flags: tuple[str, ...] = (),
    **bounds: float,
) -> Any:
    """A field with its help text.

    Args:
        default: `dataclasses.MISSING` for a required field.
        text: of --help.
        parse: argparse type of the flag; None for that of the field's type.
        flags: names of the flag; () for the field's name.
        bounds: `least`, `most`, `least_items`, see `common.config`.
    """
    return dataclasses.field(
        default=default, metadata={"help": text, "parse": parse, "flags": flags, **bounds}
    )


def add_flags(parser: argparse.ArgumentParser, config: Any, prefix: str = "") -> None:
    """Adds `--config` and one flag per field of a dataclass or of an instance with the defaults.

    The namespace holds the flags that were given alone.
    """
    if not prefix:
        text = "JSON file of these settings, such as a written config.json; flags override it"
        parser.add_argument("--config", type=Path, metavar="FILE", help=text)
    hints = typing.get_type_hints(config if isinstance(config, type) else type(config))
    for field in dataclasses.fields(config):
        default, name = _default(config, field), prefix + field.name
        if dataclasses.is_dataclass(default):
            add_flags(parser, default, name + ".")
            continue
        parser.add_argument(
            *(f"--{flag}" for flag in field.metadata.get("flags") or (name,)),
            dest=name,
            type=field.metadata.get("parse") or _parser_of(hints[field.name]),
            default=argparse.SUPPRESS,
            metavar=_metavar(hints[field.name]),
            help=_help(field, default),
        )


def from_flags(config: type[T] | T, flags: argparse.Namespace) -> T:
    """The dataclass of the given flags, of the file of --config, and of the defaults.

    Raises:
        InputError: a missing or broken file, a missing field, or a value that a field does not
            allow; fields are named as flags.
    """
    given, path = vars(flags), flags.config
    values = {} if path is None else parse_json(read_bytes(path), path)
    if isinstance(values, dict) and isinstance(values.get("config"), dict):
        values = values["config"]
    values = _merged(config, given, values, "")
    cls = config if isinstance(config, type) else type(config)
    if isinstance(values, dict):
        missing = [f"--{f.name}" for f in dataclasses.fields(cls) if f.name not in values]
        if missing:
            raise InputError(f"{', '.join(missing)}: required, as a flag or in --config", path)
    return from_dict(cls, values, path, "--")


def _merged(config: Any, given: dict[str, Any], values: Any, prefix: str) -> Any:
    """Values of the fields as in a dictionary; other values are left to `from_dict`."""
    if not isinstance(values, dict):
        return values
    merged = dict(values)
    for field in dataclasses.fields(config):
        default, name = _default(config, field), prefix + field.name
        if dataclasses.is_dataclass(default):
            merged[field.name] = _merged(default, given, values.get(field.name, {}), name + ".")
        elif name in given:
            merged[field.name] = given[name]
        elif default is not _MISSING:
            merged.setdefault(field.name, default)
    return merged


def _default(config: Any, field: dataclasses.Field) -> Any:
    if not isinstance(config, type):
        return getattr(config, field.name)
    return field.default if field.default_factory is _MISSING else field.default_factory()


def _help(field: dataclasses.Field, default: Any) -> str:
    text = field.metadata.get("help") or ""
    if default is _MISSING:
        return f"{text} (required)"
    if default is None or "(default" in text:
        return text
    shown = ",".join(map(str, default)) if isinstance(default, tuple) else default
    return f"{text} (default: {shown})"


def _metavar(kind: Any) -> str:
    if typing.get_origin(kind) is typing.Literal:
        return "|".join(str(a) for a in typing.get_args(kind))
    return getattr(kind, "__name__", "VALUE").upper() if isinstance(kind, type) else "VALUE"


def _parser_of(kind: Any) -> Any:
    arms = [arm for arm in typing.get_args(kind) if arm is not type(None)]
    if kind in _PARSERS:
        return _PARSERS[kind]
    if typing.get_origin(kind) is typing.Literal:
        return str
    if len(arms) == 1 and arms[0] in _PARSERS:  # or None
        return _PARSERS[arms[0]]
    return _parse_json


def _parse_bool(text: str) -> bool:
    if text not in ("true", "false"):
        raise argparse.ArgumentTypeError(f"expected true or false, found {text!r}")
    return text == "true"


_PARSERS = {int: integer, float: number, str: str, Path: Path, bool: _parse_bool}


def _parse_json(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
