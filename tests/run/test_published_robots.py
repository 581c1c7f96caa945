"""Published robots fall for a second: no error, no deeper than a step can take them, no energy from nothing."""

import warnings
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

import mbvi
from mbvi.constraints import JointLimits, SignedDistances
from mbvi.run.fixed_steps import taking
from mbvi.run.recording.recorder import Recorder
from mbvi_studies.published_robots import PUBLISHED, published_robot
from support.robot_problems import built_once

STEP, STEPS = 1e-3, 1000
# part of a step's displacement by which an impact can sink in. Paoli's scheme takes a whole step before the law acts.
# The default moves by half a step after a law that knows each row that its whole step would close
SINKS = {"Paoli": (mbvi.Paoli(), 1.0), "default": (None, 0.5)}


def by_kind(limits, rows, values):
    """Return the largest value of joint limits and of contacts; they are in other units."""
    return np.array([values[rows < limits].max(initial=0.0), values[rows >= limits].max(initial=0.0)])


def gaps(problem, step, k):
    """Return the true gaps after a step; those of pairs, which come last, of one step in ten, because they are slow."""
    families = [f for f in problem.constraints.families if k % 10 == 0 or not isinstance(f, SignedDistances)]
    return np.concatenate([f.gap(step.t, step.q) for f in families])


class Fall(NamedTuple):
    problem: mbvi.Problem
    run: mbvi.Trajectory
    steps: list
    # see SINKS
    part: float


MADE = built_once(published_robot)


# tests of one fall follow each other, so that it is computed once
@pytest.fixture(scope="module", params=product(PUBLISHED, SINKS), ids="-".join)
def fall(request):
    name, scheme = request.param
    problem, (method, part), steps, record = MADE(name, 0.02), SINKS[scheme], [], Recorder.step

    def noted(self, step, keep):
        steps.append(step)
        record(self, step, keep)

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.setattr(Recorder, "step", noted)
        # the compiled loop, which takes the same steps (test_compiled_loop.py), hands no steps to the recorder
        patch.setattr(taking, "compiled_loop", lambda *_: None)
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        run = mbvi.simulate(problem, method, step=STEP, duration=STEP * STEPS)
    # the first is the start
    return Fall(problem, run, steps[1:], part)


@pytest.mark.slow
def test_a_second_of_falling(fall):
    problem = fall.problem
    limits = problem.constraints.families[0].size
    assert isinstance(problem.constraints.families[0], JointLimits)
    assert isinstance(problem.constraints.families[-1], SignedDistances)
    every, count = np.arange(len(problem.constraints)), 0
    depth = speed = np.zeros(2)
    for k, step in enumerate(fall.steps):
        assert np.isfinite(step.q).all() and np.isfinite(step.v).all()
        gap = gaps(problem, step, k)
        depth = np.maximum(depth, by_kind(limits, every[: len(gap)], -gap))
        speed = np.maximum(speed, by_kind(limits, step.active.constraint, -step.rates[3]))
        # M (w - x) = J' p for the free velocity x: this is the kinetic energy of w less that of x, and none at e = 0
        # gives any, but for the residual
        given = 0.5 * step.percussion @ (step.free + step.after)
        assert given <= step.residual * np.abs(step.percussion) @ np.abs(step.free)
        count += step.active.gap.size > 0
    assert count > 0 and len(fall.steps) >= STEPS
    # a closed row is tangent to its constraint after the law, so only a row that strikes sinks in
    assert (depth <= fall.part * STEP * speed + problem.tolerance).all()


@pytest.mark.slow
def test_energy_is_lost_only(fall):
    run = fall.run
    assert max(impact.energy_change for impact in run.impacts) <= 0.0
    kinetic, potential = run.energies()
    lost = run.energy()[0] - run.energy()[-1]
    # a fall to the floor turns potential into kinetic energy, and impacts take it
    assert lost > 0.5 * kinetic.max()
    assert run.energy().max() <= run.energy()[0] + 1e-12 * (np.abs(potential).max() + kinetic.max())
    # the estimate before Proposition 3.1: forces and a changing M account for what impacts do not take
    assert run.diagnosis().energy_excess <= 1e-9 * kinetic.max()


def test_without_the_files_an_error_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr("mbvi_studies.published_robots._FOLDER", tmp_path)
    with pytest.raises(mbvi.InputError, match="Go2 comes with example-robot-data, which is not installed"):
        published_robot("go2", 0.02)


@pytest.mark.parametrize("name", ["panda", "solo12"])
def test_the_lowest_point_is_at_the_height(name):
    problem = published_robot(name, 0.02, joints={"FL_KFE": 0.5} if name == "solo12" else None)
    floor = next(f for f in problem.constraints.families if type(f).__name__ == "HalfSpaceContacts")
    lowest = floor.gap(0.0, problem.q0).min()
    assert lowest == pytest.approx(0.02, abs=1e-12) if name == "solo12" else lowest > 0.0
