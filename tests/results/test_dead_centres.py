"""The diagnosis names the times at which closed loops pass a dead centre, and no others."""

import numpy as np
import pytest

import mbvi


def parallelogram(coupler, angle, speed, e=0.0):
    """Two cranks of 0.2 m that a coupler connects, 0.5 m apart, without gravity; equal lengths make a parallelogram."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e)
    turn = (np.cos(angle / 2), 0, -np.sin(angle / 2), 0)
    along = np.array([np.cos(angle), 0, np.sin(angle)])
    across = np.array([-np.sin(angle), 0, np.cos(angle)])
    for name, x in (("crank", 0.0), ("rocker", 0.5)):
        scene.add_box(
            (0.2, 0.02, 0.02), 1.0, position=np.array([x, 0, 0]) + 0.1 * along, rotation=turn, name=name,
            velocity=0.1 * speed * across, angular_velocity=(0, -speed, 0),
        )  # fmt: skip
        scene.hinge("world", name, at=(x, 0, 0), axis=(0, 1, 0))
    middle = 0.2 * along + np.array([0.25, 0.2, 0])
    scene.add_box((0.5, 0.02, 0.02), 1.0, position=middle, name="coupler", velocity=0.2 * speed * across)
    for name, x in (("crank", 0.0), ("rocker", 0.5)):
        scene.hinge(name, "coupler", at=0.2 * along + np.array([x, coupler, 0]), axis=(0, 1, 0))
    return scene.build()


@pytest.mark.parametrize("h", [1e-3, 3.7e-3])
def test_a_parallelogram_passes_its_dead_centre_where_it_is_flat(h):
    """It turns at 2 rad/s from 0.5 rad before it is flat."""
    run = mbvi.simulate(parallelogram(0.2, -0.5, 2.0), mbvi.Centered(), step=h, duration=0.4, progress=False)
    found = run.diagnosis()
    assert len(found.dead_centres) == 1
    assert found.dead_centres[0] == pytest.approx(0.25, abs=2 * h)
    assert f"At t = {found.dead_centres[0]:.6g} s closed loops pass a dead centre" in str(found)


def test_a_parallelogram_that_does_not_become_flat_has_none():
    run = mbvi.simulate(parallelogram(0.2, -0.5, 2.0), mbvi.Centered(), step=1e-3, duration=0.2, progress=False)
    assert run.diagnosis().dead_centres == ()


def test_a_start_at_a_dead_centre_counts_once():
    run = mbvi.simulate(parallelogram(0.2, 0.0, 0.0), mbvi.Centered(), step=1e-3, duration=0.02, progress=False)
    assert run.diagnosis().dead_centres == (0.0,)


def test_robots_without_loops_have_none():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf("robot:hopper", position=(0, 0, 0.6))
    assert mbvi.simulate(scene.build(), step=1e-3, duration=0.3, progress=False).diagnosis().dead_centres == ()
