"""One evaluation from a configuration to metrics and files."""

import contextlib
import os
import re
import tempfile
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from common.config import parse_json, to_dict
from common.errors import InputError
from common.files import read_bytes, write_json, write_text
from common.notes import note
from common.progress import Progress
from common.provenance import provenance
from evaluation.config import BEST, GROUND_TRUTH, NETWORK, EvaluateConfig
from evaluation.detections import (
    BoxesAtLeast,
    BoxesOfClasses,
    DetectionFiles,
    DetectionProvider,
    LabelBoxes,
    NetworkDetections,
    check_folder,
    note_if_others,
    note_low_scores,
    note_other_classes,
)
from evaluation.scene import Scene
from evaluation.submission import SUBMISSION, write_submission
from evaluation.table import full_table
from evaluation.tracking_loop import track_scene
from kitti.labels import write_results
from kitti.object_shift import ObjectShift
from kitti.objects import Objects
from kitti.tables import sequence_file
from metrics.comparison import track_scores
from metrics.protocols import Entry, best_threshold, evaluate_protocol, evaluated_types
from models.weight_files import weights_sha256
from tracking import make_tracker

TRACKS, METRICS = "tracks", "metrics.json"
_NAME = re.compile(r"\d{4}", re.ASCII)  # of a sequence


def evaluate(
    config: EvaluateConfig,
    shift: ObjectShift | None = None,
    provider: DetectionProvider | None = None,
) -> dict[str, Any]:
    """Tracks (or reads results), writes `config.out`, and returns the content of metrics.json.

    Args:
        config: validated settings.
        shift: in place of the default reading of the paper, `config.shift`.
        provider: of the detections that `config` describes, in place of a new one (a cache).

    Raises:
        InputError: bad input; `out` then has no new file.
    """
    scenes = config.open_scenes(shift)
    if config.out is not None:
        _check_inputs_stay(config, scenes)
        check_writable(config.out)
    if config.subset == "training":
        labels = Objects.concatenate(scene.sequence.objects for scene in scenes)
        note_other_classes(config.data_root, labels, config.classes)
    results, least = _results(config, scenes, provider)
    metrics = score(config, scenes, results)
    thresholds = {"min_box_score": config.min_box_score, "min_track_score": least}
    networks = {"weights_sha256": weights_sha256(config.weights)} if config.needs_network else {}
    run = provenance(config=to_dict(config), data=_data(config, scenes), **networks)
    record = {"run": {**run, **thresholds}, **metrics}
    if config.out is not None:
        write_text(config.out / "table.md", full_table(metrics, run["command"], thresholds))
        write_json(config.out / METRICS, record)
        write_json(config.out / "config.json", record["run"])
        if config.subset == "testing":
            files = [config.out / TRACKS / f"{scene.name}.txt" for scene in scenes]
            write_submission(config.out / SUBMISSION, files)
    return record


def score(
    config: EvaluateConfig, scenes: list[Scene], results: Mapping[str, Objects]
) -> dict[str, Any]:
    """The metrics of every protocol, by name."""
    entries = _entries(scenes, results)
    return {
        name: evaluate_protocol(name, entries, classes=config.classes, min_iou=config.iou)
        for name in config.protocols
    }


def _entries(scenes: list[Scene], results: Mapping[str, Objects]) -> list[Entry]:
    return [Entry(s.name, s.num_frames, s.objects, results[s.name]) for s in scenes]


def make_provider(config: EvaluateConfig, scenes: list[Scene]) -> DetectionProvider:
    """The provider that `--detections` names, with the networks' motion where it is needed."""
    provider = None
    if config.detections == GROUND_TRUTH:
        provider = LabelBoxes(config.classes)
    elif config.detections != NETWORK:
        provider = DetectionFiles(config.detections, scenes, config.classes)
    if not config.needs_network:
        return provider
    return NetworkDetections.load(config.weights, provider)


def run_tracker(
    config: EvaluateConfig, scenes: list[Scene], provider: DetectionProvider | None = None
) -> dict[str, Objects]:
    """Result rows of every scene, by name."""
    for scene in scenes:
        scene.check(poses=config.tracker == "ab3dmot", scans=config.needs_network)
    if provider is None:
        provider = make_provider(config, scenes)
    chosen = None
    if config.detections == NETWORK:
        provider = chosen = BoxesOfClasses(provider, config.classes)
    least = config.min_box_score
    if least is not None:
        provider = BoxesAtLeast(provider, least)
    with Progress(sum(len(scene.frames) for scene in scenes), config.tracker, "frames") as bar:
        tracked = {
            scene.name: track_scene(
                scene, provider, make_tracker(config.tracker), config.classes, bar.update
            )
            for scene in scenes
        }
    if least is not None:
        note_low_scores(provider.largest, least)
    if chosen is not None:
        note_if_others(config.weights, chosen.found, config.classes)
    return tracked


def _results(
    config: EvaluateConfig, scenes: list[Scene], provider: DetectionProvider | None
) -> tuple[dict[str, Objects], float | None]:
    """The evaluated rows, rounded as in a result file, and the least mean score of a track.

    Tracks below it are left out, in the files of `config.out` too.
    """
    if config.results is not None:
        check_folder(config.results)
        tracked = _read(config.results, scenes)
        _note_unusable(config, tracked.values())
    else:
        with tempfile.TemporaryDirectory() as folder:
            tracked = _write(Path(folder), scenes, run_tracker(config, scenes, provider))
    kept, threshold = _above_threshold(config, scenes, tracked)
    if config.out is not None and _writes_tracks(config):
        kept = _write(config.out / TRACKS, scenes, kept)
        _remove_others(config.out, kept)
    elif config.out is not None and not _is_read(config, scenes, config.out / TRACKS):
        _remove_others(config.out, ())
    return kept, threshold


def _writes_tracks(config: EvaluateConfig) -> bool:
    """False for result files that are evaluated as they are."""
    return config.results is None or config.min_track_score is not None


def _note_unusable(config: EvaluateConfig, results: Iterable[Objects]) -> None:
    """Notes result rows that can match nothing: of other classes, or without a 3-D box."""
    rows = Objects.concatenate(results)
    note_other_classes(config.results, rows, config.classes)
    flat = np.isnan(rows.of_classes(config.classes).boxes).any(axis=1)
    solid = ", ".join(name for name in config.protocols if "3d" in name)
    if flat.any() and solid:
        count = f"{int(flat.sum())} of {len(flat)} boxes"
        note(f"{config.results}: {count} are 2-D alone and match nothing in {solid}")


def _above_threshold(
    config: EvaluateConfig, scenes: list[Scene], results: dict[str, Objects]
) -> tuple[dict[str, Objects], float | None]:
    threshold = config.min_track_score
    if threshold == BEST:
        entries = _entries(scenes, results)
        threshold = best_threshold(config.protocols[0], entries, config.classes, config.iou)
    if threshold is None:
        return results, None
    unscored = [name for name, rows in results.items() if np.isnan(rows.score).any()]
    if unscored:
        found = f"sequence {unscored[0]} has none"
        raise InputError(f"--score_threshold: expected scores in the results, {found}")
    types = evaluated_types(config.protocols[0], config.classes) if config.protocols else None
    scores = {name: track_scores(rows, types) for name, rows in results.items()}
    note_low_scores(np.concatenate([*scores.values()]).max(initial=-np.inf), threshold)
    return {n: rows[scores[n] >= threshold] for n, rows in results.items()}, threshold


def _write(folder: Path, scenes: list[Scene], tracked: Mapping[str, Objects]) -> dict[str, Objects]:
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in tracked.items():
        write_results(folder / f"{name}.txt", rows)
    return _read(folder, scenes)


def _remove_others(out: Path, kept: Collection[str]) -> None:
    """Removes the result files that an earlier run's metrics.json names, but for those `kept`.

    And its submission.zip, which holds them.
    """
    record, names = out / METRICS, []
    with contextlib.suppress(InputError, LookupError, TypeError):
        names = parse_json(read_bytes(record), record)["run"]["data"]["sequences"]
        (out / SUBMISSION).unlink(missing_ok=True)
    for name in names if isinstance(names, list) else []:
        if isinstance(name, str) and _NAME.fullmatch(name) and name not in kept:
            (out / TRACKS / f"{name}.txt").unlink(missing_ok=True)


def _read(folder: Path, scenes: list[Scene]) -> dict[str, Objects]:
    paths = {scene.name: sequence_file(folder, scene.name) for scene in scenes}
    for name, path in paths.items():
        if not os.path.lexists(path):
            raise InputError(f"expected a result file {name}.txt for each of --seqs", folder)
    return {s.name: s.sequence.read_results(paths[s.name]) for s in scenes}


def _check_inputs_stay(config: EvaluateConfig, scenes: list[Scene]) -> None:
    """Refuses an output folder whose result files would replace files that are read or others'."""
    tracks = config.out / TRACKS
    if _writes_tracks(config) and _is_read(config, scenes, tracks):
        raise InputError("--out: its result files would replace those that are read", tracks)


def _is_read(config: EvaluateConfig, scenes: list[Scene], folder: Path) -> bool:
    """Whether labels, results or detections of the evaluation are read from a folder."""
    read = {scene.sequence.label_path.parent for scene in scenes}
    if config.results is not None:
        read |= {sequence_file(config.results, scene.name).parent for scene in scenes}
    elif config.detections not in (GROUND_TRUTH, NETWORK):
        read |= {sequence_file(config.detections, scene.name).parent for scene in scenes}
    return folder.is_dir() and any(path.exists() and path.samefile(folder) for path in read)


def check_writable(folder: Path) -> None:
    """Raises InputError if `folder` can be neither written to nor created; creates nothing."""
    try:
        with tempfile.TemporaryFile(dir=_nearest(folder)):
            pass
    except OSError as error:
        reason = error.strerror or os.strerror(error.errno or 0)
        raise InputError(f"--out: cannot be written: {reason}", folder) from error


def _nearest(folder: Path) -> Path:
    """`folder`, or the first folder above it that exists."""
    for path in (folder, *folder.parents):
        with contextlib.suppress(FileNotFoundError):
            path.lstat()
            return path
    return Path()


def _data(config: EvaluateConfig, scenes: list[Scene]) -> dict[str, Any]:
    """Sequences, frames and labelled boxes of the evaluation, for the record."""
    labels = [scene.objects.of_classes(config.classes) for scene in scenes]
    sequences = [scene.sequence for scene in scenes]
    return {
        "sequences": [scene.name for scene in scenes],
        "frames": sum(len(scene.frames) for scene in scenes),
        "labelled_boxes": sum(map(len, labels)),
        "poses": all(sequence.has_poses for sequence in sequences),
        "image_size": {s.name: s.image_size for s in sequences if s.calib_path.is_file()},
    }
