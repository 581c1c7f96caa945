"""Which contacts at one configuration are the same at another one, where several are equally near."""

import numpy as np
import pytest

from mbvi.constraints.rows import mutual_nearest
from support.plain import mutual_nearest_plain

FORMS = [mutual_nearest, mutual_nearest_plain]


def matched(form, point, places, number=None, others=None):
    number = np.zeros(len(point), np.int64) if number is None else number
    others = np.zeros(len(places), np.int64) if others is None else others
    owner = np.full(len(point), -7)
    form(number, np.array(point), others, np.array(places), others.argsort(kind="stable"), owner)
    return owner.tolist()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_equal_distances_are_decided_by_the_order_and_not_by_rounding(form, size, rng):
    square = np.array([(1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0)])
    turned = np.array([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
    exact = {name: matched(form, size * first, size * last) for name, first, last in cases(square, turned)}
    for _ in range(20):
        for name, first, last in cases(square, turned):
            noisy = [size * (one + 1e-14 * rng.normal(size=one.shape)) for one in (first, last)]
            assert matched(form, *noisy) == exact[name], name


def cases(square, turned):
    return [
        ("one between four", np.zeros((1, 3)), square),
        ("four around one", square, np.zeros((1, 3))),
        ("a square turned by 45 degrees", turned, square),
        ("twice the same point", square[[0, 0]], square[[0, 0]]),
    ]


@pytest.mark.parametrize("form", FORMS)
def test_the_lowest_of_equally_near_ones_is_chosen(form):
    ends = [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]
    assert matched(form, [(0.0, 0.0, 0.0)], ends) == [0]
    assert matched(form, ends, [(0.0, 0.0, 0.0)]) == [0, -1]
    # two at one point remain two
    assert matched(form, [ends[0]] * 2, [ends[0]] * 2) == [0, 1]
    assert matched(form, np.full((2, 3), np.nan), np.full((2, 3), np.nan)) == [0, 1]


@pytest.mark.parametrize("form", FORMS)
def test_nearer_ones_are_chosen_before_lower_ones(form):
    assert matched(form, [(0.0, 0.0, 0.0)], [(1.0, 0.0, 0.0), (-1.0 + 1e-6, 0.0, 0.0)]) == [1]
    # the nearest of the second one is taken by the first, to which it is nearer
    assert matched(form, [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)], [(1.0, 0.0, 0.0), (9.0, 0.0, 0.0)]) == [0, -1]
