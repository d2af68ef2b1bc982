"""HOTA, DetA, AssA and IDF1 of the trackeval package, through arrays.

HOTA: Luiten et al., IJCV 2020; IDF1: Ristani et al., 2016. Both on frames that went through
KITTI's ignore rules (`kitti2d.clean`), with 2-D or 3-D IoU as similarity.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from metrics.kitti2d import CleanFrame

NAMES = ("HOTA", "DetA", "AssA", "LocA")


def hota(sequences: Mapping[str, list[CleanFrame]]) -> dict[str, Any]:
    """`{"overall": {...}, "sequences": {name: {...}}}` with HOTA, DetA, AssA, LocA, IDF1.

    Each is a fraction; HOTA's own are means over its 19 thresholds. None where a sequence has
    neither truth nor results, and IDF1 and AssA where nothing is asked for.
    """
    from trackeval.metrics import HOTA, Identity  # a second at import

    measures = (HOTA(), Identity({"THRESHOLD": 0.5, "PRINT_CONFIG": False}))
    data = {name: _arrays(frames) for name, frames in sequences.items()}
    parts = [{name: m.eval_sequence(d) for name, d in data.items()} for m in measures]
    sizes = {name: (d["num_gt_dets"], d["num_tracker_dets"]) for name, d in data.items()}
    combined = [m.combine_sequences(part) for m, part in zip(measures, parts, strict=True)]
    return {
        "overall": _figures(*combined, *map(sum, zip(*sizes.values(), strict=True))),
        "sequences": {
            name: _figures(*(part[name] for part in parts), *sizes[name]) for name in data
        },
    }


def _figures(hota_fields: dict, identity: dict, truth: int, results: int) -> dict[str, Any]:
    if not truth:
        return dict.fromkeys((*NAMES, "IDF1"))
    figures = {name: float(np.mean(hota_fields[name])) for name in NAMES}
    if not results:
        figures["LocA"] = None
    return {**figures, "IDF1": float(identity["IDF1"])}


def _arrays(frames: list[CleanFrame]) -> dict[str, Any]:
    """What trackeval's metrics read: ids from 0 without gaps, counts, similarities."""
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
