"""Fits the score of a box on labelled scans, and measures it on drives held out in turn.

    python -m training.calibrate --real_root KITTI_A --simulated_root data/val --out results/score

The score is the probability that a box is right at 3-D IoU 0.5, a logistic regression on the
features of its cluster (models/boxes/box_score.py). Its penalty is chosen by cross-validation by
drive, and the default threshold is where hits minus false alarms are most over real and simulated
drives. Several samplings of each scan steady both, and the figures.
Writes scorer.json into the folder of weights, and calibration.json and reliability.png into --out.
"""

import math
from collections.abc import Sequence
from pathlib import Path

from common.errors import InputError
from common.files import write_json
from common.flags import ArgumentParser, positive_int, run
from common.provenance import provenance
from kitti.check_points import check_points
from kitti.seqmap import parse_sequences
from kitti.sequence import KittiSequence, labelled_sequences, open_sequences
from metrics.scored_boxes import best_threshold
from models.boxes.box_score import save_scorer
from models.config import DecodingConfig
from models.weights import load_detector, network_hash
from training.sampling.data import ALL
from training.sampling.frames import frame_list
from training.scoring.box_candidates import CandidateFinder, drive_of
from training.scoring.score_fit import (
    RIGHT_IOU,
    Domain,
    ScoreFit,
    choose_penalty,
    counted_vehicles,
    scored,
)
from training.scoring.score_report import draw, report, table


def make_parser() -> ArgumentParser:
    """The command line."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("--weights", type=Path, default=Path("weights"), help="folder with detector.npz")
    for kind in ("real", "simulated"):
        add(
            f"--{kind}_root",
            action="append",
            default=[],
            metavar="DIR",
            help=f"{kind} labelled drives that are not trained on; repeatable",
        )
        add(f"--{kind}_seqs", metavar="SEQS", help=f"of every --{kind}_root (default: all)")
    add("--exam_root", metavar="DIR", help="drives that are measured and never fitted on")
    add("--exam_seqs", metavar="SEQS", help="of --exam_root, such as 0000 (default: all)")
    add("--every", type=positive_int, default=1, help="take every n-th frame")
    add("--views", type=positive_int, default=4, help="samplings of a scan; odd ones mirrored")
    text = "points of a scan, at least N (default: all, up to 4/3 N)"
    add("--max_points", type=positive_int, help=text)
    add("--folds", type=positive_int, default=5, help="of the cross-validation by drive")
    add("--out", type=Path, required=True, help="folder for the report")
    return parser


def _open(roots: Sequence[str], seqs: str | None = None) -> list[KittiSequence]:
    return [
        sequence
        for root in roots
        for sequence in open_sequences(
            root, labelled_sequences(root) if seqs in (None, ALL) else parse_sequences(seqs)
        )
    ]


def _names(sequences: Sequence[KittiSequence]) -> list[str]:
    return sorted(f"{s.data_root.resolve().name}/{s.name}" for s in sequences)


def _check_exam(exam: Sequence[KittiSequence], fitted: Sequence[KittiSequence]) -> None:
    """Raises InputError where a sequence of the exam is also fitted on."""
    used = {drive_of(sequence) for sequence in fitted}
    for sequence in exam:
        if drive_of(sequence) in used:
            found = f"found {sequence.name} of {sequence.data_root} in both"
            raise InputError(f"--exam_root: expected drives that are not fitted on, {found}")


def _check_scans(kind: str, sequences: list[KittiSequence]) -> None:
    """Raises InputError unless a frame of the drives has a scan."""
    if not frame_list(sequences):
        names = ", ".join(_names(sequences))
        raise InputError(f"--{kind}_root: expected drives with scans, found none in {names}")


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the detector, chooses the penalty, fits, measures, writes."""
    flags = make_parser().parse_args(argv)
    roots = {"real": flags.real_root, "simulated": flags.simulated_root}
    roots = {kind: found for kind, found in roots.items() if found}
    if not roots:
        raise InputError("expected --real_root or --simulated_root")
    if flags.folds < 2:
        raise InputError(f"--folds: expected at least 2, found {flags.folds}")
    for kind in ("real", "simulated", "exam"):
        if getattr(flags, f"{kind}_seqs") and not getattr(flags, f"{kind}_root"):
            raise InputError(f"--{kind}_seqs: expected --{kind}_root with it")
    seqs = {"real": flags.real_seqs, "simulated": flags.simulated_seqs}
    opened = {kind: _open(found, seqs[kind]) for kind, found in roots.items()}
    exam = _open([flags.exam_root], flags.exam_seqs) if flags.exam_root else []
    _check_exam(exam, [s for found in opened.values() for s in found])
    for kind, sequences in ({**opened, "exam": exam} if exam else opened).items():
        _check_scans(kind, sequences)
        for sequence in sequences:
            check_points(sequence)
    detector = load_detector(flags.weights / "detector.npz")
    finder = CandidateFinder(detector, DecodingConfig(), flags.max_points)
    domains = []
    for sequences in opened.values():
        views = finder.find_all(sequences, range(flags.views), flags.every)
        domains.append(Domain([frame for view in views for frame in view]))
    penalty, losses = choose_penalty(domains, flags.folds)
    fit = ScoreFit(domains, penalty)
    found = fit.cross_validated(flags.folds)
    pairs = list(zip(domains, found, strict=True))
    groups = [(scored(d.frames, s, RIGHT_IOU), counted_vehicles(d.frames)) for d, s in pairs]
    min_score = best_threshold([(boxes, max(total, 1)) for boxes, total in groups])
    min_score = math.floor(1000 * min_score) / 1000  # three digits, as it is shown
    scorer = fit.scorer(network_hash(detector), min_score)
    parts = {k: report(d.frames, s, min_score) for k, (d, s) in zip(roots, pairs, strict=True)}
    if exam:
        (frames,) = finder.find_all(exam, every=flags.every)
        scores = [frame.scores(scorer) for frame in frames]
        parts["exam"] = report(frames, scores, min_score)
    draw(parts, flags.out / "reliability.png")
    chosen = {"penalty": penalty._asdict(), "log_loss": losses, "min_score": min_score}
    data = {kind: _names(found) for kind, found in opened.items()}
    if exam:
        data["exam"] = _names(exam)
    write_json(
        flags.out / "calibration.json",
        {"run": provenance(data=data, chosen=chosen), "figures": parts},
    )
    path = save_scorer(flags.weights, scorer)
    print(table(parts) + f"\ndefault threshold {min_score:.3f}, written to {path} and {flags.out}")


if __name__ == "__main__":
    raise SystemExit(run(main))
