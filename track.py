"""Tracks vehicles in a plain folder of Velodyne scans; no labels are needed.

    python track.py --scans DIR --out DIR

Scans are KITTI's .bin files (x, y, z, intensity as float32; x ahead, y left, z up). `--out` gets
NAME.txt, a KITTI result file, and three pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from common import flags
from common.errors import InputError
from common.progress import Progress
from evaluation.run import check_writable
from kitti.boxes import project_boxes
from kitti.calibration import Calibration, read_calibration
from kitti.labels import Objects, write_results
from kitti.scans import read_scan

NOT_IN_IMAGE = 0.0  # as in evaluation.tracking_loop
DEFAULT_NAME = "tracks"


def find_scans(folder: str | Path) -> dict[int, Path]:
    """Frame number -> scan, ascending.

    Where every file is named with six digits, as KITTI's are, these are the frame numbers, and a
    number that is left out is a frame without a scan; other names are numbered in their order.

    Raises:
        InputError: there is no such folder, or no .bin file in it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("--scans: expected a directory with .bin files", folder)
    paths = sorted(folder.glob("*.bin"))
    if not paths:
        raise InputError("--scans: found no .bin file", folder)
    if all(len(path.stem) == 6 and path.stem.isdigit() for path in paths):
        return {int(path.stem): path for path in paths}
    return dict(enumerate(paths))


def track_scans(
    tracker, scans: dict[int, Path], each_frame: Callable[[], None] = lambda: None
) -> Objects:
    """Result rows of all frames from the first scan to the last.

    tracker: a `pointtracknet.Tracker`. Raises InputError for a broken scan.
    """
    parts = [Objects.empty()]
    for frame in range(min(scans), max(scans) + 1):
        points = read_scan(scans[frame]) if frame in scans else np.zeros((0, 4), np.float32)
        tracks = tracker.update(points)
        bbox = project_boxes(tracks.boxes, tracker.calib, tracker.image_size)
        bbox = np.where(np.isnan(bbox), NOT_IN_IMAGE, bbox)
        parts.append(
            Objects.from_boxes(
                frame,
                tracks.ids,
                tracks.boxes,
                tracks.scores,
                kind=tracker.types(tracks),
                bbox=bbox,
            )
        )
        each_frame()
    return Objects.concatenate(parts)


def draw(results: Objects, tracker, scans: dict[int, Path], name: str, out: Path) -> list[Path]:
    """Bird's-eye view of the last frame, trajectories and an animation; returns their files."""
    from visualization.gallery import draw_unlabelled

    def points(t: int):
        return tracker.points_level(read_scan(scans[t])) if t in scans else None

    return draw_unlabelled(name, results, points, min(scans), max(scans), out)


def main(argv: Sequence[str] | None = None) -> None:
    """Tracks, writes the result file and the pictures, prints where they are."""
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("--scans", type=Path, required=True, help="folder of .bin files")
    add("--out", type=Path, required=True, help="folder for what is written")
    add("--calib", type=Path, help="calibration in KITTI's layout (default: KITTI's mounting)")
    add("--weights", type=Path, default=Path("weights"), help="folder of the networks' weights")
    args = parser.parse_args(argv)
    scans = find_scans(args.scans)
    check_writable(args.out)
    calib: Calibration | None = None if args.calib is None else read_calibration(args.calib)
    from pointtracknet import Tracker  # TensorFlow only where the input is in order

    tracker = Tracker.load(args.weights, calib)
    name = args.scans.resolve().name or DEFAULT_NAME
    with Progress(max(scans) - min(scans) + 1, "tracking", "frames") as bar:
        results = track_scans(tracker, scans, bar.update)
    path = args.out / f"{name}.txt"
    write_results(path, results)
    print(f"{len(np.unique(results.track_id))} tracks in {len(scans)} scans")
    for written in (path, *draw(results, tracker, scans, name, args.out)):
        print(written)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
