"""A slow, literal evaluation by the official devkit's rules with 3-D IoU, for class car.

Written from the rules, one row and one frame at a time, without the project's metrics or boxes:
camera-frame boxes, shapely polygons pair by pair, every assignment tried.
"""

from itertools import permutations
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon


def read(path: Path, scored: bool) -> list[dict]:
    """Rows of a label or result file as dictionaries; cars and vans and DontCare only."""
    out = []
    for line in path.read_text().splitlines():
        f = line.split()
        if f[2] not in ("Car", "Van", "DontCare") or (f[2] != "DontCare" and int(f[1]) < 0):
            continue
        numbers = [float(value) for value in f[6:]]
        out.append(
            {
                "frame": int(f[0]),
                "id": int(f[1]),
                "type": f[2],
                "ignored": int(float(f[3])) > 0 or int(f[4]) > 2 or f[2] == "Van",
                "image": numbers[:4],
                "solid": numbers[4:11],
                "score": numbers[11] if scored else None,
            }
        )
    return out


def iou(a: list[float], b: list[float]) -> float:
    """3-D IoU of h w l x y z ry in the camera frame (y down, bottom centre)."""
    ground = []
    for _h, w, length, x, _y, z, ry in (a, b):
        c, s = np.cos(ry), np.sin(ry)
        corners = [
            (length / 2, w / 2),
            (length / 2, -w / 2),
            (-length / 2, -w / 2),
            (-length / 2, w / 2),
        ]
        ground.append(Polygon([(x + c * u + s * v, z - s * u + c * v) for u, v in corners]))
    area = ground[0].intersection(ground[1]).area
    height = max(0.0, min(a[4], b[4]) - max(a[4] - a[0], b[4] - b[0]))
    volume = area * height
    return volume / (a[0] * a[1] * a[2] + b[0] * b[1] * b[2] - volume)


def best_pairs(similarity: list[list[float]], least: float) -> list[tuple[int, int]]:
    """Most pairs of at least `least`, then the largest sum, by trying everything."""
    m = len(similarity)
    k = len(similarity[0]) if m else 0
    best, found = (0, 0.0), []
    columns = [*range(k), *([None] * m)]
    for choice in set(permutations(columns, m)):
        pairs = [
            (i, j) for i, j in enumerate(choice) if j is not None and similarity[i][j] >= least
        ]
        value = (len(pairs), sum(similarity[i][j] for i, j in pairs))
        if value > best:
            best, found = value, pairs
    return found


def naive_sum(values: list[float]) -> float:
    """One after the other, as `sum` did before Python 3.12 made it exact."""
    result = 0.0
    for value in values:
        result += value
    return result


def in_dontcare(result: dict, regions: list[dict]) -> bool:
    """Whether more than half of the result's 2-D box lies in one region."""
    x1, y1, x2, y2 = result["image"]
    for region in regions:
        a1, b1, a2, b2 = region["image"]
        w, h = min(x2, a2) - max(x1, a1), min(y2, b2) - max(y1, b1)
        if w > 0 and h > 0 and w * h / ((x2 - x1) * (y2 - y1)) > 0.5:
            return True
    return False


def evaluate(truth: list[dict], results: list[dict], least: float, averaged: bool = False) -> dict:
    """Counts of one sequence, and the matches' track scores."""
    by_id: dict[int, list[float]] = {}
    for r in results:
        by_id.setdefault(r["id"], []).append(r["score"])
    mean = {k: naive_sum(v) / len(v) for k, v in by_id.items()}
    out = {"TP": 0, "FP": 0, "FN": 0, "GT": 0, "sum": 0.0, "scores": []}
    story: dict[int, list[tuple[int, bool]]] = {}
    for frame in sorted({r["frame"] for r in truth + results}):
        here = [g for g in truth if g["frame"] == frame and g["type"] != "DontCare"]
        regions = [g for g in truth if g["frame"] == frame and g["type"] == "DontCare"]
        tracked = [r for r in results if r["frame"] == frame]
        values = [[iou(g["solid"], r["solid"]) for r in tracked] for g in here]
        pairs = dict(best_pairs(values, least))
        for i, g in enumerate(here):
            out["GT"] += not g["ignored"]
            matched = tracked[pairs[i]]["id"] if i in pairs else -1
            story.setdefault(g["id"], []).append((matched, g["ignored"]))
            if i in pairs:
                out["TP"] += 1
                out["sum"] += values[i][pairs[i]]
                out["scores"].append(tracked[pairs[i]]["score"] if averaged else mean[matched])
            elif not g["ignored"]:
                out["FN"] += 1
        for j, r in enumerate(tracked):
            small = r["image"][3] - r["image"][1] <= 25
            if j in pairs.values() or small or r["type"] == "Van" or in_dontcare(r, regions):
                continue
            out["FP"] += 1
    return {**out, **follow(story)}


def follow(story: dict[int, list[tuple[int, bool]]]) -> dict:
    """IDS, FRAG, MT, ML and the number of trajectories, from (matched id or -1, ignored)."""
    out = {"IDS": 0, "FRAG": 0, "MT": 0, "ML": 0, "tracks": 0}
    for frames in story.values():
        if all(ignored for _, ignored in frames):
            continue
        out["tracks"] += 1
        if all(matched == -1 for matched, _ in frames):
            out["ML"] += 1
            continue
        last, count = frames[0][0], int(frames[0][0] != -1)
        for f in range(1, len(frames)):
            (before, _), (now, ignored) = frames[f - 1], frames[f]
            if ignored:
                last = -1
                continue
            if now != -1 and last != -1 and before != -1 and now != last:
                out["IDS"] += 1
            ends = f == len(frames) - 1
            changed = now not in (-1, before)
            if changed and (ends or (last != -1 and frames[f + 1][0] != -1)):
                out["FRAG"] += 1
            if now != -1:
                count, last = count + 1, now
        share = count / sum(not ignored for _, ignored in frames)
        out["MT"] += share > 0.8
        out["ML"] += share < 0.2
    return out


def over_recall(truth: list[list[dict]], results: list[list[dict]], least: float) -> dict:
    """sAMOTA, AMOTA, AMOTP and the best MOTA over 40 recall points, sequences together."""

    def at(threshold: float) -> dict:
        """One pass; like AB3DMOT's evaluator it leaves each row with its track's mean score."""
        parts = []
        for g, r in zip(truth, results, strict=True):
            scores: dict[int, list[float]] = {}
            for row in r:
                scores.setdefault(row["id"], []).append(row["score"])
            mean = {k: naive_sum(v) / len(v) for k, v in scores.items()}
            for row in r:
                row["score"] = mean[row["id"]]
            parts.append(evaluate(g, [row for row in r if row["score"] >= threshold], least, True))
        return {
            key: sum((part[key] for part in parts), [] if key == "scores" else 0)
            for key in parts[0]
        }

    everything = at(-np.inf)
    evaluated = everything["TP"] + everything["FN"]
    scores = sorted(everything["scores"], reverse=True)
    points, recall = [], 0.0
    for i, score in enumerate(scores):
        here, following = (i + 1) / evaluated, (i + 2) / evaluated
        if i < len(scores) - 1 and following - recall < recall - here:
            continue
        points.append((score, recall))
        recall += 1 / 40
    sums, best = np.zeros(3), (0.0, None)
    for score, recall in points[1:]:
        c = at(score)
        errors = c["FN"] + c["FP"] + c["IDS"]
        mota = 1 - errors / c["GT"]
        scaled = 1 - (errors - (1 - recall) * c["GT"]) / (recall * c["GT"])
        sums += min(1.0, max(0.0, scaled)), mota, c["sum"] / c["TP"] if c["TP"] else 0.0
        if mota > best[0]:
            best = (mota, score)
    out = dict(zip(("sAMOTA", "AMOTA", "AMOTP"), sums / 40, strict=True))
    return out | {"best": best, "at best": at(best[1])}
