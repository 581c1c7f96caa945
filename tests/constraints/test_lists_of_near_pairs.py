"""Lists of near pairs: the rows of all pairs, whatever moves, in any order, of any sizes; names, e, sleep, copies."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints import BroadPhasePairs, SignedDistances, SphereCentres, SphereWalls
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere
from mbvi.system import FreeBodies

SEEDS = st.integers(0, 10_000)


def no_pair(i, j):
    return np.zeros(len(i), bool)


def no_bounce(i, j):
    return np.zeros(len(i))


def one_of_each(rng, size):
    """A shape of a kind by chance."""
    edges = size * rng.uniform(0.3, 1.0, 3)
    kinds = (
        Box(tuple(edges)), Box(tuple(edges * [0.1, 1.0, 2.0])), Capsule(0.3 * size, size), Sphere(0.5 * size),
        Cylinder(0.4 * size, size), Ellipsoid(tuple(0.5 * edges)), Hull(0.6 * size * rng.normal(size=(9, 3))),
    )  # fmt: skip
    return kinds[rng.integers(len(kinds))]


def heap(rng, shapes):
    """Shapes on free bodies and one on the world, the system, and a configuration in which many of them are near."""
    n = len(shapes)
    placed = [PlacedShape("fixed", Box((1.0, 1.0, 0.1)), 0, np.eye(3), np.array([0.0, 0.0, -0.5]))]
    for k, shape in enumerate(shapes):
        turn = Rotation.random(random_state=int(rng.integers(1000))).as_matrix()
        placed.append(PlacedShape(f"s{k}", shape, k + 1, turn, 0.1 * shape.bound * rng.normal(size=3)))
    system = FreeBodies(np.ones(n), np.tile(np.eye(3), (n, 1, 1)), np.zeros(3), tuple(s.name for s in placed[1:]))
    spread = 0.6 * np.median([s.bound for s in shapes]) * n ** (1 / 3)
    turns = Rotation.random(n, random_state=int(rng.integers(1000))).as_quat()
    return placed, system, np.hstack([rng.normal(size=(n, 3)) * spread, turns]).ravel()


def crowd_of(system, placed):
    return BroadPhasePairs(system, ShapeTable(placed), no_pair, no_bounce)


def every_pair(system, placed):
    """The same pairs, all of them listed."""
    i, j = np.triu_indices(len(placed), 1)
    sides = np.stack([i, j], axis=1)
    return SignedDistances(system, ShapeTable(placed), sides, np.zeros(len(i)), numbers=i * len(placed) + j)


def same_rows(found, expected, atol=1e-12):
    if expected is None:
        assert found is None
        return
    np.testing.assert_array_equal(found.constraint, expected.constraint)
    for part in ("gap", "point", "normal"):
        np.testing.assert_allclose(getattr(found, part), getattr(expected, part), rtol=0, atol=atol)
    full = [rows if isinstance(rows, np.ndarray) else rows.toarray() for rows in (found.jacobian, expected.jacobian)]
    np.testing.assert_allclose(*full, rtol=0, atol=atol)


@settings(deadline=None, max_examples=15)
@given(SEEDS, st.sampled_from([1.0, 100.0]), st.sampled_from([0.0, 0.1, np.inf]))
def test_a_list_has_the_rows_of_every_pair(seed, ratio, tolerance):
    """Of all kinds of shapes, of one size or of sizes up to 1 to 100."""
    rng = np.random.default_rng(seed)
    placed, system, q = heap(rng, [one_of_each(rng, ratio ** -rng.random()) for _ in range(12)])
    same_rows(
        crowd_of(system, placed).contacts(0.0, q, tolerance), every_pair(system, placed).contacts(0.0, q, tolerance)
    )


@settings(deadline=None, max_examples=6)
@given(SEEDS, st.sampled_from([1.0, 0.1]))
def test_a_list_misses_no_pair_while_bodies_move_and_turn(seed, ratio):
    """Thin plates that spin: their corners travel much farther than their centres. Also one large among small ones."""
    rng = np.random.default_rng(seed)
    shapes = [Box(tuple((1.0 if k == 0 else ratio) * rng.permutation([0.05, 0.4, 1.0]))) for k in range(15)]
    placed, system, q = heap(rng, shapes)
    crowd, velocity = crowd_of(system, placed), 0.05 * ratio * rng.normal(size=system.nv)
    velocity.reshape(-1, 6)[:, 3:] *= 4.0 / ratio
    for _ in range(25):
        q = system.integrate(q, 0.05 * velocity)
        wanted = every_pair(system, placed).contacts(0.0, q, 0.02 * ratio)
        same_rows(crowd.contacts(0.0, q, 0.02 * ratio), wanted)
    assert 1 < crowd._neighbours.lists < 25


def test_only_pairs_whose_boxes_are_near_are_listed():
    """Plates one above the other: their bounding spheres meet, their boxes do not."""
    placed = [PlacedShape(f"p{k}", Box((1.0, 1.0, 0.02)), k + 1, np.eye(3), np.zeros(3)) for k in range(3)]
    system = FreeBodies(np.ones(3), np.tile(np.eye(3), (3, 1, 1)), np.zeros(3), ("a", "b", "c"))
    crowd, q = crowd_of(system, placed), np.zeros((3, 7))
    q[:, 2], q[:, 6] = [0.0, 0.03, 1.0], 1.0
    assert crowd.contacts(0.0, q.ravel(), 0.0) is None
    assert len(crowd._neighbours.within(q[:, :3].copy(), 0.0)) == 3
    assert crowd._listed.numbers.tolist() == [1]


@settings(deadline=None, max_examples=6)
@given(SEEDS)
def test_the_order_of_bodies_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    placed, system, q = heap(rng, [Box(tuple(rng.uniform(0.3, 1.0, 3))) for _ in range(20)])
    order, tables = rng.permutation(len(placed)), []
    for shapes in (placed, [placed[k] for k in order]):
        crowd = crowd_of(system, shapes)
        rows = crowd.contacts(0.0, q, 0.05)
        table = []
        for number, gap, point, normal in zip(rows.constraint, rows.gap, rows.point, rows.normal, strict=True):
            first, second = crowd.name(int(number)).split(" | ")
            sign = 1.0 if first < second else -1.0
            table.append((min(first, second), max(first, second), *np.round([gap, *point, *(sign * normal)], 9) + 0.0))
        tables.append(sorted(table))
    assert len(tables[0]) == len(tables[1]) > 5
    assert [row[:2] for row in tables[0]] == [row[:2] for row in tables[1]]
    np.testing.assert_allclose(*([row[2:] for row in table] for table in tables), rtol=0, atol=3e-9)


def crowded_scene():
    """A floor and 80 boxes in two groups and three of their own, two by two one above the other."""
    scene = mbvi.Scene(restitution=0.1)
    scene.add_halfspace((0, 0, 1), name="floor")
    grid = 0.3 * np.stack(np.unravel_index(np.arange(80), (8, 5, 2)), axis=1) + [0.0, 0.0, 0.1]
    grid[:, 2] = 0.1 + 0.2 * (grid[:, 2] > 0.2)
    scene.add_boxes(grid[:40], (0.2,) * 3, 1.0, name="a")
    scene.add_boxes(grid[40:77], (0.2,) * 3, 1.0, name="b")
    for k in range(77, 80):
        scene.add_box((0.2,) * 3, position=grid[k], name=f"own{k}")
    scene.set_restitution("a", "b", 0.2)
    scene.set_restitution("a[1]", "a", 0.3)
    scene.set_restitution("a[2]", "a[3]", 0.4)
    scene.set_restitution("own78", "own79", 0.5)
    return scene


def family(problem, kind):
    return next(c for c in problem.constraints.families if isinstance(c, kind))


def test_every_row_has_its_name_and_its_restitution():
    problem = crowded_scene().build()
    crowd, shapes = family(problem, BroadPhasePairs), problem.scene.shapes
    rows = crowd.contacts(0.0, problem.q0, 0.15)
    for number, e in zip(rows.constraint.tolist(), rows.restitution, strict=True):
        names = [shapes[k].name for k in divmod(number, len(shapes))]
        assert crowd.name(number) == " | ".join(names)
        assert e == problem.scene.items.restitution_of(*names)
    assert set(rows.restitution) == {0.1, 0.2, 0.3, 0.4, 0.5}


def test_pairs_of_bodies_at_rest_are_left_out_also_of_a_new_list(rng):
    problem = crowded_scene().build()
    crowd = family(problem, BroadPhasePairs)
    full = crowd.contacts(0.0, problem.q0, 0.15)
    resting = rng.random(81) < 0.7
    resting[0] = True
    bodies = 1 + np.stack(np.divmod(full.constraint, 80))
    kept = ~resting[bodies].all(axis=0)
    assert 0 < kept.sum() < len(kept)
    crowd.skip_resting(resting)
    for tolerance in (0.15, 0.15, 0.149999):
        rows = crowd.contacts(0.0, problem.q0, tolerance)
        np.testing.assert_array_equal(rows.constraint, full.constraint[kept])
        np.testing.assert_array_equal(rows.gap, full.gap[kept])
        crowd._neighbours.reach = -np.inf
    crowd.skip_resting(None)
    assert len(crowd.contacts(0.0, problem.q0, 0.15).gap) == len(full.gap)


def test_a_copy_has_the_same_rows(rng):
    problem = crowded_scene().build()
    other = pickle.loads(pickle.dumps(problem))
    q = problem.system.integrate(problem.q0, 0.02 * rng.normal(size=problem.system.nv))
    ours, theirs = (family(p, BroadPhasePairs).contacts(0.0, q, 0.1) for p in (problem, other))
    assert len(ours.gap) > 50
    same_rows(theirs, ours, atol=0.0)
    np.testing.assert_array_equal(theirs.restitution, ours.restitution)


def test_the_report_counts_the_pairs_of_each_path():
    scene = crowded_scene()
    scene.add_cylinder(0.1, 0.2, position=(0.0, 0.0, 0.51), name="can")
    problem = scene.build()
    near = family(problem, BroadPhasePairs)._listed
    searched = sum("can" in name for name in near.names)
    assert 0 < searched < near.size
    assert (
        f"pairs of 81 shapes, found when near; {near.size} are near now: {near.size - searched} in closed form, "
        f"{searched} by search from the last axis"
    ) in problem.report()
    few = mbvi.Scene()
    few.add_box((0.2,) * 3, position=(0, 0, 0.1))
    few.add_sphere(0.1, position=(0, 0, 0.4))
    few.add_cylinder(0.1, 0.2, position=(0, 0, 1.0))
    assert "3 pairs of shapes: 2 in closed form, 1 by search" in few.build().report()


@pytest.mark.parametrize("many", [False, True])
def test_spheres_meet_boxes_and_capsules_in_bulk_or_when_near(rng, many):
    """Few boxes meet all spheres; of many only the near ones are listed, with the same rows."""
    scene = mbvi.Scene()
    count = 24 if many else 6
    for k in range(count):
        add = scene.add_box if k % 2 else scene.add_capsule
        size = ((0.2, 0.2, 0.2),) if k % 2 else (0.08, 0.15)
        turn = Rotation.random(random_state=k).as_matrix()
        add(*size, position=(0.6 * (k % 6), 0.6 * (k // 6), 0.3), rotation=turn, name=f"w{k}")
    at = np.stack(np.unravel_index(np.arange(48), (6, 8)), axis=1) * [0.6, 0.3]
    scene.add_spheres(np.hstack([at, np.full((48, 1), 0.53)]), 0.05, 1.0, name="ball")
    problem, q = scene.build(), None
    q = problem.q0
    rows = problem.constraints.active(0.0, q, 0.1)
    names = [problem.constraints.name(int(k)) for k in rows.constraint]
    system, shapes = problem.system, problem.scene.shapes
    where = SphereCentres(system.nq - 144, 48, 3)
    walls, balls = SphereWalls(
        system, where, count + 1, np.full(48, 0.05), shapes[:count], [s.name for s in shapes[count:]],
        [s.name for s in shapes[:count]], np.zeros(48, int), np.zeros((1, count)),
    ), [k for k, name in enumerate(names) if "ball" in name and "w" in name]  # fmt: skip
    expected = walls.contacts(0.0, q, 0.1)
    found = {names[k]: (rows.gap[k], *rows.point[k], *rows.normal[k]) for k in balls}
    wanted = {
        walls.name(int(k)): (gap, *point, *normal)
        for k, gap, point, normal in zip(
            expected.constraint, expected.gap, expected.point, expected.normal, strict=True
        )
    }
    assert found.keys() == wanted.keys() and len(wanted) > 3
    for name, row in wanted.items():
        np.testing.assert_allclose(found[name], row, rtol=0, atol=1e-12)
    bulk = [c for c in problem.constraints.families if isinstance(c, SphereWalls)]
    assert bool(bulk) != many
