"""Position projection in one kernel gives the same steps as searches and projections one after the other."""

import numpy as np
import pytest

import mbvi
from mbvi.projection import Projector
from support.robot_problems import problem_of

STEP, SCHEME = 1e-3, mbvi.Centered(project_positions=True)


def settled(problem, state, monkeypatch, *, by_kernel=True):
    """The step from a state, what the kernel answered, and what the law left closed; `by_kernel` False keeps it out."""
    settle, answers = Projector.settle, []

    def settle_and_keep(self, motion, gaps, w, displacement, law, rates):
        percussion, _, after, _ = rates
        closed = (STEP * np.abs(after) <= problem.tolerance) | ((percussion > 0.0) & (after < 0.0))
        answer = settle(self, motion, gaps, w, displacement, law, rates) if by_kernel else None
        answers.append((answer, gaps.number[law][closed]))
        return answer

    with monkeypatch.context() as patched:
        patched.setattr(Projector, "settle", settle_and_keep)
        return SCHEME.step(problem, *state, STEP, Projector()), *(answers[0] if answers else (None, None))


def states(run):
    return list(zip(run.t[:-1], run.q[:-1], run.v[:-1], strict=True))


def sunk_states(problem, run, rng):
    """States near those of a run, of which closed contacts are open or penetrate: the run itself hardly penetrates."""
    for t, q, v in states(run)[::2]:
        yield t, problem.system.integrate(q, 1e-6 * rng.normal(size=problem.system.nv)), v


@pytest.mark.parametrize(
    ("name", "kind", "least"), [("quadruped", "fall", 40), ("solo12", "fall", 50), ("arm", "limits", 1)]
)
def test_the_kernel_gives_the_step_that_searches_give(name, kind, least, monkeypatch, rng):
    problem = problem_of(name, kind, 0.0)
    run = mbvi.simulate(problem, SCHEME, step=STEP, duration=0.4, progress=False)
    raised = 0
    for state in sunk_states(problem, run, rng):
        step, answer, _ = settled(problem, state, monkeypatch)
        if answer is None:
            continue
        raised += answer.moved is not None
        other, *_ = settled(problem, state, monkeypatch, by_kernel=False)
        # the same to the second-order part of gaps
        np.testing.assert_allclose(problem.system.difference(other.q, step.q), 0.0, atol=1e-7 * problem.length)
        close = 1e-6 * max(1.0, np.abs(other.v).max())
        if (step.active.gap > problem.tolerance).any():
            # a contact that lands within half a step does so at a speed that follows from its gap
            close = max(close, 1e-7 * problem.length / (0.5 * STEP))
        np.testing.assert_allclose(step.v, other.v, atol=close)
        assert sorted(step.active.constraint) == sorted(other.active.constraint)
    assert raised >= least


def test_a_contact_that_bounces_is_left_to_searches(monkeypatch):
    """Where it is after the whole step tells whether it bounces or rests."""
    problem = problem_of("quadruped", "fall", 0.5)
    run = mbvi.simulate(problem, SCHEME, step=STEP, duration=0.3, progress=False)
    bounced = 0
    for state in states(run):
        step, answer, _ = settled(problem, state, monkeypatch)
        bounces = (step.percussion > 0.0) & (STEP * step.after > problem.tolerance)
        if bounces.any():
            assert answer is None
            bounced += 1
    assert bounced >= 5


def test_each_penetration_is_removed_and_no_gap_made_smaller(monkeypatch, rng):
    problem = problem_of("solo12", "fall", 0.0)
    run = mbvi.simulate(problem, SCHEME, step=STEP, duration=0.4, progress=False)
    raised = 0
    for state in sunk_states(problem, run, rng):
        step, answer, known = settled(problem, state, monkeypatch)
        if answer is None or answer.moved is None:
            continue
        raised += 1
        closed = (step.percussion > 0.0) & (np.abs(STEP * step.after) <= problem.tolerance)
        # what strikes at the end of the step is raised in the next
        closed &= np.isin(step.active.constraint, known)
        assert (step.active.gap[closed] >= -problem.tolerance).all()
        # the velocity is tangent to what is closed, and takes nothing below zero
        assert (step.after >= -np.maximum(step.active.gap, 0.0) / (0.5 * STEP) - 1e-9).all()
        assert step.residual <= 1e-9
    assert raised >= 50
