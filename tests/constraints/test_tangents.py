"""Tangents of contacts: orthonormal axes, gradients against differences, and rates of moving walls."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi import motion
from mbvi.constraints.tangents import axes_of, concatenate, none_of


@given(st.integers(0, 10_000))
@settings(deadline=None)
def test_axes_and_normal_are_a_right_handed_basis(seed):
    normal = np.random.default_rng(seed).normal(size=(4, 3))
    normal[0] = [0.0, 0.0, -1.0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    frames = np.concatenate([axes_of(normal), normal[:, None]], axis=1)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-14)


def mixed(walls=None):
    """Boxes, spheres and a robot that touch each other and the floor."""
    scene = mbvi.Scene(friction=0.4)
    scene.add_halfspace((0, 0, 1), 0.0, name="floor", motion=walls)
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05), name="low")
    scene.add_box((0.1, 0.2, 0.1), 1.0, position=(0.02, 0, 0.15), rotation=(0, 0, 0.4), name="high")
    scene.add_sphere(0.1, 1.0, (0.3, 0, 0.1))
    scene.add_spheres([[0.6, 0, 0.1], [0.6, 0.2, 0.1]], 0.1, 1.0)
    scene.add_urdf("robots/hopper/hopper.urdf", position=(3, 0, 1.0))
    return scene.build()


def test_tangents_are_rates_of_relative_displacements(rng):
    """J_t v is the velocity of the second body's material point less that of the first, along the axes."""
    problem = mixed()
    rows = problem.constraints.active(0.0, problem.q0, 1e-6)
    assert len(rows.gap) >= 11
    v = rng.normal(size=problem.system.nv)
    system, h = problem.system, 1e-6
    before, after = problem.q0, system.integrate(problem.q0, h * v)
    names = [problem.constraints.name(int(k)).split(" | ") for k in rows.constraint]
    bodies = {name: k for k, name in enumerate(system.bodies)}
    # half-spaces are named second, and are the first body
    numbers = [[bodies.get(a, 0), bodies.get(b, 0)] for a, b in names]
    numbers = [[b, a] if b == 0 else [a, b] for a, b in numbers]
    for k, pair in enumerate(numbers):
        moved = []
        for body in pair:
            if body == 0:
                moved.append(np.zeros(3))
                continue
            here, there = (system.placements(q, np.array([body]))[0] for q in (before, after))
            local = here[:3] @ (rows.point[k] - here[3])
            moved.append((local @ there[:3] + there[3] - rows.point[k]) / h)
        np.testing.assert_allclose(rows.tangents.slip(v)[k], rows.tangents.axes[k] @ (moved[1] - moved[0]), atol=1e-5)
    assert (rows.tangents.friction == 0.4).all()


def test_a_wall_that_moves_along_itself_has_tangential_rates_only():
    problem = mixed(motion.Translation((0.3, -0.2, 0.0)))
    rows = problem.constraints.active(0.0, problem.q0, 1e-6)
    on_floor = np.array(["floor" in problem.constraints.name(int(k)) for k in rows.constraint])
    slip = rows.tangents.slip(np.zeros(problem.system.nv))
    np.testing.assert_allclose(slip[on_floor], np.tile([-0.3, 0.2], (on_floor.sum(), 1)), atol=1e-15)
    assert not slip[~on_floor].any()
    assert not rows.speeds(np.zeros(problem.system.nv)).any()


def test_rates_belong_to_their_rows_after_rows_are_put_together_and_taken():
    """Only some families have walls that move; those of the others are at rest."""
    still = none_of(2, 4, False)
    belt = still._replace(rate=np.array([1.0, 2.0, 3.0, 4.0]), friction=np.array([0.1, 0.2]))
    both, rest = concatenate([still, belt]), np.zeros(4)
    np.testing.assert_array_equal(both.slip(rest), [[0, 0], [0, 0], [1, 2], [3, 4]])
    for index in (np.array([3, 0]), np.array([True, False, False, True])):
        taken = both.take(index)
        order = np.flatnonzero(index) if index.dtype == bool else index
        np.testing.assert_array_equal(taken.slip(rest), both.slip(rest)[order])
        np.testing.assert_array_equal(taken.friction, both.friction[order])
    assert concatenate([still, still]).rate is None and still.take(np.array([1])).rate is None


def test_pairs_of_moving_walls_have_their_own_friction():
    scene = mbvi.Scene(friction=0.4)
    scene.add_halfspace((0, 0, 1), 0.0, name="belt", motion=motion.Translation((0.3, 0.0, 0.0)))
    for k, name in enumerate("abc"):
        scene.add_box((0.2, 0.2, 0.1), 1.0, position=(k, 0, 0.05), name=name)
    scene.set_friction("belt", "b", 0.0)
    scene.set_friction("belt", "c", 1.5)
    problem = scene.build()
    rows = problem.constraints.active(0.0, problem.q0, 1e-6)
    names = [problem.constraints.name(int(k)) for k in rows.constraint]
    found = {name[0]: mu for name, mu in zip(names, rows.tangents.friction.tolist(), strict=True)}
    assert found == {"a": 0.4, "b": 0.0, "c": 1.5}
