"""The paper's pictures, one by one, from a data set, result files and weights.

    python visualize.py birds_eye --data_root DATA --seq 0016 --results DIR/tracks --out fig1.png
    python visualize.py trajectories --data_root DATA --seq 0016 --results A/tracks B/tracks \\
        --displacements 0,2 --out fig6.png
    python visualize.py animation --data_root DATA --seq 0016 --results DIR/tracks --out a.gif
    python visualize.py network --data_root DATA --seq 0016 --out DIR
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from common import flags
from common.errors import InputError
from demo import parse_displacements
from evaluation.config import EvaluateConfig
from evaluation.run import check_writable
from evaluation.scene import Scene
from evaluation.side_by_side import displaced_scenes
from kitti.labels import Objects, read_results
from kitti.splits import parse_sequences
from visualization.animation import animate
from visualization.birds_eye import birds_eye
from visualization.clip import Clip
from visualization.drawing import save
from visualization.gallery import draw_network
from visualization.trajectories import trajectories

FIGURES = {
    "birds_eye": "Fig. 1: truth and tracks from above",
    "trajectories": "Fig. 6: tracks in 3-D, a row per folder of results",
    "animation": "a GIF of the tracks from above",
    "network": "Fig. 3 and Fig. 4: sampling.png and association.png in the folder --out",
}
SUFFIXES = {
    "birds_eye": (".png", ".pdf", ".svg"),
    "trajectories": (".png", ".pdf", ".svg"),
    "animation": (".gif",),
}


def make_parser() -> flags.ArgumentParser:
    """The command line."""
    text = "; ".join(f"{name}: {what}" for name, what in FIGURES.items())
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("figure", choices=FIGURES, help=text)
    add("--data_root", type=Path, required=True, help="folder in KITTI's tracking layout")
    add("--seq", required=True, help="sequence, such as 0016")
    add("--results", type=Path, nargs="+", default=[], help="folders of result files 00XX.txt")
    add("--displacements", type=parse_displacements, default="0", help="metres, one per --results")
    add("--seed", type=flags.non_negative_int, default=0, help="of the displacement")
    add("--frame", type=flags.non_negative_int, help="default: the one with most vehicles")
    add(
        "--animation_frames",
        type=flags.non_negative_int,
        default=0,
        help="at most, of the animation; 0: all",
    )
    add("--weights", type=Path, default=Path("weights"), help="folder of the networks' weights")
    add("--out", type=Path, required=True, help="file to write (network: folder)")
    return parser


def make_clip(args: argparse.Namespace, distance: float, results: Path | None) -> Clip:
    """The sequence under a displacement, with the tracks of a folder if one is given."""
    seqs = tuple(parse_sequences(args.seq))
    if len(seqs) != 1:
        raise InputError(f"--seq: expected one sequence, found {args.seq!r}")
    config = EvaluateConfig(args.data_root, seqs=seqs, displacement=distance, seed=args.seed)
    scene: Scene = displaced_scenes(config)[0]
    rows = Objects.empty()
    if results is not None:
        rows = read_results(results / f"{scene.name}.txt", scene.num_frames)
    return Clip.of_scene(scene, rows)


def draw(args: argparse.Namespace) -> list[Path]:
    """The figure that the flags ask for; returns the files written."""
    if args.figure == "network":
        check_writable(args.out)
        files = [args.out / "sampling.png", args.out / "association.png"]
        clip = make_clip(args, args.displacements[0], None)
        draw_network(clip, args.weights, f"sequence {clip.name}", *files, args.frame)
        return files
    if args.out.suffix not in SUFFIXES[args.figure]:
        expected = ", ".join(SUFFIXES[args.figure])
        raise InputError(f"--out: expected a file ending in {expected}", args.out)
    if len(args.results) != len(args.displacements):
        raise InputError("expected as many --results as --displacements")
    pairs = zip(args.displacements, args.results, strict=True)
    clips = [make_clip(args, distance, results) for distance, results in pairs]
    if args.figure == "trajectories":
        names = [f"sequence {clips[0].name}, displacement {d:g} m" for d in args.displacements]
        return [save(trajectories(clips, names), args.out)]
    clip = clips[0]
    if args.figure == "animation":
        return [animate(clip, args.out, max_frames=args.animation_frames)]
    frame = clip.busiest_frame() if args.frame is None else args.frame
    if frame >= clip.num_frames:
        raise InputError(f"--frame: expected below {clip.num_frames}, found {frame}")
    return [save(birds_eye(clip, frame), args.out)]


def main(argv: Sequence[str] | None = None) -> None:
    """Draws and says where."""
    for path in draw(make_parser().parse_args(argv)):
        print(path)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
