"""A family of constraints from outside the library runs with every scheme, and the cache never changes its rows."""

import copy
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.constraints import AdmissibleSet, ConstraintFamily, Rows
from support.paths import ROBOTS

RADIUS = 2.0
STEPPING = [
    mbvi.Paoli(),
    mbvi.Paoli(project_positions=True),
    mbvi.MoreauJean(),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.SchatzmanPaoli(),
]
EVERY = [*STEPPING, mbvi.StewartTrinkle(), mbvi.EventDriven(1e-10), None]


class PointsInSphere(ConstraintFamily):
    """Points that stay inside a sphere about the origin: f_i = R - |x_i|. All that a family needs is in this class."""

    def __init__(self, count, restitution=np.nan, cached=True):
        self.size, self.restitution = count, restitution
        self.names = [f"point {k} | sphere" for k in range(count)]
        self._cached, self.queries = cached, 0

    def gap(self, t, q):
        return RADIUS - np.linalg.norm(q.reshape(-1, 3), axis=1)

    def gradient(self, t, q):
        x = q.reshape(-1, 3)
        rows = np.zeros((self.size, self.size, 3))
        rows[np.arange(self.size), np.arange(self.size)] = -x / np.linalg.norm(x, axis=1)[:, None]
        return rows.reshape(self.size, -1)

    def contacts(self, t, q, tolerance):
        self.queries += 1
        gap = self.gap(t, q)
        near = np.flatnonzero(gap <= tolerance)
        self._least = gap.min() - tolerance
        if not near.size:
            return None
        inwards = -q.reshape(-1, 3)[near]
        inwards /= np.linalg.norm(inwards, axis=1)[:, None]
        e = np.full(near.size, self.restitution)
        return Rows(near, gap[near], self.gradient(t, q)[near], e, -RADIUS * inwards, inwards)

    def clearance(self):
        return self._least if self._least > 0.0 else -np.inf

    def reach(self):
        return np.kron(np.eye(self.size), np.ones(3)) if self._cached else None

    def row_points(self, t, q, rows):
        outwards = q.reshape(-1, 3)[rows]
        outwards = outwards / np.linalg.norm(outwards, axis=1)[:, None]
        return RADIUS * outwards, -outwards


class PlainSphere:
    """The same constraint of one point, as a user writes it."""

    names = ("point 0 | sphere",)

    def gap(self, t, q):
        return RADIUS - np.linalg.norm(q)

    def gradient(self, t, q):
        return -q / np.linalg.norm(q)


def points(constraint, q, v, e=1.0, weight=0.0, count=1):
    """Free points of 1 kg each."""
    mass, force = np.eye(3 * count), np.tile([0.0, 0.0, -weight], count)
    system = mbvi.LagrangianSystem(lambda q: mass, lambda t, q, v: force, 3 * count)
    return mbvi.Problem(system, [constraint], q, v, restitution=e)


def run(problem, scheme, duration):
    step = {} if scheme is None or isinstance(scheme, mbvi.EventDriven) else {"step": 1e-3}
    return mbvi.simulate(problem, scheme, duration=duration, progress=False, **step)


every = pytest.mark.parametrize("scheme", EVERY, ids=repr)
# a chord of the sphere off its centre, at unit speed
START, SPEED = [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]


@every
def test_a_family_from_outside_moves_as_the_same_constraint_given_by_gap_and_gradient(scheme):
    e = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 1.0
    ours, plain = (run(points(one, START, SPEED, e), scheme, 8.0) for one in (PointsInSphere(1), PlainSphere()))
    assert len(ours.impacts) == len(plain.impacts) >= 1
    # users sum up their gaps in other orders than kernels do
    np.testing.assert_allclose(ours.t, plain.t, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.q, plain.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.v, plain.v, rtol=0, atol=1e-12)
    for one, other in zip(ours.impacts, plain.impacts, strict=True):
        assert one.constraints == other.constraints == ("point 0 | sphere",)
        # only the family knows where the point touches
        np.testing.assert_allclose(np.linalg.norm(one.point, axis=1), RADIUS)
        assert np.isnan(other.point).all()


def billiard(t):
    """Position and velocity of the elastic point: along chords, the first of which is half as long as the others."""
    q, v, start, end = np.array(START), np.array(SPEED), 0.0, np.sqrt(RADIUS**2 - 1.0)
    while t > end:
        q = q + (end - start) * v
        v = v - 2.0 * (q @ v) / RADIUS**2 * q
        start, end = end, end + 2.0 * np.sqrt(RADIUS**2 - 1.0)
    return q + (t - start) * v, v


@pytest.mark.parametrize("scheme", STEPPING, ids=repr)
def test_an_elastic_point_in_a_sphere_follows_the_billiard(scheme):
    moved = run(points(PointsInSphere(1), START, SPEED), scheme, 8.0)
    assert len(moved.impacts) == 2
    q, v = billiard(8.0)
    # two impacts, each up to a step early or late, turn the path by up to that
    np.testing.assert_allclose(moved.q[-1], q, rtol=0, atol=2e-2)
    np.testing.assert_allclose(moved.v[-1], v, rtol=0, atol=5e-3)
    if not isinstance(scheme, mbvi.SchatzmanPaoli):
        np.testing.assert_allclose(np.linalg.norm(moved.v, axis=1), 1.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("scheme", [mbvi.EventDriven(1e-10), None], ids=repr)
def test_located_impacts_are_those_of_the_billiard(scheme):
    moved = run(points(PointsInSphere(1), START, SPEED), scheme, 8.0)
    half, accuracy = np.sqrt(RADIUS**2 - 1.0), 1e-5 if scheme is None else 1e-9
    np.testing.assert_allclose([i.time for i in moved.impacts], [half, 3.0 * half], atol=accuracy)
    for t, q, v in zip(moved.t, moved.q, moved.v, strict=True):
        exact = billiard(t)
        np.testing.assert_allclose(q, exact[0], atol=accuracy)
        if np.abs(t - np.array([half, 3.0 * half])).min() > accuracy:
            np.testing.assert_allclose(v, exact[1], atol=accuracy)


@every
def test_a_point_that_falls_without_restitution_comes_to_rest_at_the_bottom(scheme):
    moved = run(points(PointsInSphere(1, 0.0), [0.0, 0.0, -1.0], [0.0, 0.0, 0.0], weight=9.81), scheme, 1.0)
    # no deeper than it falls within a step
    np.testing.assert_allclose(moved.q[-1], [0.0, 0.0, -RADIUS], rtol=0, atol=1e-3 * np.sqrt(2.0 * 9.81))
    np.testing.assert_allclose(moved.v[-1], 0.0, rtol=0, atol=1e-9)


def same(found, expected):
    for one, other in zip(found, expected, strict=True):
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other)


@given(seed=st.integers(0, 10_000), length=st.floats(1e-3, 0.5))
@settings(max_examples=40, deadline=None)
def test_a_cached_family_gives_the_rows_of_one_that_is_queried_at_every_step(seed, length):
    rng, count = np.random.default_rng(seed), 4
    system = points(PointsInSphere(count), np.ones(3 * count), np.zeros(3 * count), count=count).system
    families = PointsInSphere(count), PointsInSphere(count, cached=False)
    # a second family before each shifts their numbers
    cached, uncached = (
        AdmissibleSet(system, [PointsInSphere(count, 0.5), one], np.array([0.3, 0.7])) for one in families
    )
    q, found = rng.normal(size=3 * count) * 0.5, 0
    for _ in range(120):
        moved = length * rng.normal(size=3 * count) - 0.02 * q
        origin, q = q, q + moved
        # it may differ from query to query, and be negative
        tolerance = rng.choice([1e-2, 0.1, -1e-2])
        rows = cached.active(0.0, q, tolerance, origin, moved)
        same(rows, uncached.active(0.0, q, tolerance))
        assert set(rows.restitution) <= {0.5, 0.7}
        found += len(rows.gap)
    assert families[0].queries <= families[1].queries == 120
    if length < 0.01:
        assert families[0].queries < 60


@pytest.mark.parametrize("robot", ["hopper", "quadruped", "biped"])
def test_the_cache_changes_no_row_of_a_robot_on_a_random_path(robot, rng):
    """Limits, points over a floor and pairs of links, by a set that remembers and by a new one at every step."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(ROBOTS / robot / f"{robot}.urdf", position=(0, 0, 1.0))
    problem, found = scene.build(), set()
    system, known, q = problem.system, problem.constraints, problem.q0
    drift = np.zeros(system.nv)
    for _ in range(300):
        drift = 0.95 * drift + 0.01 * rng.normal(size=system.nv)
        drift[2] = -0.5 * (system.placements(q, np.array([1]))[0, 3, 2] - 0.3) * 0.1
        q = system.integrate(q, drift)
        tolerance = rng.choice([1e-3, 1.1e-2, 0.0])
        rows = known.active(0.0, q, tolerance)
        expected = AdmissibleSet(system, known.constraints, problem.restitution).active(0.0, q, tolerance)
        same((rows.constraint, rows.gap, rows.jacobian), (expected.constraint, expected.gap, expected.jacobian))
        found |= {known.name(k).split()[-1] for k in rows.constraint.tolist()}
    assert {"limit", "halfspace"} <= found or {"limit", "floor"} <= found or len(found) > 1


def test_two_sets_that_share_families_do_not_disturb_each_other():
    family, count = PointsInSphere(2), 2
    system = points(family, np.ones(6), np.zeros(6), count=count).system
    first, second = (AdmissibleSet(system, [family], np.array([e])) for e in (0.1, 0.9))
    inside, outside = np.tile([0.1, 0.0, 0.0], 2), np.array([0.1, 0.0, 0.0, 1.9995, 0.0, 0.0])
    assert not first.active(0.0, inside, 1e-3).gap.size
    np.testing.assert_array_equal(second.active(0.0, outside, 1e-3).constraint, [1])
    rows = first.active(0.0, outside, 1e-3)
    np.testing.assert_array_equal(rows.constraint, [1])
    np.testing.assert_array_equal(rows.restitution, [0.1])


class Slab(ConstraintFamily):
    """A point on either side of a plate of 1 mm; reach and thickness are all that the tunnelling guard needs."""

    thickness = 1e-3

    def gap(self, t, q):
        return np.abs(q[2:3]) - 0.5 * self.thickness

    def gradient(self, t, q):
        return np.array([[0.0, 0.0, np.copysign(1.0, q[2])]])

    def reach(self):
        return np.array([[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered()], ids=repr)
def test_nothing_tunnels_through_a_family_with_reach_and_thickness(scheme):
    problem = points(Slab(), [0.0, 0.0, 1.0], [0.0, 0.0, -300.0], e=0.5)
    moved = mbvi.simulate(problem, scheme, step=5e-3, duration=0.05, progress=False)
    assert moved.q[:, 2].min() > 0.0
    assert moved.v[-1, 2] == pytest.approx(150.0, abs=1e-9)


def test_defaults_of_a_family_that_defines_gap_and_gradient_only():
    class Least(ConstraintFamily):
        def gap(self, t, q):
            return q[2:3]

        def gradient(self, t, q):
            return np.array([[0.0, 0.0, 1.0]])

    least, q = Least(), np.array([0.0, 0.0, 0.5])
    assert least.contacts(0.0, q, 0.1) is None
    assert least.envelope() is None
    assert least.least_displacement() == np.inf
    rows = least.contacts(0.0, q, 0.5)
    np.testing.assert_array_equal(rows.jacobian, [[0.0, 0.0, 1.0]])
    assert np.isnan(rows.restitution).all() and np.isnan(rows.point).all()
    np.testing.assert_array_equal(least.friction_of(rows.constraint), [0.0])
    assert least.describe() == "1 constraint of Least"
    problem = points(least, [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], e=0.25, weight=9.81)
    assert problem.constraints.active(0.0, q, 0.5).restitution == [0.25]
    assert problem.constraints.largest_restitution == 0.25
    moved = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=0.5, progress=False)
    first = moved.impacts[0]
    assert first.time == pytest.approx(np.sqrt(2.0 / 9.81), abs=1e-9)
    assert first.constraints == ("f 0",)


def test_a_problem_with_a_family_from_outside_is_copied():
    problem = points(PointsInSphere(1), START, SPEED)
    twin = copy.copy(problem)
    assert run(twin, mbvi.Paoli(), 4.0).q.tobytes() == run(problem, mbvi.Paoli(), 4.0).q.tobytes()


def test_only_the_adapter_looks_at_types_and_attributes_of_constraints():
    families = [name for name in mbvi.constraints.__all__ if isinstance(getattr(mbvi.constraints, name), type)]
    kinds = "|".join({*families, "Pairs", "GivenConstraint", "GivenRows"} - {"Rows", "RowTable", "MovingFrame"})
    looks = re.compile(rf"isinstance\([^()]*\b({kinds})\b|(hasattr|getattr)\((constraint|family|c|one\.family)\b")
    package = Path(mbvi.__file__).parent
    found = {
        file.relative_to(package).as_posix()
        for file in package.rglob("*.py")
        if looks.search(file.read_text(encoding="utf-8"))
    }
    assert found == {"constraints/families/given.py"}
