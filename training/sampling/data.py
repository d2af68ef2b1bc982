"""Training and validation data: flags of data roots, sequences and sampling shares."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.notes import note
from kitti.check_points import check_points
from kitti.seqmap import parse_sequences
from kitti.sequence import KittiSequence, labelled_sequences, open_sequences

ALL = "all"
HELD_OUT = "0011"
"""Validation sequence of the first data root unless others are named; not trained on."""
TRAINED = "0000-0010,0012-0015"
"""Default of --seqs: KITTI's training split of the paper without `HELD_OUT`."""
LEAST_SHARE = 0.001


@dataclass(frozen=True)
class Pool:
    """Sequences whose samples are drawn with the same frequency.

    Attributes:
        share: of all samples, in (0, 1].
        sequences: indices into the training sequences.
    """

    share: float
    sequences: tuple[int, ...]


@dataclass(frozen=True)
class TrainingData:
    """Training and validation sequences, and the share of each training pool."""

    training: list[KittiSequence]
    validation: list[KittiSequence]
    pools: list[Pool]

    def record(self) -> dict[str, Any]:
        """Names and shares for the record of a training."""
        return {
            "training": [_name(s) for s in self.training],
            "validation": [_name(s) for s in self.validation],
            "shares": [
                {
                    "share": pool.share,
                    "sequences": [_name(self.training[i]) for i in pool.sequences],
                }
                for pool in self.pools
            ],
        }


def _name(sequence: Sequence) -> str:
    return f"{sequence.data_root}/{sequence.name}"


class _ShareOfRoot(argparse.Action):
    """--share of the --data_root before it, stored as {number of the root: share}."""

    def __call__(self, parser, namespace, values, option_string=None):
        root = len(namespace.data_root or []) - 1
        if root < 0 or root in namespace.share:
            parser.error("argument --share: expected once after the --data_root that it is of")
        namespace.share = {**namespace.share, root: values}


def _share(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not LEAST_SHARE <= value <= 1:
        raise argparse.ArgumentTypeError(f"expected {LEAST_SHARE} to 1, found {text!r}")
    return value


def add_data_flags(parser: argparse.ArgumentParser) -> None:
    """Adds --data_root, --seqs, --share, --val_data_root and --val_seqs."""
    add = parser.add_argument
    add(
        "--data_root",
        action="append",
        required=True,
        metavar="DIR",
        help="data in KITTI's tracking layout; repeatable",
    )
    add(
        "--seqs",
        action="append",
        metavar="SEQS",
        help="training sequences, like 0000-0015 or 0001,0003, or all: every labelled one that is "
        f"not validated on; one for all roots or one each (default: {TRAINED})",
    )
    add(
        "--share",
        action=_ShareOfRoot,
        type=_share,
        default={},
        metavar="SHARE",
        help="share of the samples that come from the --data_root before it; roots without one "
        "divide the rest in proportion to their samples",
    )
    add(
        "--val_data_root",
        action="append",
        metavar="DIR",
        help="validation data; repeatable (default: the first --data_root)",
    )
    add(
        "--val_seqs",
        action="append",
        metavar="SEQS",
        help=f"validation sequences, as --seqs (default: {HELD_OUT}; all of a --val_data_root)",
    )


def open_data(flags: argparse.Namespace) -> TrainingData:
    """Opens the sequences that the flags of `add_data_flags` name.

    Raises:
        InputError: a root or sequence is missing, counts of flags differ, shares do not fit, a
            sequence is both trained and validated on, or its scans do not fit its labels.
    """
    roots = flags.data_root
    val_roots = flags.val_data_root or roots[:1]
    val_seqs = flags.val_seqs or [ALL if flags.val_data_root else HELD_OUT]
    validated = _numbers(val_roots, val_seqs, "--val_seqs", "--val_data_root")
    held_out = {(Path(r).resolve(), seq) for r, seqs in validated for seq in seqs}
    trained = _numbers(roots, flags.seqs or [TRAINED], "--seqs", "--data_root", held_out)
    for root, seqs in trained:
        both = [seq for seq in seqs if (Path(root).resolve(), seq) in held_out]
        if both:
            raise InputError(
                f"sequence {both[0]:04d}: expected either in --seqs or in --val_seqs", root
            )
    counts = [len(seqs) for _, seqs in trained]
    data = TrainingData(
        [sequence for root, seqs in trained for sequence in _with_scans(root, seqs)],
        [sequence for root, seqs in validated for sequence in _with_scans(root, seqs)],
        _pools(counts, flags.share),
    )
    for sequence in (*data.training, *data.validation):
        check_points(sequence)
    return data


def _with_scans(root: str, seqs: Sequence[int]) -> list[KittiSequence]:
    """Opens the sequences of a root; InputError if none of them has a scan."""
    sequences = open_sequences(root, seqs)
    if not any(sequence.has_scan(t) for sequence in sequences for t in sequence.frames):
        names = ", ".join(sequence.name for sequence in sequences)
        raise InputError(f"expected scans of {names} in training/velodyne/, found none", root)
    return sequences


def check_objects(data: TrainingData, classes: Sequence[str]) -> None:
    """Notes validation sequences without any labelled box of the classes.

    Raises:
        InputError: the training sequences have none.
    """
    without = f"there is no labelled box of {', '.join(classes)}"
    if not _has_objects(data.training, classes):
        folder = data.training[0].label_path.parent
        raise InputError(f"{without} in the training sequences", folder)
    if data.validation and not _has_objects(data.validation, classes):
        note(f"{data.validation[0].label_path.parent}: {without} in the validation sequences")


def _has_objects(sequences: Sequence[KittiSequence], classes: Sequence[str]) -> bool:
    return any(len(sequence.objects.of_classes(classes)) for sequence in sequences)


def _numbers(
    roots: Sequence[str],
    seqs: Sequence[str],
    seqs_flag: str,
    root_flag: str,
    held_out: frozenset[tuple[Path, int]] | set[tuple[Path, int]] = frozenset(),
) -> list[tuple[str, list[int]]]:
    """(root, sequence numbers) of each root; "all" omits `held_out`."""
    if len(seqs) == 1:
        seqs = list(seqs) * len(roots)
    if len(seqs) != len(roots):
        raise InputError(
            f"{seqs_flag}: expected one, or one for each {root_flag}, found {len(seqs)}"
        )
    return [
        (root, sequence_numbers(root, text, held_out))
        for root, text in zip(roots, seqs, strict=True)
    ]


def sequence_numbers(
    root: str,
    text: str,
    held_out: frozenset[tuple[Path, int]] | set[tuple[Path, int]] = frozenset(),
) -> list[int]:
    """The sequences that a text such as 0001-0003 names; "all": the labelled ones not held out.

    Raises:
        InputError: "all" names none.
    """
    if text != ALL:
        return parse_sequences(text)
    found = [s for s in labelled_sequences(root) if (Path(root).resolve(), s) not in held_out]
    if not found:
        raise InputError("every labelled sequence is validated on: none is left to train", root)
    return found


def _pools(counts: Sequence[int], shares: dict[int, float]) -> list[Pool]:
    """Pools of roots with `counts` sequences: one a root with a share, one of all the others."""
    first = [sum(counts[:root]) for root in range(len(counts))]
    of_root = [tuple(range(a, a + n)) for a, n in zip(first, counts, strict=True)]
    others = sum((of_root[root] for root in range(len(counts)) if root not in shares), ())
    rest = 1.0 - sum(shares.values())
    if rest < -1e-9:
        raise InputError(f"--share: expected shares of at most 1 together, found {1 - rest:g}")
    if others and rest < LEAST_SHARE:
        raise InputError("--share: the shares given leave nothing for the roots without one")
    if not others and rest > 1e-9:
        raise InputError(
            f"--share: expected 1 together where each root has one, found {1 - rest:g}"
        )
    pools = [Pool(share, of_root[root]) for root, share in sorted(shares.items())]
    return [Pool(rest, others), *pools] if others else pools
