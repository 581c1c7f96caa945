"""Many bodies: contacts found in bulk are Coal's, neighbours are all that are near, sparse rows are the full ones."""

import coal
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints import BroadPhasePairs, SignedDistances, SphereCentres, SphereContacts, SphereWalls
from mbvi.geometry.broad.verlet_list import VerletList, near_balls
from mbvi.geometry.shapes.shape_table import indexed
from mbvi.geometry.shapes.shapes import Box, Capsule, HalfSpace, PlacedShape
from mbvi.system import BlockSystem, FreeBodies, Spheres

SEEDS = st.integers(0, 10_000)
GRAVITY = np.array([0.0, 0.0, -9.81])


def spheres(count):
    return Spheres(np.ones(count), GRAVITY, tuple(f"s{k}" for k in range(count)))


def of_coal(a, pose_a, b, pose_b):
    """Signed distance, normal and the point midway, one pair at a time."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = 1e-12
    distance = coal.distance(a, coal.Transform3s(*pose_a), b, coal.Transform3s(*pose_b), request, result)
    return distance, np.array(result.normal), 0.5 * (result.getNearestPoint1() + result.getNearestPoint2())


def contacts(constraint, q):
    """Gap, normal and point of every pair, by its number."""
    rows = constraint.contacts(0.0, q, np.inf)
    return {int(n): row for n, *row in zip(rows.constraint, rows.gap, rows.normal, rows.point, strict=True)}


def check(found, expected):
    for got, want in zip(found, expected, strict=True):
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)


def test_spheres_against_spheres_are_coals(rng):
    n, radii = 40, 0.05 * 20.0 ** rng.random(40)
    constraint = SphereContacts(
        spheres(n), SphereCentres(0, n, 3), 1, radii, ("",) * n, np.zeros(n, int), np.zeros((1, 1))
    )
    centres = rng.random((n, 3))
    found = contacts(constraint, centres.ravel())
    assert len(found) == n * (n - 1) // 2
    for number, row in found.items():
        i, j = divmod(number, n)
        pair = (coal.Sphere(radii[k]) for k in (i, j))
        a, b = pair
        check(row, of_coal(a, (np.eye(3), centres[i]), b, (np.eye(3), centres[j])))


@pytest.mark.parametrize("moving", [False, True])
def test_spheres_against_half_spaces_boxes_and_capsules_are_coals(rng, moving):
    n, radii = 60, 0.02 + 0.3 * rng.random(60)
    turn, place = Rotation.random(2, random_state=3).as_matrix(), rng.random((2, 3)) - 0.5
    shapes = [PlacedShape("box", Box((0.6, 1.0, 0.3)), moving, turn[0], place[0])]
    shapes.append(PlacedShape("rod", Capsule(0.1, 0.7), 2 * moving, turn[1], place[1]))
    normal = np.array([0.6, 0.0, 0.8])
    walls = [HalfSpace(tuple(normal), -0.2), *shapes]
    two = FreeBodies(np.ones(2), np.tile(np.eye(3), (2, 1, 1)), GRAVITY, ("a", "b"))
    system = BlockSystem([two, spheres(n)]) if moving else spheres(n)
    names = ("floor", "box", "rod")
    constraint = SphereWalls(
        system, SphereCentres(system.nq - 3 * n, n, 3), 1 + 2 * moving, radii, walls,
        [f"s{k}" for k in range(n)], names,
        np.zeros(n, int), np.zeros((1, 3)),
    )  # fmt: skip
    # some centres are inside
    centres = 1.5 * rng.random((n, 3)) - 0.75
    poses, q = [(np.eye(3), np.zeros(3))] * 2, centres.ravel()
    if moving:
        at, how = rng.normal(size=(2, 3)), Rotation.random(2, random_state=5)
        poses = list(zip(how.as_matrix(), at, strict=True))
        centres += at[0]
        q = np.concatenate([np.hstack([at, how.as_quat()]).ravel(), centres.ravel()])
    found = contacts(constraint, q)
    assert len(found) == 3 * n
    assert min(row[0] for row in found.values()) < -0.2
    for number, row in found.items():
        i, a = divmod(number, 3)
        ball = coal.Sphere(radii[i]), (np.eye(3), centres[i])
        if a == 0:
            gap = normal @ centres[i] + 0.2 - radii[i]
            check(row, (gap, normal, centres[i] - (radii[i] + 0.5 * gap) * normal))
            continue
        placed, (R, p) = walls[a], poses[a - 1]
        check(row, of_coal(placed.shape.coal(), (R @ placed.rotation, R @ placed.position + p), *ball))
    assert constraint.name(3 * 4 + 1) == "box | s4"
    assert constraint.name(3 * 4) == "s4 | floor"


@settings(deadline=None, max_examples=25)
@given(SEEDS, st.sampled_from([1.0, 20.0, 1000.0]))
def test_neighbours_are_all_pairs_within_reach(seed, ratio):
    """Of one size or many, spread out or not, and where one has flown far away."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 120))
    radii = 0.5 * ratio ** -rng.random(n)
    centres = rng.normal(size=(n, 3)) * n ** (1 / 3)
    centres[0] *= 1e6 if rng.random() < 0.3 else 1.0
    reach = 0.4 * rng.random()
    i, j = np.triu_indices(n, 1)
    apart = np.linalg.norm(centres[i] - centres[j], axis=1) - radii[i] - radii[j]
    expected = (i * n + j)[apart <= reach]
    np.testing.assert_array_equal(near_balls(centres, radii, reach), expected)


@settings(deadline=None, max_examples=20)
@given(SEEDS)
def test_a_list_of_neighbours_misses_none_while_it_lasts(seed):
    rng = np.random.default_rng(seed)
    n, neighbours = 60, VerletList(np.full(60, 0.1))
    centres, velocity = rng.random((n, 3)), 0.05 * rng.normal(size=(n, 3)) + rng.normal(size=3)
    i, j = np.triu_indices(n, 1)
    for _ in range(40):
        centres = centres + 0.1 * velocity
        reach = 0.05 * rng.random()
        near = np.linalg.norm(centres[i] - centres[j], axis=1) - 0.2 <= reach
        assert np.isin((i * n + j)[near], neighbours.within(centres, reach)).all()
    assert 1 < neighbours.lists < 40


def scene_of_many(rng, boxes, balls):
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(boxes):
        where = np.array([0.35 * (k % 8), 0.35 * (k // 8), 0.2])
        scene.add_box((0.2, 0.2, 0.2), position=where, rotation=Rotation.random(random_state=k).as_matrix())
    if balls:
        grid = np.stack(np.meshgrid(*[np.arange(5)] * 2), -1).reshape(-1, 2)[:balls]
        scene.add_spheres(np.hstack([0.35 * grid, np.full((len(grid), 1), 0.43)]), 0.05, 1.0, name="balls")
    return scene.build()


def test_a_crowd_gives_the_rows_of_listed_pairs(rng):
    """Boxes near each other: as many rows, of the same names, gaps and gradients as where every pair is listed."""
    problem = scene_of_many(rng, 70, 0)
    crowd = next(c for c in problem.constraints.constraints if isinstance(c, BroadPhasePairs))
    shapes = problem.scene.shapes
    i, j = np.triu_indices(len(shapes), 1)
    near = np.linalg.norm(problem.q0.reshape(-1, 7)[i, :3] - problem.q0.reshape(-1, 7)[j, :3], axis=1) < 0.5
    i, j = i[near], j[near]
    names = [f"{shapes[a].name} | {shapes[b].name}" for a, b in zip(i, j, strict=True)]
    listed = SignedDistances(problem.system, *indexed([shapes[a] for a in i], [shapes[b] for b in j]), np.zeros(len(i)))
    found = crowd.contacts(0.0, problem.q0, 0.1)
    expected = listed.contacts(0.0, problem.q0, 0.1)
    assert len(found.gap) > 30
    assert [crowd.name(int(n)) for n in found.constraint] == [names[k] for k in expected.constraint]
    np.testing.assert_allclose(found.gap, expected.gap, atol=1e-12)
    np.testing.assert_allclose(found.jacobian.toarray(), expected.jacobian.toarray(), atol=1e-12)


def test_sparse_rows_are_the_full_ones(rng):
    """Rows of boxes and spheres together, by finite differences of the gaps along the retraction."""
    problem = scene_of_many(rng, 10, 25)
    system, q = problem.system, problem.q0
    rows = problem.constraints.active(0.0, q, 0.15)
    assert system.sparse
    assert len(rows.gap) > 40
    assert rows.jacobian.nnz <= 12 * len(rows.gap)
    full, small = rows.jacobian.toarray(), 1e-6
    # corners of boxes against boxes change along the way: balls and corners on the floor do not
    smooth = [
        k for k, n in enumerate(rows.constraint) if "balls" in (name := problem.constraints.name(n)) or "floor" in name
    ]
    assert len(smooth) > 30
    for direction in rng.normal(size=(5, system.nv)):
        ends = [problem.constraints.active(0.0, system.integrate(q, s * small * direction), 0.16) for s in (-1.0, 1.0)]
        keys = [[(int(n), *np.round(p, 4)) for n, p in zip(r.constraint, r.point, strict=True)] for r in (rows, *ends)]
        compared = 0
        for k in smooth:
            if all(key.count(keys[0][k]) == 1 for key in keys):
                low, high = (ends[s].gap[keys[1 + s].index(keys[0][k])] for s in (0, 1))
                assert (high - low) / (2 * small) == pytest.approx(full[k] @ direction, abs=1e-6)
                compared += 1
        assert compared > 20
