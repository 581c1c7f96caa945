"""Published robots dropped with friction: no error, and no limit deeper than the stated depth."""

import warnings

import numpy as np
import pytest

import mbvi
from mbvi.constraints import JointLimits
from mbvi.run.accuracy import DEFAULT_DEPTH
from support.paths import real_robot
from support.robot_problems import built_once

FILES = {
    "solo12": "solo_description/robots/solo12.urdf",
    "talos": "talos_data/robots/talos_full_v2.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "tiago": "tiago_pro_description/robots/tiago_pro.urdf",
    "go2": "go2_description/urdf/go2.urdf",
    "anymal": "anymal_b_simple_description/robots/anymal.urdf",
    "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
    "a1": "a1_description/urdf/a1.urdf",
    "b1": "b1_description/urdf/b1.urdf",
    "bolt": "bolt_description/robots/bolt.urdf",
    "laikago": "laikago_description/urdf/laikago.urdf",
    "humanoid": "simple_humanoid_description/urdf/simple_humanoid.urdf",
    "alex": "alex_description/urdf/alex_sake_hands.urdf",
    "icub": "icub_description/robots/icub_reduced.urdf",
}
HEIGHT, DURATION = 0.1, 0.3
POSTURES = (0, 1)


@built_once
def robot(name, friction):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        scene = mbvi.Scene(friction=friction)
        scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
        scene.add_urdf(real_robot(FILES[name]), "free", (0.0, 0.0, 5.0), name=name)
        return scene.build()


def dropped(problem, seed):
    """Return the problem with the robot above the floor, turned and in another posture if the seed is not 0."""
    rng, rows, q = np.random.default_rng(seed), problem.constraints, np.array(problem.q0)
    still, bend = np.zeros(3), 0.3
    # a robot whose joints start at their limits is turned only
    while seed:
        bend *= 0.9 * (bend > 0.01)
        moved = np.concatenate([still, rng.uniform(-0.4, 0.4, 3), rng.uniform(-bend, bend, problem.system.nv - 6)])
        q = np.array(problem.system.integrate(problem.q0, moved))
        if bend == 0.0 or rows.gap(0.0, q).min() > 1e-6:
            break
    floor = [k for k in range(len(rows)) if rows.name(k).endswith("| floor")]
    q[2] += HEIGHT - rows.gap(0.0, q)[floor].min()
    return problem.at(q, problem.v0, check=True)


def limit_depth(problem, run):
    """Return how far joints are beyond their limits in each state [m, rad], shape (n,)."""
    limits = [family for family in problem.constraints.families if isinstance(family, JointLimits)]
    return np.array([max((float(-f.gap(0.0, q).min(initial=0.0)) for f in limits), default=0.0) for q in run.q])


def fall(name, friction, seed, duration=DURATION):
    problem = dropped(robot(name, friction), seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        run = mbvi.simulate(problem, duration=duration)
    assert run.t[-1] == duration and run.impacts
    depth, half = limit_depth(problem, run), 0.5 * np.diff(run.t).max()
    # a limit that an impact drives a joint into was open before: the rest of that step passes it, and the next one acts
    assert np.minimum(depth[1:], depth[:-1]).max() <= DEFAULT_DEPTH
    assert depth.max() <= half * np.abs(run.v).max() + DEFAULT_DEPTH
    return problem, run


@pytest.mark.slow(seconds=200)
@pytest.mark.parametrize("seed", POSTURES)
@pytest.mark.parametrize("friction", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("name", FILES)
def test_a_dropped_robot_keeps_its_limits(name, friction, seed):
    fall(name, friction, seed)


@pytest.mark.slow(seconds=30)
@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_talos_lies_down_within_its_limits(friction):
    # beside up to a hundred contacts of the trunk a leg was radians beyond its limit, a finger turned at 33 rad/s
    _, run = fall("talos", friction, 0, 1.0)
    assert run.residual.max() <= 1e-6
    assert not [note for note in run.notes if "were accepted" in note]


@pytest.mark.slow(seconds=10)
def test_a_law_that_no_solver_solves_does_not_end_a_run():
    # at t = 0.271 s four feet of two points each stick while their neighbours are about to close
    _, run = fall("solo12", 1.0, 0)
    assert run.residual.max() <= 1e-6
    for note in run.notes:
        if "retaken" in note:
            assert "solo12/" in note and "| floor)" in note
