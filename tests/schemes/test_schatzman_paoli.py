"""`SchatzmanPaoli` where steps differ in length: at the end of a run, and where the guard shortens one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi import reference
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


def ball_on_floor(e, height=1.0):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, 1.0, position=(0, 0, height), velocity=(0.7, 0, 0))
    return scene.build()


@pytest.mark.parametrize("e", [1.0, 0.7, 0.3, 0.0])
@pytest.mark.parametrize(
    ("make", "duration", "rate"),
    # the energy of a ball changes by up to h |g| |v|, relative to |v|^2 / 2
    [(ball_on_floor, 0.6, 5.0), (lambda e: reference.double_pendulum(e).problem, 0.85, 0.5)],
    ids=["ball", "double pendulum at a wall"],
)
def test_energies_of_all_states_and_of_impacts_are_right_to_the_order_of_the_step(make, duration, rate, e):
    """No state lies between the energies before and after an impact, wherever in a step that falls."""
    for step in (8e-3, 4e-3, 2e-3, 1e-3):
        for h in step * np.array([1.0, 0.93, 0.87, 0.81]):
            problem = make(e)
            run = mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=h, duration=duration)
            found, energy = run.impacts[0], run.energy()
            largest = max(problem.system.kinetic_energy(q, v) for q, v in zip(run.q, run.v, strict=True))
            assert found.after[0] == pytest.approx(-e * found.before[0], abs=1e-9)
            # Newton's law on one constraint
            lost = 0.5 * (1.0 - e) * found.percussion[0] * found.before[0]
            assert abs(found.energy_change - lost) < (rate * h if e < 1.0 else 1e-12) * largest
            later = round(found.time / h) + 4
            assert abs(energy[later] - energy[0] - found.energy_change) < 2.0 * rate * h * largest
            apart = np.abs(energy[: later + 1, None] - energy[[0, later]]).min(axis=1)
            assert apart.max() < 2.0 * rate * h * largest


def recursion(problem, e, h, count, weight):
    """Heights of a point above a floor by the recursion itself."""
    q = [problem.q0[1], problem.q0[1] + h * problem.v0[1] - 0.5 * h**2 * weight]
    while len(q) <= count:
        inside = max(0.0, (2.0 * q[-1] - (1.0 - e) * q[-2] - h**2 * weight) / (1.0 + e))
        q.append(-e * q[-2] + (1.0 + e) * inside)
    return np.array(q[: count + 1])


@given(e=st.floats(0.0, 1.0), h=st.floats(2e-3, 3e-2), height=st.floats(0.15, 0.5), v=st.floats(-3.0, 0.0))
def test_configurations_are_those_of_the_recursion(e, h, height, v):
    problem, _ = falling(e, height=height, v=v)
    run = mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=h, duration=60 * h)
    np.testing.assert_allclose(run.q[:, 1], recursion(problem, e, h, 60, G), rtol=0, atol=1e-12)


@given(e=st.floats(0.0, 1.0), h=st.floats(1e-3, 1e-2))
def test_energies_of_a_file_are_those_of_the_run(tmp_path_factory, e, h):
    path, problem = tmp_path_factory.getbasetemp() / "impacts.h5", ball_on_floor(e)
    run = mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=h, duration=0.9)
    streamed = mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=h, duration=0.9, out=path, progress=False)
    loaded = mbvi.load(path)
    for other in (streamed, loaded):
        np.testing.assert_array_equal(other.energy(), run.energy())
    path.unlink()
    run.save(path)
    np.testing.assert_array_equal(mbvi.load(path).energy(), run.energy())
    path.unlink()


def test_impacts_in_consecutive_steps_are_recorded_whole():
    """Balls strike the floor one after the other: each has its own impact, and the energy falls by what that takes."""
    h, e = 1e-3, 0.6
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    for k in range(8):
        scene.add_sphere(0.1, 1.0, position=(k, 0, 0.3 + 2.0 * h * k), velocity=(0, 0, -2.0))
    run = mbvi.simulate(scene.build(), mbvi.SchatzmanPaoli(), step=h, duration=0.14)
    struck = {}
    for impact in run.impacts:
        for name, before, after in zip(impact.constraints, impact.before, impact.after, strict=True):
            struck.setdefault(name, []).append((before, after))
    assert len(struck) == 8 and all(len(times) == 1 for times in struck.values())
    for ((before, after),) in struck.values():
        assert before < -2.0 and after == pytest.approx(-e * before, abs=1e-9)
    lost = np.zeros(len(run.t))
    for impact in run.impacts:
        lost[np.searchsorted(run.t, impact.time - 1e-9) :] += impact.energy_change
    np.testing.assert_allclose(run.energy(), run.energy()[0] + lost, rtol=0, atol=3.0 * h * G * 8 * 3.0)
    assert lost[-1] < -8 * 0.5 * (1 - e**2) * 4.0
