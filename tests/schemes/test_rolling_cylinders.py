"""A cylinder that begins to slide ends rolling at two thirds of its speed, whatever it rolls on, at any step."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi

SCHEMES = [
    mbvi.Paoli(),
    mbvi.MoreauJean(),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.StewartTrinkle(),
]
LYING = Rotation.from_euler("x", 0.5 * np.pi)
SQUARE = np.array([[-30.0, -30, 0], [30, -30, 0], [30, 30, 0], [-30, 30, 0]]), np.array([[0, 1, 2], [0, 2, 3]])


def rolled(floor, scheme, step, radius=0.05, length=0.08, speed=1.0, slope=0.0, mu=0.3, duration=0.3):
    """The last velocity of a cylinder in the axes of the floor, and that of a point of it at the floor."""
    turn = Rotation.from_euler("y", slope)
    scene = mbvi.Scene(friction=mu)
    if floor == "halfspace":
        scene.add_halfspace(turn.apply([0, 0, 1]), name="floor")
    elif floor == "box":
        scene.add_box((60, 60, 1), position=turn.apply([0, 0, -0.5]), rotation=turn, fixed=True, name="floor")
    else:
        scene.add_surface(*SQUARE, rotation=turn, one_sided=True, name="floor")
    start = {"position": turn.apply([0, 0, radius]), "velocity": turn.apply([speed, 0, 0]), "rotation": turn * LYING}
    scene.add_cylinder(radius, length, mass=1.0, name="wheel", **start)
    run = mbvi.simulate(scene.build(), scheme, step=step, duration=duration, progress=False)
    # linear velocities are those of the world, angular ones those of the body
    v, turned = run.v[-1].copy(), turn.inv() * Rotation.from_quat(run.q[-1, 3:].copy())
    linear, angular = turn.inv().apply(v[:3]), turned.apply(v[3:])
    return linear, linear + np.cross(angular, [0, 0, -radius])


@pytest.mark.parametrize("step", [1e-3, 2e-2])
@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
@pytest.mark.parametrize("floor", ["halfspace", "box", "mesh"])
def test_a_sliding_cylinder_ends_rolling_at_two_thirds_of_its_speed(floor, scheme, step):
    linear, slip = rolled(floor, scheme, step)
    np.testing.assert_allclose(linear, [2 / 3, 0, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(slip, 0.0, rtol=0, atol=1e-9)


@settings(max_examples=12)
@given(
    st.floats(0.02, 0.5),
    st.floats(0.1, 3.0),
    st.floats(0.05, 0.3),
    st.sampled_from(["halfspace", "box", "mesh"]),
    st.sampled_from(SCHEMES),
    st.sampled_from([5e-3, 2e-2]),
)
def test_down_a_slope_it_gains_two_thirds_of_what_a_sliding_one_does(radius, share, slope, floor, scheme, step):
    linear, slip = rolled(floor, scheme, step, radius, share * radius, 0.0, slope, mu=0.6)
    np.testing.assert_allclose(linear, [9.81 * np.sin(slope) * 0.3 * 2 / 3, 0, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(slip, 0.0, rtol=0, atol=1e-9)
