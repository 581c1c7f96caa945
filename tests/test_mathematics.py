"""Statements of the paper that are laws of a run and not of one function; docs/theory/mathematics.md lists them."""

import re
from functools import reduce
from importlib import import_module

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from support.paths import ROOT
from support.references import CASES, every_case

E = (0.0, 0.5, 1.0)
STEPS = 1e-2 * 10.0 ** -np.linspace(0.03, 1.2, 6)


def touching(case, step):
    """The gradients of what touches, found here and not by the scheme; of shapes the library's own."""
    problem, q = case.problem, step.q
    if case.name == "tumbling body":
        return problem.constraints.active(step.t, q, 1e-8 * problem.length).jacobian
    gaps = [(float(np.squeeze(c.gap(step.t, q))), c.gradient(step.t, q)) for c in problem.constraints.constraints]
    return np.array([np.ravel(gradient) for gap, gradient in gaps if gap <= 1e-8]).reshape(-1, len(step.v))


def walk(case, h=3e-3):
    """Every step of a run with the velocity before it, M and g."""
    problem, v = case.problem, case.problem.v0
    for step in mbvi.steps(problem, mbvi.Paoli(), step=h):
        if step.t > case.duration:
            return
        M = problem.system.metric(step.q).dense()
        # gyroscopic torques of a free body are those of the mean velocity without contacts
        mean = 0.5 * (v + problem.system.free_velocity(step.t, step.q, v, h))
        yield step, v, M, h * problem.system.force(step.t, step.q, mean if problem.system.free_bodies else v)
        v = step.v


def cone(J, rng, count=20):
    """Velocities in the tangent cone, its faces and its apex among them."""
    for _ in range(count):
        w = mbvi.project(rng.normal(size=J.shape[1]), np.eye(J.shape[1]), J).velocity
        yield w * rng.uniform(0, 3)


@every_case
def test_reactions_are_perfect_and_only_where_constraints_are_active(case, rng):
    """(3), (4): h R = M (v+ - v-) - h g vanishes away from walls and meets both conditions of perfect constraints."""
    for step, before, M, push in walk(case):
        R = M @ (step.v - before) - push
        scale = 1e-9 * (1 + np.abs(M @ before).max())
        J = touching(case, step)
        if not len(J):
            assert np.abs(R).max() <= scale
            continue
        for w in cone(J, rng, 3):
            assert R @ w >= -scale * (1 + np.abs(w).max())
        # T and -T share what is along all gradients' orthogonal complement
        along = np.eye(len(R)) - np.linalg.pinv(J) @ J
        assert np.abs(along @ R).max() <= scale


@every_case
def test_each_step_solves_the_measure_differential_inclusion(case, rng):
    """(9), (11), (P4): h g - M (v+ - v-) is in the subdifferential of the indicator of T at the mean velocity."""
    e = float(case.problem.restitution[0])
    for step, before, M, push in walk(case):
        z = push - M @ (step.v - before)
        mean = (step.v + e * before) / (1 + e)
        J = touching(case, step)
        scale = 1e-9 * (1 + np.abs(M @ before).max())
        # the mean velocity is in the cone, and no w in it is farther along z
        assert (J @ mean >= -scale).all()
        assert abs(z @ mean) <= scale * (1 + np.abs(mean).max())
        for w in cone(J, rng, 3):
            assert z @ (w - mean) <= scale * (1 + np.abs(w).max() + np.abs(mean).max())


@pytest.mark.parametrize("name", ["bouncing ball", "corner of 90 degrees", "double pendulum", "rocking block"])
def test_positions_are_the_integral_of_velocities(name):
    """(P3) for the approximants of Theorem 3.2: q_h(t) = q_0 + the integral of v_h."""
    case = CASES[0.5, name]
    run = mbvi.simulate(case.problem, mbvi.Paoli(), step=7e-3, duration=case.duration)
    for t in np.linspace(0, case.duration, 37):
        parts = np.diff(np.append(run.t[run.t < t], t))
        integral = parts @ run.v[: len(parts)] if t > 0 else 0.0
        np.testing.assert_allclose(run.at(t)[0], case.problem.q0 + integral, atol=1e-12)
        assert np.array_equal(run.at(t)[1], run.v[np.searchsorted(run.t, t, side="right") - 1])


seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.integers(1, 5), st.integers(1, 5), st.sampled_from([0.0, 0.3, 1.0]))
def test_what_approaches_is_sent_back_into_the_cone(seed, n, m, e):
    """(5), (7), (13)-(15) of the law: v- in -T gives v+ in T, a jump along -N, reflected where it presses."""
    rng = np.random.default_rng(seed)
    B, J = rng.normal(size=(n, n)), rng.normal(size=(m, n))
    M = B @ B.T + 0.2 * np.eye(n)
    before = -mbvi.project(rng.normal(size=n), M, J).velocity
    after = mbvi.impact(before, M, J, e)
    scale = 1e-8 * (1 + np.abs(before).max())
    assert (J @ after >= -scale).all()
    reflected = J @ (after + e * before)
    assert (reflected >= -scale).all()
    _, p, _ = mbvi.project(before, M, J, -e * (J @ before))
    np.testing.assert_allclose(J.T @ p, M @ (after - before), atol=1e-8 * (1 + np.abs(M).max()))
    assert (p >= 0).all()
    assert np.abs(p * reflected).max() <= scale * (1 + p.max())


def sweep(case):
    return [mbvi.simulate(case.problem, mbvi.Paoli(), step=h, duration=case.duration) for h in STEPS]


def kinetic_norms(case, run):
    system = case.problem.system
    return np.sqrt([2 * system.kinetic_energy(q, v) for q, v in zip(run.q, run.v, strict=True)])


def smooth_grid(case, count=400):
    """Times at which the exact solution is sampled, both sides of every jump among them."""
    grid = np.linspace(0, case.duration, count)
    return np.unique(np.concatenate([grid, case.impacts, np.nextafter(case.impacts, -np.inf)]))


@pytest.mark.slow
@every_case
def test_variation_percussions_and_speeds_are_bounded_uniformly_in_h(case):
    """Lemmas 3.3, 3.4 and 3.6, (P1), and the energy estimate before Proposition 3.1, over steps."""
    runs = sweep(case)
    found = [run.diagnosis() for run in runs]
    exact = [case.at(float(t)) for t in smooth_grid(case)]
    velocities = np.array([v for _, v in exact])
    variation = np.linalg.norm(np.diff(velocities, axis=0), axis=1).sum()
    # Lemma 3.4: no more than the motion's own and what a step can add at each event
    assert max(d.variation for d in found) <= 1.05 * variation
    assert found[-1].variation >= 0.95 * variation
    # Lemma 3.3: the largest percussion settles
    percussions = [d.largest_percussion for d in found]
    assert max(percussions) <= 1.1 * percussions[-1] + 0.02
    # Lemma 3.6: the largest speed does not exceed the motion's own by more than O(h)
    system = case.problem.system
    fastest = max(np.sqrt(2 * system.kinetic_energy(q, v)) for q, v in exact)
    for h, run in zip(STEPS, runs, strict=True):
        assert kinetic_norms(case, run).max() <= fastest + 7 * h * max(fastest, 1.0)
    # the energy estimate, with the work of each step taken at its mean velocity: not even O(h) is missing
    assert max(d.energy_excess for d in found) <= 1e-11 * max(1.0, fastest**2)


@every_case
def test_the_limit_is_in_k(case):
    """(2): a run leaves K by no more than h times its speed, so that the limit does not."""
    for h in (1e-2, 2.3e-3, 5.1e-4)[: 2 if case.duration > 2 else 3]:
        run = mbvi.simulate(case.problem, mbvi.Paoli(), step=h, duration=case.duration)
        assert run.penetration().max() <= 1.6 * h * max(1.0, np.abs(run.v).max())


@pytest.mark.parametrize("e", E)
@pytest.mark.parametrize("C", [3.0, 6.0])
def test_every_solution_stays_bounded_for_a_while(e, C):
    """Proposition 3.1 where its constants are known: M = 1 and |g| <= G + 1, so that |v| <= |v_0| + (G + 1) t.

    tau(C) = (C - |v_0|) / (G + 1) then bounds |v| by C, and |q - q_0| by C as long as tau <= 1.
    """
    v0, force = np.array([1.0, 0.5]), 10.81
    tau = min(1.0, (C - np.linalg.norm(v0)) / force)
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([np.cos(5 * t), -9.81]), 2)
    walls = [mbvi.GapFunction(lambda q: q[1], lambda q: np.array([0.0, 1.0])),
             mbvi.GapFunction(lambda q: 0.3 - q[0], lambda q: np.array([-1.0, 0.0]))]  # fmt: skip
    problem = mbvi.Problem(system, walls, [0.25, 0.05], v0, restitution=e)
    for h in STEPS:
        run = mbvi.simulate(problem, mbvi.Paoli(), step=h, duration=tau)
        assert len(run.impacts) >= 1
        assert np.linalg.norm(run.v, axis=1).max() <= C * (1 + 1e-9)
        assert np.linalg.norm(run.q - run.q[0], axis=1).max() <= C


def test_a_gradient_that_vanishes_is_named():
    """(H3) asks that gradients do not vanish where f = 0: there nothing holds the constraint."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-1.0]), 1)
    flat = mbvi.GapFunction(lambda q: q[0] ** 3, lambda q: 3 * q**2, name="flat")
    problem = mbvi.Problem(system, [flat], [0.0], [0.0], restitution=0.5)
    found = mbvi.simulate(problem, mbvi.Paoli(), step=0.1, duration=0.3).diagnosis()
    assert found.vanishing == ("flat",)
    assert "(H3) fails: the gradient of flat vanishes" in found.report()


TABLE = (ROOT / "docs/theory/mathematics.md").read_text() if (ROOT / "docs/theory/mathematics.md").exists() else ""


def rows():
    """Return the cells of the table of statements, which stands before the first section."""
    lines = TABLE.split("\n## ")[0].splitlines()
    return [line.strip("| ").split(" | ") for line in lines if line.startswith("| ") and "---" not in line]


def test_every_numbered_statement_has_its_row():
    named = " ".join(row[0] for row in rows())
    expected = [*(f"({k})" for k in range(1, 16)), *(f"(P{k})" for k in range(1, 5)), *(f"(H{k})" for k in range(1, 5)),
                "Proposition 3.1", "Theorem 3.2", *(f"Lemma 3.{k}" for k in range(3, 7))]  # fmt: skip
    assert [name for name in expected if name not in named] == []


def test_the_functions_and_tests_that_the_table_names_exist():
    functions, tests = 0, 0
    for row in rows()[1:]:
        for file, name in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", row[3]):
            assert f"def {name}(" in (ROOT / file).read_text(), name
            tests += 1
        for path in re.findall(r"`(mbvi[\w.]*)`", row[2]):
            parts = path.split(".")
            depth = next(k for k in range(len(parts), 0, -1) if _imports(".".join(parts[:k])))
            reduce(getattr, parts[depth:], import_module(".".join(parts[:depth])))
            functions += 1
    assert functions > 20
    assert tests > 25


def _imports(name):
    try:
        import_module(name)
    except ModuleNotFoundError:
        return False
    return True
