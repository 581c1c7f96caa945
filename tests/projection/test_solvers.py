"""Every solver on its own: random, singular and infeasible problems, and whole runs beside those by default."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from proxsuite import proxqp
from scipy.sparse import csr_array

import mbvi
from mbvi.projection import DenseMetric, Projector
from support.robot_problems import KINDS, OWN, problem_of

PUBLIC = (mbvi.ProxQP(), mbvi.DualActiveSet(), mbvi.SparsePCG())
BY_NAME = {"ids": lambda solver: type(solver).__name__}
SEEDS, SIZES = st.integers(0, 2**32 - 1), st.integers(1, 9)


def random_problem(seed, n, m):
    """A feasible problem, every other one with rows that are multiples of others, or sums of two."""
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(n, n))
    J, x = rng.normal(size=(m, n)), rng.normal(size=n)
    if m > 2 and rng.random() < 0.5:
        J[1] = rng.choice([1.0, 3.0]) * J[0]
        J[2] = J[0] + J[m - 1]
    return x, B @ B.T + 0.1 * np.eye(n), J, -rng.random() * np.abs(J @ x)


@settings(max_examples=150)
@given(SEEDS, SIZES, SIZES)
def test_every_solver_meets_the_kkt_conditions_and_they_agree(seed, n, m):
    x, M, J, lower = random_problem(seed, n, m)
    expected = mbvi.project(x, M, J, lower).velocity
    size = np.sqrt(x @ M @ x)
    for solver in PUBLIC:
        w, p, residual = Projector(1e-9, solver).project(x, DenseMetric(M), J, lower)
        assert residual <= 1e-9
        assert (p >= 0.0).all()
        # stationarity, feasibility and complementarity, from the problem alone
        assert np.abs(M @ (w - x) - J.T @ p).max() <= 1e-8 * max(1.0, np.abs(M @ x).max())
        lengths = np.sqrt(np.einsum("ij,ij->i", J, np.linalg.solve(M, J.T).T))
        slack = (J @ w - lower) / lengths
        assert slack.min() >= -1e-8 * size
        assert np.abs(np.minimum(p * lengths, slack)).max() <= 1e-8 * size
        assert np.sqrt((w - expected) @ M @ (w - expected)) <= 1e-7 * size


SINGULAR = {
    "one row three times": ([[1, 2, 0]] * 3, [0, 0, 0]),
    "one row at two rates": ([[1, 2, 0], [1, 2, 0], [2, 4, 0]], [0, -1, 1]),
    "four corners of rank three": ([[1, a, b] for a in (-1, 1) for b in (-1, 1)], [0, 0, 0, 0]),
    "eight corners of rank three": ([[1, a, b] for a in (-1, 0, 1, 2) for b in (-1, 1)], [0] * 8),
    "a row and its opposite": ([[1, 0, 2], [-1, 0, -2], [0, 1, 0]], [0, 0, 0]),
    "a sum of two": ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], [0, 0, 0.5]),
    "nearly parallel": ([[1, 0, 0], [1, 1e-5, 0]], [0, 0]),
}


@pytest.mark.parametrize("solver", PUBLIC, **BY_NAME)
@pytest.mark.parametrize(("J", "lower"), SINGULAR.values(), ids=SINGULAR)
def test_dependent_rows(solver, J, lower):
    J, lower, M = np.array(J, float), np.array(lower, float), np.diag([4.0, 1.0, 2.0])
    for x in ([-1.0, 0.0, 0.0], [-1.0, -2.0, 0.5], [0.3, -1.0, -1.0]):
        x = np.array(x)
        expected = mbvi.project(x, M, J, lower)
        found = Projector(1e-9, solver).project(x, DenseMetric(M), J, lower)
        assert found.residual <= 1e-9
        off = found.velocity - expected.velocity
        # |w - w*|^2 <= r (|u| + |u*|), r the residual: between nearly parallel rows percussions are large
        lengths = np.sqrt(np.einsum("ij,ij->i", J, np.linalg.solve(M, J.T).T))
        r = found.residual * ((np.abs(J @ x) + np.abs(lower)) / lengths).max()
        assert off @ M @ off <= max(1e-16, r * lengths @ (found.percussion + expected.percussion))


@pytest.mark.parametrize("sparse", [False, True], ids=["dense", "sparse"])
@pytest.mark.parametrize("solver", PUBLIC, **BY_NAME)
def test_infeasible_problems_raise(solver, sparse):
    for J, lower in (
        ([[1.0, 0.0], [-1.0, 0.0]], [1.0, 1.0]),
        ([[1.0, 1.0], [-1.0, 0.0], [0.0, -1.0]], [1.0, 0.0, 0.0]),
    ):
        J, x = np.array(J), np.zeros(2)
        with pytest.raises(mbvi.InfeasibleError) as caught:
            Projector(1e-6, solver).project(x, DenseMetric(np.eye(2)), csr_array(J) if sparse else J, np.array(lower))
        assert caught.value.problem["J"].shape == J.shape


def test_a_residual_that_is_missed_names_solver_and_residual():
    with pytest.raises(
        mbvi.ProjectionError, match=r"by ProxQP\(\) stopped at the relative KKT residual .*above 1.0e-30"
    ):
        rng = np.random.default_rng(0)
        J = rng.normal(size=(5, 7))
        Projector(1e-30, mbvi.ProxQP()).project(rng.normal(size=7), DenseMetric(np.eye(7)), J, 1.0 + rng.random(5))


@pytest.mark.parametrize("solver", PUBLIC, **BY_NAME)
def test_solvers_are_values(solver):
    kind = type(solver)
    assert solver == kind() and hash(solver) == hash(kind())
    assert pickle.loads(pickle.dumps(solver)) == solver
    assert eval(repr(solver), vars(mbvi)) == solver
    assert sum(solver == other for other in PUBLIC) == 1
    with pytest.raises(AttributeError):
        solver.accuracy = 1.0


@pytest.mark.parametrize("solver", ["proxqp", mbvi.ProxQP, 1, True])
def test_anything_else_is_refused_in_one_line(solver):
    problem = problem_of("hopper", "fall", 0.0)
    with pytest.raises(mbvi.InputError, match=r"solver must be None or one of mbvi.ProxQP\(\).*got") as caught:
        mbvi.simulate(problem, duration=1e-3, solver=solver)
    assert "\n" not in str(caught.value)
    with pytest.raises(mbvi.InputError, match="solver must be"):
        mbvi.steps(problem, step=1e-3, solver=solver)


def end_of(problem, solver, scheme=None, steps=100, **options):
    """State after so many steps of 1e-3 s, and the run."""
    run = mbvi.simulate(
        problem, scheme or mbvi.Paoli(), step=1e-3, duration=1e-3 * steps, progress=False, solver=solver, **options
    )
    return np.concatenate([run.q[-1], run.v[-1]]), run


# a projection of ProxQP is off by some 1e-11 of the largest violation; an unstable fall of 100 steps raises that
CLOSE = 1e-8


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name in OWN for kind in KINDS[name]])
def test_robots_by_proxqp_move_as_by_default(name, kind, e):
    expected, before = end_of(problem_of(name, kind, e), None)
    found, run = end_of(problem_of(name, kind, e), mbvi.ProxQP())
    np.testing.assert_allclose(found, expected, rtol=0, atol=CLOSE)
    assert [impact.constraints for impact in run.impacts] == [impact.constraints for impact in before.impacts]
    assert run.notes[-1] == "every projection was solved by ProxQP()"
    assert not any("solved by" in note for note in before.notes)


@pytest.mark.slow
@pytest.mark.parametrize("solver", PUBLIC[1:], **BY_NAME)
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name in OWN for kind in KINDS[name]])
def test_robots_by_other_solvers_move_as_by_default(name, kind, e, solver):
    expected, _ = end_of(problem_of(name, kind, e), None)
    # SparsePCG solves small islands to rounding; the others are exact on their set
    found, _ = end_of(problem_of(name, kind, e), solver)
    np.testing.assert_allclose(found, expected, rtol=0, atol=CLOSE)


@pytest.mark.parametrize("solver", PUBLIC, **BY_NAME)
def test_the_biped_on_both_feet_by_every_solver(solver):
    expected, before = end_of(problem_of("biped", "fall", 0.0), None)
    found, _ = end_of(problem_of("biped", "fall", 0.0), solver)
    assert max(len(impact.constraints) for impact in before.impacts) >= 4
    np.testing.assert_allclose(found, expected, rtol=0, atol=CLOSE)


def stack(count):
    """Boxes one on the other, four contacts each."""
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(count):
        scene.add_box((0.2, 0.2, 0.1), position=(0.005 * k, 0, 0.05 + 0.1 * k), name=f"box{k}")
    return scene.build()


@pytest.mark.parametrize("solver", PUBLIC, **BY_NAME)
def test_a_stack_of_boxes_by_every_solver(solver):
    problem = stack(5)
    expected, _ = end_of(problem, None, steps=30)
    found, run = end_of(problem, solver, steps=30)
    np.testing.assert_allclose(found, expected, rtol=0, atol=CLOSE)
    assert repr(solver) in run.notes[-1]


def pile(count):
    """Spheres thrown into a corner."""
    rng = np.random.default_rng(1)
    scene = mbvi.Scene(restitution=0.0)
    scene.add_container((0, 0, 0), (0.9, 0.9))
    places = (
        0.06 + 0.125 * np.array([[k % 6, k // 6 % 6, k // 36] for k in range(count)]) + 0.005 * rng.random((count, 3))
    )
    scene.add_spheres(places, 0.055, density=1000.0)
    return scene.build()


def test_a_pile_by_sparse_pcg_is_that_by_default():
    """Sparse rows are solved by SparsePCG by default too: bit for bit."""
    problem = pile(120)
    expected, _ = end_of(problem, None, mbvi.StewartTrinkle(), steps=60)
    found, run = end_of(problem, mbvi.SparsePCG(), mbvi.StewartTrinkle(), steps=60)
    assert np.array_equal(found, expected)
    assert any("SparsePCG()" in note for note in run.notes)


@pytest.mark.parametrize("scheme", [None, mbvi.EventDriven(1e-6)], ids=["default", "event-driven"])
def test_every_projection_of_a_run_is_by_the_chosen_solver(scheme, monkeypatch):
    """The default scheme and error control too: no other solver is asked."""
    called = []
    solve = mbvi.ProxQP.solve
    monkeypatch.setattr(
        mbvi.ProxQP, "solve", lambda self, qp, start: called.append(len(qp.d)) or solve(self, qp, start)
    )
    for module, kind in (("fused_step", "FusedStep"), ("dual_active_set", "DualActiveSet")):
        for method in ("project", "law", "solve"):
            target = f"mbvi.projection.dense.{module}.{kind}.{method}"
            monkeypatch.setattr(target, lambda *arguments: pytest.fail("another solver was asked"), raising=False)
    run = mbvi.simulate(
        problem_of("hopper", "fall", 0.5), scheme, duration=0.1, progress=False, solver=mbvi.ProxQP(), record="contacts"
    )
    assert run.impacts and called
    assert "every projection was solved by ProxQP()" in run.notes


def test_steps_by_a_solver():
    problem = problem_of("hopper", "fall", 0.5)
    walks = [mbvi.steps(problem, mbvi.Paoli(), step=1e-3, solver=solver) for solver in (None, mbvi.DualActiveSet())]
    for _ in range(40):
        first, second = (next(walk) for walk in walks)
    np.testing.assert_allclose(first.v, second.v, rtol=0, atol=1e-10)


def test_repeats_of_a_run_by_proxqp_are_equal_bit_for_bit():
    first, second = (end_of(problem_of("biped", "fall", 0.5), mbvi.ProxQP(), steps=60)[0] for _ in range(2))
    if proxqp.__name__.startswith("proxsuite.proxsuite_pywrap_avx512"):
        # with these instructions ProxSuite's last digits differ for one problem, by where its memory lies
        np.testing.assert_allclose(first, second, rtol=0, atol=1e-12)
    else:
        assert np.array_equal(first, second)
