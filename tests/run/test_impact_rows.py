"""Which rows take part in an impact, against plain forms."""

import numpy as np
import pytest
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from mbvi.run.loop.impact_rows import NO_ROWS, LaterRows, RecentPercussions, linked


def components(jacobian, chosen, seeds, parts):
    """Return what `linked` returns, by the components of the graph of rows and parts."""
    row, column = jacobian[chosen].nonzero()
    count = np.count_nonzero(chosen)
    edges = coo_array((np.ones(len(row)), (row, count + parts[column])), shape=(count + parts[-1] + 1,) * 2)
    label = connected_components(edges, directed=False)[1][:count]
    found = np.zeros(len(chosen), bool)
    found[chosen] = np.isin(label, label[seeds[chosen]])
    return found


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_linked_rows_are_those_in_the_components_of_seeds(seed, sparse):
    rng = np.random.default_rng(seed)
    parts = np.repeat(np.arange(12), 3)
    J = np.zeros((15, len(parts)))
    for row in J:
        for part in rng.choice(12, rng.integers(0, 3), replace=False):
            row[parts == part] = rng.normal(size=3)
    chosen = rng.random(15) < 0.7
    seeds = chosen & (rng.random(15) < 0.2)
    found = linked(csr_array(J) if sparse else J, chosen, seeds, parts)
    np.testing.assert_array_equal(found, components(J, chosen, seeds, parts))


def test_recent_percussions_are_those_of_the_last_steps():
    rng, recent, steps = np.random.default_rng(1), RecentPercussions(3), []
    for asked in rng.random(60) < 0.5:
        number, percussion = rng.integers(0, 9, 12), rng.normal(size=12)
        if asked:
            before = [(n, p) for one in steps[-3:] for n, p in zip(*one, strict=True)]
            level = [max([0.0, *(p for n, p in before if n == k)]) for k in number]
            np.testing.assert_array_equal(recent.exceeded(number, percussion), percussion > 2.0 * np.array(level))
        rates = rng.normal(size=(4, 12))
        recent.add(number, rates)
        steps.append((number, rates[0]))


@pytest.mark.parametrize("seed", range(20))
def test_steps_that_follow_count_as_if_they_had_been_added(seed):
    rng = np.random.default_rng(seed)
    sizes, added = rng.integers(0, 6, 8), int(rng.integers(0, 9))
    steps = [(rng.integers(0, 9, size), rng.normal(size=size)) for size in sizes]
    every, first = RecentPercussions(5), RecentPercussions(5)
    for k, (number, percussion) in enumerate(steps):
        for recent in (every, first)[: 2 if k < added else 1]:
            recent.add(number, percussion[None])
    # of those that follow no more than are kept
    left = steps[added:][-5:]
    later = LaterRows(
        *(np.concatenate([none, *(step[c] for step in left)]) for c, none in enumerate(NO_ROWS[:2])), len(left)
    )
    asked, percussion = np.arange(9), rng.random(9)
    np.testing.assert_array_equal(first.exceeded(asked, percussion, later), every.exceeded(asked, percussion))
