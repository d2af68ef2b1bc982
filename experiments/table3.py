"""Table III of the paper: the tracker with each fusion of features.

    python -m experiments.table3 --data_root DATA --seqs 0001-0015 --val_data_root VAL \
        --val_seqs 0016,0018 --weights weights --workdir runs/ablations --out results/tables

"Cosine distance" of the paper has two readings: the value beside the features of both points, or
alone. "No association" is not in the paper: the refinement uses frame t-1 alone, which shows the
contribution of the association head. `experiments.ablation.rows` describes training and evaluation.
"""

from collections.abc import Sequence

from common import flags
from experiments.ablation.rows import Ablation, Row, run_ablation
from experiments.paper import TABLE3

FUSIONS = Ablation(
    name="table3",
    title="Table III: fusion of features",
    rows=(
        Row("elementwise product", {"fusion": "elementwise_product"}, "elementwise product"),
        Row("concat", {"fusion": "concat"}, "concat"),
        Row("cosine distance", {"fusion": "cosine_distance"}, "cosine distance"),
        Row(
            "cosine distance alone",
            {"fusion": "cosine_distance", "fusion_keeps_features": False},
        ),
        Row("dot product", {"fusion": "dot_product"}, "dot product"),
        Row("no association", {"fusion": "none"}),
    ),
    paper=TABLE3,
)


def main(argv: Sequence[str] | None = None) -> None:
    """Trains and evaluates every row, writes the table."""
    run_ablation(FUSIONS, __doc__, argv)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
