"""Hungarian and greedy assignment against brute force and hand-made costs."""

import itertools

import numpy as np
import pytest

from tracking.assignment import greedy, hungarian


def brute_force(cost: np.ndarray, max_cost: float) -> float:
    """Least total over all one-to-one choices, where an end left alone costs `max_cost`."""
    rows, columns = cost.shape
    if rows > columns:
        return brute_force(cost.T, max_cost)
    return min(
        sum(min(cost[row, column], max_cost) for row, column in enumerate(choice))
        for choice in itertools.permutations(range(columns), rows)
    )


@pytest.mark.parametrize("shape", [(1, 1), (3, 3), (2, 5), (5, 2), (4, 4)])
@pytest.mark.parametrize("seed", range(5))
def test_hungarian_is_optimal_under_the_gate(shape, seed):
    cost = np.random.default_rng(seed).uniform(0, 1, shape)
    matching = hungarian(cost, max_cost=0.6)
    left = min(shape) - len(matching.pairs)
    total = sum(cost[row, column] for row, column in matching.pairs) + 0.6 * left
    assert total == pytest.approx(brute_force(cost, 0.6), abs=1e-4)
    assert all(cost[row, column] <= 0.6 for row, column in matching.pairs)


@pytest.mark.parametrize("assign", [hungarian, greedy])
@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0), (2, 5), (6, 4)])
def test_everyone_is_either_paired_or_left_over(assign, shape):
    cost = np.random.default_rng(1).uniform(0, 1, shape)
    matching = assign(cost, 0.5)
    assert matching.pairs.shape == (len(matching.pairs), 2)
    rows = np.r_[matching.pairs[:, 0], matching.unmatched_rows]
    columns = np.r_[matching.pairs[:, 1], matching.unmatched_columns]
    assert sorted(rows) == list(range(shape[0]))
    assert sorted(columns) == list(range(shape[1]))


def test_greedy_takes_the_best_pair_where_hungarian_takes_the_best_sum():
    # greedy: 0.1 first, which leaves 0.9; Hungarian: 0.2 + 0.3 = 0.5 < 0.1 + 0.9 = 1.0
    cost = np.array([[0.1, 0.2], [0.3, 0.9]])
    assert greedy(cost, 1.0).pairs.tolist() == [[0, 0], [1, 1]]
    assert hungarian(cost, 1.0).pairs.tolist() == [[0, 1], [1, 0]]


@pytest.mark.parametrize("assign", [hungarian, greedy])
def test_gate_is_inclusive_and_gated_ends_are_left_over(assign):
    cost = np.array([[0.5, np.inf], [np.inf, 0.6]])
    matching = assign(cost, 0.5)
    assert matching.pairs.tolist() == [[0, 0]]
    assert matching.unmatched_rows.tolist() == [1]
    assert matching.unmatched_columns.tolist() == [1]


def test_how_far_beyond_the_gate_does_not_matter():
    near, far = np.array([[0.4, 0.8], [0.5, 0.6]]), np.array([[0.4, 8e9], [0.5, 0.6]])
    assert np.array_equal(hungarian(near, 0.55).pairs, hungarian(far, 0.55).pairs)


def test_greedy_breaks_ties_by_row_then_column():
    assert greedy(np.zeros((2, 3)), 1.0).pairs.tolist() == [[0, 0], [1, 1]]
