"""Of the points of a flat face few become rows: they bear load as all do, and they stay the same while it rests."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, QhullError

import mbvi
from mbvi.constraints import HalfSpaceContacts, SignedDistances
from mbvi.geometry.narrow.spread import FEW_POINTS, FLAT, few_corners, one_face
from mbvi.geometry.shapes.flat_faces import flat_faces
from mbvi.geometry.shapes.shape_table import indexed
from mbvi.geometry.shapes.shapes import Box, HalfSpace, Hull, PlacedShape
from mbvi.projection import project
from mbvi.projection.projector import Projector
from mbvi.system import FreeBodies

seeds = st.integers(0, 10_000)
# how far the corner of a regular polygon of nine corners lies outside the hull of the other eight
NINTH = 1.0 - np.cos(2 * np.pi / 9)
# the most that a corner of a circle with corners anywhere lies outside of the chosen ones, relative to its radius:
# where all touch, and where some do
ALL_TOUCH, SOME_TOUCH = 0.25, 0.5


def chosen_of(place, gap, low=None):
    chosen = np.empty(FEW_POINTS, np.int64)
    low = max(float(gap.min()), 0.0) + FLAT if low is None else low
    return chosen[: few_corners(np.ascontiguousarray(place), gap, low, chosen)].copy()


def outside(place, others):
    """How far points lie outside the convex hull of others [m]."""
    hull = ConvexHull(others).equations
    return float((place @ hull[:, :2].T + hull[:, 2]).max())


def circle(rng, count):
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    return np.column_stack([np.cos(angle), np.sin(angle)])


def disc(count, height=0.3, radius=1.0):
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Hull(np.concatenate([np.column_stack([rim, np.full(count, z)]) for z in (-0.5 * height, 0.5 * height)]))


def rounded_box(rng, edges=12):
    """A box with round edges, a hull of many vertices, of which each flat face has four corners."""
    half, r = rng.uniform(0.03, 0.06, 3), 0.02
    turn = np.linspace(0.0, np.pi / 2, edges)
    ball = np.array([[np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)] for a in turn for b in turn])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return Hull(np.concatenate([s * (half + r * ball) for s in signs]))


def above_floor(shape, normal=(0.0, 0.0, 1.0)):
    system = FreeBodies(np.ones(1), np.eye(3)[None], np.zeros(3), ("a",))
    placed = PlacedShape("s", shape, 1, np.eye(3), np.zeros(3))
    return HalfSpaceContacts(system, [HalfSpace(tuple(normal), 0.0)], [placed], ["s"], np.zeros(1))


def pose(tilt, heading, height):
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    return np.array([0.0, 0.0, height, *(np.sin(0.5 * tilt) * axis), np.cos(0.5 * tilt)])


def touching(floor, tilt, heading, sunk):
    """The configuration in which the shape is sunk by some distance."""
    q = pose(tilt, heading, 0.0)
    q[2] -= floor.measure(q, np.array([0]), 0.0).gap.min() + sunk
    return q


@given(seed=seeds, corners=st.integers(3, 8), others=st.integers(0, 40))
def test_the_law_with_the_corners_of_a_face_is_that_with_all_of_its_points(seed, corners, others):
    rng = np.random.default_rng(seed)
    polygon = circle(rng, corners) * rng.uniform(0.1, 1.0, 2)
    try:
        polygon = polygon[ConvexHull(polygon).vertices]
    except QhullError:
        return
    # within the face, and on its edges
    shares = rng.dirichlet(np.ones(len(polygon)), others)
    k, s = rng.integers(len(polygon), size=others), rng.uniform(size=(others, 1))
    edges = s * polygon[k] + (1.0 - s) * polygon[k - 1]
    place = rng.permutation(np.concatenate([polygon, shares @ polygon, edges]))
    chosen = chosen_of(place, np.zeros(len(place)))
    assert len(chosen) <= FEW_POINTS and (np.diff(chosen) > 0).all()
    J = np.column_stack([np.ones(len(place)), place[:, 1], -place[:, 0]])
    B = rng.normal(size=(3, 3))
    M, x, e = B @ B.T + 0.1 * np.eye(3), rng.normal(size=3), rng.uniform()
    before = rng.normal(size=3)
    every, few = (project(x, M, rows, -e * (rows @ before)).velocity for rows in (J, J[chosen]))
    np.testing.assert_allclose(few, every, atol=1e-10 * max(1.0, np.abs(x).max() * np.linalg.cond(M)))


@pytest.mark.parametrize("tilt", [0.0, 1e-5, 1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("count", [9, 12, 20, 60, 453, 500])
def test_what_is_left_out_of_a_round_face_lies_beside_the_rest(count, tilt):
    """It sinks by no more than this distance times the slope of the face."""
    rng = np.random.default_rng(count)
    for k in range(20):
        place = circle(rng, count) if k % 2 else disc(count).vertices[:count, :2]
        gap = tilt * (place @ circle(rng, 1)[0])
        for raised in (-gap.min(), 0.0, -gap.max()):
            chosen = chosen_of(place, gap + raised)
            assert len(chosen) == FEW_POINTS
            assert gap[chosen].min() <= gap.min() + 1e-8
            low = gap + raised <= max(gap.min() + raised, 0.0) + FLAT
            assert outside(place, place[chosen]) <= (ALL_TOUCH if low.all() else SOME_TOUCH)
            if low[chosen].sum() >= 3:
                assert outside(place[low], place[chosen[low[chosen]]]) <= ALL_TOUCH
    regular = disc(453).vertices
    regular = regular[regular[:, 2] < 0.0, :2]
    assert outside(regular, regular[chosen_of(regular, np.zeros(len(regular)))]) <= 0.1
    assert outside(place[:9], place[chosen_of(place[:9], np.zeros(9))]) >= 0.0 and ALL_TOUCH > NINTH


@given(seed=seeds, count=st.integers(9, 100))
def test_the_choice_is_fixed_on_the_face_while_it_rests_slides_and_turns(seed, count):
    rng = np.random.default_rng(seed)
    floor = above_floor(disc(count))
    q = touching(floor, 0.0, 0.0, 0.0)
    owner = floor.contacts(0.0, q, 1e-3).point
    for angle in (0.0, 1e-9, 0.3, 2.0):
        shift = [*rng.normal(size=2), rng.uniform(-1e-13, 1e-13)]
        moved = np.array([*(q[:3] + shift), 0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)])
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        # a query elsewhere in between leaves no trace
        floor.contacts(0.0, touching(floor, 0.3, rng.uniform(0, 7), 0.1), rng.uniform(0.0, 0.3))
        found = floor.contacts(0.0, moved, float(rng.choice([1e-9, 1e-3, 0.1]))).point
        np.testing.assert_allclose((found - moved[:3]) @ turn, owner - q[:3], atol=1e-12)


@pytest.mark.parametrize("count", [20, 33, 190, 453, 500])
@pytest.mark.parametrize("tilt", [0.0, 1e-6, 1e-3, 1e-2, 0.05, np.pi / 2 - 0.01, np.pi / 2])
def test_a_disc_has_few_rows_for_each_of_its_faces(count, tilt):
    floor, rng = above_floor(disc(count)), np.random.default_rng(count)
    faces, _ = flat_faces(disc(count))
    assert len(faces) == 2
    for sunk in (0.0, 1e-3, 0.02):
        q = touching(floor, tilt, rng.uniform(0.0, 7.0), sunk)
        every = floor.measure(q, np.array([0]), 0.0)
        for tolerance in (1e-9, 1e-3, 0.05):
            rows = floor.contacts(0.0, q, tolerance)
            assert rows.gap.min() <= every.gap.min() + 1e-8
            within = np.flatnonzero(every.gap <= tolerance)
            kept = {tuple(p) for p in rows.point}
            for face in faces:
                members = np.intersect1d(face, within)
                number = sum(tuple(p) in kept for p in every.point[members])
                assert number == len(members) if len(within) <= FEW_POINTS else number <= FEW_POINTS


@pytest.mark.parametrize("count", [20, 90, 190, 453])
@pytest.mark.parametrize("tilt", [0.0, 1e-3, 0.02])
def test_a_disc_on_another_body_has_few_rows_that_hold_its_whole_face(count, tilt):
    for lower in (Box((6.0, 6.0, 2.0)), Hull(Box((6.0, 6.0, 2.0)).vertices), disc(count, 2.0)):
        system = FreeBodies(np.ones(2), np.tile(np.eye(3), (2, 1, 1)), np.zeros(3), ("a", "b"))
        shapes = [PlacedShape(n, s, k, np.eye(3), np.zeros(3)) for n, s, k in (("a", lower, 1), ("b", disc(count), 2))]
        contacts = SignedDistances(system, *indexed(shapes[:1], shapes[1:]), np.zeros(1))
        q = np.concatenate([pose(0.0, 0.0, 0.0), pose(tilt, 0.4, 1.15 + np.sin(tilt) + 1e-12)])
        rows = contacts.contacts(0.0, q, 3.0 * np.sin(tilt) + 1e-9)
        assert len(rows.gap) == FEW_POINTS
        rim = disc(count).vertices
        rim = rim[rim[:, 2] < 0.0, :2]
        assert outside(rim, rows.point[:, :2]) <= (0.12 if tilt == 0.0 else SOME_TOUCH)


@given(seed=seeds)
@settings(max_examples=30)
def test_a_vertex_that_is_left_out_is_no_lower_than_those_that_are_kept(seed):
    """However the body moves, if no vertex moves farther than the tolerance."""
    rng = np.random.default_rng(seed)
    shape = rounded_box(rng)
    floor, size = above_floor(shape), shape.bound
    q = touching(floor, 0.0, 0.0, 0.0)
    turn = rng.normal(size=4)
    q[3:] = turn / np.linalg.norm(turn)
    q[2] -= floor.measure(q, np.array([0]), 0.0).gap.min()
    tolerance = 0.1 * size * rng.uniform()
    rows, every = floor.contacts(0.0, q, tolerance), floor.measure(q, np.array([0]), 0.0)
    near = every.gap <= tolerance
    if near.sum() <= FEW_POINTS:
        assert len(rows.gap) == near.sum()
        return
    kept = np.flatnonzero([tuple(p) in {tuple(p) for p in rows.point} for p in every.point])
    local = every.point - q[:3]
    for _ in range(50):
        spin = rng.normal(size=3)
        shift, spin = rng.normal(size=3), spin / np.linalg.norm(spin) * rng.uniform(0.0, tolerance / size)
        moved = local @ pin.exp3(spin).T - local
        shift *= max(tolerance - np.linalg.norm(moved, axis=1).max(), 0.0) / np.linalg.norm(shift)
        after = every.gap + (moved + shift)[:, 2]
        # vertices that touch together may lie beside the hull of those that are kept
        assert after.min() >= after[kept].min() - FLAT * size - 0.02 * size * np.linalg.norm(spin)


def counted(monkeypatch):
    """The most rows of one constraint, and of all, that any projection has."""
    most = {"pair": 0, "all": 0}
    law, solve = Projector.law, Projector.project

    def note(number):
        if len(number):
            most["pair"] = max(most["pair"], int(np.bincount(number).max()))
            most["all"] = max(most["all"], len(number))

    def counted_law(self, v, motion, J, e, number=None, *rest):
        note(np.zeros(len(e), np.int64) if number is None else number)
        return law(self, v, motion, J, e, number, *rest)

    def counted_project(self, x, metric, J, lower, contacts=None, *rest):
        note(np.zeros(len(lower), np.int64) if contacts is None else contacts)
        return solve(self, x, metric, J, lower, contacts, *rest)

    monkeypatch.setattr(Projector, "law", counted_law)
    monkeypatch.setattr(Projector, "project", counted_project)
    return most


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.MoreauJean(), None], ids=str)
def test_a_hull_of_many_vertices_that_tumbles_over_a_floor_has_few_rows(scheme, monkeypatch):
    most = counted(monkeypatch)
    rng = np.random.default_rng(0)
    scene = mbvi.Scene()
    scene.add_halfspace((0.0, 0.0, 1.0))
    shape = rounded_box(rng)
    assert len(shape.vertices) > 1000
    scene.add_convex(shape.vertices, [(0, 0, 0.15)], 1.0, velocities=[(1, 0, -1)], angular_velocities=[(9, 7, 3)])
    problem = scene.build()
    # two flat faces and the edge between them
    for step in mbvi.steps(problem, scheme, step=1e-3):
        if step.t > 0.3:
            break
    assert 4 <= most["pair"] <= 3 * FEW_POINTS


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), None], ids=str)
def test_a_disc_of_many_corners_rocks_and_comes_to_rest(scheme, monkeypatch):
    most = counted(monkeypatch)
    scene = mbvi.Scene()
    scene.add_halfspace((0.0, 0.0, 1.0))
    tilt = 0.05
    scene.add_convex(
        disc(453, 0.04, 0.1).vertices,
        mass=1.0,
        positions=[(0, 0, 0.02 + 0.1 * np.sin(tilt) + 1e-3)],
        rotations=[pin.exp3(np.array([tilt, 0.0, 0.0]))],
    )
    problem = scene.build()
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.6)
    # the end of the last fall, at rest on its face
    np.testing.assert_allclose(run.v[-1], 0.0, atol=1e-2)
    assert np.diff(run.energy()).max() <= 1e-3 * abs(run.energy()[0])
    assert most["pair"] <= FEW_POINTS
    assert len(run.impacts) > 2


def test_a_disc_of_many_corners_stands_and_does_not_creep():
    scene = mbvi.Scene()
    scene.add_halfspace((0.0, 0.0, 1.0))
    scene.add_convex(disc(128, 0.1, 0.1).vertices, positions=[(0, 0, 0.05)], mass=1.0)
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.5, record="contacts")
    np.testing.assert_allclose(run.q, np.tile(run.q[0], (len(run.q), 1)), atol=1e-12)
    assert len(run.contacts(0.4)) == FEW_POINTS


@given(seed=seeds, count=st.integers(9, 60))
def test_gaps_that_are_linear_in_the_place_are_one_face(seed, count):
    rng = np.random.default_rng(seed)
    place, size = circle(rng, count), 1.0
    gap = place @ rng.normal(size=2) + rng.normal()
    assert one_face(place, gap, size)
    assert one_face(place, gap + 1e-7 * rng.uniform(-1, 1, count), size)
    gap[rng.integers(count)] += rng.choice([-1.0, 1.0]) * 1e-2
    assert not one_face(place, gap, size)
    line = np.column_stack([np.arange(9.0), 2.0 * np.arange(9.0)])
    assert one_face(line, 3.0 * line[:, 0], size) and not one_face(line, line[:, 0] ** 2, size)


def test_a_disc_on_a_tilted_floor_that_moves_has_few_rows():
    scene, n = mbvi.Scene(), np.array([0.6, 0.0, 0.8])
    scene.add_halfspace(n, motion=mbvi.motion.Oscillation((0.0, 0.0, 0.01), 1.0))
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), n).toRotationMatrix()
    scene.add_convex(disc(150, 0.04, 0.1).vertices, [0.0200001 * n], 1.0, rotations=[turn])
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.1, record="contacts")
    counts = [len(run.contacts(t)) for t in run.t[1:]]
    assert max(counts) == FEW_POINTS
