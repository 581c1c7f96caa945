"""Schemes and systems of users' own classes: what they lack has a default, and their runs are the library's."""

import copy
import pickle

import numpy as np
import pytest

import mbvi
from mbvi.run.given_scheme import checked_scheme
from mbvi.run.loop.kernel_scheme import KernelScheme
from mbvi.schemes import Timing
from mbvi.schemes.kernels.paoli import paoli_step
from support.robot_problems import problem_of


class OwnPaoli:
    """The least a scheme can be: one method."""

    def step(self, problem, t, q, v, h, projector):
        return mbvi.Paoli().step(problem, t, q, v, h, projector)


class OwnSchatzmanPaoli:
    """A scheme with everything a scheme may state."""

    jump, whole_steps = 0.0, True
    checked = 0

    def __init__(self):
        self.inner = mbvi.SchatzmanPaoli()

    def check(self, problem):
        self.checked += 1

    def step(self, *arguments):
        return self.inner.step(*arguments)

    def shortened(self, *arguments):
        return self.inner.shortened(*arguments)


class OwnMass:
    """A falling mass without any attribute that has a default."""

    nq = nv = 1

    def __init__(self):
        inner = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-9.81]), 1)
        for name in (
            "integrate", "difference", "metric", "force", "free_velocity", "free_motion", "acceleration",
            "chart_rate", "kinetic_energy", "potential_energy", "placements", "separation_rows", "point_bias", "reach",
        ):  # fmt: skip
            setattr(self, name, getattr(inner, name))


def dropped(system, e=0.5):
    floor = mbvi.GapFunction(lambda q: q, lambda q: np.eye(1))
    return mbvi.Problem(system, [floor], [0.5], [0.0], restitution=e)


def mass():
    return mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-9.81]), 1)


@pytest.mark.parametrize(
    ("own", "library"),
    [(OwnPaoli(), mbvi.Paoli()), (OwnSchatzmanPaoli(), mbvi.SchatzmanPaoli())],
    ids=["only step", "everything"],
)
def test_a_run_with_a_users_scheme_is_that_of_the_library(own, library, tmp_path):
    # no multiple of the step: the last step is a shortened one, or a whole one beyond the end
    options = {"step": 1e-2, "duration": 1.234}
    run, expected = (mbvi.simulate(dropped(mass()), scheme, **options) for scheme in (own, library))
    np.testing.assert_array_equal(run.q, expected.q)
    np.testing.assert_array_equal(run.v, expected.v)
    assert run.record.timing == expected.record.timing == library.timing
    assert run.scheme == type(own).__name__
    assert repr(run.record.scheme) == repr(own)
    run.save(tmp_path / "run.h5")
    back = mbvi.load(tmp_path / "run.h5")
    assert back.record.scheme is None and back.record.timing.jump == library.timing.jump
    assert back.scheme == run.scheme


def test_a_users_scheme_states_its_timing_and_is_checked():
    own = OwnSchatzmanPaoli()
    scheme = checked_scheme(own)
    assert scheme.timing == Timing(jump=0.0, whole_steps=True)
    assert checked_scheme(OwnPaoli()).timing == Timing()
    next(mbvi.steps(dropped(mass()), own, step=1e-3))
    assert own.checked == 1


@pytest.mark.parametrize("wrong", [OwnPaoli, object(), "Paoli"], ids=["class", "no step", "text"])
def test_what_is_no_scheme_is_refused(wrong):
    with pytest.raises(mbvi.InputError, match="scheme must be an object such as"):
        mbvi.simulate(dropped(mass()), wrong, duration=0.1)


def test_a_run_with_a_users_system_is_that_of_the_library():
    for scheme in (mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.EventDriven()):
        options = {"duration": 0.8} | ({} if scheme.timing.own_steps else {"step": 1e-3})
        run, expected = (mbvi.simulate(dropped(system), scheme, **options) for system in (OwnMass(), mass()))
        np.testing.assert_array_equal(run.q, expected.q)
        np.testing.assert_array_equal(run.v, expected.v)
        assert str(run.diagnosis()) == str(expected.diagnosis())


def test_a_problem_with_a_users_system_has_all_defaults_and_is_copied():
    problem = copy.deepcopy(dropped(OwnMass()))
    assert problem.system.bodies == ("world",)
    assert not problem.system.controlled
    assert problem.system.describe() == "a system of 1 degrees of freedom"
    assert problem.at([0.2], [0.0]).system is problem.system


def test_a_scheme_that_is_a_kernel_alone_refuses_what_kernels_do_not_take():
    scheme = KernelScheme(paoli_step)
    with pytest.raises(mbvi.UnsuitableError, match="paoli_step is a kernel"):
        mbvi.simulate(mbvi.reference.bouncing_ball(0.5).problem, scheme, step=1e-3, duration=0.1)


def test_a_step_of_a_subclass_is_not_that_of_the_kernel():
    class Own(mbvi.Paoli):
        def step(self, *arguments):
            raise RuntimeError("the user's own step")

    with pytest.raises(RuntimeError, match="own step"):
        mbvi.simulate(problem_of("hopper", "fall", 0.5), Own(), step=1e-3, duration=0.01, progress=False)


def test_single_steps_of_a_kernel_have_the_residual_of_their_run_and_the_control_of_python():
    scheme = KernelScheme(paoli_step)
    problem = problem_of("hopper", "fall", 0.5)
    problem.system.set_control(lambda t, q, v: -0.1 * v * np.array([0] * 6 + [1] * (len(v) - 6)))
    for residual in (1e-4, 1e-9):
        run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.4, residual=residual, progress=False)
        steps = mbvi.steps(problem, scheme, step=1e-3, residual=residual)
        last = [next(steps) for _ in range(400)][-1]
        np.testing.assert_array_equal(last.q, run.q[-1])
        assert {made._step.scales.residual for made in scheme._made.values()} >= {residual}
    assert run.impacts


def test_a_scheme_that_is_a_kernel_is_copied_without_what_takes_its_steps():
    scheme = KernelScheme(paoli_step, Timing(jump=0.5))
    next(mbvi.steps(problem_of("hopper", "fall", 0.5), scheme, step=1e-3))
    for other in (pickle.loads(pickle.dumps(scheme)), copy.deepcopy(scheme)):
        assert other == scheme and other.kernel is paoli_step and other.timing == scheme.timing
