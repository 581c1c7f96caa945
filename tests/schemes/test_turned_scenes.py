"""Friction knows no direction of space: a scene that is turned moves as before, turned."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import mbvi
from support.robot_arguments import rotation, unit

PROJECTED = [
    mbvi.Centered(project_positions=True),
    mbvi.Paoli(project_positions=True),
    mbvi.MoreauJean(0.5, project_positions=True),
]


def _strike(turned, friction, others, rng):
    """A capsule and a box, or another capsule, that strike off centre in free space; `others` do so far away.

    Before they are turned, the normal is nearly at right angles to z, about which axes of tangents change their signs.
    """
    scene = mbvi.Scene(gravity=(0, 0, 0), friction=friction, restitution=0.3)
    for k in range(1 + others):
        box = rng.random() < 0.5
        for side in (0, 1):
            at = np.array([5.0 * k, 0.0, 0.0]) + side * np.array([0.45, 0.04, 0.0]) + 0.003 * side * unit(rng)
            velocity = (1 - 2 * side) * np.array([1.5, 0.4, 0.0]) + 0.1 * rng.normal(size=3)
            moves = {
                "position": tuple(turned @ at), "rotation": turned @ rotation(rng),
                "velocity": tuple(turned @ velocity), "angular_velocity": tuple(turned @ (3.0 * rng.normal(size=3))),
            }  # fmt: skip
            if box and side:
                scene.add_box((0.2, 0.2, 0.2), **moves)
            else:
                scene.add_capsule(0.1, 0.1, **moves)
    return scene.build()


def _velocities(problem, scheme, by_python):
    """The velocities after the blows, of each body in a row."""
    if by_python:
        *_, last = (step.v for _, step in zip(range(250), mbvi.steps(problem, scheme, step=1e-3), strict=False))
        return last.reshape(-1, 6)
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.25)
    assume(len(run.impacts) > 0)
    return run.v[-1].reshape(-1, 6)


@given(st.integers(0, 10_000), st.sampled_from([0.4, (0.4, 0.01, 0.02)]), st.booleans(), st.sampled_from([0, 1]))
@settings(max_examples=25, deadline=None)
@pytest.mark.parametrize("scheme", PROJECTED, ids=lambda scheme: type(scheme).__name__)
def test_a_turned_scene(scheme, seed, friction, by_python, others):
    """The projection of positions takes friction to where contacts are then, along other axes."""
    turned = rotation(np.random.default_rng(seed + 1))
    runs = [
        _velocities(_strike(turn, friction, others, np.random.default_rng(seed)), scheme, by_python)
        for turn in (np.eye(3), turned)
    ]
    # linear velocities are those in the world
    np.testing.assert_allclose(runs[1][:, :3], runs[0][:, :3] @ turned.T, atol=1e-7)
