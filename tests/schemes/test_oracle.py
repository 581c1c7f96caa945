"""Single steps of robots against their equations in docs/, solved by numpy, Pinocchio and a QP of the tests' own."""

import warnings
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from support.oracle import RobotOracle, projection
from support.paths import real_robot
from support.robot_problems import OWN, REAL, is_free, path_of
from support.step_laws import check_step, names, random_state

MORE = {
    "anymal": "anymal_b_simple_description/robots/anymal.urdf",
    "bolt": "bolt_description/robots/bolt.urdf",
    "go2": "go2_description/urdf/go2.urdf",
    "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
}
SCHEMES = {
    "paoli": mbvi.Paoli(),
    "moreau_jean": mbvi.MoreauJean(),
    "centered": mbvi.Centered(),
    "stewart_trinkle": mbvi.StewartTrinkle(),
}
H = 2e-3
# speeds of percussions of light links are known to fewer digits
TOLERANCE = 1e-9


@cache
def robot(name, e, mu):
    """A robot over two half-spaces, or a fixed one over a floor, and its oracle."""
    free = name in MORE or is_free(name)
    path = real_robot(MORE[name]) if name in MORE else path_of(name)
    scene = mbvi.Scene(restitution=e, friction=mu)
    # fixed robots reach below their base
    depth = 0.0 if free else 5.0 if name == "double_pendulum" else 0.3
    scene.add_halfspace((0, 0, 1), offset=-depth, name="floor")
    if free:
        scene.add_halfspace((1.0, 0.0, 0.3), offset=-1.5, name="slope")
    if name == "double_pendulum":
        scene.add_halfspace((-1, 0, 0), offset=-0.2, name="wall")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        scene.add_urdf(path, base="free" if free else "fixed", position=(0, 0, 5.0) if free else (0, 0, 0))
        problem = scene.build()
    return problem, RobotOracle(problem)


# by robot and seed: neither e nor mu changes which states are admissible
STATES = {}


def state_of(name, problem, oracle, seed):
    if (name, seed) not in STATES:
        STATES[name, seed] = random_state(problem, oracle, np.random.default_rng([seed, *name.encode()]))
    return tuple(part.copy() for part in STATES[name, seed])


def newton(e):
    return lambda v: lambda called, J: -e * (J @ v)


def kept_open(oracle, q):
    """The bounds of Stewart's and Trinkle's scheme at e = 0; rows of one shape share its least gap, if they are few."""
    gaps = oracle.gaps(q)

    def lower(called, J):
        return -np.maximum([gaps[name] for name in called], 0.0) / H

    return lower


def one_step(problem, scheme, q, v):
    """The step by hand, or None where it is shortened so that nothing is passed."""
    step = next(mbvi.steps(problem.at(q, v), scheme, step=H, residual=1e-10))
    return step if np.isclose(step.t, H, rtol=1e-12) else None


def hold(name, scheme, e, mu, seeds, wanted):
    """Hold the steps of a robot from random states against all laws; return how many had rows."""
    problem, oracle = robot(name, e, mu)
    touched = 0
    for seed in seeds:
        q, v = state_of(name, problem, oracle, seed)
        step = one_step(problem, SCHEMES[scheme], q, v)
        if step is None or not wanted(oracle, q, v, step):
            continue
        free = getattr(oracle, scheme)(q, v, H)
        lower = kept_open(oracle, q) if scheme == "stewart_trinkle" else newton(e)(v)
        found = check_step(oracle, free, v, step, lower)
        assert max(found) < TOLERANCE, (name, scheme, e, mu, seed, found)
        touched += len(step.active.gap) > 0
    return touched


def always(oracle, q, v, step):
    return True


def single_points(oracle, q, v, step):
    """Each row has a constraint of its own, whose gap the oracle knows: no pair of shapes, no face with many rows."""
    called = names(oracle.problem, step.active)
    return len(set(called)) == len(called) and set(called) <= set(oracle.gaps(q))


def in_the_middle(oracle, q, v, step):
    """Every row's contact is found in the middle of the step, where the law acts, and not only at its end."""
    here = pin.integrate(oracle.model, q, 0.5 * H * v)
    rows = step.active
    J = [oracle.row(here, *one) for one in zip(names(oracle.problem, rows), rows.point, rows.normal, strict=True)]
    return not len(J) or np.abs(np.array(J) - rows.jacobian).max() < 1e-12


LAWS = [(0.0, 0.0), (0.5, 0.0), (0.0, 0.6), (0.4, 0.3)]


@pytest.mark.parametrize("e, mu", LAWS)
@pytest.mark.parametrize("scheme", ["paoli", "moreau_jean"])
@pytest.mark.parametrize("name", OWN)
def test_a_step_solves_the_equations_of_its_scheme(name, scheme, e, mu):
    assert hold(name, scheme, e, mu, range(12), always) >= 2


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("name", OWN)
def test_a_step_of_stewart_and_trinkle_solves_its_equations(name, mu):
    assert hold(name, "stewart_trinkle", 0.0, mu, range(12), single_points) >= 1


@pytest.mark.parametrize("e, mu", LAWS)
@pytest.mark.parametrize("name", ["hopper", "quadruped", "double_pendulum"])
def test_a_centered_step_solves_its_equations_without_damping(name, e, mu):
    assert hold(name, "centered", e, mu, range(12), in_the_middle) >= 2


@pytest.mark.parametrize("e, mu", LAWS)
@pytest.mark.parametrize("scheme", ["paoli", "moreau_jean"])
def test_a_step_of_coupled_fingers_solves_its_equations(scheme, e, mu):
    """Those of Panda are at their limits in many states, where both have the same row on ker J_e."""
    assert len(robot("panda", e, mu)[1].couplings) == 1
    assert hold("panda", scheme, e, mu, range(12), always) >= 2


@pytest.mark.slow(seconds=90)
@pytest.mark.parametrize("e, mu", LAWS)
@pytest.mark.parametrize("name", [*OWN, *REAL, *MORE])
def test_many_steps_of_many_robots_solve_their_equations(name, e, mu):
    seeds = range(100, 108)
    damped = robot(name, e, mu)[1].damping.any()
    for scheme, wanted in (("paoli", always), ("moreau_jean", always), ("centered", in_the_middle)):
        if scheme != "centered" or not damped:
            hold(name, scheme, e, mu, seeds, wanted)
    if e == 0.0:
        hold(name, "stewart_trinkle", e, mu, seeds, single_points)


@pytest.mark.parametrize("scheme", ["paoli", "moreau_jean"])
@pytest.mark.parametrize("name", OWN)
def test_nothing_that_is_closed_is_left_out(name, scheme):
    """Gaps of limits and of shapes to half-spaces, each in its own closed form."""
    problem, oracle = robot(name, 0.0, 0.0)
    for seed in range(12):
        q, v = state_of(name, problem, oracle, seed)
        step = one_step(problem, SCHEMES[scheme], q, v)
        if step is None:
            continue
        gaps, known = oracle.gaps(getattr(oracle, scheme)(q, v, H).place), set(names(problem, step.active))
        closed = {key for key, gap in gaps.items() if gap < -1e-12 and not fixed(oracle, key)}
        assert closed <= known <= {key for key in known if gaps.get(key, 0.0) < 2e-8}, (seed, closed ^ known)


def fixed(oracle, name):
    """Whether a contact is one of two parts that never move; they have no row."""
    return " | " in name and not any(oracle.bodies(name))


@pytest.mark.parametrize("name", OWN)
def test_the_oracle_has_the_gaps_of_the_problem(name):
    problem, oracle = robot(name, 0.0, 0.0)
    q, _ = random_state(problem, oracle, np.random.default_rng(5))
    least = {}
    for k, gap in enumerate(problem.constraints.gap(0.0, q)):
        key = problem.constraints.name(k)
        least[key] = min(gap, least.get(key, np.inf))
    mine = {key: gap for key, gap in oracle.gaps(q).items() if not fixed(oracle, key)}
    assert set(mine) <= set(least)
    np.testing.assert_allclose([mine[key] for key in mine], [least[key] for key in mine], atol=1e-12)


@pytest.mark.parametrize("scheme", ["paoli", "moreau_jean"])
@pytest.mark.parametrize("name", OWN)
def test_the_compiled_loop_takes_the_same_step(name, scheme):
    """Without friction the velocity after is unique, so that it is compared with the oracle's own."""
    e = 0.5
    problem, oracle = robot(name, e, 0.0)
    touched = 0
    for seed in range(12):
        q, v = state_of(name, problem, oracle, seed)
        run = mbvi.simulate(problem.at(q, v), SCHEMES[scheme], step=H, duration=H, progress=False, residual=1e-10)
        step = one_step(problem, SCHEMES[scheme], q, v)
        if step is None or len(run.t) != 2:
            continue
        free = getattr(oracle, scheme)(q, v, H)
        rows = step.active
        called = names(problem, rows)
        J = np.array([oracle.row(free.place, *one) for one in zip(called, rows.point, rows.normal, strict=True)])
        J = J.reshape(-1, oracle.model.nv)
        exact = oracle.project(free, J, -e * (J @ v))
        np.testing.assert_allclose(run.v[1], exact, atol=TOLERANCE * max(1.0, np.abs(exact).max()))
        end = free.place if scheme == "paoli" else pin.integrate(oracle.model, free.place, 0.5 * H * exact)
        np.testing.assert_allclose(run.q[1], end, atol=TOLERANCE)
        touched += len(J) > 0
    assert touched >= 2


def test_the_projection_of_the_oracle_is_that_by_enumeration():
    """Every subset of rows as equalities; the one that fits is the answer."""
    rng = np.random.default_rng(1)
    for _ in range(60):
        n, m = 4, rng.integers(1, 6)
        root, J, x = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=n)
        M, lower = root @ root.T + 0.1 * np.eye(n), J @ rng.normal(size=n) - rng.uniform(0.0, 1.0, m)
        best = None
        for mask in range(2**m):
            on = np.array([bool(mask >> k & 1) for k in range(m)])
            if on.sum() > n:
                continue
            G = J[on] @ np.linalg.solve(M, J[on].T)
            p = np.linalg.solve(G, lower[on] - J[on] @ x)
            w = x + np.linalg.solve(M, J[on].T @ p)
            if (p >= -1e-10).all() and (J @ w >= lower - 1e-10).all():
                best = w
        np.testing.assert_allclose(projection(M, x, J, lower)[0], best, atol=1e-9)
