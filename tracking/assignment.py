"""One-to-one assignment of tracks (rows) and detections (columns), with a gate.

Rows and columns of a pair beyond the gate stay unmatched.
"""

from dataclasses import dataclass

import numpy as np

EPSILON = 1e-5  # as in DEEP_SORT: extra cost of a pair beyond the gate


@dataclass(frozen=True)
class Matching:
    """Pairs (P, 2) of row and column, unmatched rows and columns; int64, each ascending."""

    pairs: np.ndarray
    unmatched_rows: np.ndarray
    unmatched_columns: np.ndarray


def _matching(pairs, shape: tuple[int, int]) -> Matching:
    pairs = np.array(sorted(pairs), np.int64).reshape(-1, 2)
    return Matching(
        pairs,
        np.setdiff1d(np.arange(shape[0]), pairs[:, 0]),
        np.setdiff1d(np.arange(shape[1]), pairs[:, 1]),
    )


def hungarian(cost: np.ndarray, max_cost: float) -> Matching:
    """The assignment of least total cost (Kuhn 1955), where a pair left unmatched costs `max_cost`.

    Pairs that cost more than `max_cost` (infinity is allowed, NaN is not) are excluded; the amount
    beyond it has no influence on the others.
    """
    if cost.size == 0:
        return _matching([], cost.shape)
    from scipy.optimize import linear_sum_assignment  # slow to import; Algorithm 1 is greedy

    rows, columns = linear_sum_assignment(np.minimum(cost, max_cost + EPSILON))
    kept = cost[rows, columns] <= max_cost
    return _matching(zip(rows[kept], columns[kept], strict=True), cost.shape)


def greedy(cost: np.ndarray, max_cost: float) -> Matching:
    """Cheapest pair first, then the cheapest of the rest, up to `max_cost`.

    Equal costs: the lower row first, then the lower column.
    """
    order = np.argsort(cost, axis=None, kind="stable")
    free_rows, free_columns = np.ones(cost.shape[0], bool), np.ones(cost.shape[1], bool)
    pairs = []
    for row, column in zip(*np.unravel_index(order, cost.shape), strict=True):
        if cost[row, column] > max_cost:
            break
        if free_rows[row] and free_columns[column]:
            free_rows[row] = free_columns[column] = False
            pairs.append((row, column))
    return _matching(pairs, cost.shape)
