"""Makes data sets on disk; completes interrupted ones and reuses complete ones."""

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

from common.config import parse_json
from common.errors import InputError
from common.files import temporary_of, write_bytes, write_json
from common.progress import Progress
from kitti.seqmap import SEQMAP, sequence_name, write_seqmap
from simulator.plan import Plan, label_path, part_path, scan_path
from simulator.pool import run_jobs

MANIFEST = "manifest.json"
OWN_NAMES = rf"{re.escape(MANIFEST)}|{re.escape(SEQMAP)}\.training|\d{{4}}\.txt|\d{{6}}\.(bin|txt)"
SHOWN = 4  # most names of differences in a message
STRETCH = 200  # most frames of a job; each process builds the worlds of its jobs


def make_dataset(plan: Plan, root: str | Path, processes: int | None = None) -> bool:
    """Makes or completes the data set in `root`; returns False if it was complete.

    Raises:
        InputError: `root` contains anything other than this data set, complete or partial.
    """
    root = Path(root)
    manifest = json.loads(json.dumps(plan.manifest()))
    state = _state(root, manifest)
    if state.get("complete") and not _missing(plan, root):
        return False
    _remove_leftovers(root)
    write_json(root / MANIFEST, {**manifest, "complete": False})
    jobs = _jobs(plan, root)
    total = sum(plan.frames.values())
    todo = sum(len(frames) for _, frames in jobs)
    processes = min(processes or len(os.sched_getaffinity(0)), max(len(jobs), 1))
    with Progress(total, "simulating", "frames", initial=total - todo) as bar:
        for _ in run_jobs(plan, root, jobs, processes):
            bar.update(todo - _left(root, jobs) - (bar.done - bar.initial))
    for seq, count in plan.frames.items():
        if not label_path(root, seq).is_file():
            parts = (part_path(root, seq, frame).read_bytes() for frame in range(count))
            write_bytes(label_path(root, seq), b"".join(parts))
    write_seqmap(root, "training", plan.frames)
    shutil.rmtree(root / ".parts", ignore_errors=True)
    write_json(root / MANIFEST, {**manifest, "complete": True})
    return True


def _state(root: Path, manifest: dict[str, Any]) -> dict[str, Any]:
    """The manifest in `root` if it describes the same data set; {} in an empty or new folder.

    A folder in which a first run was killed before it had its manifest counts as empty.
    """
    path = root / MANIFEST
    if not root.exists():
        return {}
    if not root.is_dir():
        raise InputError("expected a folder, found a file", root)
    if all(temporary_of(each) == MANIFEST for each in root.iterdir()):
        return {}
    if not path.is_file():
        raise InputError(f"is not empty and has no {MANIFEST}; choose another folder", root)
    found = parse_json(path.read_bytes(), path)
    if not isinstance(found, dict):
        raise InputError("expected a JSON object", path)
    other = _differences(found, manifest)
    if other:
        shown = ", ".join([*other[:SHOWN], *["..."] * (len(other) > SHOWN)])
        raise InputError(
            f"holds another data set (differs in {shown}); choose another folder", path
        )
    return found


def _differences(found: dict[str, Any], manifest: dict[str, Any]) -> list[str]:
    """Names of what identifies a data set and differs; of a replay's source, the files.

    The path of the source is a record alone: the digests of its files identify it.
    """
    names = [key for key in manifest if key != "spec" and found.get(key) != manifest[key]]
    before, now = _settings(found.get("spec")), _settings(manifest["spec"])
    return names + [key for key in {**now, **before} if before.get(key) != now.get(key)]


def _settings(spec: Any) -> dict[str, Any]:
    """The settings of a plan by name, files of the source by theirs, such as poses/0016."""
    if not isinstance(spec, dict):
        return {}
    files = spec.get("files")
    rest = {key: value for key, value in spec.items() if key not in ("from_labels", "files")}
    return {**rest, **(files if isinstance(files, dict) else {})}


def _remove_leftovers(root: Path) -> None:
    """Removes the temporary files of the data set that a killed run left."""
    for path in root.rglob(".*"):
        name = temporary_of(path)
        if name is not None and re.fullmatch(OWN_NAMES, name, re.ASCII) and path.is_file():
            path.unlink()


def _missing(plan: Plan, root: Path) -> bool:
    scans = (
        scan_path(root, seq, frame) for seq, count in plan.frames.items() for frame in range(count)
    )
    texts = [root / "training" / f"{SEQMAP}.training"]
    for seq in plan.frames:
        folders = ["training/label_02", "training/calib", "training/oxts"]
        folders += ["poses"] if plan.has_poses(seq) else []
        texts += [root / folder / f"{sequence_name(seq)}.txt" for folder in folders]
    return not all(path.is_file() for path in (*scans, *texts))


def _jobs(plan: Plan, root: Path) -> list[tuple[int, list[int]]]:
    """(sequence, frames without scan); with no frames only the text files are written."""
    cores = len(os.sched_getaffinity(0))
    jobs = []
    for seq, count in plan.frames.items():
        labelled = label_path(root, seq).is_file() or plan.driver == "labels"
        rest = [
            frame
            for frame in range(count)
            if not scan_path(root, seq, frame).is_file()
            or not (labelled or part_path(root, seq, frame).is_file())
        ]
        share = STRETCH if len(plan.frames) >= 2 * cores else -(-len(rest) // cores)
        size = max(min(STRETCH, share), 1)
        parts = [rest[first : first + size] for first in range(0, len(rest), size)]
        jobs += [(seq, part) for part in parts or [[]]]
    return sorted(jobs, key=lambda job: -len(job[1]))


def _left(root: Path, jobs) -> int:
    """Number of frames of `jobs` without a scan."""
    return sum(not scan_path(root, seq, frame).is_file() for seq, rest in jobs for frame in rest)
