"""Table III of the paper: the tracker with each of the four fusions of features.

    python -m experiments.table3 --data_root DATA --seqs 0000-0015 --val_data_root VAL \
        --detector weights/detector.npz --workdir runs/table3 --out results/table3

See `experiments.ablation` for what is trained, evaluated and written.
"""

from __future__ import annotations

from collections.abc import Sequence

from common import flags
from experiments.ablation import Ablation, run_ablation
from experiments.paper import TABLE3

FUSIONS = Ablation(
    name="table3",
    title="Table III: fusion of features",
    field="fusion",
    rows={
        "elementwise product": "elementwise_product",
        "concat": "concat",
        "cosine distance": "cosine_distance",
        "dot product": "dot_product",
    },
    paper=TABLE3,
)


def main(argv: Sequence[str] | None = None) -> None:
    """Trains and evaluates every row, writes the table."""
    run_ablation(FUSIONS, __doc__, argv)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
