"""What the false alarms, misses and identity switches of tracking results are, one by one.

    python -m studies.track_errors --data_root KITTI --seqs 0000 --results results/network/tracks \
        --out results/errors

The errors are those of `clear3d` at 3-D IoU 0.5. A false alarm is told by the matches of its
track: "before" the first one (a vehicle that is labelled only later, for instance), "between",
"after" the last one, or "never" where the track has none; a miss likewise by the matches of its
label. Writes track_errors.md and track_errors.json.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.flags import (
    non_negative_float,
    non_negative_int,
    positive_int,
    run,
)
from common.markdown import cell, markdown
from evaluation.scene import Scene, open_scenes
from experiments.record import data_record
from experiments.runs import make_parser, write
from kitti.iou import iou_3d
from kitti.object_shift import ObjectShift
from kitti.objects import VEHICLES, Objects
from kitti.tables import sequence_file
from metrics.clear3d import RowErrors, row_errors
from metrics.comparison import Comparison, compare
from metrics.kitti_rules import in_dontcare

MIN_IOU = 0.5
BEFORE, BETWEEN, AFTER, NEVER = KINDS = ("before", "between", "after", "never")
SWITCH = ("switch in", "frame", "label", "from", "to", "frames since")


def kinds(frame: np.ndarray, ids: np.ndarray, wrong: np.ndarray) -> np.ndarray:
    """(n,) str, one of `KINDS` for each of n rows: where it lies among the matches of its id.

    Args:
        frame, ids: (n,) int.
        wrong: (n,) bool, rows without a match; the kind is "" elsewhere.
    """
    found = np.full(len(frame), "", "<U8")
    for row in np.flatnonzero(wrong):
        matches = frame[(ids == ids[row]) & ~wrong]
        if not len(matches):
            found[row] = NEVER
        elif frame[row] < matches.min():
            found[row] = BEFORE
        else:
            found[row] = AFTER if frame[row] > matches.max() else BETWEEN
    return found


def switches(name: str, results: Objects, errors: RowErrors) -> list[dict[str, Any]]:
    """The identity switches of a sequence: label, both tracks, frames since its last match."""
    rows = []
    for row in np.flatnonzero(errors.switched):
        frame, label = results.frame[row], errors.matched_id[row]
        earlier = np.flatnonzero((errors.matched_id == label) & (results.frame < frame))
        last = earlier[results.frame[earlier].argmax()]
        tracks = results.track_id[last], results.track_id[row]
        values = (frame, label, *tracks, frame - results.frame[last])
        rows.append(dict(zip(SWITCH, (name, *map(int, values)), strict=True)))
    return rows


def errors_of(scene: Scene, folder: Path) -> dict[str, Any]:
    """Counts of the kinds, tracks with false alarms and switches of one sequence."""
    results = scene.sequence.read_results(sequence_file(folder, scene.name))
    results = results.of_classes(VEHICLES)
    truth = scene.objects.of_classes(VEHICLES)
    c = compare(scene.name, scene.num_frames, truth, results, iou_3d)
    errors = row_errors(c, np.ones(len(c.results), bool), MIN_IOU)
    alarm = kinds(c.results.frame, c.results.track_id, errors.false_alarm)
    miss = kinds(c.truth.frame, c.truth.track_id, errors.missed)
    ignorable = in_dontcare(c.results, scene.objects.of_classes(("DontCare",)), c.num_frames)
    return {
        "false alarms": Counter(alarm[errors.false_alarm].tolist()),
        "false alarms outside DontCare": Counter(alarm[errors.false_alarm & ~ignorable].tolist()),
        "misses": Counter(miss[errors.missed].tolist()),
        "tracks": _tracks(c, alarm),
        "switches": switches(c.name, c.results, errors),
    }


def _tracks(c: Comparison, alarm: np.ndarray) -> list[dict[str, Any]]:
    """Tracks with false alarms: their frames, the number of each kind, mean range and score."""
    rows = []
    for track in np.unique(c.results.track_id[alarm != ""]):
        own = c.results.track_id == track
        wrong = own & (alarm != "")
        counts = Counter(alarm[wrong].tolist())
        rows.append(
            {
                "false alarms in": c.name,
                "track": int(track),
                "frames": f"{c.results.frame[own].min()}-{c.results.frame[own].max()}",
                "boxes": int(own.sum()),
                **{kind: counts[kind] for kind in KINDS},
                "range (m)": float(np.hypot(*c.results.boxes[wrong, :2].T).mean()),
                "score": float(c.results.score[wrong].mean()),
            }
        )
    return rows


def table(found: list[dict[str, Any]], longest: int) -> str:
    """Counts over all sequences, the tracks with most false alarms, and all switches."""
    names = ("false alarms", "false alarms outside DontCare", "misses")
    totals = [sum((part[name] for part in found), Counter()) for name in names]
    cells = [
        [name, *(str(total[kind]) for kind in KINDS), str(total.total())]
        for name, total in zip(names, totals, strict=True)
    ]
    text = markdown(["", *KINDS, "sum"], cells)
    tracks = [track for part in found for track in part["tracks"]]
    tracks.sort(key=lambda track: -sum(track[kind] for kind in KINDS))
    if tracks:
        cells = [[cell(value, 2) for value in t.values()] for t in tracks[:longest]]
        text += "\n" + markdown(list(tracks[0]), cells)
    changed = [switch for part in found for switch in part["switches"]]
    if changed:
        cells = [[cell(value, 0) for value in s.values()] for s in changed]
        text += "\n" + markdown(SWITCH, cells)
    return text


def main(argv: Sequence[str] | None = None) -> None:
    """Reads result files and lists their errors."""
    parser = make_parser(__doc__, "0000")
    add = parser.add_argument
    add("--results", type=Path, required=True, metavar="DIR", help="result files of evaluate.py")
    add("--object_shift", type=non_negative_float, default=0.0, help="with which they were made")
    add("--seed", type=non_negative_int, default=0, help="of that object shift")
    add("--longest", type=positive_int, default=20, help="tracks in the list")
    flags = parser.parse_args(argv)
    shift = ObjectShift(flags.object_shift, flags.seed) if flags.object_shift else None
    scenes = open_scenes(flags.data_root, flags.seqs, shift=shift)
    data = [data_record(flags.data_root, flags.seqs)]
    found = [errors_of(scene, flags.results) for scene in scenes]
    text = table(found, flags.longest)
    write(flags.out, "track_errors", "Tracking errors", text, found, data=data)


if __name__ == "__main__":
    raise SystemExit(run(main))
