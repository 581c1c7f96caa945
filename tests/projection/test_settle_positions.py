"""The position projection of linear gaps on cases worked out by hand: a unit mass in space, rows along its axes."""

import numpy as np
import pytest

from mbvi.projection import DenseMetric, FreeMotion, LinearGaps, Projector

STEP, DRIFT, TOLERANCE = 1.0, 0.5, 1e-8
AXES = np.eye(3)


def settle(J, end, law, *, x, w, v=(0.0, 0.0, 0.0), e=0.0, number=None, point=None):
    """Settle a step whose law took x to w; `end` are the gaps at its end."""
    J, w, v, law = np.array(J, dtype=float), np.array(w, dtype=float), np.array(v, dtype=float), np.array(law)
    m = len(J)
    displacement = DRIFT * (w - v)
    number = np.arange(m) if number is None else np.array(number)
    point = np.zeros((m, 3)) if point is None else np.array(point, dtype=float)
    gaps = LinearGaps(
        number, point, J, J, np.array(end) - J @ displacement, np.ones(m), np.full(m, e), np.zeros(m), np.ones((1, 3)),
        v, STEP, DRIFT, TOLERANCE, 10.0, 10.0, np.zeros(3, bool),
    )  # fmt: skip
    x = np.array(x, dtype=float)
    rates = np.array([J @ (w - x), J @ x, J @ w, J @ v])[:, law]
    return Projector().settle(FreeMotion(x, DenseMetric(np.eye(3))), gaps, w, displacement, law, rates)


def test_without_restitution_all_contacts_in_penetration_are_raised():
    """One that opens too; its velocity stays."""
    found = settle(AXES[:2], [-1e-3, -1e-3], [True, True], x=(-1, 0.5, 0), w=(0, 0.5, 0))
    np.testing.assert_allclose(found.moved, [1e-3, 1e-3, 0], atol=1e-15)
    np.testing.assert_allclose(found.gap, [0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(found.tangent, [0, 0.5, 0], atol=1e-15)
    np.testing.assert_allclose(found.rates[0], [1.0, 0.0], atol=1e-15)


def test_what_is_no_deeper_than_the_tolerance_stays():
    found = settle(AXES[:1], [-0.9 * TOLERANCE], [True], x=(-1, 0, 0), w=(0, 0, 0))
    assert found.moved is None
    np.testing.assert_array_equal(found.w, 0.0)


@pytest.mark.parametrize(("rate", "raised"), [(0.5 * TOLERANCE, True), (4e-4, True), (6e-4, False)])
def test_with_restitution_a_contact_is_raised_that_does_not_leave_within_two_steps(rate, raised):
    found = settle(AXES[:1], [-1e-3], [True], x=(rate, 0, 0), w=(rate, 0, 0), e=0.5)
    assert (found.moved is not None) == raised


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_beside_a_contact_that_bounces_another_way_is_taken(e):
    found = settle(AXES[:2], [-1e-3, -1e-3], [True, True], x=(-1, 0.5, 0), w=(0, 0.5, 0), v=(0, 0.5, 0), e=e)
    assert (found is None) == (e > 0.0)


def test_a_row_that_joins_bears_no_load_while_it_is_open():
    """At the end of the step it is 5e-5 open, half a unit where the law acts."""
    found = settle(AXES[:2], [-1e-3, 5e-5], [True, False], x=(-1, -1, 0), w=(0, -1, 0), v=(0, -1, 0))
    np.testing.assert_array_equal(found.law, [True, True])
    np.testing.assert_allclose(found.w, [0, -1, 0], atol=1e-15)
    # until the next law, half a step on, it may close
    np.testing.assert_allclose(found.tangent, [0, -5e-5 / (STEP - DRIFT), 0], atol=1e-15)


def test_a_row_that_joins_is_kept_from_sinking():
    """It would have sunk by 0.1; the law with it ends where it touches."""
    found = settle(AXES[:2], [-1e-3, -0.1], [True, False], x=(-1, -1, 0), w=(0, -1, 0), v=(0, -1, 0))
    np.testing.assert_allclose(found.w, [0, -0.8, 0], atol=1e-14)
    np.testing.assert_allclose(found.gap, [0, 0], atol=1e-14)


def test_a_contact_is_followed_to_another_point_of_its_bodies():
    """The pair has left the point of the law's row and sunk at another, whose row takes its place."""
    rows = {"number": [7, 7], "point": [(0, 0, 0), (0.1, 0, 0)]}
    found = settle(AXES[:2], [0.1, -1e-3], [True, False], x=(-1, -1, 0), w=(0, -1, 0), v=(0, -1, 0), **rows)
    np.testing.assert_array_equal(found.law, [False, True])
    np.testing.assert_allclose(found.moved, [0, 1e-3, 0], atol=1e-15)
    np.testing.assert_allclose(found.tangent, [-1, 0, 0], atol=1e-15)
    # of another pair it is no successor, and joins
    rows["number"] = [7, 8]
    found = settle(AXES[:2], [-1e-3, -1e-3], [True, False], x=(-1, -1, 0), w=(0, -1, 0), v=(0, -1, 0), **rows)
    np.testing.assert_array_equal(found.law, [True, True])


def test_one_successor_follows_one_contact():
    """Of two points of a pair the nearer one takes the place of the law's; the other joins."""
    rows = {"number": [7, 7, 7], "point": [(0, 0, 0), (0.1, 0, 0), (0.5, 0, 0)]}
    found = settle(
        AXES, [0.1, -1e-3, -1e-3], [True, False, False], x=(-1, -1, -1), w=(0, -1, -1), v=(0, -1, -1), **rows
    )
    np.testing.assert_array_equal(found.law, [False, True, True])
    # what joins takes part in the law
    np.testing.assert_allclose(found.w, [0, -1, -0.998], atol=1e-14)


def test_rows_that_contradict_each_other_are_left_to_others():
    assert settle([AXES[0], -AXES[0]], [-1e-3, 0.0], [True, True], x=(-1, 0, 0), w=(0, 0, 0)) is None
