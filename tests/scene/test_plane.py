"""Planar scenes move as the same scenes in space, where these are symmetric about the plane."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from support.paths import ROBOTS
from support.poses import places_of

HOPPER = ROBOTS / "hopper" / "hopper.urdf"
SCHEMES = (mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.SchatzmanPaoli(), mbvi.StewartTrinkle())
PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


def along(plane, first, second):
    """A vector of space by its two parts in a plane."""
    vector = np.zeros(3)
    vector[list(PLANES[plane])] = first, second
    return vector


def turned(plane, angle):
    """The turn from the plane's first axis to its second."""
    axis = np.cross(along(plane, 1, 0), along(plane, 0, 1))
    return Rotation.from_rotvec(angle * axis).as_matrix(), axis


def scene_of(plane, e):
    scene = mbvi.Scene(gravity=along(plane, 0, -9.81), restitution=e, plane=plane)
    scene.add_halfspace(along(plane, 0, 1), name="floor")
    return scene


def balls(plane, e):
    scene = scene_of(plane, e)
    scene.add_halfspace(along(plane, 1, 0.2), -0.2, name="wall")
    scene.add_sphere(0.1, 1.0, along(plane, 0.2, 0.4), along(plane, -1, 0))
    scene.add_spheres([along(plane, 0.23, 0.7), along(plane, 0.5, 0.2)], 0.08, 0.5)
    return scene


def boxes(plane, e):
    scene = scene_of(plane, e)
    normal = np.cross(along(plane, 1, 0), along(plane, 0, 1))
    # its frame's axes are the plane's in another order: turned in it, and on its side
    aside = np.stack([along(plane, 0, 1), normal, along(plane, 1, 0)], axis=1)
    turn, axis = turned(plane, 0.35)
    scene.add_box((0.3, 0.2, 0.16), 2.0, position=along(plane, 0, 0.25), rotation=turn @ aside, name="low")
    turn, _ = turned(plane, -0.5)
    scene.add_box(
        (0.2, 0.2, 0.2), 1.0, position=along(plane, 0.05, 0.6), rotation=turn, angular_velocity=3 * axis, name="high"
    )
    scene.add_cylinder(
        0.1, 0.2, 1.0, position=along(plane, 0.5, 0.3), rotation=turned_to(axis), velocity=along(plane, -1, 0)
    )
    return scene


def turned_to(axis):
    """A rotation that takes z to an axis."""
    other = np.roll(axis, 1)
    return np.stack([other, np.cross(axis, other), axis], axis=1)


def hopper(plane, e):
    scene = scene_of("xz", e)
    turn, _ = turned("xz", -0.2)
    scene.add_urdf(
        HOPPER, position=(0.3, 0.1, 0.7), rotation=turn, joints={"knee": 0.4, "hip": -0.2}, velocity={"hip": 2}
    )
    scene.add_sphere(0.08, 2.0, (0.2, 0.1, 1.2), (0, 0, -3))
    return scene


def both(scene):
    return scene.build(["plane"]), scene.build(())


def compare(planar, full, scheme, tolerance, **options):
    names = [s.name for s in full.scene.shapes]
    runs = [mbvi.simulate(p, scheme, **options) for p in (planar, full)]
    assert runs[0].impacts
    times = np.linspace(0.0, options["duration"], 41)
    for t in times:
        poses = [places_of(p, run.at(t)[0], names) for p, run in zip((planar, full), runs, strict=True)]
        np.testing.assert_allclose(*poses, rtol=0, atol=tolerance)
    np.testing.assert_allclose(*(run.energy()[[0, -1]] for run in runs), rtol=0, atol=100 * tolerance)
    return runs


CASES = [(make, plane) for make in (balls, boxes) for plane in PLANES] + [(hopper, "xz")]


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize(("make", "plane"), CASES, ids=lambda x: getattr(x, "__name__", x))
def test_a_planar_scene_moves_as_in_space(make, plane, scheme):
    planar, full = both(make(plane, 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.5))
    assert planar.system.nv < full.system.nv
    compare(planar, full, scheme, 1e-10, step=1e-3, duration=0.5)


@pytest.mark.parametrize(("make", "plane"), [(balls, "yz"), (hopper, "xz")], ids=lambda x: getattr(x, "__name__", x))
def test_error_control_finds_the_same(make, plane):
    runs = compare(*both(make(plane, 0.5)), mbvi.EventDriven(tolerance=1e-9), 1e-7, duration=0.4)
    # a half-space and a joint's limit are the same rows in both
    times = [[i.time for i in run.impacts] for run in runs]
    np.testing.assert_allclose(*times, rtol=0, atol=1e-7)


def test_degrees_of_freedom_and_rows_are_named():
    scene = boxes("xz", 0.5)
    scene.add_spheres([(2, 0, 1), (2, 0, 2)], 0.1, 1.0)
    report = scene.build().report()
    for line in (
        "3 free bodies, 3 degrees of freedom each",
        "2 spheres, 2 degrees of freedom each",
        "13 degrees of freedom in all, in the plane xz",
        "motion of 3 bodies out of the plane: the scene is planar; saves 9 degrees of freedom",
        "motion of 2 spheres out of the plane: the scene is planar; saves 2 degrees of freedom",
        # four corners of each box, and one of two rims and half of the points on them
        "points in line across the plane: their rows are the same; saves 21 rows",
        "saved in all: 17 degrees of freedom, 21 rows",
    ):
        assert line in report, line
    assert "planar base, 2 joints, 5 degrees of freedom" in hopper("xz", 0.5).build().report()


def test_walls_along_the_plane_are_left_out_and_named():
    scene = mbvi.Scene(plane="xz")
    scene.add_container((-1, -0.1, 0), (1, 0.1))
    scene.add_sphere(0.1, position=(0, 0, 0.5))
    problem = scene.build()
    assert len(problem.constraints) == len(scene.build(reduce=()).constraints) - 2
    for side in ("front", "back"):
        assert f"half-space container/{side}: lies along the plane: nothing moves towards it; saves 1 pair" in (
            problem.report()
        )
    # what is part of the world may lie as it likes
    scene.add_box((1, 2, 3), position=(9, 9, 9), rotation=Rotation.from_rotvec([1, 2, 3]).as_matrix(), fixed=True)
    scene.build()
    scene.add_box((0.1, 0.3, 0.1), position=(0.5, 0, 0.5))
    with pytest.raises(mbvi.InadmissibleStartError, match=r"box_2 reaches 0\.05 into container/front"):
        scene.build()


def test_a_planar_robot_may_lock_what_leaves_the_plane():
    hips = [f"{leg}_hip_joint" for leg in ("FL", "FR", "RL", "RR")]
    scene = mbvi.Scene(restitution=0.3, plane="xz")
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(ROBOTS / "quadruped" / "quadruped.urdf", position=(0, 0, 0.6), locked=hips)
    planar, full = both(scene)
    assert (planar.system.nv, full.system.nv) == (11, 14)
    # left and right move alike
    compare(planar, full, mbvi.Paoli(), 1e-9, step=1e-3, duration=0.3)


def test_damping_and_limits_of_a_planar_robot_are_its_own(tmp_path):
    text = HOPPER.read_text().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics damping="0.3"/>', 1)
    (tmp_path / "hopper.urdf").write_text(text)
    scene = scene_of("xz", 0.5)
    scene.add_urdf(tmp_path / "hopper.urdf", position=(0, 0, 0.7), velocity={"hip": -19.0, "knee": 5.0})
    runs = compare(*both(scene), mbvi.Paoli(), 1e-10, step=1e-3, duration=0.4)
    assert "hopper/knee lower limit" in {name for i in runs[0].impacts for name in i.constraints}


def test_walls_may_move_in_the_plane():
    scene = scene_of("xz", 0.5)
    shake = mbvi.motion.Oscillation(amplitude=(0.02, 0, 0), frequency=4.0)
    scene.add_container((-0.3, -0.2, 0.05), (0.3, 0.2), motion=shake)
    scene.add_box((0.2, 0.1, 0.1), position=(0, 0, 0.3), rotation=turned("xz", 0.4)[0], velocity=(1.0, 0, 0))
    scene.add_sphere(0.05, position=(0.1, 0, 0.5))
    compare(*both(scene), mbvi.MoreauJean(), 1e-10, step=1e-3, duration=0.4)


def test_many_planar_bodies_have_sparse_rows():
    scene = scene_of("xz", 0.0)
    spots = [(0.21 * (k % 8) + 0.1 * (k // 8 % 2), 0, 0.105 + 0.2 * (k // 8)) for k in range(72)]
    scene.add_spheres(spots, 0.1, 1.0)
    scene.add_box((0.3, 0.3, 0.3), position=(0.8, 0, 2.2), rotation=turned("xz", 0.3)[0], velocity=(0, 0, -2))
    planar, full = both(scene)
    assert planar.system.sparse and full.system.sparse
    compare(planar, full, mbvi.StewartTrinkle(), 1e-6, step=2e-3, duration=0.2, residual=1e-10)


@given(seed=st.integers(0, 2**32 - 1), plane=st.sampled_from(list(PLANES)))
def test_planar_systems_are_restrictions_of_those_in_space(seed, plane):
    rng = np.random.default_rng(seed)
    planar, full = both(boxes(plane, 0.5))
    two, three = planar.system, full.system
    q = two.integrate(planar.q0, rng.normal(size=two.nv))
    dv = rng.normal(size=two.nv)
    # how velocities in the plane are velocities in space
    P = np.stack([three.difference(q, two.integrate(q, 1e-3 * e)) / 1e-3 for e in np.eye(two.nv)], axis=1)
    np.testing.assert_allclose(P @ dv, three.difference(q, two.integrate(q, 0.1 * dv)) / 0.1, atol=1e-10)
    np.testing.assert_allclose(two.metric(q).dense(), P.T @ three.metric(q).dense() @ P, atol=1e-10)
    np.testing.assert_allclose(two.force(0, q, dv), P.T @ three.force(0, q, P @ dv), atol=1e-10)
    np.testing.assert_allclose(two.difference(q, two.integrate(q, dv)), dv, atol=1e-10)
    assert two.kinetic_energy(q, dv) == pytest.approx(three.kinetic_energy(q, P @ dv))
    assert two.potential_energy(0, q) == pytest.approx(three.potential_energy(0, q))
    first, second = rng.integers(0, 4, size=(2, 6))
    point, normal = rng.normal(size=(2, 6, 3))
    rows = [s.separation_rows(q, first, second, point, normal) for s in (two, three)]
    np.testing.assert_allclose(rows[0], rows[1] @ P, atol=1e-9)
    bodies, points = np.array([1, 2, 3]), rng.normal(size=(3, 3))
    biases = [s.point_bias(q, v, bodies, points) for s, v in ((two, dv), (three, P @ dv))]
    np.testing.assert_allclose(*biases, atol=1e-9)
    # no point of a ball travels further than the reach says
    moved = two.placements(two.integrate(q, dv), bodies) - two.placements(q, bodies)
    for k in range(3):
        way = np.linalg.norm(points[k] @ moved[k, :3] + moved[k, 3])
        assert way <= two.reach(k + 1, points[k], 0.0) @ np.abs(dv) + 1e-12


@given(seed=st.integers(0, 2**32 - 1))
def test_gaps_are_those_in_space(seed):
    rng = np.random.default_rng(seed)
    scene = boxes("xz", 0.5)
    # a rim's centre in line with points of it, and not
    scene.add_cylinder(0.1, 0.3, 1.0, position=(1.2, 0, 0.5), name="rod")
    twist = Rotation.from_rotvec([0, 0, rng.uniform(0, 6)]).as_matrix()
    scene.add_cylinder(0.1, 0.3, 1.0, position=(2.4, 0, 0.5), rotation=twist, name="twisted")
    scene.add_capsule(0.1, 0.3, 1.0, position=(1.8, 0, 0.5), name="pill")
    planar, full = both(scene)
    q = planar.system.integrate(planar.q0, rng.normal(size=planar.system.nv))
    for two, three in zip(planar.constraints.constraints, full.constraints.constraints, strict=True):
        np.testing.assert_allclose(two.gap(0.0, q), three.gap(0.0, q), rtol=0, atol=1e-9)


def test_runs_of_planar_scenes_come_back_from_files(tmp_path):
    scene = hopper("xz", 0.5)
    scene.add_box((0.1, 0.1, 0.1), position=(1, 0, 0.2))
    for reduce in (mbvi.REDUCTIONS, ()):
        problem = scene.build(reduce)
        run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.1)
        run.save(tmp_path / "run.h5")
        again = mbvi.load(tmp_path / "run.h5")
        assert again.problem.report() == problem.report()
        np.testing.assert_array_equal(again.energy(), run.energy())
        np.testing.assert_array_equal(again.problem.v0, problem.v0)
    run.replay_html(tmp_path / "run.html")


def test_what_leaves_the_plane_is_refused_by_name():
    def scene(**options):
        made = mbvi.Scene(plane="xz", **options)
        made.add_sphere(0.1, position=(0, 0, 5))
        return made

    def add_box(made, **body):
        made.add_box((0.1, 0.2, 0.3), **body)
        return made

    tilted = Rotation.from_rotvec([0.3, 0, 0]).as_matrix()
    leaning, moving = scene(), scene()
    leaning.add_halfspace((0, 0.1, 1))
    moving.add_spheres([(1, 0, 0), (2, 0, 0)], 0.1, 1.0, velocities=[(1, 0, 0), (1, 0.1, 0)])
    robot = scene()
    robot.add_urdf(ROBOTS / "quadruped" / "quadruped.urdf")
    for made, words in (
        (scene(gravity=(0, -1, -9)), "gravity .* leaves the plane xz"),
        (leaning, "half-space floor leans out of the plane xz"),
        (moving, r"spheres\[1\] starts with a velocity out of the plane xz"),
        (add_box(scene(), velocity=(0, 1, 0)), "box starts with a velocity out of the plane"),
        (add_box(scene(), angular_velocity=(0, 1, 1)), "box starts with an angular velocity that turns it out"),
        (add_box(scene(), rotation=tilted), "no principal axis of inertia of box"),
        (robot, "FL_hip_joint, FR_hip_joint, RL_hip_joint, RR_hip_joint of quadruped leave the plane xz: lock"),
    ):
        with pytest.raises(mbvi.InputError, match=words):
            made.build()
        # it is no plane's motion either where it is built in space
        with pytest.raises(mbvi.InputError, match=words):
            made.build(reduce=())
    with pytest.raises(mbvi.InputError, match="plane must be one of xy, xz, yz, or None; got 'zx'"):
        mbvi.Scene(plane="zx")


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(), mbvi.MoreauJean()], ids=repr)
@pytest.mark.parametrize("plane", ["xz", None])
@pytest.mark.parametrize("twist", [0.0, 0.2])
def test_a_tilted_cylinder_lands_on_its_lowest_point_in_a_long_step(scheme, plane, twist):
    """Other points of its rim are below the floor by then: the percussion is that of the lowest one, in closed form."""
    radius, length, mass, tilt, speed, e, step = 0.1, 0.15, 2.0, 0.12, 3.0, 0.5, 2e-3
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e, plane=plane)
    scene.add_halfspace((0, 0, 1), name="floor")
    turn = Rotation.from_rotvec([0, tilt, 0]) * Rotation.from_rotvec([0, 0, twist])
    arm = np.array(
        [-0.5 * length * np.sin(tilt) + radius * np.cos(tilt), -0.5 * length * np.cos(tilt) - radius * np.sin(tilt)]
    )
    place = (0, 0, 0.2 * speed * step - arm[1])
    scene.add_cylinder(radius, length, mass, position=place, rotation=turn.as_matrix(), velocity=(0, 0, -speed))
    run = mbvi.simulate(scene.build(), scheme, step=step, duration=step)
    inertia = mass * (length**2 / 12 + radius**2 / 4)
    percussion = (1 + e) * speed / (1 / mass + arm[0] ** 2 / inertia)
    v = run.v[-1]
    up, spin = (v[1], v[2]) if plane else (v[2], np.linalg.norm(v[3:]))
    # arms turn with the body within the step
    np.testing.assert_allclose(up, percussion / mass - speed, rtol=1e-2)
    np.testing.assert_allclose(abs(spin), arm[0] * percussion / inertia, rtol=1e-2)
