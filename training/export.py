"""Makes a folder of weights out of two trainings' checkpoints.

    python -m training.export --detector runs/det/checkpoints/best.npz \\
        --tracker runs/track/checkpoints/best.npz --out weights

Each network becomes NAME.npz (weights and configuration, without the optimiser's state) and
NAME.json, its configuration, figures and training record for reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common.files import write_json
from common.flags import ArgumentParser, run
from training import checkpoint
from training.weights import load_detector, load_tracker


def export(path: str | Path, variables, out: Path) -> None:
    """Writes out.npz and out.json from the checkpoint at `path` and the variables read from it."""
    meta, _ = checkpoint.load(path)
    meta.pop("format")
    checkpoint.save(out.with_suffix(".npz"), meta, model=variables)
    write_json(out.with_suffix(".json"), meta)


def main(argv: Sequence[str] | None = None) -> None:
    """Checks that the two networks belong together, then writes both."""
    parser = ArgumentParser(description="Make a folder of weights out of two checkpoints.")
    parser.add_argument("--detector", required=True, metavar="CHECKPOINT")
    parser.add_argument("--tracker", required=True, metavar="CHECKPOINT")
    parser.add_argument("--out", type=Path, default=Path("weights"), metavar="DIR")
    flags = parser.parse_args(argv)
    detector = load_detector(flags.detector)
    tracker = load_tracker(flags.tracker, detector)
    export(flags.detector, detector.weights, flags.out / "detector")
    export(flags.tracker, tracker.weights, flags.out / "tracker")
    print(f"written to {flags.out}")


if __name__ == "__main__":
    raise SystemExit(run(main))
