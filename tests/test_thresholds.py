"""Sizes at which the code takes another path: every scheme runs on both sides of each, and both paths find the same."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints import JointLimits, cache
from mbvi.constraints.families import half_space, pairs
from mbvi.projection import projector
from mbvi.projection.dense import fused_step
from mbvi.run import default_scheme
from mbvi.scene import assembly
from mbvi.schemes.event_driven.rows import contact_rows as smooth
from mbvi.system import blocks as block_systems
from mbvi.system.free import bodies, planar, sparse_rows
from support.random_scenes import add_robot

SCHEMES = {
    "default": None,
    "Paoli": mbvi.Paoli(),
    "Centered": mbvi.Centered(),
    "lifting": mbvi.Centered(project_positions=True),
    "MoreauJean": mbvi.MoreauJean(),
    "SchatzmanPaoli": mbvi.SchatzmanPaoli(),
    "StewartTrinkle": mbvi.StewartTrinkle(),
}
STEP = 2e-3
# how fast the fast body is [m/s]
SPEEDS = (0.0, 5.0, 50.0)


def every_two(names):
    """Every name with every scheme and with every speed, and every scheme with every speed."""
    return [(a, b, SPEEDS[(j + k) % len(SPEEDS)]) for j, a in enumerate(names) for k, b in enumerate(SCHEMES)]


def sites(count, spacing, low):
    """The first sites of a cubic lattice."""
    side = int(np.ceil(count ** (1 / 3) - 1e-9))
    return spacing * np.indices((side, side, side)).reshape(3, -1).T[:count] + np.array(low)


def crowd(boxes=0, spheres=0, mixed=0, e=0.3, fast=0.0, robot=None, fixed=0, driven=0, shaken=False):
    """Boxes, spheres and other shapes in heaps beside each other, just above a floor; one may be fast [m/s].

    Nothing is aligned: which corners of equal faces touch would be rounding.
    """
    rng = np.random.default_rng(1)
    scene = mbvi.Scene(restitution=e)
    motion = mbvi.motion.Oscillation((0.0, 0.0, 0.01), 5.0)
    scene.add_halfspace((0, 0, 1), 0.0, motion=motion if shaken else None)
    for k, at in enumerate(sites(boxes, 0.212, (0.0, 0.0, 0.11))):
        turn = Rotation.from_rotvec(0.02 * rng.uniform(-1.0, 1.0, 3)).as_matrix()
        velocity = (fast if k == boxes // 2 else 0.0, 0.0, -1.0)
        scene.add_box((0.2, 0.2, 0.2), position=at + 1e-3 * rng.random(3), rotation=turn, velocity=velocity)
    if spheres:
        at = sites(spheres, 0.202, (3.0, 0.0, 0.1))
        velocities = np.tile([0.0, 0.0, -1.0], (spheres, 1))
        velocities[0, 0] = fast
        scene.add_spheres(at, 0.1, 1.0, velocities)
    for k, at in enumerate(sites(mixed, 0.31, (-3.0, 0.0, 0.16))):
        move = {"position": at, "velocity": rng.normal(size=3), "angular_velocity": rng.normal(size=3)}
        if k % 3 == 0:
            scene.add_capsule(0.05, 0.2, **move)
        elif k % 3 == 1:
            scene.add_cylinder(0.08, 0.2, **move)
        else:
            scene.add_ellipsoid((0.14, 0.1, 0.08), **move)
    for at in sites(fixed, 0.4, (0.0, 3.0, 0.3)):
        scene.add_box((0.3, 0.3, 0.3), position=at, fixed=True)
    for at in sites(driven, 0.4, (0.0, -3.0, 0.3)):
        scene.add_box((0.3, 0.3, 0.3), position=at, motion=motion)
    if robot:
        add_robot(scene, robot, rng, at=(-1.5, -1.5, 0.8))
    return scene


def chain(count, e=0.3, fast=0.0):
    """Spheres that touch each other in a row on the floor, in a plane: 2 count - 1 rows."""
    scene = mbvi.Scene(restitution=e, plane="xz")
    scene.add_halfspace((0, 0, 1), 0.0)
    at = np.array([[0.2 * k, 0.0, 0.1] for k in range(count)])
    velocities = np.zeros((count, 3))
    velocities[0, 0] = 1.0 + fast
    scene.add_spheres(at, 0.1, 1.0, velocities)
    return scene


# a constant, and sizes of scenes below, at and above it
SIZES = {
    "few spheres": [crowd, [{"spheres": n, "boxes": 1} for n in (32, 33, 34)]],
    "few spheres among others": [crowd, [{"spheres": n, "mixed": 3, "fixed": 1, "driven": 1} for n in (33, 34)]],
    "few spheres and a robot": [crowd, [{"spheres": n, "robot": "hopper"} for n in (33, 34)]],
    "few shapes": [crowd, [{"boxes": n} for n in (59, 60, 61)]],
    "few shapes and spheres": [crowd, [{"boxes": n, "spheres": 12} for n in (48, 60, 61)]],
    "few mixed shapes": [crowd, [{"mixed": n, "fixed": 2} for n in (57, 58, 59)]],
    "few shapes and a robot": [crowd, [{"boxes": n, "robot": "arm"} for n in (47, 60)]],
    "columns of boxes": [crowd, [{"boxes": n} for n in (16, 17)]],
    "columns of boxes and spheres": [crowd, [{"boxes": 8, "spheres": n, "shaken": True} for n in (17, 18)]],
    "columns and a robot": [crowd, [{"boxes": n, "robot": "quadruped"} for n in (16, 17)]],
    "entries of reaches": [crowd, [{"boxes": n} for n in (40, 41, 42)]],
    "entries of reaches in a mixed scene": [crowd, [{"boxes": n, "spheres": 12, "driven": 1} for n in (38, 39, 40)]],
    "pairs with driven shapes": [crowd, [{"boxes": n, "driven": 15} for n in (19, 20, 21)]],
    "pairs of spheres with driven shapes": [crowd, [{"spheres": n, "boxes": 1, "driven": 10} for n in (29, 30, 34)]],
    "32 rows": [chain, [{"count": n} for n in (16, 17)]],
    "64 rows": [chain, [{"count": n} for n in (32, 33)]],
    "100 columns in a plane": [chain, [{"count": n} for n in (50, 51)]],
}  # fmt: skip


def check_run(make, size, scheme, fast):
    stewart = isinstance(scheme, mbvi.StewartTrinkle)
    if isinstance(scheme, mbvi.SchatzmanPaoli):
        # its projection onto K asks for smaller steps where bodies start a step deep in each other
        fast = min(fast, 5.0)
    problem = make(**size, fast=fast, e=0.0 if stewart else 0.3).build()
    run = mbvi.simulate(problem, scheme, step=STEP, duration=4 * STEP, progress=False)
    assert np.isfinite(run.v).all() and len(run.t) == 5
    # nothing is in another by more than it is thick: a fast body is stopped by what it meets
    assert run.penetration().max() < 0.2


@pytest.mark.parametrize("fast", SPEEDS)
@pytest.mark.parametrize("name", SIZES)
def test_the_default_runs_above_every_threshold(name, fast):
    make, sizes = SIZES[name]
    check_run(make, sizes[-1], None, fast)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scheme", "fast"), every_two(SIZES))
def test_every_scheme_runs_on_both_sides_of_every_threshold(name, scheme, fast):
    make, sizes = SIZES[name]
    for size in sizes:
        check_run(make, size, SCHEMES[scheme], fast)


def falling(count, parts):
    """Numbers that fall onto limits of their own, these in so many constraints."""
    system = mbvi.LagrangianSystem(
        mass=lambda q: np.eye(count), force=lambda t, q, v: -10.0 * np.ones(count), dim=count
    )
    limits = [
        JointLimits(count, own, own, np.full(len(own), -0.01), np.full(len(own), np.inf), [f"j{k}" for k in own], 0.5)
        for own in np.array_split(np.arange(count), parts)
    ]
    return mbvi.Problem(system, limits, np.linspace(0.0, 0.01, count), np.full(count, -0.5))


@pytest.mark.parametrize("parts", [59, 60, 61, 62])
@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.EventDriven(1e-8)])
def test_cached_constraints_may_be_many(parts, scheme):
    options = {"duration": 0.05} | ({} if isinstance(scheme, mbvi.EventDriven) else {"step": STEP})
    one, many = (mbvi.simulate(falling(62, n), scheme, **options) for n in (1, parts))
    np.testing.assert_allclose(many.v[-1], one.v[-1], rtol=0, atol=1e-12)
    assert one.impacts


@pytest.mark.parametrize("count", [99, 100, 101])
def test_the_default_scheme_runs_for_any_number_of_constraints(count):
    run = mbvi.simulate(falling(count, 3), duration=0.03)
    assert ("EventDriven" in run.notes[0]) == (count <= default_scheme._FEW)


@pytest.mark.slow
@pytest.mark.parametrize("dim", [200, 201])
def test_modes_are_looked_for_in_systems_of_up_to_so_many_degrees_of_freedom(dim):
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(dim), force=lambda t, q, v: -1e4 * q, dim=dim)
    problem = mbvi.Problem(system, [], np.full(dim, 1e-6), np.zeros(dim))
    _, scale = default_scheme.time_step(problem, 1.0)
    assert ("mode" in scale) == (dim <= default_scheme._MOST_MODES)


# the constants of both paths; a scene small enough for either, and how well both are to agree
DENSE = [(module, "MOST_DENSE") for module in (sparse_rows, bodies, planar, block_systems)]
PATHS = {
    "rows, dense or sparse": (DENSE, crowd, {"boxes": 9, "spheres": 3}),
    "rows with a robot, dense or sparse": (DENSE, crowd, {"boxes": 4, "robot": "hopper", "fixed": 1}),
    "rows in a plane, dense or sparse": (DENSE, chain, {"count": 9}),
    "reaches, dense or sparse": ([(pairs, "_MOST_DENSE")], crowd, {"boxes": 8, "mixed": 6}),
    "spheres, few or many": ([(assembly, "_FEW_SPHERES")], crowd, {"spheres": 8, "boxes": 2, "driven": 1, "fixed": 1}),
    "shapes, few or many": ([(assembly, "_FEW_SHAPES")], crowd, {"boxes": 6, "mixed": 5, "spheres": 2}),
    "pairs with driven shapes, few or many": ([(assembly, "_MANY_PAIRS")], crowd, {"boxes": 8, "driven": 3}),
    "constraints in the cache": ([(cache, "_MOST_CACHED")], crowd, {"boxes": 6, "robot": "hopper"}),
    "rows solved by the fused step": ([(projector, "MOST_FUSED")], crowd, {"boxes": 6}),
    "rows solved to rounding": ([(fused_step, "FEW")], crowd, {"boxes": 6}),
    "selections of points kept": ([(half_space, "_MOST_SELECTIONS")], crowd, {"boxes": 6}),
}  # fmt: skip


def both_paths(name, scheme, fast, monkeypatch):
    constants, make, size = PATHS[name]
    found = []
    for value in (1, 10**9):
        for module, constant in constants:
            assert isinstance(getattr(module, constant), int)
            monkeypatch.setattr(module, constant, value)
        problem = make(**size, fast=fast, e=0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.3).build()
        run = mbvi.simulate(problem, scheme, step=STEP, duration=5 * STEP, residual=1e-10, progress=False)
        found.append(run)
    return found


def check_paths(name, scheme, fast, monkeypatch):
    few, many = both_paths(name, scheme, fast, monkeypatch)
    speed = np.abs(few.v).max()
    np.testing.assert_allclose(many.q, few.q, rtol=0, atol=1e-9 * max(1.0, speed))
    np.testing.assert_allclose(many.v, few.v, rtol=0, atol=1e-8 * speed)


@pytest.mark.parametrize("name", PATHS)
def test_both_paths_find_the_same(name, monkeypatch):
    check_paths(name, mbvi.Centered(), 50.0, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scheme", "fast"), every_two(PATHS))
def test_both_paths_find_the_same_with_every_scheme(name, scheme, fast, monkeypatch):
    check_paths(name, SCHEMES[scheme], fast, monkeypatch)


@pytest.mark.parametrize("limit", [1, 1000])
def test_sets_of_rows_kept_by_error_control(limit, monkeypatch):
    monkeypatch.setattr(smooth, "_MOST_SETS", limit)
    run = mbvi.simulate(crowd(spheres=4).build(), mbvi.EventDriven(1e-8), duration=0.05)
    monkeypatch.undo()
    again = mbvi.simulate(crowd(spheres=4).build(), mbvi.EventDriven(1e-8), duration=0.05)
    np.testing.assert_array_equal(run.v, again.v)
