"""Simulated against real scans: KITTI tracking sequence 0000, replayed from its own labels.

    python -m studies.simulator_fidelity --data_root KITTI --out DIR

Simulates the frames that have real scans, prints the table (goals beside it), writes it to
DIR/fidelity.json, and draws bird's-eye views and range images side by side (fidelity.png).
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import write_json
from common.flags import ArgumentParser, non_negative_int, positive_int, run
from common.markdown import markdown
from common.progress import progress
from common.provenance import provenance
from kitti.objects import VEHICLES
from kitti.sequence import KittiSequence
from simulator.drives.replay import Replay, replay
from simulator.fidelity import FrameCounts, compare_frame, summarise
from simulator.sensor_model.frames import Options, take_sweep

GOALS = {
    "points per frame, ratio": (0.85, 1.15),
    "points per vehicle, median ratio": (0.8, 1.25),
    "points per vehicle, Spearman": (0.85, 1.0),
    "points per vehicle 0-15 m, median ratio": (0.7, 1.4),
    "points per vehicle 15-30 m, median ratio": (0.7, 1.4),
    "points per vehicle 30-50 m, median ratio": (0.7, 1.4),
    "beams per vehicle, median ratio": (0.8, 1.2),
    "beams per vehicle, mean ratio": (0.8, 1.2),
}


def parser() -> ArgumentParser:
    """The flags."""
    result = ArgumentParser(description=__doc__.split("\n")[0])
    result.add_argument("--data_root", type=Path, required=True, help="KITTI's tracking layout")
    result.add_argument("--out", type=Path, required=True, help="folder for table and pictures")
    result.add_argument("--seq", type=non_negative_int, default=0, help="sequence with scans")
    result.add_argument("--every", type=positive_int, default=1, help="use every n-th frame")
    result.add_argument("--seeds", type=positive_int, default=3, help="worlds to average over")
    result.add_argument(
        "--pictures", type=non_negative_int, nargs="*", default=[20, 140], help="frames to draw"
    )
    return result


def simulate(sequence: KittiSequence, world: Replay, frame: int, seed: int) -> np.ndarray:
    """A simulated scan (n, 4) of the level frame."""
    where = (sequence.calib, sequence.image_size, Options(), (seed, sequence.seq, frame))
    points = take_sweep(world.scene(frame), *where).points
    points[:, :3] = sequence.calib.velo_to_level(points[:, :3])
    return points


def table(rows: dict[str, float | int | None]) -> str:
    """The measures as a Markdown table with the goals."""
    return markdown(
        ("measure", "value", "goal"),
        [
            (
                name,
                f"{value:.3f}" if isinstance(value, float) else value,
                "{} to {}".format(*GOALS[name]) if name in GOALS else "",
            )
            for name, value in rows.items()
        ],
    )


Pairs = list[tuple[int, np.ndarray, np.ndarray]]
"""(frame, real scan, simulated scan) each, level frame."""


def draw(path: Path, sequence: KittiSequence, pairs: Pairs) -> None:
    """Bird's-eye views and range images; pairs of (frame, real, simulated) level-frame scans."""
    from matplotlib.figure import Figure

    from visualization.drawing import save

    figure = Figure(figsize=(11, 6.4 * len(pairs)), layout="tight")
    axes = figure.subplots(2 * len(pairs), 2, squeeze=False)
    for index, (frame, *scans) in enumerate(pairs):
        boxes = sequence.objects.at(frame).of_classes(VEHICLES).boxes
        for side, (name, scan) in enumerate(zip(("real", "simulated"), scans, strict=True)):
            _bird(axes[2 * index, side], scan, boxes, f"{name}, frame {frame}, {len(scan)} points")
            _range_image(axes[2 * index + 1, side], sequence.calib.level_to_velo(scan[:, :3]))
    save(figure, path, dpi=70)


def _bird(axes, scan, boxes, title: str) -> None:
    from visualization.drawing import birds_eye_axes, draw_boxes

    axes.scatter(scan[:, 0], scan[:, 1], s=0.3, c=np.clip(scan[:, 2], -2, 1.5), cmap="turbo")
    draw_boxes(axes, boxes, "k", linewidth=0.8)
    birds_eye_axes(axes, (0, 75), (-25, 35))
    axes.set_title(title)


def _range_image(axes, xyz) -> None:
    flat = np.hypot(xyz[:, 0], xyz[:, 1])
    azimuth, up = (
        -np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0])),
        np.degrees(np.arctan2(xyz[:, 2] - 0.2, flat)),
    )
    axes.scatter(azimuth, up, s=0.4, c=np.log(flat), cmap="turbo_r", marker="s")
    axes.set(xlim=(-42, 42), ylim=(-17, 3.5), xlabel="azimuth, degrees", ylabel="elevation")


def frames_with_scans(sequence: KittiSequence, pictures: Sequence[int]) -> list[int]:
    """The frames to compare; raises InputError without any, or for a picture of another frame."""
    sequence.check_scans()
    frames = [frame for frame in sequence.frames if sequence.has_scan(frame)]
    lacking = sorted(set(pictures) - set(frames))
    if lacking:
        raise InputError(f"--pictures: expected frames with scans, found {lacking[0]}")
    return frames


def world_of(sequence: KittiSequence, seed: int) -> Replay:
    """The sequence's objects in a random world."""
    return replay(sequence, np.random.default_rng((seed, sequence.seq, 2**20)))


def compare_world(sequence: KittiSequence, frames: Sequence[int], seed: int) -> list[FrameCounts]:
    """The measures of every frame, simulated in the world of a seed, see `compare_frame`."""
    world, found = world_of(sequence, seed), []
    for frame in progress(frames, len(frames), f"world {seed}", "frames"):
        real, made = sequence.read_points_level(frame), simulate(sequence, world, frame, seed)
        boxes = sequence.objects.at(frame).of_classes(VEHICLES).boxes
        found.append(compare_frame(real, made, boxes, sequence.calib))
    return found


def draw_frames(path: Path, sequence: KittiSequence, frames: Sequence[int]) -> None:
    """Draws real and simulated scans of some frames, in the world of seed 1."""
    world = world_of(sequence, 1)
    pairs = [(f, sequence.read_points_level(f), simulate(sequence, world, f, 1)) for f in frames]
    draw(path, sequence, pairs)


def main(argv: Sequence[str] | None = None) -> None:
    """Prints and writes the table, draws the pictures."""
    flags = parser().parse_args(argv)
    sequence = KittiSequence(flags.data_root, flags.seq)
    frames = frames_with_scans(sequence, flags.pictures)[:: flags.every]
    seeds = range(1, flags.seeds + 1)
    rows = summarise([compare_world(sequence, frames, seed) for seed in seeds])
    print(table(rows), end="")
    missed = [k for k, (a, b) in GOALS.items() if rows[k] is None or not a <= rows[k] <= b]
    print("goals missed: " + (", ".join(missed) or "none"), file=sys.stderr)
    record = provenance(figures=rows, goals=GOALS, missed=missed, seeds=flags.seeds)
    write_json(flags.out / "fidelity.json", record)
    if flags.pictures:
        draw_frames(flags.out / "fidelity.png", sequence, flags.pictures)


if __name__ == "__main__":
    raise SystemExit(run(main))
