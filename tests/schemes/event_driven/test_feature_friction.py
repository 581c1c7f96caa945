"""Friction of polyhedra, capsules and cylinders that stay on each other, under error control."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.constraints.feature_motion import slip_biases, touching
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
        T, bias = kernels.slips(q, v, index, np.ones(len(index)))
        there = _tangents(system, q, parts)
        np.testing.assert_allclose(T, there, atol=1e-10 * (1 + np.abs(there).max(initial=0.0)))
        np.testing.assert_allclose(bias, expected, atol=1e-7 * size)
