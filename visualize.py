"""Draws the paper's figures, and 3-D scenes for a browser, from data, result files and weights.

    python visualize.py scene --data_root DATA --seq 0016 --results A/tracks B/tracks --out a.html
    python visualize.py birds_eye --data_root DATA --seq 0016 --results DIR/tracks --out fig1.png
    python visualize.py trajectories --data_root DATA --seq 0016 --results A/tracks B/tracks \\
        --object_shift 0,2 --out fig6.png
    python visualize.py animation --data_root DATA --seq 0016 --results DIR/tracks --out a.gif
    python visualize.py network --data_root DATA --seq 0016 --out DIR
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from common import flags
from common.errors import InputError
from evaluation.run import check_writable
from evaluation.scene import Scene, open_scenes
from kitti.object_shift import ObjectShift
from kitti.objects import Objects
from kitti.seqmap import parse_sequences
from kitti.tables import sequence_file
from visualization.animation import animate
from visualization.birds_eye import birds_eye
from visualization.clip import Clip
from visualization.drawing import save
from visualization.gallery import draw_network, draw_scene, sequence_title
from visualization.scene_points import POINTS_PER_FRAME
from visualization.trajectories import trajectories

FIGURES = {
    "scene": "a drive in 3-D as one HTML file: tracks of several folders, errors per frame",
    "birds_eye": "Fig. 1: truth and tracks from above",
    "trajectories": "Fig. 6: tracks in 3-D, a row per folder of results",
    "animation": "a GIF of the tracks from above",
    "network": "Fig. 3 and Fig. 4: sampling.png, association.png and network.html in a folder",
}
STILL = (".png", ".pdf", ".svg")


def make_parser() -> flags.ArgumentParser:
    """The command line."""
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    figures = parser.add_subparsers(dest="figure", required=True, metavar="|".join(FIGURES))
    parsers = {name: figures.add_parser(name, help=text) for name, text in FIGURES.items()}
    for name, part in parsers.items():
        add = part.add_argument
        add("--data_root", type=Path, required=True, help="folder in KITTI's tracking layout")
        add("--seq", required=True, help="sequence, such as 0016")
        add("--out", type=Path, required=True, help="file to write (network: folder)")
        several = ", one for all --results or one each" if name == "trajectories" else ""
        shifts = flags.non_negative_floats if several else flags.non_negative_float
        help_text = f"metres, D of section IV.D{several}"
        add("--object_shift", "--displacements", type=shifts, default="0", help=help_text)
        add("--seed", type=flags.non_negative_int, default=0, help="of the object shift")
        if name != "network":
            count = "+" if name in ("trajectories", "scene") else 1
            needed = {"required": True} if name == "trajectories" else {"default": []}
            rest = "" if name == "trajectories" else "; without it the labels alone"
            add("--results", type=Path, nargs=count, help=f"folder of 00XX.txt{rest}", **needed)
        if name in ("network", "birds_eye"):
            text = "default: the one with most vehicles in the second half of the sequence"
            add("--frame", type=flags.non_negative_int, help=text)
        if name in ("network", "scene"):
            add("--weights", type=Path, default=Path("weights"), help="folder of the networks'")
    _add_scene_flags(parsers["scene"])
    frames = {"type": flags.non_negative_int, "default": 0, "help": "at most; 0: all"}
    parsers["animation"].add_argument("--animation_frames", **frames)
    return parser


def _add_scene_flags(parser: flags.ArgumentParser) -> None:
    add = parser.add_argument
    add("--iou", type=flags.finite_float, default=0.5, help="least 3-D IoU of a match")
    add("--points", type=flags.positive_int, default=POINTS_PER_FRAME, help="of a frame, at most")
    foreground = "colour points by the detector's foreground probability (needs --weights)"
    add("--foreground", action="store_true", help=foreground)
    add("--rerun", type=Path, help="also write this .rrd for the Rerun viewer (needs rerun-sdk)")


def open_scene(args: argparse.Namespace, distance: float) -> Scene:
    """The sequence, its objects shifted by up to `distance` metres."""
    seqs = tuple(parse_sequences(args.seq))
    if len(seqs) != 1:
        raise InputError(f"--seq: expected one sequence, found {args.seq!r}")
    shift = ObjectShift(distance, args.seed) if distance else None
    return open_scenes(args.data_root, seqs, shift=shift)[0]


def read_tracks(scene: Scene, folder: Path) -> Objects:
    """The result rows of a scene in a folder of result files."""
    return scene.sequence.read_results(sequence_file(folder, scene.name))


def make_clip(args: argparse.Namespace, distance: float, results: Path | None = None) -> Clip:
    """The sequence with the tracks of a folder, if there is one."""
    scene = open_scene(args, distance)
    return Clip.of_scene(scene, read_tracks(scene, results) if results else Objects.empty())


def tracker_names(folders: Sequence[Path]) -> list[str]:
    """A name per folder of results: its own, or its parent's where it is called tracks."""
    names: list[str] = []
    for folder in (folder.resolve() for folder in folders):
        name = folder.parent.name if folder.name == "tracks" else folder.name
        again = sum(other == name or other.startswith(f"{name} (") for other in names)
        names.append(f"{name} ({again + 1})" if again else name)
    return names


def draw_drive(args: argparse.Namespace) -> list[Path]:
    """Writes the scene and, with --rerun, the recording."""
    _check_suffix(args.out, (".html",))
    if not 0 < args.iou <= 1:
        raise InputError(f"--iou: expected above 0 and at most 1, found {args.iou:g}")
    if args.rerun is not None:
        _check_suffix(args.rerun, (".rrd",), "--rerun")
        from visualization.rerun_file import load_rerun, write_recording

        load_rerun()
    scene = open_scene(args, args.object_shift)
    names = tracker_names(args.results)
    pairs = zip(names, args.results, strict=True)
    trackers = {name: read_tracks(scene, folder) for name, folder in pairs}
    clip = Clip.of_scene(scene, Objects.empty())
    title = sequence_title(scene.name, args.object_shift)
    weights = args.weights if args.foreground else None
    options = {"min_iou": args.iou, "points_per_frame": args.points}
    files = [draw_scene(clip, trackers, title, args.out, weights, **options)]
    if args.rerun is not None:
        files.append(write_recording(args.rerun, clip, trackers))
    return files


def draw_inside(args: argparse.Namespace) -> list[Path]:
    """Draws intermediate outputs of the networks in one frame."""
    check_writable(args.out)
    files = [args.out / name for name in ("sampling.png", "association.png", "network.html")]
    clip = Clip.of_scene(open_scene(args, args.object_shift), Objects.empty())
    sampling, association, scene = files
    title = sequence_title(clip.name, args.object_shift)
    draw_network(clip, args.weights, title, sampling, association, args.frame, scene)
    return files


def draw_trajectories(args: argparse.Namespace) -> list[Path]:
    """Draws Fig. 6."""
    _check_suffix(args.out, STILL)
    count, shifts = len(args.results), args.object_shift
    if len(shifts) == 1:
        shifts *= count
    if len(shifts) != count:
        raise InputError(f"--object_shift: expected 1 or {count} values, found {len(shifts)}")
    names = tracker_names(args.results) if count > 1 else [""]
    rows = list(zip(shifts, args.results, names, strict=True))
    clips = [make_clip(args, shift, results) for shift, results, _ in rows]
    titles = [sequence_title(clips[0].name, shift, name) for shift, _, name in rows]
    return [save(trajectories(clips, titles), args.out)]


def draw_animation(args: argparse.Namespace) -> list[Path]:
    """Writes a GIF."""
    _check_suffix(args.out, (".gif",))
    clip = make_clip(args, args.object_shift, *args.results)
    title = sequence_title(clip.name, args.object_shift)
    return [animate(clip, args.out, title, args.animation_frames)]


def draw_birds_eye(args: argparse.Namespace) -> list[Path]:
    """Draws Fig. 1."""
    _check_suffix(args.out, STILL)
    clip = make_clip(args, args.object_shift, *args.results)
    frame = clip.busiest_frame() if args.frame is None else args.frame
    if frame not in clip.frames:
        first, last = clip.frames[0], clip.frames[-1]
        raise InputError(f"--frame: expected {first} to {last}, found {frame}")
    title = f"{sequence_title(clip.name, args.object_shift)}, frame {frame}"
    return [save(birds_eye(clip, frame, title), args.out)]


DRAW = {
    "scene": draw_drive,
    "birds_eye": draw_birds_eye,
    "trajectories": draw_trajectories,
    "animation": draw_animation,
    "network": draw_inside,
}


def _check_suffix(path: Path, suffixes: Sequence[str], flag: str = "--out") -> None:
    if path.suffix not in suffixes:
        raise InputError(f"{flag}: expected a file ending in {', '.join(suffixes)}", path)


def main(argv: Sequence[str] | None = None) -> None:
    """Draws, and prints the paths of the files."""
    args = make_parser().parse_args(argv)
    for path in DRAW[args.figure](args):
        print(path)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
