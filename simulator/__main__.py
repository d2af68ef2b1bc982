"""Simulates LiDAR scans and labels in KITTI's tracking format: own traffic, or labels replayed.

    python -m simulator --out DIR --split val --sequences 1 --frames 100
    python -m simulator --out DIR --from_labels KITTI --seqs 0016-0020

An interrupted run is completed by the same command. See this folder's README.
"""

import argparse
import hashlib
from collections.abc import Sequence
from pathlib import Path

from common.errors import InputError
from common.files import read_bytes
from common.flags import ArgumentParser, finite_float, non_negative_int, positive_int, run
from kitti.labels import MAX_FRAMES
from kitti.seqmap import parse_sequences
from kitti.sequence import KittiSequence, open_sequences
from simulator.config import VehicleMix
from simulator.dataset import make_dataset
from simulator.plan import Plan
from simulator.sensor_model.frames import Options

OWN_SEQUENCES = {"train": range(16), "val": range(16, 21)}  # as in KITTI's split
OWN_FRAMES = 200  # of each sequence, unless --frames is given


def van_share(text: str) -> float:
    """argparse type: a share in [0, 0.9]; the rest are cars and trucks."""
    value = finite_float(text)
    if not 0 <= value <= 0.9:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to 0.9, found {text!r}")
    return value


def parser() -> ArgumentParser:
    """The flags."""
    result = ArgumentParser(prog="python -m simulator", description=__doc__.split("\n")[0])
    add = result.add_argument
    add("--out", type=Path, required=True, help="output folder; reused if complete")
    text = "own traffic: numbers of the sequences (default: train)"
    add("--split", choices=["train", "val"], help=text)
    counts = " and ".join(f"{len(numbers)} of {name}" for name, numbers in OWN_SEQUENCES.items())
    text = f"own traffic: how many (default: all, {counts})"
    add("--sequences", type=positive_int, help=text)
    text = f"of each sequence, at most (default: own traffic {OWN_FRAMES}, replays all)"
    add("--frames", type=positive_int, help=text)
    mix = VehicleMix()
    shares = f"default: {mix.moving_vans:g} of those that move, {mix.parked_vans:g} of the parked"
    add("--van_share", type=van_share, help=f"own traffic: vans among vehicles ({shares})")
    add("--from_labels", type=Path, help="KITTI folder with labels to replay, needs --seqs")
    add("--seqs", help="sequences to replay, such as 0016-0020 or 0000,0003")
    add("--seed", type=non_negative_int, default=0, help="random seed")
    add("--full", action="store_true", help="360 degrees, not the camera's view")
    add("--motion_distortion", action="store_true", help="keep motion during a sweep in the scans")
    add("--processes", type=positive_int, help="processes, by default one per core")
    return result


def make_plan(flags) -> Plan:
    """The plan of the flags; raises InputError where they contradict each other."""
    options = Options(flags.full, flags.motion_distortion)
    if flags.from_labels is not None:
        return _label_plan(flags, options)
    return _own_plan(flags, options)


def _label_plan(flags, options: Options) -> Plan:
    if any(value is not None for value in (flags.split, flags.sequences, flags.van_share)):
        raise InputError(
            "--split, --sequences and --van_share are for own traffic; --from_labels takes --seqs"
        )
    if flags.seqs is None:
        raise InputError("--from_labels needs --seqs, for example 0016-0020")
    sequences = open_sequences(flags.from_labels, parse_sequences(flags.seqs))
    for sequence in sequences:
        _check(sequence)
    frames = {sequence.seq: sequence.num_frames for sequence in sequences}
    if flags.frames is not None:
        frames = {seq: min(count, flags.frames) for seq, count in frames.items()}
    files = {key: value for sequence in sequences for key, value in _digests(sequence).items()}
    spec = {"from_labels": str(flags.from_labels), "files": files}
    return Plan("labels", spec, flags.seed, frames, options)


def _check(sequence: KittiSequence) -> None:
    """Reads the files of a sequence, so that faults are found before anything is written."""
    _ = sequence.objects, sequence.calib, sequence.poses
    if sequence.frames.start:
        begins = f"sequence {sequence.name} begins at frame {sequence.frames.start} by its seqmap"
        raise InputError(f"--from_labels: {begins}, expected 0", sequence.data_root)


def _digests(sequence: KittiSequence) -> dict[str, str]:
    """Digests of the files of a sequence that its replay depends on."""
    paths = {"label_02": sequence.label_path, "calib": sequence.calib_path}
    if sequence.has_poses:
        paths["poses"] = sequence.poses_path
    return {
        f"{folder}/{sequence.name}": hashlib.blake2b(read_bytes(path), digest_size=16).hexdigest()
        for folder, path in paths.items()
    }


def _own_plan(flags, options: Options) -> Plan:
    if flags.seqs is not None:
        raise InputError("--seqs is for --from_labels; own traffic takes --split and --sequences")
    split = flags.split or "train"
    numbers = OWN_SEQUENCES[split]
    count = flags.sequences or len(numbers)
    if count > len(numbers):
        raise InputError(
            f"--sequences: split {split} has {len(numbers)} numbers "
            f"({numbers[0]:04d}-{numbers[-1]:04d}), found {count}"
        )
    if (flags.frames or 0) > MAX_FRAMES:
        raise InputError(f"--frames: expected at most {MAX_FRAMES}, found {flags.frames}")
    frames = dict.fromkeys(numbers[:count], flags.frames or OWN_FRAMES)
    spec = {"split": split}
    if flags.van_share is not None:
        spec["van_share"] = flags.van_share
    return Plan("traffic", spec, flags.seed, frames, options)


def main(argv: Sequence[str] | None = None) -> int:
    """Makes the data set and prints its path."""
    flags = parser().parse_args(argv)
    plan = make_plan(flags)
    made = make_dataset(plan, flags.out, flags.processes)
    total = sum(plan.frames.values())
    word = "simulated" if made else "already there, complete:"
    print(f"{word} {len(plan.frames)} sequences, {total} frames in {flags.out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(run(main))
