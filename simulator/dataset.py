"""Data sets on disk: jobs over sequences and frames, a pool, resume, manifest.

A job is a stretch of frames of one sequence. Every frame's bytes depend on (seed, sequence,
frame) alone, so neither the number of processes nor an interruption shows in the result.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

from common.errors import InputError
from common.files import write_bytes, write_json
from common.progress import Progress
from kitti.calibration import Calibration
from kitti.labels import write_labels
from kitti.objects import Objects
from kitti.scans import write_scan
from kitti.splits import sequence_name
from simulator import VERSION
from simulator.config import RETURNS, SENSOR, SIZES
from simulator.frames import Options, ego_velocity, take_sweep
from simulator.scan import Scene, Sweep

MANIFEST = "manifest.json"
STRETCH = 200  # most frames a job: each process builds the worlds of its jobs


class World(Protocol):
    """What a driver builds for one sequence; bigger than its frames, so kept by each process."""

    calib: Calibration
    image_size: tuple[int, int]
    poses: Any  # (F, 4, 4)

    def scene(self, frame: int, motion: bool) -> Scene:
        """The scene of `frame`."""

    def labels(self, frame: int, sweep: Sweep) -> Objects | None:
        """Label rows of `frame`; None if `write_texts` writes the labels."""

    def write_texts(self, root: Path, name: str, frames: int) -> None:
        """Writes labels, calibration, oxts and what else is known, for the first `frames`."""


@dataclass(frozen=True)
class Plan:
    """A data set to be made: `driver` names an entry of `simulator.drivers.DRIVERS`, `spec` is
    its JSON-ready description, `frames` says how many frames each sequence has."""

    driver: str
    spec: dict[str, Any]
    seed: int
    frames: dict[int, int]
    options: Options

    def manifest(self) -> dict[str, Any]:
        """What identifies the data set: same manifest, same bytes."""
        return {
            "format": "KITTI tracking, simulated",
            "version": VERSION,
            "driver": self.driver,
            "spec": self.spec,
            "seed": self.seed,
            "frames": {sequence_name(seq): count for seq, count in self.frames.items()},
            "options": asdict(self.options),
            "sensor": asdict(SENSOR),
            "returns": asdict(RETURNS),
            "sizes": asdict(SIZES),
        }


Builder = Callable[[Plan, int], World]


def scan_path(root: Path, seq: int, frame: int) -> Path:
    """Where a scan goes in KITTI's layout."""
    return root / "training" / "velodyne" / sequence_name(seq) / f"{frame:06d}.bin"


def part_path(root: Path, seq: int, frame: int) -> Path:
    """Where one frame's labels wait until all frames of the sequence are there."""
    return root / ".parts" / sequence_name(seq) / f"{frame:06d}.txt"


def label_path(root: Path, seq: int) -> Path:
    """Where labels go in KITTI's layout."""
    return root / "training" / "label_02" / f"{sequence_name(seq)}.txt"


def make_dataset(plan: Plan, root: str | Path, processes: int | None = None) -> bool:
    """Makes or completes the data set in `root`; False if it was there already, complete.

    Raises:
        InputError: `root` holds something else than this very data set, complete or begun.
    """
    root = Path(root)
    manifest = json.loads(json.dumps(plan.manifest()))
    state = _state(root, manifest)
    if state.get("complete") and not _missing(plan, root):
        return False
    write_json(root / MANIFEST, {**manifest, "complete": False})
    jobs = _jobs(plan, root)
    total = sum(plan.frames.values())
    todo = sum(len(frames) for _, frames in jobs)
    processes = min(processes or len(os.sched_getaffinity(0)), max(len(jobs), 1))
    with Progress(total, "simulating", "frames", initial=total - todo) as bar:
        for _ in _run(plan, root, jobs, processes):
            bar.update(todo - _left(root, jobs) - (bar.done - bar.initial))
    for seq, count in plan.frames.items():
        if not label_path(root, seq).is_file():
            parts = (part_path(root, seq, frame).read_bytes() for frame in range(count))
            write_bytes(label_path(root, seq), b"".join(parts))
    shutil.rmtree(root / ".parts", ignore_errors=True)
    write_json(root / MANIFEST, {**manifest, "complete": True})
    return True


def _state(root: Path, manifest: dict[str, Any]) -> dict[str, Any]:
    """The manifest in `root`, if it is of the same data set; {} in an empty or new folder."""
    path = root / MANIFEST
    if not root.exists() or (root.is_dir() and not any(root.iterdir())):
        return {}
    if not path.is_file():
        raise InputError(f"is not empty and has no {MANIFEST}; choose another folder", root)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"expected JSON, {error}", path) from error
    if not isinstance(found, dict):
        raise InputError("expected a JSON object", path)
    other = [key for key in manifest if found.get(key) != manifest[key]]
    if other:
        raise InputError(
            f"holds another data set (differs in {', '.join(other)}); choose another folder", path
        )
    return found


def _missing(plan: Plan, root: Path) -> bool:
    scans = (
        scan_path(root, seq, frame) for seq, count in plan.frames.items() for frame in range(count)
    )
    texts = (
        root / "training" / folder / f"{sequence_name(seq)}.txt"
        for seq in plan.frames
        for folder in ("label_02", "calib", "oxts")
    )
    return not all(path.is_file() for path in (*scans, *texts))


def _jobs(plan: Plan, root: Path) -> list[tuple[int, list[int]]]:
    """(sequence, frames without scan); an empty list of frames still writes the text files."""
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
    """Frames of `jobs` whose scan is not there yet."""
    return sum(not scan_path(root, seq, frame).is_file() for seq, rest in jobs for frame in rest)


def _run(plan: Plan, root: Path, jobs, processes: int) -> Iterator[None]:
    """Runs the jobs; yields now and then, so that progress can be shown."""
    if processes == 1:
        for seq, frames in jobs:
            for first in range(0, max(len(frames), 1), 10):
                _work(plan, root, seq, frames[first : first + 10])
                yield
        return
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"  # the processes share the cores; their matrices are small
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        waiting = {pool.submit(_work, plan, root, seq, frames) for seq, frames in jobs}
        try:
            while waiting:
                done, waiting = wait(waiting, timeout=2.0, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                yield
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _work(plan: Plan, root: Path, seq: int, frames: list[int]) -> None:
    world = _world(json.dumps(asdict(plan), sort_keys=True), seq)
    name = sequence_name(seq)
    if not frames or frames[0] == 0 or not (root / "training" / "calib" / f"{name}.txt").is_file():
        world.write_texts(root / "training", name, plan.frames[seq])
    for frame in frames:
        result = take_sweep(
            world.scene(frame, plan.options.motion_distortion),
            world.calib,
            world.image_size,
            plan.options,
            (plan.seed, seq, frame),
            ego_velocity(world.poses, frame, SENSOR.period_s),
        )
        rows = world.labels(frame, result)
        if rows is not None:
            write_labels(part_path(root, seq, frame), rows)
        write_scan(scan_path(root, seq, frame), result.points)


@lru_cache(maxsize=2)
def _world(plan_json: str, seq: int) -> World:
    """Each process builds a sequence's world once; it is the same in all of them."""
    from simulator.drivers import DRIVERS

    fields = json.loads(plan_json)
    fields["options"] = Options(**fields["options"])
    fields["frames"] = {int(key): count for key, count in fields["frames"].items()}
    plan = Plan(**fields)
    return DRIVERS[plan.driver](plan, seq)
