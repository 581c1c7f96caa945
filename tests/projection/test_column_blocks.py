"""Blocks of columns of sparse rows, against scipy's own."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array, hstack, random_array

from mbvi.projection.sparse.column_blocks import compose, cut


def blocks(seed):
    rng = np.random.default_rng(seed)
    m, widths = rng.integers(0, 6), rng.integers(1, 5, size=rng.integers(1, 5))
    return m, [csr_array(random_array((m, w), density=0.5, rng=rng, format="csr")) for w in widths]


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=50)
def test_blocks_side_by_side_are_those_of_scipy_and_are_cut_out_again(seed):
    m, parts = blocks(seed)
    ends = np.cumsum([0, *(part.shape[1] for part in parts)])
    shape, every = (m, int(ends[-1])), np.arange(m)
    # every other block is a full array
    given_parts = [part if k % 2 else part.toarray() for k, part in enumerate(parts)]
    rows = csr_array(compose([(every, int(e), p) for e, p in zip(ends, given_parts, strict=False)], shape), shape=shape)
    expected = hstack(parts, format="csr")
    np.testing.assert_array_equal(rows.toarray(), expected.toarray())
    assert rows.indices.dtype == np.int32 and rows.nnz == expected.nnz
    for first, end, part in zip(ends[:-1].tolist(), ends[1:].tolist(), parts, strict=True):
        np.testing.assert_array_equal(cut(rows, slice(first, end)).toarray(), part.toarray())


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_a_block_may_have_some_of_the_rows_only(seed):
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 9))
    full, parts = np.zeros((m, 6)), []
    for first, width in ((0, 2), (2, 4)):
        here = np.flatnonzero(rng.random(m) < 0.5)
        block = rng.normal(size=(len(here), width)) * (rng.random((len(here), width)) < 0.7)
        full[here, first : first + width] = block
        parts.append((here, first, csr_array(block) if first else block))
    rows = csr_array(compose(parts, (m, 6)), shape=(m, 6))
    np.testing.assert_array_equal(rows.toarray(), full)
