"""What demo.py does, step by step; each step is skipped if it is done."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.files import write_json, write_text
from common.provenance import ROOT, provenance
from common.steps import Steps, key_of
from evaluation.config import NETWORK, EvaluateConfig
from evaluation.network_cache import CachedPredictions
from evaluation.run import TRACKS, check_writable
from evaluation.scene import Scene
from evaluation.side_by_side import SIDE_BY_SIDE, displaced_scenes, evaluate_cached
from experiments.comparison_table import HEADER, comparison_markdown, comparison_rows
from kitti.labels import Objects, read_results
from simulator.__main__ import OWN_SEQUENCES
from simulator.__main__ import main as simulate
from visualization.clip import Clip
from visualization.gallery import draw_network, draw_scene, draw_tracks, pictures
from visualization.page import page

PICTURE_CODE = {
    "modules": ["visualization.gallery", "visualization.page"],
    "files": sorted((ROOT / "visualization" / "web").iterdir()),
}
SCENE = "scene.html"
SCENE_CAPTION = "The drive in 3-D, to turn: two trackers side by side, errors marked frame by frame"
TITLE = "PointTrackNet: trackers side by side"


@dataclass(frozen=True)
class DemoConfig:
    """The demo's settings; the defaults take less than five minutes on two cores.

    Attributes:
        out: folder for everything that is made.
        weights: folder with detector.npz and tracker.npz.
        sequences, frames: how many simulated held-out sequences, of how many frames.
        data_root, seqs: recorded data in place of simulated.
        displacements: metres, section IV.D of the paper; the pictures need 0 to be the first.
        iou: least 3-D IoU of a match in clear3d.
        score_threshold: least mean score of a track or "best", for every tracker alike; the
            default was chosen on the simulated training sequence 0011 (90 frames, both
            displacements; 0.2 to 0.4 were tried).
    """

    out: Path = Path("results/demo")
    weights: Path = Path("weights")
    sequences: int = 2
    frames: int = 80
    data_root: Path | None = None
    seqs: tuple[int, ...] = ()
    displacements: tuple[float, ...] = (0.0, 2.0)
    iou: float = 0.5
    score_threshold: float | str = 0.33
    trackers: tuple[str, ...] = field(default=SIDE_BY_SIDE)

    def __post_init__(self):
        if self.displacements[:1] != (0.0,) or len(set(self.displacements)) < len(
            self.displacements
        ):
            raise InputError(
                f"--displacements: expected 0 and then others, found {self.displacements}"
            )


def run_demo(config: DemoConfig) -> dict[str, Any]:
    """All steps; prints the table and the paths, returns what metrics.json holds."""
    check_writable(config.out)
    demo = Demo(config)
    demo.make_data()
    demo.record()
    records = {d: demo.evaluate(d) for d in config.displacements}
    demo.draw()
    demo.draw_drive()
    return demo.report(records)


class Demo:
    """The steps of one demo."""

    def __init__(self, config: DemoConfig):
        self.config, self.steps = config, Steps(config.out)
        self.cached = CachedPredictions(config.out / "network_cache", config.weights)
        self.simulated = config.data_root is None
        self.data_root = config.out / "data" if self.simulated else config.data_root
        first = OWN_SEQUENCES["val"][0]
        self.seqs = tuple(range(first, first + config.sequences)) if self.simulated else config.seqs

    def make_data(self) -> None:
        """Simulates the held-out sequences, unless they are there or the data is given."""
        if self.simulated:
            counts = ["--sequences", self.config.sequences, "--frames", self.config.frames]
            argv = ["--out", self.data_root, "--split", "val", *counts]
            simulate([str(value) for value in argv])

    def evaluation(self, distance: float) -> EvaluateConfig:
        """The configuration that all trackers share at a displacement."""
        return EvaluateConfig(
            data_root=self.data_root,
            seqs=self.seqs,
            detections=NETWORK,
            tracker="pointtracknet",
            weights=self.config.weights,
            displacement=distance,
            iou=self.config.iou,
            score_threshold=self.config.score_threshold,
        )

    @cached_property
    def scenes(self) -> dict[float, list[Scene]]:
        """Displacement -> scenes."""
        return {d: displaced_scenes(self.evaluation(d)) for d in self.config.displacements}

    def record(self) -> None:
        """One pass of the networks over every scene."""
        kept = [self.cached.path(scene) for scenes in self.scenes.values() for scene in scenes]
        for path in self.cached.folder.glob("*.npz"):
            if path not in kept:  # of other weights, data or code
                path.unlink()
        for distance, scenes in self.scenes.items():
            self.cached.fill_all(scenes, f"networks, D = {distance:g} m")

    def evaluate(self, distance: float) -> dict[str, Any]:
        """Every tracker on the same boxes: tracker -> its record."""
        boxes = [self.cached.path(scene).name for scene in self.scenes[distance]]
        config = self.evaluation(distance)
        key = key_of(boxes, config, modules=["evaluation.side_by_side"])
        records = {}
        for tracker in self.config.trackers:
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
        """Where a tracker's result files are."""
        return self.config.out / f"{tracker}-{distance:g}m"

    def clips(self) -> list[Clip]:
        """PointTrackNet's tracks of one sequence, at every displacement."""
        scenes = [scenes[self._shown] for scenes in self.scenes.values()]
        return [
            Clip.of_scene(scene, self._tracks(distance, scene, "pointtracknet"))
            for distance, scene in zip(self.scenes, scenes, strict=True)
        ]

    @cached_property
    def _shown(self) -> int:
        """The sequence with most labelled vehicles is the one in the pictures."""
        first = next(iter(self.scenes.values()))
        counts = [len(scene.objects.of_classes(self.evaluation(0).classes)) for scene in first]
        return counts.index(max(counts))

    def _tracks(self, distance: float, scene: Scene, tracker: str) -> Objects:
        folder = self.folder(distance, tracker) / TRACKS
        return read_results(folder / f"{scene.name}.txt", scene.num_frames)

    def draw(self) -> None:
        """All pictures."""
        folder, weights = self.config.out, self.config.weights
        files = [picture.path for picture in pictures(folder)]
        tracks = [
            (self.folder(d, "pointtracknet") / "record.json").read_bytes()
            for d in self.config.displacements
        ]
        key = key_of(tracks, **PICTURE_CODE)
        clips = self.clips()
        source = "simulated" if self.simulated else "recorded"
        titles = [
            f"{source} sequence {clips[0].name}, displacement {d:g} m"
            for d in self.config.displacements
        ]
        self.steps.run("tracks", key, files, lambda: draw_tracks(clips, titles, folder))
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
        """The drive of the pictures in 3-D: two trackers at the largest displacement."""
        distance = max(self.config.displacements)
        scene, path = self.scenes[distance][self._shown], self.config.out / SCENE
        trackers = {name: self._tracks(distance, scene, name) for name in self.config.trackers[:2]}
        files = [self.folder(distance, name) / "record.json" for name in trackers]
        key = key_of([file.read_bytes() for file in files], **PICTURE_CODE)
        clip = Clip.of_scene(scene, Objects.empty())
        title = f"sequence {scene.name}, displacement {distance:g} m"
        self.steps.run("scene", key, [path], lambda: draw_scene(clip, trackers, title, path))

    def report(self, records: dict[float, dict[str, Any]]) -> dict[str, Any]:
        """Writes metrics.json, table.md and index.html; prints the table and the paths."""
        out = self.config.out
        rows = comparison_rows(records, "ours, simulated" if self.simulated else "ours")
        notes = self._notes()
        table = comparison_markdown(rows)
        shares = json.loads((out / "sampling.json").read_text(encoding="utf-8"))
        run = provenance(
            data=self._data(),
            score_threshold=self.config.score_threshold,
            iou=self.config.iou,
            weights_sha256={
                name: hashlib.sha256((self.config.weights / name).read_bytes()).hexdigest()
                for name in ("detector.npz", "tracker.npz")
            },
        )
        metrics = {
            "run": run,
            "notes": notes,
            "figures": {f"{d:g}": records[d] for d in records},
            "sampled_points_on_vehicles": shares,
        }
        write_json(out / "metrics.json", metrics)
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
        first = next(iter(self.scenes.values()))
        return {
            "source": "simulated, held-out traffic" if self.simulated else str(self.data_root),
            "sequences": {scene.name: scene.num_frames for scene in first},
        }

    def _notes(self) -> list[str]:
        source = (
            "Our rows: simulated held-out traffic, which the networks never saw"
            if self.simulated
            else f"Our rows: {self.data_root}, with networks trained on simulation only"
        )
        frames = sum(self._data()["sequences"].values())
        return [
            f"{source}: {len(self.seqs)} sequences, {frames} frames. The paper's rows: KITTI's "
            "validation sequences, so they stand beside ours, not against them.",
            f"Protocol clear3d, 3-D IoU at least {self.config.iou:g}; tracks of mean score "
            f"{self.config.score_threshold} or more; every tracker gets the same "
            "boxes from the detector. D: objects displaced at random by up to D metres in each "
            "frame. s/frame: networks (without the displacement for the baselines) and tracker, "
            "on this machine; the paper's on a GTX 1080 Ti.",
        ]
