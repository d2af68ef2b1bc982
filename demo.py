"""Runs the whole chain in one command: data, networks, trackers on the same boxes, table, pictures.

    python demo.py --out results/demo

Without --data_root a few held-out sequences of the simulator's own traffic are made first.
Finished steps are skipped, so an interrupted demo resumes.
"""

from collections.abc import Sequence

from common import flags
from common.config_flags import add_flags, from_flags
from common.errors import InputError
from experiments.demo import DemoConfig, run_demo


def parse_config(argv: Sequence[str] | None = None) -> DemoConfig:
    """Flags to configuration; raises InputError for contradictory ones."""
    parser = flags.ArgumentParser(description=__doc__.split("\n")[0])
    add_flags(parser, DemoConfig)
    given = parser.parse_args(argv)
    config = from_flags(DemoConfig, given)
    if config.data_root is not None and ("sequences" in given or "frames" in given):
        raise InputError("--sequences and --frames are for simulated data: leave out --data_root")
    return config


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the demo; prints the table and the paths of the output."""
    run_demo(parse_config(argv))


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
