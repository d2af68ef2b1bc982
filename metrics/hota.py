"""HOTA, DetA, AssA, LocA and IDF1 of the trackeval package, computed from arrays.

HOTA: Luiten et al., IJCV 2020; IDF1: Ristani et al., 2016. Both on frames after KITTI's
ignore rules (`kitti2d.clean`), with 2-D or 3-D IoU as similarity.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from metrics.kitti2d import CleanFrame

NAMES = ("HOTA", "DetA", "AssA")


def hota(sequences: Mapping[str, list[CleanFrame]]) -> dict[str, Any]:
    """`{"overall": {...}, "sequences": {name: {...}}}` with HOTA, DetA, AssA, LocA, IDF1.

    Each is a fraction. HOTA, DetA and AssA are means over the 19 thresholds of similarity, LocA
    over those with a match (trackeval counts 1 for the others). LocA is None without any match,
    and all are None without evaluated ground truth.
    """
    from trackeval.metrics import HOTA, Identity  # its import takes a second

    measures = (HOTA(), Identity({"THRESHOLD": 0.5, "PRINT_CONFIG": False}))
    data = {name: _arrays(frames) for name, frames in sequences.items()}
    parts = [{name: m.eval_sequence(d) for name, d in data.items()} for m in measures]
    combined = [m.combine_sequences(part) for m, part in zip(measures, parts, strict=True)]
    return {
        "overall": _metrics(*combined),
        "sequences": {name: _metrics(*(part[name] for part in parts)) for name in data},
    }


def _metrics(fields: dict, identity: dict) -> dict[str, Any]:
    matches = fields["HOTA_TP"]  # (19,) per threshold
    if not (matches + fields["HOTA_FN"]).any():
        return dict.fromkeys((*NAMES, "LocA", "IDF1"))
    located = fields["LocA"][matches > 0]
    return {
        **{name: float(np.mean(fields[name])) for name in NAMES},
        "LocA": float(np.mean(located)) if len(located) else None,
        "IDF1": float(identity["IDF1"]),
    }


def _arrays(frames: list[CleanFrame]) -> dict[str, Any]:
    """Inputs of trackeval's metrics: ids from 0 without gaps, counts, similarities."""
    truth, num_truth = _consecutive([frame.truth_ids for frame in frames])
    results, num_results = _consecutive([frame.result_ids for frame in frames])
    return {
        "gt_ids": truth,
        "tracker_ids": results,
        "similarity_scores": [frame.similarity for frame in frames],
        "num_gt_ids": num_truth,
        "num_tracker_ids": num_results,
        "num_gt_dets": sum(map(len, truth)),
        "num_tracker_dets": sum(map(len, results)),
        "num_timesteps": len(frames),
    }


def _consecutive(ids: list[np.ndarray]) -> tuple[list[np.ndarray], int]:
    known, flat = np.unique(np.concatenate([np.zeros(0, int), *ids]), return_inverse=True)
    edges = np.cumsum([len(frame) for frame in ids])[:-1]
    return np.split(flat, edges), len(known)
