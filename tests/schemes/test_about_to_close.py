"""Contacts that a step leaves slightly open bear load in the next step, where positions are projected."""

import numpy as np
import pytest

import mbvi
from mbvi.studies.shipped import robot_path

LEGS = np.tile([0.0, 0.6, -1.2], 4)


def landing(friction):
    """A quadruped on soft PD control, dropped by two centimetres."""
    scene = mbvi.Scene(friction=friction)
    scene.add_halfspace((0, 0, 1))
    names = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]
    control = mbvi.PDControl(LEGS, 60.0, 1.5)
    path = robot_path("quadruped")
    scene.add_urdf(path, position=(0, 0, 0.37), joints=dict(zip(names, LEGS, strict=True)), control=control)
    return scene.build()


@pytest.mark.parametrize("friction", [0.0, 0.7])
@pytest.mark.parametrize("h", [4e-3, 2e-3, 1e-3])
def test_a_robot_that_has_landed_stands_still(friction, h):
    """Without penetration its feet would be active in every other step only, and its legs would rattle."""
    problem = landing(friction)
    run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=h, duration=1.0, progress=False)
    assert max(impact.time for impact in run.impacts) < 0.2
    # with friction it still sways
    assert np.abs(run.v[-1]).max() < 0.1
    assert run.penetration()[-10:].max() <= 10 * problem.tolerance
    feet = problem.constraints.gap(run.t[-1], run.q[-1])
    assert (np.sort(feet)[:4] <= 100 * problem.tolerance).all()
