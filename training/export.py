"""Makes a folder of weights from the checkpoints of one or both trainings.

    python -m training.export --detector runs/detector --tracker runs/tracker --out weights

Each network becomes NAME.npz (weights and configuration, without the optimizer's state),
NAME.json, its configuration, metrics and training record for reading, and NAME_history.csv, the
metrics of every epoch; training.md has them in two tables.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import keras
import numpy as np

from common.errors import InputError
from common.files import write_bytes, write_json, write_text
from common.flags import ArgumentParser, positive_int, run
from common.notes import note
from models import checkpoint
from models.boxes.box_score import load_scorer
from models.weight_files import SCORER, TRACKER
from models.weights import load_detector, load_tracker, network_hash
from training.checkpoint_folder import CHECKPOINTS, CheckpointFolder


def mean_network(paths: Sequence[Path], network: keras.Model) -> dict[str, Any]:
    """Gives the network, that of the last checkpoint, the mean weights of all; returns the meta.

    This is stochastic weight averaging (Izmailov et al. 2018). The moving averages of batch
    normalisation are averaged too, which is exact where the training has frozen them.

    Raises:
        InputError: a checkpoint is broken, or of another network.
    """
    metas, arrays = zip(*map(checkpoint.load, paths), strict=True)
    meta = metas[-1]
    meta.pop("format")
    if len(paths) > 1:
        weights = checkpoint.named_variables(network)
        parts = []
        for path, part in zip(paths, arrays, strict=True):
            part = {name: array for name, array in part.items() if name.startswith("model/")}
            checkpoint.restore(path, part, model=weights)  # checks them
            parts.append(part)
        mean = {name: np.mean([part[name] for part in parts], axis=0) for name in parts[-1]}
        checkpoint.restore(paths[-1], mean, model=weights)
        meta |= {"metrics": {}, "mean_of_steps": [part.get("step") for part in metas]}
    return meta


def export(meta: dict[str, Any], network: keras.Model, history: Path, out: Path) -> None:
    """Writes out.npz, out.json, and the history of the training where it is there."""
    checkpoint.save(out.with_suffix(".npz"), meta, model=checkpoint.named_variables(network))
    write_json(out.with_suffix(".json"), meta)
    copy = out.with_name(f"{out.name}_history.csv")
    if history.is_file():
        write_bytes(copy, history.read_bytes())
    elif copy.exists():
        note(f"{copy}: is of the network that was here before, {history} does not exist")


def history_of(path: Path) -> Path:
    """The history beside a checkpoint: of its training's workdir, or of an exported network."""
    if path.parent.name == CHECKPOINTS:
        return path.parent.parent / "history.csv"
    return path.with_name(f"{path.stem}_history.csv")


@contextmanager
def _of_a_training(path: Path) -> Iterator[None]:
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"not a training's checkpoint ({error!r})", path) from error


def describe(meta: dict[str, Any], path: Path) -> str:
    """A Markdown table of a network's training record and last metrics.

    Raises:
        InputError: the meta of this checkpoint lacks a part of them.
    """
    with _of_a_training(path):
        json.dumps(meta, allow_nan=False)
        schedule, record = meta["config"]["schedule"], meta["record"]
        means, resumed = meta.get("mean_of_steps", []), record.get("resumed", [])
        parts = ", ".join(f"at step {p['step']}, commit {p['git_commit']}" for p in resumed)
        rows = {
            "command": f"`{record['command']}`",
            "made": f"{record['time_utc']}, commit {record['git_commit']}",
            **({"resumed": parts} if parts else {}),
            "parameters": record["parameters"],
            "steps": meta["step"],
            **({"mean of the weights after steps": ", ".join(map(str, means))} if means else {}),
            "batch": schedule["batch_size"],
            "samples seen": int(meta["step"]) * int(schedule["batch_size"]),
            "learning rate": f"{schedule['learning_rate_min']} to {schedule['learning_rate_max']}",
            "started from": record["data"].get("init") or "random weights",
            "training data": _ranges(record["data"]["training"]),
            "validation data": _ranges(record["data"]["validation"]),
            **{name: f"{value:.4g}" for name, value in meta["metrics"].items()},
        }
        lines = [f"| {meta['kind']} | |", "|---|---|"]
        return "\n".join([*lines, *(f"| {name} | {value} |" for name, value in rows.items()), ""])


def _ranges(sequences: Sequence[str]) -> str:
    """Folders with the ranges of their sequences: ["a/0001", "a/0002"] -> "a/0001-0002"."""
    parts: list[tuple[str, int, int]] = []  # folder, first, last
    for folder, _, name in (sequence.rpartition("/") for sequence in sequences):
        number = int(name)
        if parts and parts[-1][::2] == (folder, number - 1):
            parts[-1] = (folder, parts[-1][1], number)
        else:
            parts.append((folder, number, number))
    return ", ".join(
        f"{folder}/{first:04}" + (f"-{last:04}" if last > first else "")
        for folder, first, last in parts
    )


def checkpoints_of(path: Path, epochs: int) -> list[Path]:
    """The checkpoints of the last epochs of a training's workdir, or `path` where it is a file.

    The last one within an epoch stands for the last epoch of a training that was stopped.

    Raises:
        InputError: a folder without checkpoints, or with those of fewer epochs.
    """
    if not path.is_dir():
        return [path]
    folder = CheckpointFolder(path / CHECKPOINTS)
    steps = folder.steps()
    if not steps:
        raise InputError("expected a training's workdir with checkpoints", path)
    paths = [folder.path(step) for step in steps]
    earlier = [p for p in paths[:-1] if checkpoint.load(p)[0].get("metrics")]
    chosen = [*earlier, paths[-1]][-epochs:]
    if len(chosen) < epochs:
        raise InputError(
            f"--mean_of_epochs: expected checkpoints of at least {epochs} epochs "
            f"(--schedule.keep_checkpoints), found {len(chosen)}",
            path,
        )
    return chosen


def _check_tracker(folder: Path, detector: keras.Model) -> None:
    """Raises InputError where the tracker in a folder of weights is of another detector."""
    path = folder / TRACKER
    if path.exists():
        try:
            load_tracker(path, detector)
        except InputError as error:
            raise InputError(f"{error}: give --tracker too, or another --out") from error


def _note_scorer(folder: Path, detector: keras.Model) -> None:
    """Notes that the scorer in a folder of weights is of another detector."""
    if (folder / SCORER).exists():
        try:
            load_scorer(folder, network_hash(detector))
        except InputError as error:
            note(f"{error}: training.calibrate makes another")


def main(argv: Sequence[str] | None = None) -> None:
    """Checks that the networks belong together, then writes them."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    text = "a checkpoint, or a training's workdir (its last checkpoint)"
    add("--detector", type=Path, required=True, metavar="PATH", help=text)
    add("--tracker", type=Path, metavar="PATH", help=text)
    text = "of a workdir: the mean of the weights after this many last epochs"
    add("--mean_of_epochs", type=positive_int, default=1, metavar="N", help=text)
    add("--out", type=Path, default=Path("weights"), metavar="DIR")
    flags = parser.parse_args(argv)
    given = [path for path in (flags.detector, flags.tracker) if path is not None]
    if flags.mean_of_epochs > 1 and not any(path.is_dir() for path in given):
        raise InputError("--mean_of_epochs: expected a training's workdir", given[-1])
    paths = checkpoints_of(flags.detector, flags.mean_of_epochs)
    detector = load_detector(paths[-1])
    networks = {"detector": (mean_network(paths, detector), detector, paths[-1])}
    if flags.tracker is not None:
        paths = checkpoints_of(flags.tracker, flags.mean_of_epochs)
        tracker = load_tracker(paths[-1], detector)
        networks["tracker"] = (mean_network(paths, tracker), tracker, paths[-1])
    else:
        _check_tracker(flags.out, detector)
    described = [describe(meta, path) for meta, _, path in networks.values()]
    for name, (meta, network, path) in networks.items():
        export(meta, network, history_of(path), flags.out / name)
    write_text(flags.out / "training.md", "\n".join(described))
    _note_scorer(flags.out, detector)
    print(f"written to {flags.out}")


if __name__ == "__main__":
    raise SystemExit(run(main))
