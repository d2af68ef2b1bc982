"""Flags of very small networks, and the made-up drives of tests/training, for tests anywhere."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
from pathlib import Path
from types import ModuleType

from common.config import to_dict

TESTS = Path(__file__).resolve().parent


def config_flags(config, prefix: str) -> list[str]:
    """Flags of `common.config_flags` for this configuration: --prefix.field value."""
    words, values = [], to_dict(config)
    for field in dataclasses.fields(config):
        part, name = getattr(config, field.name), f"{prefix}.{field.name}"
        if dataclasses.is_dataclass(part):
            words += config_flags(part, name)
        else:
            value = values[field.name]
            words += [f"--{name}", value if isinstance(value, str) else json.dumps(value)]
    return words


def two_cars() -> ModuleType:
    """tests/training/two_cars.py."""
    path = TESTS / "training" / "two_cars.py"
    spec = importlib.util.spec_from_file_location("two_cars_anywhere", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
