"""Steps that are not solved: halves, then the second bound of the residual, then an error that says what to change."""

import itertools

import numpy as np
import pytest

import mbvi
from mbvi.errors import InfeasibleError, ProjectionError
from mbvi.run.fixed_steps.retaken import SolvedSteps
from mbvi.run.tunnelling import TunnellingGuard
from mbvi.schemes.step import NO_RATES, Step

H = 1e-3


def ball(friction=0.5):
    scene = mbvi.Scene(restitution=0.5, friction=friction)
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    scene.add_sphere(0.1, mass=1.0, position=(0.0, 0.0, 0.12), velocity=(0.3, 0.0, -1.0), name="ball")
    return scene.build()


class Unsolved(mbvi.Paoli):
    """Refuses steps about a time that are longer than allowed, unless the second bound applies."""

    def __init__(self, about=0.0105, longest=0.3 * H, error=ProjectionError):
        super().__init__()
        self.about, self.longest, self.error, self.calls = about, longest, error, []

    def step(self, problem, t, q, v, h, projector):
        self.calls.append((t, h, projector.acceptance.second))
        if t <= self.about < t + h and h > self.longest:
            raise self.error("not solved", {}, 1e-4, 0)
        if projector.acceptance.second:
            projector.acceptance.beyond.append((2.5e-5, 0))
        return super().step(problem, t, q, v, h, projector)


def test_a_step_is_cut_where_it_is_not_solved():
    scheme = Unsolved()
    run, plain = (mbvi.simulate(ball(), one, step=H, duration=0.05) for one in (scheme, mbvi.Paoli()))
    assert np.abs(run.q - plain.q).max() < 2.0 * H * np.abs(plain.v).max() and len(run.t) == len(plain.t)
    lengths = [round(h / H, 9) for t, h, _ in scheme.calls if 0.0099 < t < 0.0109]
    # whole, first half, its halves, the second half
    assert lengths == [1.0, 0.5, 0.5, 0.25, 0.25] and not any(second for _, _, second in scheme.calls)
    (note,) = [note for note in run.notes if "retaken" in note]
    assert "at t = 0.01 s in 3 parts (ball | floor)" in note
    assert not [note for note in run.notes if "passed through" in note or "were accepted" in note]


def test_the_second_bound_holds_for_eighths_only_and_is_noted():
    class Loose(Unsolved):
        def step(self, problem, t, q, v, h, projector):
            self.longest = H if projector.acceptance.second else 0.0
            return super().step(problem, t, q, v, h, projector)

    scheme = Loose()
    run = mbvi.simulate(ball(), scheme, step=H, duration=0.05)
    assert [round(h / H, 9) for _, h, second in scheme.calls if second] == [0.125]
    (note,) = [note for note in run.notes if "were accepted" in note]
    assert "2.5e-05 at t = 0.01 s (ball | floor)" in note
    assert run.t[-1] == 0.05


def test_many_retaken_steps_have_one_note():
    class Always(Unsolved):
        def step(self, problem, t, q, v, h, projector):
            self.about = t
            return super().step(problem, t, q, v, h, projector)

    run = mbvi.simulate(ball(), Always(longest=0.6 * H), step=H, duration=0.01)
    (note,) = [note for note in run.notes if "retaken" in note]
    assert note.endswith("and 7 more") and note.count("parts (") == 3


def test_what_nothing_solves_raises_with_time_place_and_advice():
    with pytest.raises(ProjectionError) as raised:
        mbvi.simulate(ball(), Unsolved(longest=0.0), step=H, duration=0.05)
    message = str(raised.value)
    assert "from t = 0.01 s" in message and "ball | floor" in message and "take a step below 0.001 s" in message
    assert "a smaller friction or restitution" in message and raised.value.run.t[-1] == pytest.approx(0.01)


def test_rows_that_contradict_each_other_are_not_retaken():
    scheme = Unsolved(error=InfeasibleError)
    with pytest.raises(InfeasibleError):
        mbvi.simulate(ball(), scheme, step=H, duration=0.05)
    assert [h for t, h, _ in scheme.calls if t > 0.0099] == [H]


def test_steps_and_the_simulator_take_the_same_parts():
    run = mbvi.simulate(ball(), Unsolved(), step=H, duration=0.02)
    walk = list(itertools.islice(mbvi.steps(ball(), Unsolved(), step=H), 22))
    assert len(walk) == 22 and walk[-1].t == pytest.approx(0.02)
    assert np.array_equal(walk[-1].q, run.q[-1])
    simulator = mbvi.Simulator(ball(), Unsolved(), step=H)
    simulator.step(20)
    assert np.array_equal(simulator.q, run.q[-1])


def test_controls_receive_the_contacts_of_each_part():
    seen, problem = [], ball()
    guard = TunnellingGuard(problem, scheme := Unsolved(about=0.0), H)
    guard.observe = lambda state, length: seen.append((state.t, length))
    state = Step(0.0, problem.q0, problem.v0, problem.constraints.empty, NO_RATES, 0.0)
    projector = mbvi.projection.Projector()
    parts = list(SolvedSteps(problem, scheme, guard).steps(0.0, state, H, projector))
    assert [part.t for part in parts] == pytest.approx([0.25 * H, 0.5 * H, H])
    # the loop passes the last
    assert seen == [
        (part.t, pytest.approx(length)) for part, length in zip(parts[:2], [0.25 * H, 0.25 * H], strict=True)
    ]
