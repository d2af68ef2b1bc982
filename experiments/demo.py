"""The demo: data, networks, trackers, pictures, page; finished steps are skipped."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from common import flags
from common.config import to_dict
from common.config_flags import option
from common.errors import InputError
from common.files import write_json, write_text
from common.markdown import cell, markdown
from common.provenance import ROOT, provenance
from common.steps import Steps, key_of
from evaluation.config import NETWORK, EvaluateConfig, parse_seqs
from evaluation.network_cache import CachedPredictions
from evaluation.run import TRACKS, check_writable
from evaluation.scene import Scene
from evaluation.side_by_side import SIDE_BY_SIDE, evaluate_cached
from experiments.paper import TABLE5, TABLE5_COLUMNS
from experiments.record import data_record
from experiments.runs import TRACKER_NAMES
from kitti.labels import read_results
from kitti.object_shift import MAX_DISTANCE
from kitti.objects import VEHICLES, Objects
from models.weight_files import network_files, weights_sha256
from simulator.__main__ import OWN_SEQUENCES
from simulator.__main__ import main as simulate
from visualization.animation import MAX_FRAMES
from visualization.clip import Clip
from visualization.gallery import (
    draw_network,
    draw_scene,
    draw_tracks,
    pictures,
    sequence_title,
)
from visualization.page import page

PICTURE_CODE = {
    "modules": ["visualization.gallery", "visualization.page"],
    "files": sorted((ROOT / "visualization" / "web").iterdir()),
}
CACHE = "demo_cache"  # of the demo alone, which deletes what it no longer needs
SCENE = "scene.html"
BOXES = "boxes.json"
SCENE_CAPTION = "The drive in 3-D, to turn: two trackers side by side, errors marked frame by frame"
TITLE = "PointTrackNet: trackers side by side"
HEADER = ("method", "D (m)", "from", *TABLE5_COLUMNS, "s/frame")
PAPER_SECONDS = {"PointTrackNet": 0.099}  # Table II, N = 15000, N' = 5000, GTX 1080 Ti
PAPER = "paper, KITTI"
FEW_POINTS = 10
Row = tuple[str, list[str]]


@dataclass(frozen=True)
class DemoConfig:
    """Settings of demo.py, one flag per field; the defaults take minutes on two cores."""

    out: Path = option(Path("results/demo"), "output folder")
    weights: Path = option(Path("weights"), "folder of the networks' weights")
    sequences: int = option(2, "number of simulated sequences", flags.positive_int, least=1)
    frames: int = option(80, "of each simulated sequence", flags.positive_int, least=1)
    data_root: Path | None = option(None, "own data in KITTI's tracking layout, not simulated")
    seqs: tuple[int, ...] | None = option(
        None, "of --data_root, such as 0000 or 0016-0020", parse_seqs
    )
    object_shifts: tuple[float, ...] = option(
        (0.0, 2.0),
        "metres, section IV.D; 0 comes first",
        flags.non_negative_floats,
        ("object_shifts", "displacements"),
        least=0,
        most=MAX_DISTANCE,
    )
    iou: float = option(EvaluateConfig.iou, "least 3-D IoU of a match", flags.finite_float)
    score_threshold: float | None = option(
        None, "least score of a box (default: that of the weights)", flags.finite_float
    )
    animation_frames: int = option(
        MAX_FRAMES, "at most, of the animation; 0: all", flags.non_negative_int, least=0
    )

    def __post_init__(self):
        shifts = self.object_shifts
        if shifts[:1] != (0.0,) or len(set(shifts)) < len(shifts):
            raise InputError(f"--object_shifts: expected 0 and then others, found {shifts}")
        if (self.data_root is None) != (self.seqs is None):
            raise InputError("--data_root and --seqs go together")


def run_demo(config: DemoConfig) -> dict[str, Any]:
    """Runs all steps; prints the table and the paths, returns the content of metrics.json."""
    check_writable(config.out)
    demo = Demo(config)
    network_files(config.weights)  # raises where one is missing
    for distance in config.object_shifts:
        demo.evaluation(distance)  # raises where a setting is out of range
    from tf_ops.devices import describe_device

    print(describe_device(), flush=True)
    demo.make_data()
    demo.fill_cache()
    demo.count_points()
    records = {d: demo.evaluate(d) for d in config.object_shifts}
    demo.draw()
    demo.draw_drive()
    return demo.report(records)


class Demo:
    """The steps of one demo."""

    def __init__(self, config: DemoConfig):
        self.config, self.steps = config, Steps(config.out)
        self.cached = CachedPredictions(config.out / CACHE, config.weights)
        self.simulated = config.data_root is None
        self.data_root = config.out / "data" if self.simulated else config.data_root
        first = OWN_SEQUENCES["val"][0]
        self.seqs = tuple(range(first, first + config.sequences)) if self.simulated else config.seqs

    def make_data(self) -> None:
        """Simulates the held-out sequences, unless they exist or --data_root is given."""
        if self.simulated:
            counts = ["--sequences", self.config.sequences, "--frames", self.config.frames]
            argv = ["--out", self.data_root, "--split", "val", *counts]
            simulate([str(value) for value in argv])

    def evaluation(self, distance: float) -> EvaluateConfig:
        """The configuration that all trackers share at an object shift."""
        return EvaluateConfig(
            data_root=self.data_root,
            seqs=self.seqs,
            detections=NETWORK,
            tracker="pointtracknet",
            weights=self.config.weights,
            object_shift=distance,
            iou=self.config.iou,
            score_threshold=self.config.score_threshold,
        )

    @cached_property
    def scenes(self) -> dict[float, list[Scene]]:
        """Object shift -> scenes."""
        return {d: self.evaluation(d).open_scenes() for d in self.config.object_shifts}

    def fill_cache(self) -> None:
        """Runs the networks once over every scene."""
        kept = [self.cached.path(scene) for scenes in self.scenes.values() for scene in scenes]
        for path in self.cached.folder.glob("*.npz"):
            if path not in kept:  # cached with other weights, data or code
                path.unlink()
        for distance, scenes in self.scenes.items():
            self.cached.fill_all(scenes, f"networks, D = {distance:g} m")

    def count_points(self) -> None:
        """Counts the labelled boxes, and those of few points, which a detector hardly finds."""
        scenes = self.scenes[0.0]
        key = key_of([self.cached.path(scene).name for scene in scenes], FEW_POINTS)

        def make():
            counts = np.concatenate([_points_of_boxes(scene) for scene in scenes])
            few = int((counts <= FEW_POINTS).sum())
            write_json(self.config.out / BOXES, {"labelled": len(counts), "few_points": few})

        self.steps.run("boxes", key, [self.config.out / BOXES], make)

    def evaluate(self, distance: float) -> dict[str, Any]:
        """Every tracker on the same boxes: tracker -> its record."""
        scenes, config = self.scenes[distance], self.evaluation(distance)
        boxes = [self.cached.path(scene).name for scene in scenes]
        poses = [s.sequence.poses_path for s in scenes if s.sequence.has_poses]
        key = key_of(boxes, config, modules=["evaluation.side_by_side"], files=poses)
        records = {}
        for tracker in SIDE_BY_SIDE:
            path = self.folder(distance, tracker) / "record.json"
            self.steps.run(
                f"{tracker} {distance:g}", key, [path], self._evaluation(distance, tracker, path)
            )
            records[tracker] = json.loads(path.read_text(encoding="utf-8"))
        return records

    def _evaluation(self, distance: float, tracker: str, path: Path) -> Callable[[], None]:
        def make():
            config = self.evaluation(distance)
            write_json(path, evaluate_cached(config, self.cached, tracker, path.parent))

        return make

    def folder(self, distance: float, tracker: str) -> Path:
        """Folder of a tracker's result files."""
        return self.config.out / f"{tracker}-{distance:g}m"

    def clips(self) -> list[Clip]:
        """PointTrackNet's tracks of one sequence, at every object shift."""
        scenes = [scenes[self._shown] for scenes in self.scenes.values()]
        return [
            Clip.of_scene(scene, self._tracks(distance, scene, "pointtracknet"))
            for distance, scene in zip(self.scenes, scenes, strict=True)
        ]

    @cached_property
    def _shown(self) -> int:
        """Index of the sequence in the pictures: the one with most labelled vehicles."""
        first = next(iter(self.scenes.values()))
        counts = [len(scene.objects.of_classes(self.evaluation(0).classes)) for scene in first]
        return counts.index(max(counts))

    def _tracks(self, distance: float, scene: Scene, tracker: str) -> Objects:
        folder = self.folder(distance, tracker) / TRACKS
        return read_results(folder / f"{scene.name}.txt", scene.num_frames)

    def draw(self) -> None:
        """Draws all pictures."""
        folder, weights = self.config.out, self.config.weights
        files = [picture.path for picture in pictures(folder)]
        tracks = [
            (self.folder(d, "pointtracknet") / "record.json").read_bytes()
            for d in self.config.object_shifts
        ]
        key = key_of(tracks, **PICTURE_CODE)
        clips = self.clips()
        source = "simulated" if self.simulated else "recorded"
        shifts = self.config.object_shifts
        titles = [f"{source} {sequence_title(clips[0].name, d)}" for d in shifts]
        most = self.config.animation_frames
        drawn = key_of([key, most])
        self.steps.run("tracks", drawn, files, lambda: draw_tracks(clips, titles, folder, most))
        shares = folder / "sampling.json"
        self.steps.run(
            "network",
            key,
            [*files, shares],
            lambda: write_json(
                shares,
                draw_network(
                    clips[0],
                    weights,
                    titles[0],
                    folder / "sampling.png",
                    folder / "association.png",
                ),
            ),
        )

    def draw_drive(self) -> None:
        """Writes the 3-D scene: two trackers at the largest object shift."""
        distance = max(self.config.object_shifts)
        scene, path = self.scenes[distance][self._shown], self.config.out / SCENE
        trackers = {name: self._tracks(distance, scene, name) for name in ("pointtracknet", "sort")}
        files = [self.folder(distance, name) / "record.json" for name in trackers]
        iou = self.config.iou
        key = key_of([file.read_bytes() for file in files], iou, **PICTURE_CODE)
        clip = Clip.of_scene(scene, Objects.empty())
        title = sequence_title(scene.name, distance)

        def make():
            draw_scene(clip, trackers, title, path, min_iou=iou)

        self.steps.run("scene", key, [path], make)

    def report(self, records: dict[float, dict[str, Any]]) -> dict[str, Any]:
        """Writes metrics.json, table.md and index.html; prints the table and the paths."""
        out = self.config.out
        rows = comparison_rows(records, "ours, simulated" if self.simulated else "ours")
        boxes = json.loads((out / BOXES).read_text(encoding="utf-8"))
        notes = self._notes(boxes)
        table = markdown(HEADER, [cells for _, cells in rows])
        shares = json.loads((out / "sampling.json").read_text(encoding="utf-8"))
        run = provenance(
            config=to_dict(self.config),
            data=self._data(),
            weights_sha256=weights_sha256(self.config.weights),
            min_box_score=self.evaluation(0.0).min_box_score,
        )
        metrics = {
            "run": run,
            "notes": notes,
            "boxes": boxes,
            "figures": {f"{d:g}": records[d] for d in records},
            "sampled_points_on_vehicles": shares,
        }
        write_json(out / "metrics.json", metrics)
        write_json(out / "config.json", run)
        made = f"Made by `{run['command']}`."
        parts = [f"# {TITLE}", notes[0], table.rstrip(), *notes[1:], made]
        write_text(out / "table.md", "\n\n".join(parts) + "\n")
        html = page(TITLE, notes, HEADER, rows, pictures(out), {SCENE: SCENE_CAPTION})
        write_text(out / "index.html", html)
        print(table + "".join(f"\n{note}\n" for note in notes))
        for path in ("table.md", "metrics.json", "index.html", SCENE):
            print(out / path)
        for picture in pictures(out):
            print(picture.path)
        return metrics

    def _data(self) -> dict[str, Any]:
        source = "simulated, held-out traffic" if self.simulated else str(self.data_root)
        return {"source": source, **data_record(self.data_root, self.seqs)}

    def _notes(self, boxes: Mapping[str, int]) -> list[str]:
        source = (
            "Our rows: simulated traffic that is held out of training"
            if self.simulated
            else f"Our rows: {self.data_root}"
        )
        frames = sum(self._data()["sequences"].values())
        return [
            f"{source}: {len(self.seqs)} sequences, {frames} frames. The paper's rows: KITTI's "
            "validation sequences, so they are not comparable with ours.",
            f"{boxes['few_points']} of the {boxes['labelled']} labelled boxes hold at most "
            f"{FEW_POINTS} points (D = 0).",
            f"Protocol clear3d, 3-D IoU at least {self.config.iou:g}; boxes of score "
            f"{self.evaluation(0.0).min_box_score:.3g} or more; every tracker gets the same "
            "boxes from the detector. D: objects shifted at random by up to D metres in each "
            "frame. s/frame: networks (the displacement for PointTrackNet alone, pooled features "
            "for DEEP_SORT alone) and tracker, on this machine; the paper's on a GTX 1080 Ti.",
        ]


def _points_of_boxes(scene: Scene) -> np.ndarray:
    """(R,) points in each labelled box of the classes that are evaluated, frame by frame."""
    objects = scene.objects.of_classes(VEHICLES)
    counts = [scene.points_in(t, objects.at(t).boxes) for t in scene.frames]
    return np.concatenate([np.zeros(0, int), *counts])


def comparison_rows(records: Mapping[float, Mapping[str, Any]], ours: str) -> list[Row]:
    """The demo's table with the paper's rows beside ours; each row with its class.

    The class is "ours" (PointTrackNet), "paper" or "".

    Args:
        records: object shift -> tracker -> the record of `evaluate_cached`.
        ours: name of our data in the third column, such as "ours, simulated".
    """
    rows: list[Row] = []
    for distance, trackers in records.items():
        for tracker, record in trackers.items():
            name, metrics = TRACKER_NAMES[tracker], record["clear3d"]["overall"]
            seconds = record["seconds_per_frame"]["total"]
            cells = [cell(metrics[column], 3) for column in TABLE5_COLUMNS]
            kind = "ours" if tracker == "pointtracknet" else ""
            rows.append((kind, [name, f"{distance:g}", ours, *cells, f"{seconds:.3f}"]))
            printed = TABLE5["predicted"].get(name, {}).get(distance)
            if printed is not None:
                time = PAPER_SECONDS.get(name)
                cells = [cell(value, 3) for value in (*printed, time)]
                rows.append(("paper", [name, f"{distance:g}", PAPER, *cells]))
    return rows
