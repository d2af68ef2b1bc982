"""Table IV of the paper: the tracker with each choice of the layers whose features are fused.

    python -m experiments.table4 --data_root DATA --seqs 0001-0015 --val_data_root VAL \
        --val_seqs 0016,0018 --weights weights --workdir runs/ablations --out results/tables

`experiments.ablation.rows` describes training and evaluation; with the workdir of Table III the row
that is in both tables is trained once.
"""

from collections.abc import Sequence

from common import flags
from experiments.ablation.rows import Ablation, Row, run_ablation
from experiments.paper import TABLE4

FEATURES = Ablation(
    name="table4",
    title="Table IV: layers whose features are fused",
    rows=(
        Row("DSA2 + DFP2", {"fused_features": "DSA2+DFP2"}, "DSA2 + DFP2"),
        Row("DSA3 + DFP3", {"fused_features": "DSA3+DFP3"}, "DSA3 + DFP3"),
        Row("Filter + FC2", {"fused_features": "filter+FC2"}, "Filter + FC2"),
        Row("Filter + FC1", {"fused_features": "filter+FC1"}, "Filter + FC1"),
    ),
    paper=TABLE4,
)


def main(argv: Sequence[str] | None = None) -> None:
    """Trains and evaluates every row, writes the table."""
    run_ablation(FEATURES, __doc__, argv)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
