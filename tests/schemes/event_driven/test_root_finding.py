"""First falls through zero of functions whose falls are known otherwise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbvi.schemes.event_driven.finding.root_finding import first_root

waves = st.lists(
    st.tuples(st.floats(-1, 1), st.floats(0, 25), st.floats(0, 6.3)), min_size=1, max_size=4
).filter(lambda terms: sum(abs(a) for a, _, _ in terms) > 0.1)  # fmt: skip


def found(*functions):
    def values(places, index):
        return np.array([[functions[k](x) for k in index] for x in places])

    return first_root(values, np.full(len(functions), np.inf))


def wave(terms):
    return lambda x: sum(a * np.cos(w * x + phase) for a, w, phase in terms)


@given(st.lists(waves, min_size=1, max_size=3), st.floats(-1, 1))
def test_the_first_fall_of_smooth_functions(several, lift):
    """Against a hundred thousand samples; where a function all but grazes zero either answer is right."""
    functions = [wave([*terms, (lift, 0.0, 0.0)]) for terms in several]
    x, k = found(*functions)
    fine = np.linspace(0.0, 1.0, 100_001)
    values = np.array([f(fine) for f in functions])
    # a fall: from above zero to below by more than a graze
    if k >= 0:
        # what starts below turns there
        assert abs(functions[k](x)) < 1e-5 or (values[k, fine < x] < 1e-5).all()
        before = values[:, fine < x - 1e-5]
    else:
        before = values
    for row in before:
        above = np.flatnonzero(row > 1e-7)
        first = above[0] if above.size else len(row)
        assert (row[first:] > -1e-7).all()


def test_a_kink_a_hop_and_a_graze():
    assert found(lambda x: abs(x - 0.5) - 1e-3)[0] == pytest.approx(0.499, abs=1e-6)
    assert found(lambda x: abs(x - 0.5) + 1e-3) == (1.0, -1)
    assert found(lambda x: x * (1e-6 - x))[0] == pytest.approx(1e-6, rel=1e-4)
    assert found(lambda x: (x - 0.4) ** 2 - 1e-12)[0] == pytest.approx(0.4 - 1e-6, abs=1e-9)
    assert found(lambda x: (x - 0.4) ** 2 + 1e-12) == (1.0, -1)


def test_what_starts_below_falls_where_it_turns():
    assert found(lambda x: x - 1e-9) == (1.0, -1)
    assert found(lambda x: -1e-9 - x)[0] == 0.0
    assert found(lambda x: -1.0 + x * (1.0 - x))[0] == pytest.approx(0.5, abs=2e-3)


def test_the_earliest_of_several():
    assert found(lambda x: 0.7 - x, lambda x: 0.3 - x, lambda x: 0.5 - x) == (pytest.approx(0.3), 1)


def test_a_dip_too_narrow_for_any_sample_is_found_by_a_bound_of_the_slope():
    """A ball that flies through a plate a thousand times thinner than its way."""

    def gap(x, index):
        return np.array([abs(x - 0.5371) - 1e-4])

    assert first_root(gap, np.array([1.2])) == (pytest.approx(0.537, abs=1e-8), 0)
    assert first_root(lambda x, index: gap(x, index) + 2e-4, np.array([1.2])) == (1.0, -1)
    # one that starts in contact and leaves has none
    assert first_root(lambda x, index: np.array([1e-15 + x]), np.array([1.2])) == (1.0, -1)
