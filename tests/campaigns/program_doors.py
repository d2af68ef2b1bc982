"""Flags of the scripts, the library and the ops: a door is a function of folder and generator."""

import contextlib
import io
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import tensorflow as tf

import evaluate
import tf_ops
import track
import train_det
import train_track
import visualize
from campaigns.mutations import damaged_points, nasty_word
from common import flags
from common.errors import InputError
from models.boxes.box_decoding import Detections
from pointtracknet import Tracker
from simulator import __main__ as simulator

ABSENT = "/nonexistent"
SCRIPTS = {
    evaluate: (
        *("--data_root", "--seqs", "--iou", "--seed", "--protocol", "--score_threshold"),
        *("--classes", "--tracker", "--object_shift", "--config"),
    ),
    track: (
        *("--scans", "--calib", "--image_size", "--scan_columns", "--scan_dtype", "--format"),
        *("--scan_scale", "--animation_frames", "--config"),
    ),
    train_det: (
        *("--data_root", "--share", "--seqs", "--workers", "--detector.num_points"),
        *("--detector.set_upconv", "--detector.box.classes", "--loss.mask", "--query_points"),
        *("--schedule.epochs", "--schedule.seed", "--schedule.clip_norm", "--schedule.epsilon"),
    ),
    train_track: (
        *("--schedule.batch_size", "--schedule.keep_checkpoints", "--schedule.beta1"),
        *("--tracker.set_abstraction", "--tracker.association_radius", "--deep_supervision"),
    ),
    visualize: ("--seq", "--frame", "--displacements", "--results", "--seed"),
    simulator: ("--split", "--sequences", "--frames", "--seqs", "--seed", "--processes"),
}
"""Some of their flags."""
REQUIRED = {
    evaluate: ["--data_root", ABSENT],
    track: ["--scans", ABSENT, "--out", ABSENT],
    train_det: ["--data_root", ABSENT, "--workdir", ABSENT],
    train_track: ["--data_root", ABSENT, "--workdir", ABSENT, "--detector", ABSENT],
    visualize: ["birds_eye", "--data_root", ABSENT, "--seq", "0000", "--out", "x.png"],
    simulator: [],
}


def command_lines(folder: Path, rng: np.random.Generator) -> None:
    """A script with odd values of its flags, without data or output folder: exit code 2."""
    script = list(SCRIPTS)[rng.integers(len(SCRIPTS))]
    argv = list(REQUIRED[script])
    if script not in (train_det, train_track):
        argv += ["--out", str(folder / "out")]
    for _ in range(rng.integers(1, 4)):
        name, word = SCRIPTS[script][rng.integers(len(SCRIPTS[script]))], nasty_word(rng)
        argv += [f"{name}={word}"] if rng.random() < 0.5 else [name, word]
    argv = [word.replace("\0", "") for word in argv]  # no process can be given one
    (folder / "out").write_text("taken")
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
        try:
            code = flags.run(script.main, argv)
        except SystemExit as end:
            code = end.code
    assert code == 2, f"exit code {code}: {argv}"
    assert errors.getvalue().count("\n") == 1, errors.getvalue()


class ScriptedNetwork:
    """Finds one car where the first point is."""

    def __init__(self):
        box = SimpleNamespace(classes=("Car", "Van"))
        self.detector = SimpleNamespace(config=SimpleNamespace(box=box))

    def detect(self, points, t):
        """A box of 4 x 1.8 x 1.5 m around the first point."""
        count = min(len(points), 1)
        boxes = np.array([[0.0, 0, 0, 4, 1.8, 1.5, 0]] * count).reshape(-1, 7)
        boxes[:, :3] = points[:count, :3]
        found = Detections(boxes, np.ones(count), np.zeros(count, np.int32))
        return SimpleNamespace(
            points=boxes[:, :3], foreground=np.ones(count), detections=found, encoded=None
        )

    def displacement(self, previous, current):
        """No movement."""
        return np.zeros_like(previous.points)


def library(_folder: Path, rng: np.random.Generator) -> None:
    """A damaged scan is taken or refused; the tracker then works on a good one."""
    tracker = Tracker(ScriptedNetwork())
    good = np.array([[10.0, 0, 0, 0.5]] * 5)
    tracker.update(good)
    points = damaged_points(rng)
    if rng.random() < 0.2:
        points = points[:, : rng.integers(0, 3)] if rng.random() < 0.5 else points[None, None]
    with contextlib.suppress(InputError):
        tracker.update(points)
    tracks = tracker.update(good)
    assert len(tracks) >= 1 and np.isfinite(tracks.boxes).all()


@cache
def _operations() -> dict[str, Callable]:
    """Neighbour searches and samplers of (points, queries, number), giving indices into points."""
    return {
        "knn_point": lambda a, b, k: tf_ops.knn_point(k, a, b)[1],
        "query_ball_point": lambda a, b, k: tf_ops.query_ball_point(1.5, k, a, b)[0],
        "farthest_point_sample": lambda a, b, k: tf_ops.farthest_point_sample(k, a),
        "three_nn": lambda a, b, k: tf_ops.three_nn(b, a)[1],
    }


def operations(_folder: Path, rng: np.random.Generator) -> None:
    """Ops on impossible points: indices lie in the cloud, or the op refuses."""
    name = list(_operations())[rng.integers(len(_operations()))]
    clouds = [damaged_points(rng)[None, :, :3].astype(np.float32) for _ in range(2)]
    try:
        index = _operations()[name](*clouds, int(rng.integers(1, 40))).numpy()
    except (tf.errors.InvalidArgumentError, ValueError):
        return
    assert ((index >= 0) & (index < max(clouds[0].shape[1], 1))).all(), name


PROGRAM_DOORS: tuple[Callable[[Path, np.random.Generator], None], ...] = (
    command_lines,
    library,
    operations,
)
