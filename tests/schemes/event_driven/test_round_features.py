"""Capsules and cylinders on polyhedra under error control: their axes, ends and rims are smooth rows."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.constraints.features.feature_kernels import FACE_RIM
from mbvi.constraints.features.pair_features import FeatureRows
from mbvi.schemes.event_driven.rows.contact_rows import SmoothRows
from support.robot_arguments import rotation, unit

G = 9.81
LIES = (0.0, np.pi / 2, 0.0)


def _add(scene, kind, **more):
    return (scene.add_capsule if kind == "capsule" else scene.add_cylinder)(0.1, 0.3, **more)


@pytest.mark.parametrize("kind", ["capsule", "cylinder"])
@pytest.mark.parametrize("place", ["lies", "tilted", "stands", "rolls"])
def test_on_the_top_of_a_box_as_on_a_plane(kind, place):
    """Above a half-space every point has a row of its own; a large box below must give the same motion."""
    turned, velocity = {
        "lies": (LIES, (0.0, 0.0, 0.0)), "tilted": ((0.0, np.pi / 2 + 0.05, 0.0), (0.0, 0.0, 0.0)),
        "stands": ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)), "rolls": (LIES, (0.0, 0.4, 0.0)),
    }[place]  # fmt: skip
    turning = (-4.0, 0.0, 0.5) if place == "rolls" else (0.0, 0.0, 0.0)
    runs = []
    for floor in ("box", "plane"):
        scene = mbvi.Scene(restitution=0.3)
        if floor == "box":
            scene.add_box((2.0, 2.0, 0.4), position=(0, 0, -0.2), fixed=True)
        else:
            scene.add_halfspace((0, 0, 1))
        at = {"rolls": 0.1, "stands": 0.27 if kind == "capsule" else 0.17}.get(place, 0.17)
        moves = {"velocity": velocity, "angular_velocity": turning}
        _add(scene, kind, position=(0.0, 0.0, at), rotation=turned, **moves)
        runs.append(mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.4))
    on_box, on_plane = runs
    assert on_box.notes == on_plane.notes == ()
    np.testing.assert_allclose(on_box.q[-1], on_plane.q[-1], atol=1e-5)
    np.testing.assert_allclose(on_box.v[-1], on_plane.v[-1], atol=1e-4)


def _on_an_edge(kind, first, start, across):
    """A rod on the upper edge of a fixed box, at an angle from the vertical; its axis is turned from along the edge."""
    scene, tilt = mbvi.Scene(restitution=0.0), -0.2

    def about_y(angle):
        return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])

    def box():
        turn = about_y(tilt)
        scene.add_box((0.2, 1.0, 0.2), position=tuple(turn @ [-0.1, 0.0, -0.1]), rotation=turn, fixed=True)

    def rod():
        c, s = np.cos(across), np.sin(across)
        turn = (
            about_y(start) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        )
        _add(scene, kind, position=tuple(about_y(start) @ [0.0, 0.0, 0.1]), rotation=turn)

    for add in (box, rod) if first == "box" else (rod, box):
        add()
    return scene.build()


@pytest.mark.parametrize("first", ["box", "rod"])
@pytest.mark.parametrize("kind", ["capsule", "cylinder"])
def test_sliding_off_an_edge_along_it(kind, first):
    """Without friction a rod slides about the edge as a point about a circle, and leaves where cos a = 2/3 cos a0."""
    start, r = 0.1, 0.1
    run = mbvi.simulate(_on_an_edge(kind, first, start, 0.0), mbvi.EventDriven(1e-8), duration=0.4)
    assert run.notes == ()
    x, z = run.q[:, 0], run.q[:, 2]
    # a step that follows the release soon is near the circle, too
    last = np.flatnonzero(np.abs(np.hypot(x, z) - r) < 1e-13)[-1]
    assert 0 < last < len(x) - 2
    np.testing.assert_allclose((run.v[:, :3] ** 2).sum(axis=1), 2 * G * (r * np.cos(start) - z), atol=1e-6)
    # the state at the release is recorded
    assert z[last] / r == pytest.approx(2 / 3 * np.cos(start), abs=1e-6)


@pytest.mark.parametrize("first", ["box", "rod"])
@pytest.mark.parametrize("kind", ["capsule", "cylinder"])
def test_sliding_off_an_edge_across_it(kind, first):
    """The energy stays, and the motion does not depend on the tolerance."""
    ends = []
    for tolerance in (1e-8, 1e-6):
        run = mbvi.simulate(_on_an_edge(kind, first, 0.1, 0.6), mbvi.EventDriven(tolerance), duration=0.35)
        assert run.notes == ()
        energy = run.energy()
        np.testing.assert_allclose(energy, energy[0], atol=100 * tolerance * np.abs(energy[0]))
        ends.append((run.q[-1], run.v[-1]))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-5)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-4)
    # it has slid
    assert ends[0][0][2] < 0.08


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize(("x", "length"), [(0.2, 0.5), (0.0, 0.2), (0.02, 0.2)])
@pytest.mark.parametrize("kind", ["capsule", "cylinder"])
def test_a_rod_that_lands_on_edges_comes_to_rest(kind, x, length, restitution):
    """Its ends strike in turns, less each time; landings that were found late would never get weaker."""
    scene = mbvi.Scene(restitution=restitution)
    scene.add_box((length, 0.4, 0.3), fixed=True)
    _add(scene, kind, position=(x, 0.0, 0.15 + 0.1 + 0.01), rotation=(0.0, np.pi / 2 + 0.05, 0.0))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.3)
    assert len(run.impacts) < 200 and run.notes == ()
    assert run.penetration().max() < 1e-7


@st.composite
def _touching(draw):
    """A box and a round shape in no order, that touch, turned at random; at times axes are along the box's."""
    rng = np.random.default_rng(draw(st.integers(0, 100_000)))
    kind = draw(st.sampled_from(["capsule", "cylinder"]))
    turned = rotation(rng) if draw(st.booleans()) else np.eye(3)[draw(st.permutations(range(3)))] * [[1], [1], [1]]
    turned = turned * np.sign(np.linalg.det(turned))
    scene = mbvi.Scene(gravity=(0, 0, 0))
    adds = [
        lambda: scene.add_box((0.4, 0.5, 0.6), position=(0, 0, 0), rotation=np.eye(3)),
        lambda: _add(scene, kind, position=tuple(unit(rng)), rotation=turned),
    ]
    for add in adds if draw(st.booleans()) else reversed(adds):
        add()
    return scene.build(), rng


@given(_touching())
@settings(max_examples=60, deadline=None)
def test_rows_of_features_are_the_distance_nearby(made):
    """Where one row stands for the pair it is the distance, to first order in any motion, with its gradient."""
    problem, rng = made
    system, q = problem.system, problem.q0.copy()
    ((family, _, _),) = problem.constraints.numbered()
    nearest = family.nearest(q, np.array([0]))
    assume(nearest.gap[0] > 0.01)
    towards = np.zeros(system.nv)
    towards[6:9] = nearest.normal[0]
    q = system.integrate(q, -nearest.gap[0] * towards)
    features = FeatureRows(system)
    rows = np.array(family.feature_rows(q, 0, 1e-9, features))
    assume(len(rows) > 0)
    # where corners meet any normal between two is one
    assume(features.row_points(0.0, q, rows)[1][0] @ nearest.normal[0] > 1.0 - 1e-12)
    np.testing.assert_allclose(features.row_gap(0.0, q, rows), 0.0, atol=1e-8)
    # the contact points are on both surfaces
    assert features.outside(q, rows).max() < 1e-7
    for _ in range(5):
        move = 1e-5 * rng.normal(size=system.nv)
        moved = system.integrate(q, move)
        gap = features.row_gap(0.0, moved, rows)
        # the search for the distance is exact to 1e-6 of the size only, where lines or faces are nearly parallel
        found = family.row_gap(0.0, moved, np.array([0]))[0]
        assert found == pytest.approx(gap.min(), abs=1e-8 if len(rows) == 1 else 3e-7)
        rates = features.row_gradient(0.0, q, rows) @ move
        np.testing.assert_allclose(gap, rates, atol=5e-8)


def test_a_rim_turns_with_its_derivatives(rng):
    """(dJ/dt) v of a free cylinder's rims on a plane, along the normal and along tangents, against differences."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0.3, 0.2, 1.0))
    scene.add_cylinder(0.1, 0.3, position=(0, 0, 0.5), rotation=(0.4, 0.7, 0.1))
    problem = scene.build()
    system, rows = problem.system, SmoothRows(problem.constraints, 0.0, problem.q0)
    rims = rows.all[(rows.parts(rows.all).kind == FACE_RIM)]
    assert len(rims) == 2
    v, h = rng.normal(size=system.nv), 1e-5

    def at(x):
        q = system.integrate(problem.q0, x * v)
        return rows.gradients(0.0, q, rims), np.asarray(rows.tangents(0.0, q, rims).jacobian)

    (J0, T0), (J1, T1) = at(-h), at(h)
    np.testing.assert_allclose(rows.bias(0.0, problem.q0, v, rims), (J1 - J0) @ v / (2 * h), atol=1e-6)
    np.testing.assert_allclose(rows.slips(0.0, problem.q0, v, rims)[1].ravel(), (T1 - T0) @ v / (2 * h), atol=1e-6)


@pytest.mark.slow
def test_a_cylinder_that_comes_to_stand_with_friction_gains_no_energy():
    """The lowest point of its rim moves the faster the flatter it lies."""
    scene = mbvi.Scene(friction=0.5, restitution=0.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_cylinder(0.1, 0.3, position=(0, 0, 0.21), rotation=(0, 0.2, 0))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.6)
    energy = run.energy()
    assert energy.max() <= energy[0] + 1e-6
    assert run.q[-1, 2] == pytest.approx(0.15, abs=2e-3)
