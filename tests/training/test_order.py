"""The order of samples: shares, shuffles, a pure function of the step."""

import numpy as np
import pytest

from common.errors import InputError
from training.sampling.data import Pool
from training.sampling.pipeline import BLOCK, Order, make_order, micro_batches


def one_pool(count: int, batch_size: int, seed: int) -> Order:
    return make_order([(0, t) for t in range(count)], (), 0, batch_size, seed)


def test_a_round_contains_every_sample_once():
    order = one_pool(10, batch_size=4, seed=1)
    assert order.steps_per_epoch == 2
    seen = np.concatenate([order.batch(step) for step in range(5)])
    np.testing.assert_array_equal(np.sort(seen[:10]), np.arange(10))
    np.testing.assert_array_equal(np.sort(seen[10:]), np.arange(10))
    assert not np.array_equal(seen[:10], seen[10:])


def test_order_can_start_anywhere():
    order = one_pool(7, batch_size=3, seed=2)
    whole = list(micro_batches(order, 0, 6, 0, 1, 1))
    late = list(micro_batches(order, 4, 6, 0, 1, 1))
    for (a, b), (c, d) in zip(whole[4:], late, strict=True):
        np.testing.assert_array_equal(a, c)
        np.testing.assert_array_equal(b, d)


def test_replicas_share_a_batch():
    order = one_pool(20, batch_size=8, seed=3)
    whole = [indices for indices, _ in micro_batches(order, 0, 2, 0, 1, 1)]
    parts = [list(micro_batches(order, 0, 2, worker, 2, 4)) for worker in (0, 1)]
    for step in range(2):
        joined = [parts[w][2 * step + r][0] for w in (0, 1) for r in (0, 1)]
        np.testing.assert_array_equal(np.concatenate(joined), whole[step])


def test_pools_have_their_shares_and_are_used_evenly():
    items = [(0, t) for t in range(50)] + [(1, t) for t in range(8)] + [(2, t) for t in range(30)]
    pools = [Pool(0.65, (0, 2)), Pool(0.35, (1,))]
    orders = [make_order(items, pools, 0, 4, seed) for seed in (5, 5, 6)]
    seen = [np.concatenate([order.batch(s) for s in range(3 * BLOCK // 4)]) for order in orders]
    np.testing.assert_array_equal(seen[0], seen[1])  # a function of seed and step alone
    assert not np.array_equal(seen[0], seen[2])
    small = (seen[0] >= 50) & (seen[0] < 58)
    for block in np.split(small, 3):
        assert np.count_nonzero(block) == 350
    assert small[:100].mean() == pytest.approx(0.35, abs=0.15)  # mixed within a block
    for indices in (np.arange(50, 58), np.r_[0:50, 58:88]):
        drawn = seen[0][np.isin(seen[0], indices)]
        for start in range(0, len(drawn) - len(indices), len(indices)):
            np.testing.assert_array_equal(np.sort(drawn[start : start + len(indices)]), indices)


def test_an_order_of_pools_can_start_anywhere():
    items = [(i % 3, i) for i in range(90)]
    order = make_order(items, [Pool(0.2, (0,)), Pool(0.5, (1,)), Pool(0.3, (2,))], 0, 7, 1)
    late = make_order(items, [Pool(0.2, (0,)), Pool(0.5, (1,)), Pool(0.3, (2,))], 0, 7, 1)
    whole = [order.batch(step) for step in range(400)]
    for step in (399, 3, 200):
        np.testing.assert_array_equal(late.batch(step), whole[step])


def test_no_items_are_refused():
    with pytest.raises(InputError, match="expected frames"):
        make_order([], (), 0, 2, 0)
    with pytest.raises(InputError, match="expected frames"):
        make_order([(0, 1)], [Pool(0.5, (0,)), Pool(0.5, (1,))], 0, 2, 0)
