"""Flags of a configuration, for commands with very small networks."""

import dataclasses
import json

from common.config import to_dict


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
