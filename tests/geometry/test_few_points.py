"""Of the many points of a face few become rows: they bear load as all do, and they stay the same while it rests."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

import mbvi
from mbvi.constraints import HalfSpaceContacts
from mbvi.geometry.shapes import HalfSpace, Hull, PlacedShape
from mbvi.geometry.spread import FEW_POINTS, spread_out
from mbvi.projection.projector import Projector
from mbvi.system import FreeBodies

seeds = st.integers(0, 10_000)
# by how much points may lie outside the hull of the chosen ones, relative to the shape's radius; eight corners of a
# regular polygon of very many leave 1 - cos(pi / 8) = 0.08
OUTSIDE = 0.2


def chosen_of(place, gap, size, tolerance):
    chosen = np.empty(FEW_POINTS, np.int64)
    return chosen[: spread_out(np.ascontiguousarray(place), gap, size, tolerance, chosen)].copy()


def face(rng, count):
    """Points of a face: on a circle, an ellipse, a long strip, anywhere."""
    angle, kind = rng.uniform(0, 2 * np.pi, count), rng.integers(4)
    if kind < 2:
        return np.stack([np.cos(angle), [1.0, 0.1][kind] * np.sin(angle)], axis=1)
    return rng.uniform(-1, 1, (count, 2)) * [1.0, [1.0, 0.02][kind - 2]]


def radius(place):
    return float(np.linalg.norm(place - place.mean(axis=0), axis=1).max())


@given(seed=seeds, count=st.integers(1, 300))
def test_few_points_of_a_face_hold_the_others(seed, count):
    rng = np.random.default_rng(seed)
    place, size = face(rng, count), 1.0
    chosen = chosen_of(place, np.zeros(count), size, 1e-3)
    assert len(chosen) <= FEW_POINTS and (np.diff(chosen) > 0).all()
    if count <= FEW_POINTS:
        np.testing.assert_array_equal(chosen, np.arange(count))
        return
    # the cone of wrenches of forces along the normal is that of the places of the points that bear them
    hull = ConvexHull(place[chosen])
    assert (place @ hull.equations[:, :2].T + hull.equations[:, 2]).max() <= OUTSIDE * radius(place)


@given(seed=seeds, sunk=st.booleans(), count=st.integers(9, 200))
def test_the_deepest_point_is_chosen_whatever_the_gaps(seed, sunk, count):
    rng = np.random.default_rng(seed)
    place, gap = face(rng, count), rng.uniform(size=count) * 10.0 ** rng.uniform(-10, 0) - sunk
    chosen = chosen_of(place, gap, 1.0, float(rng.choice([gap.max(), 2.0, np.inf])))
    assert len(chosen) <= FEW_POINTS
    assert gap[chosen].min() == gap.min() or gap[chosen].min() <= gap.min() + 1e-11


@given(seed=seeds, count=st.integers(9, 100))
def test_the_choice_is_fixed_on_the_face_while_it_rests_slides_and_turns(seed, count):
    rng = np.random.default_rng(seed)
    place, none = face(rng, count), np.zeros(count)
    chosen = chosen_of(place, none, 1.0, 1e-3)
    for angle in (0.0, 1e-9, 0.3, 2.0):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        moved = place @ turn.T + rng.normal(size=2)
        np.testing.assert_array_equal(chosen_of(moved, rng.uniform(-1e-13, 1e-13, count), 1.0, 1e-3), chosen)


@given(seed=seeds)
def test_points_that_touch_go_before_points_that_are_near(seed):
    """A face of four corners in a bowl of many other points: the corners are rows, whatever the tolerance."""
    rng = np.random.default_rng(seed)
    corners, bowl = rng.normal(size=(4, 2)), 3.0 * rng.normal(size=(60, 2))
    gap = np.concatenate([np.zeros(4), 1e-5 + 0.1 * (bowl**2).sum(axis=1)])
    for tolerance in (1e-3, 0.1, 10.0):
        assert {0, 1, 2, 3} <= set(chosen_of(np.concatenate([corners, bowl]), gap, 3.0, tolerance).tolist())


@given(seed=seeds)
def test_the_points_that_become_lowest_as_a_body_tilts_are_among_the_near_ones(seed):
    """Of a dense dome they are a ring of points about the lowest one."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(-1, 1, (400, 2))
    gap, tolerance = 0.5 * (place**2).sum(axis=1), 0.1
    near = np.flatnonzero(gap <= gap.min() + tolerance)
    chosen = near[chosen_of(place[near], gap[near], 1.0, gap.min() + tolerance)]
    apart = []
    for direction in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        tilted = gap[near] - tolerance * (place[near] @ [np.cos(direction), np.sin(direction)])
        lowest = near[tilted.argmin()]
        apart.append(np.linalg.norm(place[chosen] - place[lowest], axis=1).min())
    # beside the deepest point there is room for seven
    assert sorted(apart)[-2] <= 0.12


def lump(rng, size=0.1, kind=0):
    """A hull of very many vertices: a ball, a puck with a round rim, a box with a noisy bottom."""
    if kind == 0:
        points = rng.normal(size=(1500, 3))
        return size * points / np.linalg.norm(points, axis=1)[:, None]
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    if kind == 1:
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        rings = [
            np.column_stack([(1 - 0.1 + 0.1 * np.sin(a)) * around, np.full(96, -0.2 + 0.1 * (1 - np.cos(a)))])
            for a in np.linspace(0, np.pi / 2, 8)
        ]
        return size * np.concatenate([*rings, np.column_stack([around, np.full(96, 0.3)])])
    flat = rng.uniform(-1, 1, (1000, 2))
    # the points of a shallow bowl are all of them corners
    bottom = np.column_stack([flat, 1e-5 * (flat**2).sum(axis=1) - 0.3])
    top = np.array([[x, y, 0.3] for x in (-1, 1) for y in (-1, 1)])
    return size * np.concatenate([bottom, top])


@given(seed=seeds, kind=st.integers(0, 2), tolerance=st.sampled_from([0.0, 1e-9, 1e-4, 1e-2, np.inf]))
@settings(max_examples=40)
def test_no_hull_has_more_than_eight_rows_on_a_half_space(seed, kind, tolerance):
    rng = np.random.default_rng(seed)
    shape = Hull(lump(rng, kind=kind))
    system = FreeBodies(np.ones(1), np.eye(3)[None], np.zeros(3), ("a",))
    floor = HalfSpaceContacts(
        system, [HalfSpace((0.0, 0.0, 1.0), 0.0)], [PlacedShape("s", shape, 1, np.eye(3), np.zeros(3))], ["s"],
        np.zeros(1),
    )  # fmt: skip
    q = np.array([0.0, 0.0, 0.0, *(1e-3 * rng.normal(size=3)), 1.0])
    q[3:] /= np.linalg.norm(q[3:])
    every = floor.measure(q, np.array([0]), 0.0)
    q[2] -= every.gap.min() + rng.choice([0.0, 1e-3])
    rows = floor.contacts(0.0, q, tolerance)
    assert 1 <= len(rows.gap) <= FEW_POINTS
    assert rows.gap.min() <= floor.measure(q, np.array([0]), 0.0).gap.min() + 1e-13


@given(seed=seeds, kinds=st.tuples(st.integers(0, 2), st.integers(0, 3)))
@settings(max_examples=20)
def test_no_two_shapes_have_more_than_eight_rows(seed, kinds):
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_convex(lump(rng, kind=kinds[0]), positions=[(0, 0, 0.2)], mass=1.0)
    if kinds[1] == 3:
        scene.add_box((0.3, 0.3, 0.2), fixed=True)
    else:
        scene.add_convex(lump(rng, kind=kinds[1]), positions=[(0, 0, 0)], mass=1.0)
    problem = scene.build()
    q = problem.q0.copy()
    for _ in range(6):
        for _ in range(30):
            # along z, which is not quite their normal
            q[2] -= float(problem.constraints.gap(0.0, q).min()) + 1e-5
        rows = problem.constraints.active(0.0, q, float(rng.choice([1e-9, 1e-3, 1e-2])))
        assert 1 <= len(rows.gap) <= FEW_POINTS
        q[:3] += [*(0.01 * rng.normal(size=2)), 0.01]


SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.SchatzmanPaoli(), mbvi.StewartTrinkle(),
    mbvi.EventDriven(1e-6), None,
]  # fmt: skip


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
@pytest.mark.parametrize("kind", [1, 2])
def test_no_projection_of_a_lump_that_falls_on_a_floor_sees_more(scheme, kind, monkeypatch):
    asked = [0]

    def counted(method):
        return lambda self, *given: (
            asked.append(max(part.shape[0] for part in given if getattr(part, "ndim", 0) == 2)) or method(self, *given)
        )

    monkeypatch.setattr(Projector, "project", counted(Projector.project))
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1))
    scene.add_convex(lump(np.random.default_rng(1), kind=kind), positions=[(0, 0, 0.05)], mass=1.0)
    problem = scene.build()
    step = None if isinstance(scheme, mbvi.EventDriven) else 1e-3
    run = mbvi.simulate(problem, scheme, step=step, duration=0.25, record="contacts")
    # `SchatzmanPaoli` adds points to those of its first answer
    assert max(asked) <= FEW_POINTS * (2 if isinstance(scheme, mbvi.SchatzmanPaoli) else 1)
    assert max(len(run.contacts(t)) for t in np.linspace(0, 0.25, 26)) <= FEW_POINTS
    # it stands; schemes that leave penetration sink by what it falls in a step, and a shallow bowl rocks
    np.testing.assert_allclose(run.v[-1], 0.0, atol=5e-3)
    assert abs(problem.constraints.gap(0.0, run.q[-1]).min()) <= 1e-4


@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("noise", [0.0, 1e-7, 1e-5])
def test_a_hull_of_noisy_flat_faces_rests_and_slides_as_a_box_does(noise, friction):
    rng = np.random.default_rng(3)
    half = np.array([0.1, 0.08, 0.03])
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    flat = np.column_stack([rng.uniform(-1, 1, (400, 2)), np.full(400, -1.0)]) * half
    flat[:, 2] -= noise * 0.1 * rng.uniform(size=400)
    ends = []
    for points in (box, np.concatenate([box, flat])):
        scene = mbvi.Scene(friction=friction)
        scene.add_halfspace((0, 0, 1))
        scene.add_convex(points, positions=[(0, 0, 0.0301 + noise)], velocities=[(0.5, 0.2, 0.0)], mass=1.0)
        ends.append(mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.4).q)
    np.testing.assert_allclose(ends[1][:, :3], ends[0][:, :3], atol=1e-9 + 10 * noise)
    np.testing.assert_allclose(np.abs(ends[1][:, 6]), np.abs(ends[0][:, 6]), atol=1e-9 + 10 * noise)


def test_a_disc_of_many_corners_stands_and_does_not_creep():
    angle = np.linspace(0, 2 * np.pi, 256, endpoint=False)
    rim = 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.column_stack([rim, np.full(256, z)]) for z in (-0.05, 0.05)])
    assert len(ConvexHull(points).vertices) == 512
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_convex(points, positions=[(0, 0, 0.05)], mass=1.0)
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.5)
    np.testing.assert_allclose(run.q, np.tile(run.q[0], (len(run.q), 1)), atol=1e-12)
