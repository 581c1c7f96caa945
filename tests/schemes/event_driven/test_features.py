"""Polyhedra that stay on each other under error control: their features are rows, and changes of them are events."""

import numpy as np
import pytest

import mbvi
from mbvi.constraints.features.pair_features import FeatureRows
from mbvi_studies.published_robots import published_robot

G = 9.81


def _turned(x, y):
    """The rotation about y, then x."""
    a, b = np.eye(3), np.eye(3)
    a[1:, 1:] = [[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]]
    b[::2, ::2] = [[np.cos(y), np.sin(y)], [-np.sin(y), np.cos(y)]]
    return a @ b


def end(problem, tolerance, duration):
    """The last state of a run without fallback steps."""
    run = mbvi.simulate(problem, mbvi.EventDriven(tolerance), duration=duration)
    assert run.notes == ()
    return run.q[-1], run.v[-1]


def test_a_box_rests_on_a_box():
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.4, 0.4, 0.2), position=(0, 0, 0.1))
    scene.add_box((0.2, 0.2, 0.2), position=(0.02, 0, 0.32))
    q, v = end(scene.build(), 1e-6, 0.3)
    np.testing.assert_allclose(q[[2, 9]], [0.1, 0.3], atol=1e-10)
    assert np.abs(v).max() < 1e-10


def test_a_box_slides_down_a_slope_past_its_end():
    """On the slope it has the acceleration of a point; its corners leave the slope one pair after the other."""
    angle, half = 0.3, 0.05
    along, up = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, np.cos(angle)])
    turned = _turned(0.0, angle)
    scene = mbvi.Scene(restitution=0.0)
    scene.add_box((1.0, 1.0, 0.2), position=tuple(-0.1 * up), rotation=turned, fixed=True)
    scene.add_box((2 * half,) * 3, position=tuple(half * up + 0.2 * along), rotation=turned)
    problem = scene.build()
    q, v = end(problem, 1e-8, 0.3)
    np.testing.assert_allclose(v[:3], G * np.sin(angle) * 0.3 * along, atol=1e-7)
    np.testing.assert_allclose(q[:3], half * up + (0.2 + 0.5 * G * np.sin(angle) * 0.09) * along, atol=1e-7)
    # when its middle has passed the end of the slope it tips over the edge
    later, sooner = (end(problem, tolerance, 0.48) for tolerance in (1e-8, 1e-6))
    assert later[1][4] > 0.1
    assert np.abs(problem.system.difference(later[0], sooner[0])).max() < 1e-5


@pytest.mark.parametrize("kind", ["vertex on face", "face on vertex", "edges"])
def test_the_rows_of_features_are_smooth_and_have_their_derivatives(kind, rng):
    """Gap, gradient and its change against differences."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    tilted, level = (0.5, 0.6), (0.0, 0.0)
    first, second = {
        "vertex on face": (tilted, level), "face on vertex": (level, tilted), "edges": ((0.0, 0.7), (0.7, 0.0)),
    }[kind]  # fmt: skip
    scene.add_box((1.0, 1.0, 1.0), position=(0, 0, 0), rotation=_turned(*first))
    scene.add_box((1.0, 1.0, 1.0), position=(0.03, 0.02, 3.0), rotation=_turned(*second))
    problem = scene.build()
    system, constraints = problem.system, problem.constraints
    q = problem.q0.copy()
    q[9] -= float(constraints.gap(0.0, q)[0])
    ((family, _, _),) = constraints.numbered()
    features = FeatureRows(system)
    rows = np.array(family.feature_rows(q, 0, 1e-9, features))
    assert len(rows) == 1
    v = rng.normal(size=system.nv)
    J = features.row_gradient(0.0, q, rows)
    # velocities that keep the gap, as of closed contacts
    v -= J[0] * (J[0] @ v) / (J[0] @ J[0])
    h = 1e-4

    def at(x):
        return system.integrate(q, x * v)

    np.testing.assert_allclose(features.row_gap(0.0, q, rows), 0.0, atol=1e-12)
    for x in (-h, h):
        np.testing.assert_allclose(features.row_gap(0.0, at(x), rows), constraints.gap(0.0, at(x)), atol=1e-12)
    rate = (features.row_gap(0.0, at(h), rows) - features.row_gap(0.0, at(-h), rows)) / (2 * h)
    np.testing.assert_allclose(J @ v, rate, atol=1e-6)
    change = (features.row_gradient(0.0, at(h), rows) - features.row_gradient(0.0, at(-h), rows)) @ v / (2 * h)
    np.testing.assert_allclose(features.row_bias(0.0, q, v, rows), change, atol=1e-5)


@pytest.mark.parametrize("tilt", [0.0, 3e-12, 1e-11, 1e-10])
@pytest.mark.parametrize("bulge", [1e-6, 1e-4, 1e-2])
def test_features_of_an_edge_on_a_face_among_nearly_parallel_ones(tilt, bulge):
    """A hull has facets that are nearly level; an edge of another one lies on one of them, but for rounding."""
    # a roof of four facets about a triangle; the edge crosses the triangle and leaves it on both sides
    corners = [(-0.1, -0.1), (0.1, -0.1), (0.0, 0.1), (-0.2, 0.1), (0.2, 0.1), (0.0, -0.3)]
    roof = np.array([(x, y, 0.0 if k < 3 else -bulge) for k, (x, y) in enumerate(corners)] + [(0.0, 0.0, -0.5)])
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [tilt, 0.0, 1.0]])
    beam = np.array([(-0.3, 0, 0), (0.3, 0, 0), (-0.3, 0.1, 0.2), (0.3, 0.1, 0.2), (-0.3, -0.1, 0.2), (0.3, -0.1, 0.2)])
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_convex(roof, [(0.0, 0.0, 0.0)], mass=1.0)
    scene.add_convex(beam @ turn.T, [(0.0, 0.02, 1.0)], mass=1.0)
    problem = scene.build()
    system, q = problem.system, problem.q0.copy()
    ((family, _, _),) = problem.constraints.numbered()
    q[9] -= float(family.row_gap(0.0, q, np.array([0]))[0])
    features = FeatureRows(system)
    rows = np.array(family.feature_rows(q, 0, 1e-8, features))
    assert 0 < len(rows) <= 2
    gaps = features.row_gap(0.0, q, rows)
    np.testing.assert_allclose(gaps, 0.0, atol=1e-10)
    # each is on both shapes, and the least of them is the distance
    assert features.outside(q, rows).max() < 1e-8
    assert gaps.min() == pytest.approx(float(family.row_gap(0.0, q, np.array([0]))[0]), abs=1e-10)


def test_a_contact_rests_by_the_force_of_another_that_rests():
    """A ball in an acute corner: gravity alone would lift it off the leaning wall, the floor's force holds it there."""
    scene = mbvi.Scene(gravity=(-1.0, 0.0, -9.0), restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((0.9, 0.0, -np.sqrt(1 - 0.81)), name="wall")
    # where it touches both
    scene.add_sphere(0.1, position=((0.1 + 0.1 * np.sqrt(1 - 0.81)) / 0.9, 0.0, 0.1), velocity=(2e-9, 0.0, 1e-9))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.1)
    assert run.impacts == ()
    assert np.abs(run.v[-1]).max() < 1e-12


@pytest.mark.parametrize("restitution", [0.0, pytest.param(0.5, marks=pytest.mark.slow)])
def test_hulls_of_a_published_robot_stay_on_each_other(restitution):
    """G1's wrists come to lie on its hips after 0.22 s."""
    problem = published_robot("g1", 0.02, restitution)
    (q, v), (finer, swifter) = (end(problem, tolerance, 0.23) for tolerance in (1e-6, 1e-8))
    assert np.abs(problem.system.difference(q, finer)).max() < 1e-5
    assert np.abs(v - swifter).max() < 1e-5
