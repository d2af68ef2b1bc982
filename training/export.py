"""Makes a folder of weights from the checkpoints of one or both trainings.

    python -m training.export --detector runs/detector --tracker runs/tracker --out weights

Each network becomes NAME.npz (weights and configuration, without the optimizer's state),
NAME.json, its configuration, metrics and training record for reading, and NAME_history.csv, the
metrics of every epoch; training.md has them in two tables.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import keras

from common.errors import InputError
from common.files import write_bytes, write_json, write_text
from common.flags import ArgumentParser, run
from models import checkpoint
from models.weights import load_detector, load_tracker
from training.checkpoint_folder import CHECKPOINTS, CheckpointFolder


def export(path: Path, network: keras.Model, out: Path) -> dict[str, Any]:
    """Writes out.npz, out.json and the history from the checkpoint at `path`; returns its meta."""
    meta, _ = checkpoint.load(path)
    meta.pop("format")
    checkpoint.save(out.with_suffix(".npz"), meta, model=checkpoint.named_variables(network))
    write_json(out.with_suffix(".json"), meta)
    history = path.parent.parent / "history.csv"
    if history.is_file():
        write_bytes(out.with_name(f"{out.name}_history.csv"), history.read_bytes())
    return meta


def describe(meta: dict[str, Any]) -> str:
    """A Markdown table of a network's training record and last metrics."""
    schedule, record = meta["config"]["schedule"], meta["record"]
    rows = {
        "command": f"`{record['command']}`",
        "made": f"{record['time_utc']}, commit {record['git_commit']}",
        "parameters": record["parameters"],
        "steps": meta["step"],
        "batch": schedule["batch_size"],
        "samples seen": meta["step"] * schedule["batch_size"],
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


def checkpoint_of(path: Path) -> Path:
    """The last checkpoint of a training's workdir, or `path` itself where it is a file.

    Raises:
        InputError: a folder without checkpoints.
    """
    if not path.is_dir():
        return path
    folder = CheckpointFolder(path / CHECKPOINTS, 1)
    steps = folder.steps()
    if not steps:
        raise InputError("expected a training's workdir with checkpoints", path)
    return folder.path(steps[-1])


def main(argv: Sequence[str] | None = None) -> None:
    """Checks that the networks belong together, then writes them."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    text = "a checkpoint, or a training's workdir (its last checkpoint)"
    add("--detector", type=Path, required=True, metavar="PATH", help=text)
    add("--tracker", type=Path, metavar="PATH", help=text)
    add("--out", type=Path, default=Path("weights"), metavar="DIR")
    flags = parser.parse_args(argv)
    path = checkpoint_of(flags.detector)
    detector = load_detector(path)
    networks = {"detector": (path, detector)}
    if flags.tracker is not None:
        path = checkpoint_of(flags.tracker)
        networks["tracker"] = (path, load_tracker(path, detector))
    metas = [export(path, network, flags.out / name) for name, (path, network) in networks.items()]
    write_text(flags.out / "training.md", "\n".join(map(describe, metas)))
    print(f"written to {flags.out}")


if __name__ == "__main__":
    raise SystemExit(run(main))
