"""Table IV of the paper: the tracker with each choice of the layers whose features are fused.

    python -m experiments.table4 --data_root DATA --seqs 0000-0015 --val_data_root VAL \
        --detector weights/detector.npz --workdir runs/table4 --out results/table4

See `experiments.ablation` for what is trained, evaluated and written.
"""

from __future__ import annotations

from collections.abc import Sequence

from common import flags
from experiments.ablation import Ablation, run_ablation
from experiments.paper import TABLE4

FEATURES = Ablation(
    name="table4",
    title="Table IV: layers whose features are fused",
    field="fused_features",
    rows={
        "DSA2 + DFP2": "DSA2+DFP2",
        "DSA3 + DFP3": "DSA3+DFP3",
        "Filter + FC2": "filter+FC2",
        "Filter + FC1": "filter+FC1",
    },
    paper=TABLE4,
)


def main(argv: Sequence[str] | None = None) -> None:
    """Trains and evaluates every row, writes the table."""
    run_ablation(FEATURES, __doc__, argv)


if __name__ == "__main__":
    raise SystemExit(flags.run(main))
