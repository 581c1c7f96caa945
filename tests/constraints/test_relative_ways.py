"""How far the bodies of a pair move relative to each other: never less than gaps change, whatever moves all bodies."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints.families.signed_distance import SignedDistances
from mbvi.constraints.families.spheres import SphereContacts
from mbvi.constraints.mechanism.state import MechanismState
from mbvi.constraints.mechanism.ways import pair_ways, relative_way
from mbvi.constraints.relative_ways import PairBalls, pair_approach, relative_ways, ways_of
from mbvi.system.mechanisms.joined import joined
from mbvi.system.mechanisms.mechanism import place
from support.paths import DATA, ROBOTS

# parts of a displacement at which gaps are measured
SAMPLES = np.linspace(0.0, 1.0, 41)


def bodies(rng, scene=None, height=0.0):
    """Boxes, cylinders and capsules close to each other, turned at random."""
    scene = mbvi.Scene(gravity=(0, 0, 0)) if scene is None else scene
    for k in range(4):
        place = 0.34 * np.array([k % 2, k // 2, 0.0]) + (0.0, 0.0, height)
        start = {"position": place, "rotation": Rotation.random(random_state=rng.integers(1000)).as_matrix()}
        if k % 3 == 0:
            scene.add_box((0.3, 0.1, 0.05), 1.0, **start)
        elif k % 3 == 1:
            scene.add_capsule(0.05, 0.2, 1.0, **start)
        else:
            scene.add_cylinder(0.1, 0.2, 1.0, **start)
    return scene


def free_bodies(rng):
    return bodies(rng).build()


def beside_a_plate(rng):
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((3.0, 3.0, 0.1), position=(0.2, 0.1, -0.4), fixed=True)
    scene.add_box((3.0, 3.0, 0.1), 100.0, position=(0.2, 0.1, 0.4))
    return bodies(rng, scene).build()


def robot_and_bodies(rng):
    """A quadruped with a free base; its links move along the axes of the base."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.2))
    return bodies(rng, scene, 0.6).build()


def on_a_cart(rng):
    """A box on a cart that slides along an axis of the world, then along another, and turns."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(DATA / "turntable_on_slides.urdf", base="fixed", name="cart")
    return bodies(rng, scene, 0.6).build()


def frictional_balls(rng):
    scene = mbvi.Scene(gravity=(0, 0, 0), friction=0.5)
    scene.add_spheres(0.21 * np.indices((2, 2, 2)).reshape(3, -1).T + 0.005 * rng.random((8, 3)), 0.1, 1.0)
    return scene.build()


def in_a_plane(rng):
    scene = mbvi.Scene(gravity=(0, 0, -9.81))
    scene.add_halfspace((0, 0, 1), offset=-50.0)
    for k in range(4):
        turn = Rotation.from_rotvec((0, rng.normal(), 0)).as_matrix()
        scene.add_box((0.3, 0.1, 0.1), 1.0, position=(0.33 * (k % 2), 0, 0.33 * (k // 2)), rotation=turn)
    return scene.build()


SCENES = [free_bodies, beside_a_plate, robot_and_bodies, on_a_cart, frictional_balls, in_a_plane]
each = pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)


def pairs_of(problem):
    (family,) = (f for f in problem.constraints.families if isinstance(f, SignedDistances | SphereContacts))
    return family, family.all_pairs() if isinstance(family, SphereContacts) else np.arange(family.size)


def by_python(problem, family, pairs, displacement):
    if isinstance(family, SphereContacts):
        # no turn of a sphere matters
        displacement = np.where(problem.system.are_lengths(), displacement, 0.0)
    ways = ways_of(problem.system, displacement, family.reach_of(pairs).T)
    return relative_ways(problem.system, problem.q0, displacement, ways, family.balls_of(pairs))


def by_kernel(problem, family, pairs, displacement):
    mechanism, arrays = joined(problem.system).mechanism(), MechanismState(problem.constraints).arrays
    table = arrays.touching if isinstance(family, SphereContacts) else arrays.pairs
    ways = pair_ways(problem.system, [family], [pairs])
    place(mechanism, problem.q0.copy())
    columns = enumerate(pairs.tolist())
    return np.array([relative_way(mechanism, table, pair, ways, i, displacement, 1.0) for i, pair in columns])


def absolute(family, pairs, displacement):
    return np.abs(displacement) @ family.reach_of(pairs).T


def common_motion(problem, velocity):
    """All bodies, or the bases of mechanisms, moved by the same vector in the world."""
    system, found = problem.system, np.zeros(problem.system.nv)
    for part in system.located_parts():
        inner, end = part.system, part.v + part.system.nv
        straight = inner.go_straight()
        if inner.model is not None and not straight.any():
            # a free base moves along its own axes
            turn = system.placements(problem.q0, np.array([part.body + 1]))[0, :3]
            found[part.v : part.v + 3] = turn @ velocity
        elif inner.model is None:
            wide = straight.sum() // inner.independent_bodies
            found[part.v : end][straight] = np.resize(velocity[[0, 2] if wide == 2 else [0, 1, 2]], straight.sum())
    return found


@each
@pytest.mark.parametrize("coasting", [False, True])
@pytest.mark.parametrize("turn", [0.003, 0.1, 0.4])
@pytest.mark.parametrize("fast", [0.0, 3.0])
def test_no_gap_changes_faster(scene, coasting, turn, fast):
    rng, tight, found = np.random.default_rng(0), 0, 0
    for _ in range(3):
        problem = scene(rng)
        system, (family, pairs) = problem.system, pairs_of(problem)
        way = np.where(system.are_lengths(), 0.05, turn) * rng.uniform(-1.0, 1.0, system.nv)
        way += common_motion(problem, fast * rng.normal(size=3))
        bound, most = by_python(problem, family, pairs, way), absolute(family, pairs, way)
        assert (bound <= most * (1.0 + 1e-12)).all()
        tight, found = tight + np.count_nonzero(bound < 0.5 * most), found + len(pairs)
        steps = (system.coast(way, x)[0] if coasting else x * way for x in SAMPLES)
        gaps = np.array([family.nearest_of(0.0, system.integrate(problem.q0, step), pairs)[0] for step in steps])
        change = np.abs(np.diff(gaps, axis=0)).max(axis=0) / SAMPLES[1]
        assert (change <= bound + 1e-9).all(), (change / bound).max()
        # what moves all shows in the bounds of those alone that it does not move
        if scene is not in_a_plane:
            np.testing.assert_allclose(by_kernel(problem, family, pairs, way), bound, rtol=1e-9, atol=1e-12)
    if fast == 3.0 and turn == 0.003:
        assert tight > (0.3 if scene in (beside_a_plate, on_a_cart, robot_and_bodies) else 0.9) * found


@each
@pytest.mark.parametrize("coasting", [False, True])
@pytest.mark.parametrize("turn", [0.01, 0.4, 1.0])
@pytest.mark.parametrize("fast", [0.0, 3.0])
def test_no_gap_falls_below_its_approach(scene, coasting, turn, fast):
    """Up to the end of the part for which it holds; it says more than the ways where bodies slide past each other."""
    rng, problem = np.random.default_rng(1), scene(np.random.default_rng(0))
    system, (family, pairs) = problem.system, pairs_of(problem)
    way = np.where(system.are_lengths(), 0.05, turn) * rng.uniform(-1.0, 1.0, system.nv)
    way += common_motion(problem, fast * rng.normal(size=3))
    gaps, normals = family.nearest_of(0.0, problem.q0, pairs)
    balls, reach, first, held = family.balls_of(pairs), family.reach_of(pairs), family.bodies_of(pairs)[0], 0
    for k in np.flatnonzero((gaps > 0.0) & (reach @ np.abs(way) > 0.0)).tolist():
        one = PairBalls(balls.bodies[:, [k]], balls.centres[:, [k]], balls.radius[[k]])
        sign = 1.0 if first[k] == balls.bodies[0, k] else -1.0
        here = pair_approach(system, one, reach[k], problem.q0, way, float(gaps[k]), sign * normals[k])
        assert 0.0 < here.share <= 1.0
        for x in here.share * SAMPLES[1::4]:
            step = system.coast(way, x)[0] if coasting else x * way
            ((gap,), _) = family.nearest_of(0.0, system.integrate(problem.q0, step), pairs[[k]])
            assert gap >= gaps[k] + here.slope * x - 0.5 * here.bend * x * x - 1e-9
            assert gap >= gaps[k] - here.most * x - 1e-9
        # where it may fall by as much as is asked
        free = here.free(0.5 * gaps[k])
        fall = min(here.most * free, 0.5 * here.bend * free * free - here.slope * free)
        assert fall <= 0.5 * gaps[k] * (1.0 + 1e-9)
        assert free == here.share or fall > 0.5 * gaps[k] * (1.0 - 1e-9)
        held += 1
    assert held
