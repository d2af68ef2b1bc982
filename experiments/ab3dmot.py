"""AB3DMOT on PointRCNN's cars, compared with its authors' published numbers.

    python -m experiments.ab3dmot --data_root KITTI --detections KITTI/detections/pointrcnn_Car \
        --out results/ab3dmot

KITTI's ignore rules as AB3DMOT's evaluator applies them, 3-D IoU 0.25, 0.5 and 0.7 and 2-D IoU
0.5, each at the score threshold of its best MOTA.
"""

from collections.abc import Sequence
from typing import Any

from common import flags
from common.markdown import markdown
from evaluation.config import EvaluateConfig
from evaluation.run import check_writable, make_provider
from evaluation.tracking_loop import track_scene
from experiments.paper import AB3DMOT, AB3DMOT_COLUMNS, AB3DMOT_SEQUENCES
from experiments.record import measured_with
from experiments.runs import make_parser, write
from kitti.seqmap import sequence_name
from metrics.protocols import Entry, Kitti2d, Kitti3d, metrics_of
from tracking import make_tracker

SPACES = {
    "3-D IoU 0.25": ("3d", 0.25),
    "3-D IoU 0.5": ("3d", 0.5),
    "3-D IoU 0.7": ("3d", 0.7),
    "2-D IoU 0.5": ("2d", 0.5),
}


def main(argv: Sequence[str] | None = None) -> None:
    """Tracks the sequences once and evaluates them under each protocol."""
    seqs = ",".join(sequence_name(seq) for seq in AB3DMOT_SEQUENCES)
    parser = make_parser(__doc__, seqs)
    parser.add_argument("--detections", required=True, help="folder of PointRCNN detections")
    args = parser.parse_args(argv)
    check_writable(args.out)
    config = EvaluateConfig(
        data_root=args.data_root,
        seqs=args.seqs,
        classes=("Car",),
        detections=args.detections,
        tracker="ab3dmot",
    )
    details = measured_with([config])
    entries, poses = _tracked(config)
    figures: dict[str, Any] = {
        name: _at_best(Kitti3d(entries, min_iou, space), entries, over_recall=True)
        for name, (space, min_iou) in SPACES.items()
    }
    figures["kitti2d (TrackEval)"] = _at_best(Kitti2d(entries), entries)
    text = f"Ego-motion compensation: {'from poses/' if poses else 'off (no poses/)'}.\n\n"
    title = "AB3DMOT on PointRCNN detections"
    write(args.out, "ab3dmot", title, text + _table(figures), figures, **details)


def _at_best(protocol, entries: list[Entry], **options: bool) -> dict[str, Any]:
    """Metrics over all sequences at the score threshold of the best MOTA."""
    return metrics_of(protocol, entries, best=True, **options)["overall"]


def _tracked(config: EvaluateConfig) -> tuple[list[Entry], bool]:
    """The tracks of every sequence; whether there are poses of all."""
    scenes = config.open_scenes()
    provider = make_provider(config, scenes)

    def track(scene):
        return track_scene(scene, provider, make_tracker("ab3dmot"), config.classes)

    entries = [Entry(s.name, s.num_frames, s.objects, track(s)) for s in scenes]
    return entries, all(scene.ego_motions is not None for scene in scenes)


def _table(figures: dict[str, dict[str, Any]]) -> str:
    lines = []
    for name, values in figures.items():
        lines.append([f"ours, {name}", *(values.get(key) for key in AB3DMOT_COLUMNS), values["GT"]])
        if name in AB3DMOT:
            lines.append([f"published, {name}", *AB3DMOT[name], None])
    return markdown(["", *AB3DMOT_COLUMNS, "GT"], lines)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
