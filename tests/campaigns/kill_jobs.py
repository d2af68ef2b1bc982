"""Small jobs that are killed: their command, and the outputs that must be equal."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TRAIN = ("-m", "helpers.train_small")
SIMULATE = ("-m", "simulator", "--split", "val", "--sequences", "1", "--processes", "1")
FRAMES = ("--frames", "3")

Digest = dict[str, str]


@dataclass(frozen=True)
class Job:
    """A command that resumes where it was interrupted.

    Attributes:
        command: arguments of the Python interpreter for inputs and output folder, before each run.
        digest: of the outputs that are equal in every complete run, by name.
    """

    command: Callable[[Path, Path], list[str]]
    digest: Callable[[Path], Digest]


def make_inputs(folder: Path) -> None:
    """Writes data sets and weights that the jobs read: `cars`, `kitti`, `weights`."""
    from helpers import tiny_kitti, two_cars
    from helpers.small_weights import write_weights

    two_cars.write_sequence(folder / "cars", frames=5)
    tiny_kitti.make(folder / "kitti")
    write_weights(folder / "weights")


def _hash(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=8).hexdigest()


def _files(folder: Path, *patterns: str) -> Digest:
    """Hashes of files; the folder's own path, which recorded commands hold, counts as equal."""
    paths = sorted(path for pattern in patterns for path in folder.rglob(pattern) if path.is_file())
    own = str(folder).encode()
    return {str(p.relative_to(folder)): _hash(p.read_bytes().replace(own, b"OUT")) for p in paths}


def _training(kind: str) -> Callable[[Path, Path], list[str]]:
    def command(inputs: Path, out: Path) -> list[str]:
        resume = ["--resume"] if (out / "config.json").is_file() else []
        return [*TRAIN, kind, str(inputs / "cars"), str(out), "--epochs", "2", *resume]

    return command


def _last_checkpoint(out: Path) -> Digest:
    """The arrays of the last step and the number of epochs in the history."""
    path = max((out / "checkpoints").glob("step-*.npz"))
    epochs = len((out / "history.csv").read_text().splitlines())
    return {"step": path.name, "epochs": str(epochs), **_arrays(path)}


def _arrays(path: Path) -> Digest:
    with np.load(path) as file:
        return {n: _hash(np.ascontiguousarray(file[n]).tobytes()) for n in file if n != "meta"}


def _made(out: Path) -> Digest:
    """The last checkpoint of the recipe's training, and the weights that it copies."""
    copied = {f"weights/{name}": value for name, value in _arrays(out / "out" / "best.npz").items()}
    return {**_last_checkpoint(out / "detector"), **copied}


def _evaluation(inputs: Path, out: Path) -> list[str]:
    argv = ["--data_root", str(inputs / "kitti"), "--seqs", "0000-0001", "--tracker", "ab3dmot"]
    return ["evaluate.py", *argv, "--protocol", "clear3d,kitti2d,kitti3d", "--out", str(out)]


def _evaluated(out: Path) -> Digest:
    metrics = json.loads((out / "metrics.json").read_text())
    metrics.pop("run")  # holds the time
    return {**_files(out, "*.txt", "table.md"), "metrics": _hash(json.dumps(metrics).encode())}


def _demo(inputs: Path, out: Path) -> list[str]:
    argv = ["--out", str(out), "--weights", str(inputs / "weights"), "--sequences", "1"]
    return ["demo.py", *argv, *FRAMES, "--displacements", "0"]


def _demonstrated(out: Path) -> Digest:
    figures = json.loads((out / "metrics.json").read_text())["figures"]
    counts = {d: {n: r["clear3d"] for n, r in trackers.items()} for d, trackers in figures.items()}
    pictures = ("birds_eye.png", "trajectories.png", "animation.gif")
    data = _files(out, "*.bin", "[0-9]*.txt", *pictures)
    return {**data, "figures": _hash(json.dumps(counts).encode())}


def _recipe(inputs: Path, out: Path) -> list[str]:
    return ["-m", "campaigns.small_recipe", str(inputs / "cars"), str(out)]


JOBS = {
    "simulation": Job(
        lambda _, out: [*SIMULATE, *FRAMES, "--out", str(out)], lambda out: _files(out, "*")
    ),
    "detector": Job(_training("detector"), _last_checkpoint),
    "tracker": Job(_training("tracker"), _last_checkpoint),
    "evaluation": Job(_evaluation, _evaluated),
    "demo": Job(_demo, _demonstrated),
    "recipe": Job(_recipe, _made),
}
"""By name."""
