"""`SchatzmanPaoli` where steps differ in length: at the end of a run, and where the guard shortens one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.projection import Projector
from mbvi.schemes.step import Step

G = 9.81


def falling(e, height=1.0, v=0.0, gravity=G, angle=0.0):
    """A point above a floor that is tilted by an angle, in the plane."""
    normal = np.array([np.sin(angle), np.cos(angle)])
    weight = np.array([0.0, -gravity])
    system = mbvi.LagrangianSystem(
        mass=lambda q: np.eye(2), force=lambda t, q, v: weight, dim=2, potential=lambda q: -weight @ q
    )
    floor = mbvi.GapFunction(lambda q: normal @ q, lambda q: normal, name="floor")
    return mbvi.Problem(system, [floor], height * normal, v * normal, restitution=e), normal


@given(
    e=st.floats(0.0, 1.0),
    duration=st.floats(0.05, 1.5),
    step=st.sampled_from([2e-3, 7e-3, 1e-2, 3e-2]),
    angle=st.floats(-0.5, 0.5),
)
def test_a_run_may_end_at_any_part_of_a_step(e, duration, step, angle):
    """Its end lies on what a longer run does, and no impact there gains more energy than the bound that is stated."""
    problem, _ = falling(e, angle=angle)
    run = mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=step, duration=duration)
    longer = mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=step, duration=duration + 2.0 * step)
    assert run.t[-1] == duration
    whole = int(duration / step * (1.0 + 1e-12))
    assert run.q[: whole + 1].tobytes() == longer.q[: whole + 1].tobytes()
    q, v = longer.at(duration)
    np.testing.assert_allclose(run.q[-1], q, atol=1e-12)
    # at the end of a whole step the velocity is that of the step before
    if abs(duration - longer.t).min() > 1e-6 * step:
        np.testing.assert_allclose(run.v[-1], v, atol=1e-12)
    fastest = np.sqrt(2.0 * G)
    # across the floor, along which it slides ever faster
    assert np.abs(run.v @ [np.sin(angle), np.cos(angle)]).max() < 1.2 * fastest
    # both the staggering of q and v by half a step and what an impact may gain at e = 1
    assert run.energy().max() < G * np.cos(angle) + 2.0 * step * G * fastest


@given(e=st.floats(0.0, 1.0), step=st.sampled_from([1e-3, 5e-3]), part=st.floats(0.0, 0.999))
def test_after_an_impact_the_velocity_is_that_of_the_law_wherever_the_run_ends(e, step, part):
    """Two steps after the impact: -e v, to the order of the step."""
    problem, normal = falling(e, height=0.0713, v=-2.0)
    struck = (np.sqrt(4.0 + 2.0 * G * 0.0713) - 2.0) / G
    duration = step * (np.ceil(struck / step) + 3.0 + part)
    run = mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=step, duration=duration)
    assert normal @ run.v[-1] == pytest.approx(e * (2.0 + G * struck), abs=8.0 * G * step)


@given(
    e=st.floats(0.0, 1.0),
    parts=st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=6),
    height=st.floats(1e-4, 0.999),
    half_way=st.booleans(),
)
def test_shortened_steps_take_the_law_and_give_no_energy(e, parts, height, half_way):
    """From any place before the impact or in the middle of it, by any parts of a step, then by whole steps."""
    step, speed = 1e-2, 3.0
    problem, normal = falling(e, height=speed * step * height, v=-speed, gravity=0.0)
    scheme, projector = mbvi.SchatzmanPaoli(), Projector()
    t, state = 0.0, Step(0.0, problem.q0, problem.v0, problem.constraints.empty, np.zeros((4, 0)), 0.0)
    if half_way:
        while not state.active.gap.size:
            t, state = t + step, scheme.step(problem, t, state.q, state.v, step, projector)
    speeds = [normal @ state.v]
    for part in parts:
        state = scheme.shortened(problem, t, state, part * step, projector)
        t = state.t
        speeds.append(normal @ state.v)
        if speeds[-1] != speeds[-2]:
            assert state.percussion[0] > 0.0
    for _ in range(4):
        t, state = t + step, scheme.step(problem, t, state.q, state.v, step, projector)
        speeds.append(normal @ state.v)
    assert np.abs(speeds).max() <= speed * (1.0 + 1e-9)
    assert speeds[-1] == pytest.approx(e * speed, abs=1e-9 * speed)
    assert normal @ state.q > -1e-9


@given(parts=st.lists(st.floats(0.05, 1.0), min_size=2, max_size=30))
def test_shortened_steps_are_exact_to_their_order_in_flight(parts):
    step = 1e-3
    problem, _ = falling(0.5, height=5.0, v=1.0)
    scheme, projector = mbvi.SchatzmanPaoli(), Projector()
    state = Step(0.0, problem.q0, problem.v0, problem.constraints.empty, np.zeros((4, 0)), 0.0)
    for part in parts:
        state = scheme.shortened(problem, state.t, state, part * step, projector)
    t = step * sum(parts)
    assert state.t == pytest.approx(t)
    np.testing.assert_allclose(state.v, [0.0, 1.0 - G * t], atol=1e-12)
    assert state.q[1] == pytest.approx(5.0 + t - 0.5 * G * t**2, abs=0.5 * G * step * t * 1.01)
