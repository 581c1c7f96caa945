"""Scenes with friction that are hard: many bodies whose rows are dense, a groove in which held contacts oppose."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import mbvi
from mbvi.constraints.rows import take
from mbvi.projection import Projector
from mbvi.projection.metric import BlockMetric, BodiesMetric, DenseMetric
from mbvi.schemes.positions.closed_contacts import Applied
from mbvi.schemes.positions.least_displacement import _held
from mbvi.schemes.positions.position_projection import _sticking

G = 9.81


def test_rows_without_the_zeros_of_their_bodies_are_whitened_too(rng):
    """Rows that were dense keep no zeros, as in a stack of boxes whose faces are parallel to the axes."""
    A = rng.normal(size=(4, 6, 6))
    metric = BodiesMetric(A @ A.transpose(0, 2, 1) + np.eye(6))
    J = rng.normal(size=(9, 24)) * (rng.random((9, 24)) < 0.3)
    J[2] = 0.0
    for M, rows in ((metric, J), (BlockMetric([DenseMetric(np.eye(3)), metric], [slice(0, 3), slice(3, 27)]),
                                  np.hstack([J[:, :3], J]))):  # fmt: skip
        U = M.whiten_rows(csr_array(rows)).toarray()
        np.testing.assert_allclose(U @ U.T, rows @ M.solve_rows(rows).T, atol=1e-12)
        z = rng.normal(size=rows.shape[1])
        np.testing.assert_allclose(U @ z, rows @ M.unwhiten(z), atol=1e-12)


@pytest.mark.parametrize("count", [8, 9, 12, 20])
def test_a_stack_of_boxes_on_a_slope_stands(count):
    """It does not creep: up to 128 contacts are solved exactly where Newton's method does it."""
    scene = mbvi.Scene(gravity=(0.05 * G, 0.0, -G), friction=0.5)
    scene.add_halfspace((0, 0, 1), 0.0)
    for k in range(count):
        scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05 + 0.1 * k))
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05)
    assert np.abs(run.q - problem.q0).max() <= 1e-12


def pyramid(rows):
    """Boxes that stand on two others each; each box rests on eight contacts, those of the lowest row on four."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), 0.0)
    for row in range(rows):
        for k in range(rows - row):
            scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0.102 * (k + 0.5 * row), 0, 0.05 + 0.1 * row))
    return scene.build()


def test_a_pyramid_of_boxes_stands():
    problem = pyramid(5)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.02)
    assert len(problem.constraints.active(0.0, problem.q0, 1e-8).gap) == 100
    assert np.abs(run.q - problem.q0).max() <= 1e-12
    assert run.residual.max() <= 1e-9


@pytest.mark.parametrize("scheme", [mbvi.Centered(project_positions=True), mbvi.Paoli(project_positions=True)])
def test_a_ball_that_rolls_along_a_groove_is_lifted_by_no_more_than_it_sank(scheme):
    """Both contacts stick, and with their tangents held their normals oppose each other."""
    scene = mbvi.Scene(friction=1.0)
    side = np.sin(0.04), np.cos(0.04)
    scene.add_halfspace((0, side[0], side[1]), 0.0)
    scene.add_halfspace((0, -side[0], side[1]), 0.0)
    scene.add_sphere(0.04, 0.5, (0, 0, 0.2), (0.3, 0, 0))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.5)
    assert run.penetration().max() <= 1e-5
    np.testing.assert_allclose(run.q[-1, 1:3], [0.0, 0.04 / side[1]], atol=1e-5)
    assert run.q[-1, 0] == pytest.approx(0.3 * (0.2 + 5 / 7 * 0.3), abs=0.02)


def test_balls_that_roll_on_a_mesh_stay_on_it():
    """A ball that rolls from triangle to triangle touches two at once, and sinks into the next by a step."""
    grid = np.linspace(-0.5, 0.5, 11)
    x, y = np.meshgrid(grid, grid)
    vertices, faces = mbvi.surfaces.terrain(grid, grid, 0.4 * (x**2 + y**2))
    scene = mbvi.Scene(friction=0.3)
    scene.add_surface(vertices, faces)
    scene.add_spheres([[0.3, 0, 0.2], [-0.2, 0.1, 0.2]], 0.04, 0.5)
    run = mbvi.simulate(scene.build(), mbvi.Centered(project_positions=True), step=1e-3, duration=0.4)
    assert np.abs(run.q[:, [0, 1, 2, 7, 8, 9]]).max() <= 0.5
    # less than a ball sinks where nothing lifts it
    assert run.penetration().max() <= 1e-3


def test_a_run_with_many_contacts_is_diagnosed_as_exactly_as_it_was_solved():
    run = mbvi.simulate(pyramid(6), mbvi.Paoli(project_positions=True), step=1e-3, duration=0.01)
    assert 1e-6 < run.residual.max() <= 1e-3
    # it solves the law again, because positions are projected
    assert str(run.diagnosis())


def test_a_ball_on_a_turntable_circles_at_two_sevenths_of_its_rate():
    """A rolling ball of uniform density: dv/dt = 2/7 spin x v, wherever it is."""
    rate, h = 2.0, 1e-3
    scene = mbvi.Scene(friction=1.0)
    scene.add_halfspace((0, 0, 1), 0.0, motion=mbvi.motion.Rotation((0, 0, 1), rate, (0.3, 0.1, 0.0)))
    scene.add_sphere(0.1, 1.0, (0.5, 0.0, 0.1), name="ball")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=h, duration=0.5)
    # it slips to begin with; from there on it rolls
    first, rolls = run.v[100], 2.0 / 7.0 * rate
    angle = rolls * (run.t[-1] - run.t[100])
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ first[:2]
    assert np.linalg.norm(turned) > 0.05
    np.testing.assert_allclose(run.v[-1, :2], turned, atol=rate * h * np.linalg.norm(turned))


def test_held_rows_move_no_sticking_contact_along_its_tangents(rng):
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), 0.0)
    scene.add_urdf("robots/quadruped/quadruped.urdf", position=(0, 0, 1.0))
    problem = scene.build()
    rows = problem.constraints.active(0.0, problem.q0, 2.0)
    metric = problem.system.metric(problem.q0)
    some = rng.permutation(len(rows.gap))[:4]
    rows = take(rows, some)
    sticking = np.array([True, False, True, False])
    held = _held(metric, rows, sticking, np.arange(4))
    tangents = rows.tangents.take(np.flatnonzero(sticking)).jacobian
    assert np.abs(held @ metric.solve_rows(tangents).T).max() <= 1e-6 * np.abs(rows.jacobian).max()
    # rows along such displacements are what they were
    free = rng.normal(size=problem.system.nv)
    solved = metric.solve_rows(tangents)
    free -= np.linalg.lstsq(tangents @ solved.T, tangents @ free, rcond=None)[0] @ solved
    np.testing.assert_allclose(held @ free, rows.jacobian @ free, atol=1e-9 * np.abs(free).max())
    np.testing.assert_array_equal(_held(metric, rows, sticking, np.full(4, -1)), rows.jacobian)


@pytest.mark.parametrize(("speed", "sticks"), [(0.0, True), (0.5, False)])
def test_only_contacts_that_stick_are_held(speed, sticks):
    scene = mbvi.Scene(gravity=(1.0, 0.0, -G), friction=0.5)
    scene.add_halfspace((0, 0, 1), 0.0)
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05), velocity=(speed, 0, 0))
    problem, h = scene.build(), 1e-3
    step = mbvi.Paoli().step(problem, 0.0, problem.q0, problem.v0, h, Projector())
    motion = problem.system.free_motion(0.0, problem.q0, problem.v0, h)
    found = _sticking(problem, Applied(h, step.q, problem.v0, h, motion), step)
    assert (found is not None and found.any()) == sticks


def test_contacts_without_tangential_percussions_are_not_held():
    """Of two boxes at rest on a slope, the one on ice leans on the other."""
    scene = mbvi.Scene(gravity=(1.0, 0.0, -G), friction=0.5)
    scene.add_halfspace((0, 0, 1), 0.0, name="floor")
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05), name="ice")
    scene.add_box((0.2, 0.2, 0.1), 10.0, position=(0.2, 0, 0.05), name="stone")
    scene.set_friction("floor", "ice", 0.0)
    problem, h = scene.build(), 1e-3
    step = mbvi.Paoli().step(problem, 0.0, problem.q0, problem.v0, h, Projector())
    motion = problem.system.free_motion(0.0, problem.q0, problem.v0, h)
    found = _sticking(problem, Applied(h, step.q, problem.v0, h, motion), step)
    on_ice = (step.active.tangents.friction == 0.0) & (step.percussion > 0.0)
    # they do not slide either
    assert on_ice.any() and (h * np.abs(step.slip[2][on_ice]) <= problem.tolerance).all()
    assert found.any() and not found[on_ice].any()


def test_nothing_is_left_of_a_row_that_only_moves_a_sticking_contact_along_its_tangents(rng):
    """A point on a floor and at a wall: where it sticks to the floor it cannot leave the wall, not even by rounding."""
    x, y, z = np.eye(3)
    floor = mbvi.GapFunction(lambda q: q[2], lambda q: z, tangents=lambda q: np.array([x, y]))
    wall = mbvi.GapFunction(
        lambda q: 0.6 * q[0] + 0.8 * q[1],
        lambda q: 0.6 * x + 0.8 * y,
        tangents=lambda q: np.array([z, 0.8 * x - 0.6 * y]),
    )
    B = rng.normal(size=(3, 3))
    system = mbvi.LagrangianSystem(lambda q: B @ B.T + np.eye(3), lambda t, q, v: -z, 3)
    problem = mbvi.Problem(system, [floor, wall], np.zeros(3), np.zeros(3), friction=0.5)
    rows, metric = problem.constraints.active(0.0, problem.q0, 1.0), system.metric(problem.q0)
    held = _held(metric, rows, np.array([True, False]), np.arange(2))
    assert held[0].any() and not held[1].any()


def test_a_box_that_lands_tilted_in_a_groove_is_lifted():
    """It must turn about contacts that stick, which it cannot while all of them are held."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0.5, 0.8))
    scene.add_halfspace((0, -0.5, 0.8))
    scene.add_box((0.4, 0.1, 0.1), 1.0, position=(0, 0, 0.2), rotation=(np.pi / 4 + 0.1, 0.1, 0))
    run = mbvi.simulate(scene.build(), mbvi.Centered(project_positions=True), step=1e-3, duration=0.35)
    assert run.penetration().max() <= 1e-7


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.MoreauJean()])
def test_a_wedge_that_is_driven_in_stops_and_a_ball_beside_it_bounces(scheme):
    """No velocity leads the wedge out of both walls at once, because friction holds it: it has no restitution then."""
    lean, height = 0.15, 0.05
    c, s = np.cos(lean), np.sin(lean)
    scene = mbvi.Scene(friction=0.5, restitution=0.5)
    scene.add_halfspace((c, 0, s))
    scene.add_halfspace((-c, 0, s))
    corners = [(sign * z * s / c, y, z) for z in (0.2, 0.4) for sign in (-1.0, 1.0) for y in (-0.1, 0.1)]
    scene.add_convex(np.array(corners), np.array([[0.0, 0.0, height]]), 1.0)
    scene.add_box((0.04, 0.04, 0.04), position=(0, 1.0, 0.28), fixed=True)
    scene.add_sphere(0.02, 0.1, (0, 1.0, 0.32 + height))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.11)
    fall = np.sqrt(2.0 * G * height)
    # it falls on by the gap that is left
    np.testing.assert_allclose(run.v[-1, :6], 0.0, atol=G * 0.01)
    assert run.v[-1, 8] == pytest.approx(0.5 * fall - G * (0.11 - fall / G), abs=0.03)
    assert any("jammed" in note for note in run.notes)
    jam = next(impact for impact in run.impacts if len(impact.e_used) > 1)
    assert set(jam.e_used) <= {0.0, 0.5} and 0.0 in jam.e_used


def test_grains_in_a_turning_drum_with_strong_friction_are_not_driven_apart():
    """Compliant contacts have a second answer here, whose percussions grow without bound as compliance falls."""
    scene = mbvi.Scene(restitution=0.2, friction=1.5)
    turning = mbvi.motion.Rotation(axis=(0, 1, 0), rate=3.0)
    scene.add_surface(*mbvi.surfaces.drum(radius=0.2, length=0.12, vanes=6, depth=0.07), motion=turning)
    grains = mbvi.packing.random_loose(
        (-0.1, -0.06, -0.1), (0.1, 0.06, 0.1), mbvi.packing.uniform(0.008, 0.012), count=70, seed=4
    )
    scene.add_spheres(*grains, density=2500.0)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.2)
    assert run.residual.max() <= 1e-3
