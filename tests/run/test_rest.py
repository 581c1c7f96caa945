"""Piles come to rest where their contacts allow it, and smooth bodies that nothing stops move on."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi

EDGE, GRAVITY, STEP = 0.04, 9.81, 2e-3


def poured(count, along=(-0.35, -0.2, -1.0)):
    """Boxes in random poses above a corner into which their weight draws them, and the weight of a unit mass."""
    across = int(np.ceil(count ** (1 / 3)))
    cell = np.stack(np.unravel_index(np.arange(count), (across + 1, across, across)), axis=1)[:, ::-1]
    scene = mbvi.Scene(gravity=GRAVITY * np.array(along) / np.linalg.norm(along))
    scene.add_container((0, 0, 0), (1.8 * EDGE * across,) * 2)
    turned = Rotation.random(count, random_state=1).as_matrix()
    scene.add_boxes(1.8 * EDGE * (cell + 0.5) + [0, 0, 0.05], (EDGE,) * 3, mass=1.0, rotations=turned)
    return scene


def column(count):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    for k in range(count):
        scene.add_box((EDGE,) * 3, mass=1.0, position=(0, 0, EDGE * (k + 0.5)))
    return scene


def pyramid(levels):
    scene, centres = mbvi.Scene(), []
    scene.add_halfspace((0, 0, 1))
    for level in range(levels):
        side = EDGE * (np.arange(levels - level) - 0.5 * (levels - level - 1))
        centres += [(x, y, EDGE * (level + 0.5)) for x in side for y in side]
    scene.add_boxes(centres, (EDGE,) * 3, mass=1.0)
    return scene


def run(scene, duration, **options):
    return mbvi.simulate(
        scene.build(), mbvi.StewartTrinkle(), step=STEP, duration=duration, every=25, progress=False, **options
    )


def drift(result):
    """The largest distance of a body from where it was at first [m]."""
    q = result.q.reshape(len(result.t), -1, 7)[:, :, :3]
    return np.linalg.norm(q - q[0], axis=2).max()


def energies(result, count):
    """Kinetic energy per body at each recorded time, relative to m g times the edge."""
    system = result.problem.system
    return np.array([system.kinetic_energy(*state) for state in zip(result.q, result.v, strict=True)]) / (
        count * GRAVITY * EDGE
    )


def test_a_smooth_box_that_nothing_stops_glides_and_spins_for_ever():
    """Contact forces of the floor are vertical: they change neither its path nor its spin, whatever sleeps near it."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_boxes([(3 * EDGE * (k % 8), 3 * EDGE * (k // 8), EDGE / 2) for k in range(31)], (EDGE,) * 3, mass=1.0)
    start = np.array([-1.0, -1.0, EDGE / 2])
    scene.add_box((EDGE,) * 3, mass=1.0, position=start, velocity=(-1e-3, 2e-3, 0), angular_velocity=(0, 0, 0.5))
    result = run(scene, 1.0)
    v, q = result.v[-1].reshape(-1, 6), result.q[-1].reshape(-1, 7)
    np.testing.assert_allclose(v[-1], (-1e-3, 2e-3, 0, 0, 0, 0.5), rtol=0, atol=1e-12)
    np.testing.assert_allclose(q[-1, :3], start + np.array([-1e-3, 2e-3, 0]), rtol=0, atol=1e-10)
    assert (v[:-1] == 0.0).all()


def test_boxes_in_a_corner_come_to_rest_and_sleep():
    count = 18
    result = run(poured(count), 1.0)
    assert energies(result, count)[-1] == 0.0
    assert result.penetration().max() < 1e-3 * EDGE
    assert "bodies at rest slept" in result.notes[-1]


def test_a_tilted_floor_lets_nothing_sleep():
    """A slope of 1e-5 accelerates boxes by less than one projection may be off, but step after step."""
    scene, slope = mbvi.Scene(gravity=(1e-5 * GRAVITY, 0, -GRAVITY)), 1e-5
    scene.add_halfspace((0, 0, 1))
    scene.add_boxes([(3 * EDGE * (k % 6), 3 * EDGE * (k // 6), EDGE / 2) for k in range(30)], (EDGE,) * 3, mass=1.0)
    result = run(scene, 0.6)
    v = result.v[-1].reshape(-1, 6)
    np.testing.assert_allclose(v[:, 0], slope * GRAVITY * 0.6, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [column(10), pyramid(5)], ids=["column of 10", "pyramid of 55"])
def test_stacks_stay_where_they_are(scene):
    result = run(scene, 10.0)
    assert drift(result) < 1e-6
    assert result.penetration().max() < 1e-4 * EDGE


@pytest.mark.slow
def test_many_boxes_in_a_corner_come_to_rest():
    count = 64
    result = run(poured(count), 1.6)
    assert energies(result, count)[-1] < 1e-8
    assert result.penetration().max() < 1e-3 * EDGE
    assert (np.diff(result.energy()) <= 1e-6 * count * GRAVITY * EDGE).all()
