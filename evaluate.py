"""Sequences -> boxes -> trajectories -> CLEAR MOT table.

    python evaluate.py --data_root KITTI --seqs 0016-0020 --tracker sort --out results/sort

Runs a tracker on labelled or detected boxes (or evaluates given result files, --results) and
evaluates it. `--out` gets tracks/00XX.txt, table.md and metrics.json; with `--subset testing` also
submission.zip for the KITTI server.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from common import flags
from common.config_flags import add_flags, from_flags
from common.errors import InputError
from evaluation.config import GROUND_TRUTH, NETWORK, EvaluateConfig
from evaluation.run import evaluate
from evaluation.submission import SUBMISSION
from evaluation.table import overall_table, threshold_line
from kitti.seqmap import TEST

__all__ = ["EvaluateConfig", "evaluate", "main"]


DEFAULT_OUT = Path("results/evaluate")
_BOXES = {
    GROUND_TRUTH: "the labelled boxes (--detections network: the detector's)",
    NETWORK: "the detector's boxes",
}


def parse_config(argv: Sequence[str] | None = None) -> EvaluateConfig:
    """Flags to configuration; raises InputError for contradictory ones."""
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    add_flags(parser, EvaluateConfig)
    given = parser.parse_args(argv)
    if "results" in given and ("tracker" in given or "detections" in given):
        raise InputError("--results runs no tracker: leave out --tracker and --detections")
    config = from_flags(EvaluateConfig, given)
    return replace(config, out=config.out or DEFAULT_OUT)


def main(argv: Sequence[str] | None = None) -> None:
    """Evaluates and prints one table."""
    config = parse_config(argv)
    record = evaluate(config)
    metrics = {name: record[name] for name in config.protocols}
    if config.results is None:
        print(f"{config.tracker} on {_BOXES.get(config.detections, config.detections)}")
    if metrics:
        print(overall_table(metrics) + threshold_line(record["run"]), end="")
    print(f"written to {config.out}")
    if config.subset == "testing":
        missing = len(TEST) - len(config.seqs)
        state = f"lacks {missing} of the server's sequences" if missing else "complete"
        print(f"for the KITTI server: {config.out / SUBMISSION} ({state})")


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
