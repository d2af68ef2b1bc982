"""The choice of Algorithm 1's free parameters: training sequences, detector boxes, noisy motion.

    python -m studies.algorithm1_parameters --data_root KITTI --detections DIR --out DIR

The boxes are detections of a file detector; their displacement is the labels' own plus Gaussian
noise in the ground plane, which simulates an imperfect network. An object that is lost
has no points in its box, so its displacement is unknown. Writes algorithm1_parameters.md and .json.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from common.flags import finite_float, non_negative_int, run
from common.markdown import markdown
from common.progress import progress
from evaluation.detections import DetectionFiles
from evaluation.scene import open_scenes
from evaluation.tracking_loop import track_scene
from experiments.record import data_record
from experiments.runs import make_parser, write
from kitti.objects import VEHICLES
from metrics.protocols import Entry, evaluate_protocol
from tracking.association_to_trajectory import AssociationByLabels, AssociationParameters

COLUMNS = ("MOTA", "MT", "IDS", "FRAG", "FP", "FN")


@dataclass(frozen=True)
class Trial:
    """One row of the table: standard deviation of the displacement in metres, and parameters."""

    noise: float
    parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def described(self) -> str:
        """ "tau = 0.1"."""
        return ", ".join(f"{name} = {value}" for name, value in self.parameters.items())


TRIALS = (
    *(
        Trial(noise, {"similarity": name, "tau": tau})
        for noise in (0.0, 0.5, 1.0)
        for name, taus in (("iou_3d", (0.01, 0.1, 0.3)), ("giou_3d", (-0.6, -0.4, -0.2, 0.0)))
        for tau in taus
    ),
    *(Trial(0.2, {"max_age": age}) for age in (0, 1, 3, 5, 10)),
    *(Trial(0.2, {"lost_frames": frames, "lost_points": 0}) for frames in (1, 3)),
    *(Trial(0.2, {"min_hits": hits}) for hits in (2, 3)),
    *(Trial(0.2, {"duplicate_iou": least}) for least in (0.3, 0.5, 1.0)),
)


class NoisyLabels(AssociationByLabels):
    """Algorithm 1 whose displacement is the labels' motion plus Gaussian noise in x and y."""

    def __init__(self, trial: Trial, rng: np.random.Generator):
        super().__init__(AssociationParameters(**trial.parameters))
        self.noise, self.rng = trial.noise, rng

    def box_displacement(self, boxes, detections, context) -> np.ndarray:
        """(T, 3) metres; NaN for a lost object, which has no points in its box."""
        motion = super().box_displacement(boxes, detections, context)
        motion[:, :2] += self.rng.normal(0.0, self.noise, (len(motion), 2))
        lost = [track.time_since_update > 1 for track in self.life.tracks]
        motion[np.array(lost, bool)] = np.nan
        return motion


def main(argv: Sequence[str] | None = None) -> None:
    """Parses the flags, runs every trial, writes the table."""
    parser = make_parser(__doc__, "0001,0004,0005,0007,0009,0010,0011,0015")
    add = parser.add_argument
    add("--detections", type=Path, required=True, help="folder of detection files")
    add("--min_score", type=finite_float, default=2.0, help="least score of a detection")
    add("--seed", type=non_negative_int, default=0, help="of the noise")
    args = parser.parse_args(argv)
    scenes = open_scenes(args.data_root, args.seqs)
    provider = DetectionFiles(args.detections, scenes, VEHICLES, args.min_score)
    rows = []
    for trial in progress(TRIALS, len(TRIALS), "algorithm 1", "trials"):
        entries = []
        for scene in scenes:
            tracker = NoisyLabels(trial, np.random.default_rng([args.seed, int(scene.name)]))
            results = track_scene(scene, provider, tracker, VEHICLES)
            entries.append(Entry(scene.name, scene.num_frames, scene.objects, results))
        rows.append((trial, evaluate_protocol("clear3d", entries, classes=VEHICLES)["overall"]))
    text = markdown(
        ["displacement noise", "parameters", *COLUMNS],
        [[f"{t.noise} m", t.described, *(metrics[c] for c in COLUMNS)] for t, metrics in rows],
    )
    trials = [{"noise": t.noise, "parameters": t.parameters, "clear3d": m} for t, m in rows]
    config = {name: str(value) for name, value in vars(args).items()}
    title = "Algorithm 1's parameters"
    details = {"config": config, "data": [data_record(args.data_root, args.seqs)]}
    write(args.out, "algorithm1_parameters", title, text, trials, **details)


if __name__ == "__main__":
    raise SystemExit(run(main))
