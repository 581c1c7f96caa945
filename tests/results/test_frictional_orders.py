"""A diagnosis finds where an impact with friction depends on which contact closes first."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi


def landing(turn=(0.0, 0.0, 0.0), **more):
    scene = mbvi.Scene(friction=0.6, **more)
    scene.add_halfspace((0, 0, 1), name="floor")
    rotation = Rotation.from_rotvec(turn).as_matrix()
    scene.add_urdf(mbvi.robot("quadruped"), position=(0, 0, 0.6), rotation=rotation, name="robot")
    return mbvi.simulate(scene.build(), mbvi.EventDriven(1e-8), duration=0.2)


def test_four_feet_that_land_at_once_are_a_fork():
    run = landing()
    (impact,) = run.impacts
    assert len(impact.constraints) == 4
    found = run.diagnosis()
    assert found.horizon == impact.time and not found.not_followed
    assert f"Beyond t = {impact.time:.6g} s this run is one of several answers" in str(found)
    (forks,) = [i.forks for i in found.instants if i.forks is not None]
    assert len(forks.outcomes) > 4
    after = run.v[np.searchsorted(run.t, impact.time, side="right") - 1]
    np.testing.assert_allclose(forks.law, after, atol=1e-9)
    # the error of a run is that until then
    assert run.error_estimate().fork == impact.time


@pytest.mark.parametrize("turn", [(1e-8, 3e-9, 0), (-1e-8, 3e-9, 0), (1e-8, -3e-9, 0), (-1e-8, -3e-9, 0)])
def test_a_tiny_tilt_leads_to_one_of_the_outcomes(turn):
    found = landing().diagnosis()
    (forks,) = [i.forks for i in found.instants if i.forks is not None]
    run = landing(turn)
    # impacts that follow each other within the difference of heights
    last = np.searchsorted(run.t, found.horizon + 1e-7) - 1
    distances = np.abs(forks.outcomes - run.v[last]).max(axis=1)
    assert distances.min() < 1e-6 < 0.1 < np.abs(forks.law - run.v[last]).max()


def test_balls_that_land_at_once_are_none():
    scene = mbvi.Scene(friction=0.5, restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(3):
        scene.add_sphere(0.1, 1.0, position=(0.5 * k, 0, 0.2), velocity=(1, 0, 0))
    found = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3).diagnosis()
    assert found.not_followed and np.isnan(found.horizon)


def test_a_ball_that_hits_another_at_rest_is_none():
    """The other touches the floor before, and stays in the law whichever contact closes first."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0.1))
    scene.add_sphere(0.1, 1.0, position=(-0.3, 0, 0.25), velocity=(2, 0, -1))
    found = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.2).diagnosis()
    assert not np.isfinite(found.horizon)


@pytest.mark.parametrize("turn", [(1e-7, 3e-8, 0), (3e-8, 1e-7, 0), (1e-7, -3e-8, 0), (3e-8, -1e-7, 0)])
def test_a_box_that_lands_flat_goes_on_as_its_tilt_decides(turn):
    def landing(turn):
        scene = mbvi.Scene(gravity=(0, 0, 0), friction=0.5)
        scene.add_halfspace((0, 0, 1), name="floor")
        rotation = Rotation.from_rotvec(turn).as_matrix()
        scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.105), velocity=(1, 0, -1), rotation=rotation, name="box")
        return mbvi.simulate(scene.build(), mbvi.EventDriven(1e-9), duration=0.0052)

    (forks,) = [i.forks for i in landing((0, 0, 0)).diagnosis().instants if i.forks is not None]
    after = landing(turn).v[-1]
    assert forks.complete and np.abs(forks.outcomes - after).max(axis=1).min() < 1e-6 < np.abs(forks.law - after).max()
