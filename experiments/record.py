"""What an experiment was measured with, for its record: configurations, data, networks."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from common.config import parse_json, to_dict
from common.files import read_bytes
from evaluation.config import EvaluateConfig
from kitti.sequence import open_sequences
from models.weight_files import weights_sha256
from simulator.dataset import MANIFEST


def measured_with(configs: Iterable[EvaluateConfig]) -> dict[str, Any]:
    """Configurations, data, and the networks if one of them runs, for `provenance`.

    configs: of one folder of weights.
    """
    configs = list(configs)
    data = dict.fromkeys((config.data_root, config.seqs) for config in configs)
    record = {"configs": config_records(configs), "data": [data_record(*part) for part in data]}
    if folders := [config.weights for config in configs if config.needs_network]:
        record["weights_sha256"] = weights_sha256(folders[0])
    return record


def config_records(configs: Iterable[EvaluateConfig]) -> list[dict[str, Any]]:
    """Each configuration with its `min_box_score`.

    Those that differ in tracker and seed alone are one, with lists of `trackers` and `seeds`.
    """
    alike: dict[EvaluateConfig, list[EvaluateConfig]] = {}
    for config in configs:
        key = replace(config, tracker="sort", seed=0, out=None)
        alike.setdefault(key, []).append(config)
    records = []
    for config, group in alike.items():
        fields = to_dict(config)
        for name in ("tracker", "seed"):
            del fields[name]
            fields[f"{name}s"] = list(dict.fromkeys(getattr(each, name) for each in group))
        records.append({**fields, "min_box_score": config.min_box_score})
    return records


def data_record(data_root: str | Path, seqs: Sequence[int]) -> dict[str, Any]:
    """Frames of each sequence; `simulated`: version and seed of a simulated data set, else None."""
    path = Path(data_root) / MANIFEST
    found = parse_json(read_bytes(path), path) if path.is_file() else None
    own = isinstance(found, dict)
    return {
        "data_root": str(data_root),
        "sequences": {s.name: len(s.frames) for s in open_sequences(data_root, seqs)},
        "simulated": {name: found.get(name) for name in ("version", "seed")} if own else None,
    }
