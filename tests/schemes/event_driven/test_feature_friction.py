"""Friction of polyhedra, capsules and cylinders that stay on each other, under error control."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints.features.feature_motion import slip_biases, touching
from mbvi.constraints.mechanism.held_rows import LIMIT, RowParts
from mbvi.constraints.tangents import axes_of
from mbvi.schemes.event_driven.rows.known_rows import known_rows
from support.held_row_arguments import random_parts
from support.robot_arguments import moving_robot

G, HALF = 9.81, 0.05
ANGLE = 0.3
ALONG, UP = np.array([np.cos(ANGLE), 0, -np.sin(ANGLE)]), np.array([np.sin(ANGLE), 0, np.cos(ANGLE)])
TILT = np.column_stack([ALONG, [0, 1, 0], UP])
# its axis is horizontal and across the slope
LYING = TILT @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
# moments of inertia over m r^2 about the axis: of a capsule those of its cylinder and of its two halves of a ball
_CYLINDER, _BALL = np.pi * HALF**2 * 0.2, 4 / 3 * np.pi * HALF**3
INERTIA = {"cylinder": 0.5, "capsule": (0.5 * _CYLINDER + 0.4 * _BALL) / (_CYLINDER + _BALL)}


def _on_slope(kind, friction):
    scene = mbvi.Scene(restitution=0.0, friction=friction)
    scene.add_box((3, 1, 0.2), position=tuple(-0.1 * UP), rotation=TILT, fixed=True)
    place = {"position": tuple(HALF * UP - ALONG), "rotation": TILT if kind == "box" else LYING}
    if kind == "box":
        scene.add_box((2 * HALF,) * 3, **place)
    else:
        getattr(scene, f"add_{kind}")(HALF, 0.2, **place)
    return scene.build()


def _end(problem, tolerance, duration):
    run = mbvi.simulate(problem, mbvi.EventDriven(tolerance), duration=duration)
    assert run.notes == ()
    return run.q[-1], run.v[-1]


@pytest.mark.parametrize("friction", [0.2, 0.4])
@pytest.mark.parametrize("kind", ["box", "capsule", "cylinder"])
def test_on_a_slope_that_is_a_box(kind, friction):
    """A box slides or sticks; round bodies roll, with as much friction as that takes, or slide as they roll."""
    problem = _on_slope(kind, friction)
    pull, grip = G * np.sin(ANGLE), friction * G * np.cos(ANGLE)
    if kind == "box":
        a = max(pull - grip, 0.0)
    else:
        a = pull - min(grip, pull * INERTIA[kind] / (1 + INERTIA[kind]))
    q, v = _end(problem, 1e-8, 0.5)
    np.testing.assert_allclose(v[:3], 0.5 * a * ALONG, atol=1e-9)
    np.testing.assert_allclose(q[:3] - problem.q0[:3], 0.125 * a * ALONG, atol=1e-9)


def test_a_box_brings_another_one_along():
    """Friction slows the upper box and drives the lower one until both have the velocity of their centre of mass."""
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((2, 1, 0.2), 2.0, position=(0, 0, 0.1), name="cart")
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(-0.8, 0, 0.25), velocity=(1, 0, 0), name="load")
    scene.set_friction("cart", "load", 0.3)
    problem = scene.build()
    q, v = _end(problem, 1e-8, 0.4)
    meet = 1 / (1.5 * 0.3 * G)
    np.testing.assert_allclose(v[[0, 6]], 1 / 3, atol=1e-9)
    np.testing.assert_allclose(q[0], 0.075 * G * meet**2 + (0.4 - meet) / 3, atol=1e-9)
    np.testing.assert_allclose(q[7] + 0.8, meet - 0.15 * G * meet**2 + (0.4 - meet) / 3, atol=1e-9)


@pytest.mark.slow
def test_a_box_that_tumbles_over_an_edge_keeps_to_its_tolerance():
    """It lands on a corner, slides, turns over the edge of the table and leaves it."""
    scene = mbvi.Scene(restitution=0.2, friction=0.4)
    scene.add_box((1, 1, 0.2), position=(0, 0, -0.1), fixed=True)
    scene.add_box((0.2, 0.1, 0.3), position=(0.35, 0.05, 0.18), rotation=(0.05, 0.35, 0.0), velocity=(0.8, 0, 0))
    problem = scene.build()
    (rough, _), (fine, _) = (_end(problem, tolerance, 0.4) for tolerance in (1e-6, 1e-8))
    assert np.abs(problem.system.difference(fine, rough)).max() < 1e-5


def _tangents(system, q, parts):
    """The tangents of some rows, by the separation of the bodies along each axis at the contact points."""
    at = touching(system, q, parts)
    point = at.point + parts.shift[:, None] * at.normal
    sides = np.ascontiguousarray(at.bodies.T)
    axes = axes_of(at.normal)
    return np.stack([system.separation_rows(q, *sides, point, axes[:, c].copy()) for c in range(2)], axis=1)


@given(st.integers(0, 10_000).map(np.random.default_rng))
@settings(max_examples=30)
def test_tangents_turn_with_their_derivatives(rng):
    """(dT/dt) v of all kinds of features, where these touch, against differences of tangents along the motion."""
    system, q, v = moving_robot(rng)
    q, parts = np.array(q), random_parts(rng, system.model, 6)
    parts = RowParts(*(column[parts.kind != LIMIT].copy() for column in parts))
    parts = parts._replace(radius=parts.radius + touching(system, q, parts).gap)
    h = 1e-5
    slips = [_tangents(system, system.integrate(q, k * h * v), parts) @ v for k in (-2, -1, 1, 2)]
    expected = (slips[0] - 8 * slips[1] + 8 * slips[2] - slips[3]) / (12 * h)
    size = 1 + np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(slip_biases(system, q, v, parts), expected, atol=1e-7 * size)
    kernels = known_rows(system, parts)
    if kernels is not None:
        index = np.arange(len(parts.kind))
        T, bias, axes = kernels.slips(q, v, index, np.ones(len(index)))
        there = _tangents(system, q, parts)
        np.testing.assert_allclose(T, there, atol=1e-10 * (1 + np.abs(there).max(initial=0.0)))
        np.testing.assert_allclose(bias, expected, atol=1e-7 * size)
        np.testing.assert_allclose(axes, axes_of(touching(system, q, parts).normal), atol=1e-12)


def _turned_to(axis):
    """A rotation that takes the z axis to another one."""
    return {"x": np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]), "y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}[
        axis
    ]


def test_a_capsule_slides_along_a_rail_until_it_rolls():
    """Both cross: the rail is a capsule too."""
    mu, speed, r, length = 0.3, 1.0, 0.05, 0.4
    scene = mbvi.Scene(restitution=0.0, friction=mu)
    scene.add_capsule(0.1, 4.0, rotation=_turned_to("x"), position=(0, 0, 0), fixed=True)
    scene.add_capsule(r, length, rotation=_turned_to("y"), position=(-1, 0, 0.15), velocity=(speed, 0, 0))
    cylinder, ball = np.pi * r**2 * length, 4 / 3 * np.pi * r**3
    inertia = (0.5 * cylinder + 0.4 * ball) / (cylinder + ball)
    rolls = speed / (mu * G * (1 + 1 / inertia))
    left = speed - mu * G * rolls
    q, v = _end(scene.build(), 1e-8, 0.5)
    assert v[0] == pytest.approx(left, abs=1e-9)
    assert q[0] + 1 == pytest.approx(speed * rolls - 0.5 * mu * G * rolls**2 + left * (0.5 - rolls), abs=1e-9)


def test_a_capsule_lies_in_a_groove_of_capsules():
    """Along each of both a line of contact stays, of which the ends count."""
    scene = mbvi.Scene(restitution=0.2)
    for y in (-0.06, 0.06):
        scene.add_capsule(0.05, 2.0, rotation=_turned_to("x"), position=(0, y, 0), fixed=True)
    scene.add_capsule(0.05, 0.6, rotation=_turned_to("x"), position=(0, 0, 0.2), velocity=(0.3, 0, 0))
    q, v = _end(scene.build(), 1e-6, 0.6)
    np.testing.assert_allclose(q[:3], [0.18, 0, 0.08], atol=1e-9)
    np.testing.assert_allclose(v, [0.3, 0, 0, 0, 0, 0], atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_capsule_that_falls_onto_another_keeps_to_its_tolerance(seed):
    """Steps in which both would pass through each other and part again end where they meet."""
    rng = np.random.default_rng(seed)
    turned = [Rotation.random(random_state=seed + more).as_matrix() for more in (0, 50)]
    scene = mbvi.Scene(restitution=0.5)
    scene.add_capsule(0.1, 1.0, rotation=turned[0], position=(0, 0, 0), fixed=True)
    place = (*0.05 * rng.normal(size=2), 0.9)
    scene.add_capsule(0.05, 0.6, rotation=turned[1], position=place, angular_velocity=rng.normal(size=3))
    problem = scene.build()
    (rough, _), (fine, _) = (_end(problem, tolerance, 0.6) for tolerance in (1e-6, 1e-9))
    assert np.abs(problem.system.difference(fine, rough)).max() < 1e-6
