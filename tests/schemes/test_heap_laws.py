"""Laws of mechanics on random heaps of mixed shapes, whatever the order of bodies and the unit of length."""

from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.projection import Projector
from support.heaps import PITCH, UNIQUE, heap, linear, masses

H, DEPTH = 2e-3, 1e-3
SEEDS = st.integers(0, 10_000)
# heaps of up to 16 bodies have dense rows, those of more sparse ones
SMALL, MANY = st.integers(2, 20), [30, 60]


class Recorded(Projector):
    """A projector that keeps what it projected."""

    def __init__(self, residual):
        super().__init__(residual)
        self.calls = []

    def project(self, x, metric, J, lower, contacts=None, h=None):
        found = super().project(x, metric, J, lower, contacts, h)
        self.calls.append((x, metric, J, lower, found))
        return found


def stepped(problem, count, residual=1e-10, projector=None):
    """Yield configuration and velocity before, and each step of the scheme for piles."""
    scheme, q, v = mbvi.StewartTrinkle(), problem.q0, problem.v0
    projector = Projector(residual) if projector is None else projector
    for k in range(count):
        step = scheme.step(problem, k * H, q, v, H, projector)
        yield q, v, step
        q, v = step.q, step.v


def check_energy_of_impacts(seed, count, e, steps):
    """Without gravity: what is left are the forces of turning, whose work is theirs at the mean velocity.

    With d = h M^-1 g, a projection onto rates that hold -e v gives (w - v - d) . (w + e v) <= 0, from which follows
    |w|^2 <= |v|^2 + d . (w + v) + |d|^2 / 4.
    """
    problem = heap(seed, count, e=e, gravity=0.0, box=False)
    system, lost = problem.system, 0.0
    for q, v, step in stepped(problem, steps):
        force = H * system.force(0.0, q, v)
        before, after = system.kinetic_energy(q, v), system.kinetic_energy(q, step.v)
        second_order = 0.25 * system.kinetic_energy(q, system.free_motion(0.0, q, v, H).free - v)
        assert after <= before + force @ (0.5 * (step.v + v)) + second_order + 1e-9 * before
        lost += before - after
    return lost


@given(seed=SEEDS, count=SMALL, e=st.sampled_from([0.0, 0.5, 1.0]) | st.floats(0.0, 1.0))
@settings(max_examples=8)
def test_impacts_never_raise_the_kinetic_energy(seed, count, e):
    check_energy_of_impacts(seed, count, e, 25)


@pytest.mark.slow
@pytest.mark.parametrize("count", MANY)
@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
def test_impacts_never_raise_the_kinetic_energy_of_many_bodies(count, e):
    lost = check_energy_of_impacts(7, count, e, 100)
    assert lost > 0.1 or e == 1.0


def check_total_energy(seed, count, steps):
    """Potential energy rises beyond what the velocity accounts for only by the lift that removes penetration."""
    problem = heap(seed, count)
    system, weight = problem.system, 9.81 * masses(problem).sum()
    layers = np.ptp(linear(problem, problem.q0)[:, 2]) / PITCH + 1.0
    q, v, highest = problem.q0, problem.v0, 0.0
    for step in islice(mbvi.steps(problem, mbvi.StewartTrinkle(), step=H, depth=DEPTH), steps):
        start = system.kinetic_energy(q, v) + system.potential_energy(0.0, q)
        place = system.integrate(q, H * step.v)
        lift = system.potential_energy(0.0, step.q) - system.potential_energy(0.0, place)
        end = system.kinetic_energy(step.q, step.v) + system.potential_energy(0.0, step.q)
        jump = system.kinetic_energy(q, step.v - v)
        turning = H * (system.force(0.0, q, v) - system.force(0.0, q, np.zeros_like(v))) @ step.v
        # a projection onto rates that hold zero gives |w|^2 <= (v + h M^-1 g) . w, to its residual
        assert end - start <= lift + turning - jump + step.residual * end + 1e-12 * start
        # pushing bodies out raises each layer by no more than the deepest contact, before or after the step, of all
        # layers below it
        deepest = -min(problem.constraints.active(step.t, at, 0.0).gap.min(initial=0.0) for at in (q, place))
        assert lift <= weight * layers * deepest + 1e-12 * start
        highest = max(highest, lift)
        q, v = step.q, step.v
    return highest


@given(seed=SEEDS, count=SMALL)
@settings(max_examples=8)
def test_the_total_energy_rises_at_most_by_the_lift_out_of_penetration(seed, count):
    check_total_energy(seed, count, 40)


@pytest.mark.slow
@pytest.mark.parametrize("count", MANY)
def test_the_total_energy_of_many_bodies_rises_at_most_by_the_lift(count):
    check_total_energy(3, count, 200)


def check_momentum(seed, count, e, steps):
    """Contacts between bodies cancel, those with walls act along the normals of these."""
    problem = heap(seed, count, e=e)
    scene, mass = problem.scene, masses(problem)
    pressed = 0
    for _, v, step in stepped(problem, steps, residual=1e-6):
        names = [problem.constraints.name(k).rpartition(" | ")[2] for k in step.active.constraint.tolist()]
        walls = [k for k, name in enumerate(names) if name in scene.walls]
        normals = np.array([scene.walls[names[k]].normal for k in walls]).reshape(-1, 3)
        given = H * mass.sum() * np.array([0.0, 0.0, -9.81]) + step.percussion[walls] @ normals
        size = np.abs(mass @ np.abs(linear(problem, v))).max() + np.abs(step.percussion).sum()
        np.testing.assert_allclose(mass @ linear(problem, step.v - v), given, rtol=0, atol=1e-13 * size)
        pressed += np.delete(step.percussion, walls).any()
    return pressed


@given(seed=SEEDS, count=SMALL, e=st.sampled_from([0.0, 0.5]))
@settings(max_examples=8)
def test_momentum_changes_by_weight_and_percussions_of_walls(seed, count, e):
    check_momentum(seed, count, e, 25)


@pytest.mark.slow
@pytest.mark.parametrize("count", MANY)
def test_momentum_of_many_bodies_changes_by_weight_and_percussions_of_walls(count):
    assert check_momentum(5, count, 0.0, 150) > 50


def by_name(problem, q):
    return dict(zip([name.partition("[")[0] for name in problem.system.bodies[1:]], linear(problem, q), strict=True))


def check_order(seed, count, steps, residual=1e-10):
    order = np.random.default_rng(seed + 1).permutation(count)
    ends = []
    for problem in (heap(seed, count, kinds=UNIQUE), heap(seed, count, order=order, kinds=UNIQUE)):
        *_, (_, _, step) = stepped(problem, steps, residual)
        ends.append((by_name(problem, step.q), by_name(problem, step.v)))
    (place, speed), (other, others) = ends
    assert list(place) != list(other) or count < 4
    off = max(np.abs(place[name] - other[name]).max() for name in place)
    return off, max(np.abs(speed[name] - others[name]).max() for name in speed)


@given(seed=SEEDS, count=SMALL)
@settings(max_examples=6)
def test_the_order_of_bodies_does_not_matter(seed, count):
    off, faster = check_order(seed, count, 25)
    assert off < 1e-8 and faster < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("count", MANY)
def test_the_order_of_many_bodies_does_not_matter(count):
    off, faster = check_order(11, count, 40)
    assert off < 1e-7 and faster < 1e-5


def check_unit(seed, count, length, steps):
    ends = []
    for s in (1.0, length):
        problem = heap(seed, count, length=s, kinds=UNIQUE)
        *_, (_, _, step) = stepped(problem, steps)
        ends.append((linear(problem, step.q) / s, linear(problem, step.v) / s))
    return [np.abs(a - b).max() for a, b in zip(*ends, strict=True)]


@given(seed=SEEDS, count=SMALL, exponent=st.floats(-3.0, 3.0))
@settings(max_examples=6)
def test_the_unit_of_length_does_not_matter(seed, count, exponent):
    off, faster = check_unit(seed, count, 10.0**exponent, 25)
    assert off < 1e-8 and faster < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("count", MANY)
@pytest.mark.parametrize("length", [1e-3, 7.0])
def test_the_unit_of_length_does_not_matter_to_many_bodies(count, length):
    off, faster = check_unit(13, count, length, 40)
    assert off < 1e-7 and faster < 1e-5


def check_exact(seed, count, steps, most=40):
    """Compare projections of up to so many contacts with the dense dual active set; return how many there were."""
    problem, projector = heap(seed, count), Recorded(1e-10)
    for _ in stepped(problem, steps, projector=projector):
        pass
    few = [call for call in projector.calls if 0 < len(call[3]) <= most]
    for x, metric, J, lower, found in few:
        dense = J if isinstance(J, np.ndarray) else J.toarray()
        exact = Projector(1e-10, mbvi.DualActiveSet()).project(x, metric, dense, lower)
        scale = max(np.sqrt(problem.system.kinetic_energy(problem.q0, u)) for u in (x, exact.velocity, problem.v0))
        gap = np.sqrt(problem.system.kinetic_energy(problem.q0, found.velocity - exact.velocity))
        assert gap <= 1e-7 * scale
        assert found.residual <= 1e-10 and exact.residual <= 1e-10
    return sum(call[4].percussion.any() for call in few)


@given(seed=SEEDS, count=st.integers(4, 24))
@settings(max_examples=8)
def test_projections_of_up_to_forty_contacts_are_those_of_the_exact_solver(seed, count):
    check_exact(seed, count, 25)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_sparse_projections_of_up_to_forty_contacts_are_those_of_the_exact_solver(seed):
    problem = heap(seed, 20)
    assert problem.system.sparse
    assert check_exact(seed, 20, 60) > 5
