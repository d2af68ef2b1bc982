"""Tracks vehicles in a plain folder of Velodyne scans; no labels are needed.

    python track.py --scans DIR --out DIR

Scans are KITTI's .bin files (x, y, z, intensity as float32; x ahead, y left, z up in metres), or
.npy, .pcd, .ply; docs/DATA.md describes other layouts. `--out` gets NAME.txt, a KITTI result file
(or --format csv, jsonl), three pictures, and scene.html, the drive in 3-D for a browser. Objects
are found where the camera of the calibration looks: the networks were trained on its view.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path

import numpy as np

from common import flags
from common.config_flags import add_flags, from_flags, option
from common.errors import InputError, printable
from common.notes import note
from common.progress import Progress
from evaluation.run import check_writable
from evaluation.tracking_loop import result_rows
from kitti.calibration import (
    SENSOR_HEIGHT,
    Calibration,
    read_calibration,
    standard_mounting,
)
from kitti.camera_view import (
    check_view,
    describe_image_size,
    parse_image_size,
    spreads_sideways,
)
from kitti.objects import Objects
from kitti.scans.heading import axis_ahead
from kitti.scans.point_arrays import MAX_RANGE
from kitti.scans.scan_files import SUFFIXES, read_points
from kitti.scans.scan_folder import find_scans
from kitti.scans.scan_layout import KITTI_COLUMNS, KITTI_LAYOUT, ScanLayout, parse_columns
from kitti.track_files import WRITERS, parse_formats, write_tracks
from models.weight_files import network_files

PROBED_SCANS, PROBED_PAIRS = 3, 5
DEFAULT_NAME = "tracks"
AXES_AHEAD = {
    "y": ({"x": "-y", "y": "x"}, {"x": "y", "y": "x"}),
    "-y": ({"x": "y", "y": "-x"}, {"x": "-y", "y": "-x"}),
    "-x": ({"x": "-x", "y": "-y"}, {"x": "-x", "y": "y"}),
}
"""By the axis that is ahead, what x and y are really: of right-handed and of left-handed axes."""


@dataclass(frozen=True)
class TrackConfig:
    """Settings of track.py, one flag per field."""

    scans: Path = option(MISSING, f"folder of scans ({' '.join(SUFFIXES)})")
    out: Path = option(MISSING, "output folder")
    calib: Path | None = option(None, "calibration in KITTI's layout (default: KITTI's mounting)")
    sensor_height: float | None = option(
        None,
        f"metres of the scanner above the road, without --calib (default: {SENSOR_HEIGHT})",
        flags.finite_float,
        least=0.2,
        most=10.0,
    )
    image_size: str | None = option(
        None, "of the camera, such as 1242x375 (default: from the calibration)"
    )
    weights: Path = option(Path("weights"), "folder of the networks' weights")
    score_threshold: float | None = option(
        None, "least score of a box (default: that of the weights)", flags.finite_float
    )
    scan_columns: str | None = option(
        None, "of a scan, such as x,y,z,i,ring or -y,x,z (default: x,y,z,i)"
    )
    scan_dtype: str | None = option(
        None, "of the numbers in .bin, such as float64 (default: float32)"
    )
    scan_scale: float = option(1.0, "metres per unit of a scan", flags.finite_float)
    format: str = option("kitti", f"of the tracks: {','.join(WRITERS)}, or several")
    animation_frames: int = option(
        100, "at most, of the animation; 0: all", flags.non_negative_int, least=0
    )


class Scans:
    """The scans of a folder, by frame number.

    Args:
        folder: see `kitti.scans.scan_folder.find_scans`.
        layout: how the files are read.

    Raises:
        InputError: as `find_scans`.
    """

    def __init__(self, folder: str | Path, layout: ScanLayout = KITTI_LAYOUT):
        self.files, self.layout = find_scans(folder), layout
        self.dropped: dict[int, int] = {}

    @property
    def frames(self) -> range:
        """Frame numbers from the first scan to the last."""
        return range(min(self.files), max(self.files) + 1)

    def __len__(self) -> int:
        return len(self.files)

    def points(self, t: int) -> np.ndarray:
        """(n, 4) points of frame t, see `read_points`; none for a frame without a scan."""
        if t not in self.files:
            return np.zeros((0, 4), np.float32)
        points, self.dropped[t] = read_points(self.files[t], self.layout)
        return points

    def probes(self) -> Iterator[np.ndarray]:
        """The scans of up to `PROBED_SCANS` frames, from the first to the last."""
        frames = list(self.files)
        for i in sorted({round(i) for i in np.linspace(0, len(frames) - 1, PROBED_SCANS)}):
            yield self.points(frames[i])

    def consecutive(self, gap: int = 1) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Up to `PROBED_PAIRS` pairs of scans of frames t - gap and t, from first to last."""
        pairs = [(t - gap, t) for t in self.files if t - gap in self.files]
        for i in sorted({round(i) for i in np.linspace(0, len(pairs) - 1, PROBED_PAIRS)}):
            if pairs:
                yield self.points(pairs[i][0]), self.points(pairs[i][1])

    def remarks(self) -> Iterator[str]:
        """Notes on frames without a scan and on dropped points."""
        missing = len(self.frames) - len(self)
        if missing:
            yield f"{missing} of {len(self.frames)} frames have no scan (gaps in the numbers)"
        dropped = sum(self.dropped.values())
        if dropped:
            yield (
                f"{dropped} points without a return were dropped (not finite, or beyond "
                f"{MAX_RANGE:.0f} m)"
            )


def track_scans(
    tracker, scans: Scans, each_frame: Callable[[int], None] = lambda frame: None
) -> Objects:
    """Result rows of all frames from the first scan to the last.

    tracker: a new `pointtracknet.Tracker`; each_frame: called with the frame's number after each.
    Raises InputError for a broken scan.
    """
    frames, tracker.frame = [], scans.frames[0]
    for frame in scans.frames:
        frames.append((frame, tracker.update(scans.points(frame))))
        each_frame(frame)
    return result_rows(frames, tracker.calib, tracker.image_size)


def look(scans: Scans, calib: Calibration, size: tuple[int, int]) -> tuple[int, int]:
    """Points in view and points in all of a few scans.

    Raises:
        InputError: as `check_view`, or the scanner moves along y.
    """
    try:
        seen = check_view(scans.probes(), calib, size)
    except InputError as error:
        if error.path is not None:  # a file is at fault
            raise
        flags_of_scans = "--scan_columns such as -y,x,z,i, --scan_scale, --calib, --image_size"
        raise InputError(f"--scans: {error} ({flags_of_scans} describe others)") from error
    _check_heading(scans, calib)
    return seen


def _check_heading(scans: Scans, calib: Calibration) -> None:
    """Looks along which axis the surroundings move from scan to scan: x, where x is ahead."""

    def level(points: np.ndarray) -> np.ndarray:
        return calib.velo_to_level(points[:, :3])

    ahead = None
    for gap in (1, 2):  # slow drives tell after two frames
        pairs = scans.consecutive(gap)
        ahead = ahead or axis_ahead([level(points) for points in pair] for pair in pairs)
    if ahead is None and any(spreads_sideways(level(points)) for points in scans.probes()):
        note("the scene is wider than long; if y is ahead, give --scan_columns -y,x,z,i")
    if ahead in (None, "x"):
        return
    columns, mirrored = (_renamed(scans.layout.columns, axes) for axes in AXES_AHEAD[ahead])
    fault = (
        f"the surroundings move along {ahead} from scan to scan, expected along x, which is ahead: "
        f"--scan_columns {columns} reads such scans, {mirrored} those of left-handed axes"
    )
    if ahead == "-x" or scans.layout.columns is not None:  # it may drive backwards
        note(fault)
    else:
        raise InputError(f"--scans: {fault}")


def _renamed(columns: tuple[str, ...] | None, axes: Mapping[str, str]) -> str:
    """--scan_columns in which the axes x and y are what `axes` says."""
    found = []
    for name in columns or KITTI_COLUMNS:
        axis = axes.get(name.removeprefix("-"), name.removeprefix("-"))
        turned = name.startswith("-") != axis.startswith("-")
        found.append("-" * turned + axis.removeprefix("-"))
    return ",".join(found)


def draw(
    results: Objects, tracker, scans: Scans, name: str, out: Path, max_frames: int, seen
) -> list[Path]:
    """Bird's-eye view of the last frame, trajectories, an animation and the 3-D scene.

    seen: `ScenePoints` of the scene. Returns the files written.
    """
    from visualization.gallery import draw_unlabelled

    def points(t: int):
        return tracker.points_level(scans.points(t)) if t in scans.files else None

    return draw_unlabelled(name, results, points, scans.frames, out, max_frames, seen)


def parse_config(argv: Sequence[str] | None = None) -> TrackConfig:
    """Flags to configuration."""
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    add_flags(parser, TrackConfig)
    return from_flags(TrackConfig, parser.parse_args(argv))


def open_scans(args: TrackConfig) -> Scans:
    """The scans in the layout that the flags describe; raises InputError as `Scans`."""
    columns = None if args.scan_columns is None else parse_columns(args.scan_columns)
    return Scans(args.scans, ScanLayout(columns, args.scan_dtype, args.scan_scale))


def mounting(args: TrackConfig) -> Calibration:
    """The calibration of the flags; raises InputError if it is broken or given twice."""
    if args.calib is None:
        return standard_mounting(args.sensor_height or SENSOR_HEIGHT)
    if args.sensor_height is not None:
        raise InputError("--sensor_height: expected without --calib, which defines the mounting")
    return read_calibration(args.calib)


def load_tracker(args: TrackConfig, calib: Calibration, size: tuple[int, int]):
    """The `pointtracknet.Tracker` of the flags; prints the device and the score threshold."""
    network_files(args.weights)  # before the import of TensorFlow
    from pointtracknet import Tracker
    from tf_ops.devices import describe_device

    print(describe_device())
    tracker = Tracker.load(args.weights, calib, size, args.score_threshold)
    print(f"boxes with a score of at least {tracker.score_threshold:.3g}")
    return tracker


def track_and_keep(tracker, scans: Scans):
    """Tracks under a progress bar: result rows, and `ScenePoints` of the detector's input."""
    from visualization.scene_points import FOREGROUND, ScenePoints

    seen = ScenePoints(len(scans.frames), FOREGROUND)
    with Progress(len(scans.frames), "tracking", "frames") as bar:

        def each_frame(frame: int) -> None:
            seen.put(frame - scans.frames[0], tracker.seen)
            bar.update()

        return track_scans(tracker, scans, each_frame), seen


def main(argv: Sequence[str] | None = None) -> None:
    """Tracks, writes the tracks and the pictures, prints where they are."""
    args = parse_config(argv)
    formats, scans = parse_formats(args.format), open_scans(args)
    calib = mounting(args)
    given = None if args.image_size is None else parse_image_size(args.image_size)
    try:
        size, known_from = describe_image_size(calib, given)
    except InputError as error:
        raise InputError(str(error), args.calib) from error
    in_view, total = look(scans, calib, size)
    check_writable(args.out)
    print(f"camera: {size[0]} x {size[1]} pixels ({known_from}); only its view is searched:")
    print(f"{in_view / max(total, 1):.0%} of the points lie in it")
    tracker = load_tracker(args, calib, size)  # imports TensorFlow, only for valid input
    results, seen = track_and_keep(tracker, scans)
    for remark in scans.remarks():
        note(remark)
    name = args.scans.resolve().name or DEFAULT_NAME
    files = write_tracks(args.out, name, results, formats)
    print(f"{len(np.unique(results.track_id))} tracks in {len(scans)} scans")
    title = printable(name)
    pictures = draw(results, tracker, scans, title, args.out, args.animation_frames, seen)
    for written in (*files, *pictures):
        print(written)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
