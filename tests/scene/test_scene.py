"""What a user writes, what is built from it, and every way to get it wrong."""

import numpy as np
import pytest

import mbvi
from mbvi.constraints import SignedDistances
from mbvi.system import ArticulatedSystem
from support.paths import ROBOTS

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.5"/><mass value="{mass}"/>
    <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
    <collision><origin xyz="0 0 -0.5"/><geometry>{geometry}</geometry></collision></link>
  <link name="lower"><inertial><origin xyz="0 0 -0.25"/><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
    <collision><origin xyz="0 0 -0.25"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/><dynamics damping="0.1" friction="0.3"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -1"/>
    <axis xyz="0 1 0"/></joint>
</robot>"""


def urdf(tmp_path, mass=1, ixx=0.1, geometry='<box size="0.1 0.1 0.8"/>', change=lambda text: text):
    path = tmp_path / "arm.urdf"
    path.write_text(change(URDF.format(mass=mass, ixx=ixx, geometry=geometry)))
    return path


def test_sizes_follow_what_a_scene_needs():
    scene = mbvi.Scene()
    scene.add_sphere(0.1, position=(0, 0, 1))
    assert scene.build().system.nv == 3
    scene.add_box((1, 1, 1))
    assert scene.build().system.nv == 9
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 3))
    problem = scene.build()
    assert (problem.system.nq, problem.system.nv) == (9 + 7 + 3, 8 + 6 + 3)
    np.testing.assert_allclose(problem.q0[:3], [0, 0, 3])


def test_the_report_names_what_was_left_out_and_why(tmp_path):
    scene = mbvi.Scene()
    scene.add_urdf(urdf(tmp_path), base="fixed", name="swing")
    scene.add_sphere(0.1, position=(3, 0, 0))
    report = scene.build().report()
    assert "dry friction of shoulder: joint_friction=True models it" in report
    assert "pair swing/upper | swing/lower: adjacent links" in report
    assert "rotation of 1 sphere: no friction can turn them" in report
    assert "effort and velocity limits" in report


def test_pairs_that_overlap_at_neutral_are_left_out(tmp_path):
    third = """<link name="hand"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0"
      izz="0.1"/></inertial><collision><geometry><box size="3 3 3"/></geometry></collision></link>
      <joint name="wrist" type="revolute"><parent link="lower"/><child link="hand"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    path = urdf(tmp_path, change=lambda text: text.replace("</robot>", third))
    scene = mbvi.Scene()
    scene.add_urdf(path, base="fixed")
    assert "pair arm/upper | arm/hand: overlap at the neutral configuration" in scene.build().report()


def test_an_srdf_is_read_where_given(tmp_path):
    quadruped = ROBOTS / "quadruped/quadruped.urdf"
    srdf = tmp_path / "q.srdf"
    srdf.write_text('<robot name="q"><disable_collisions link1="FL_foot" link2="FR_foot" reason="Never"/></robot>')
    counts = []
    for file in (None, str(srdf)):
        scene = mbvi.Scene()
        scene.add_urdf(quadruped, srdf=file)
        problem = scene.build()
        counts.append(sum(len(c.names) for c in problem.constraints.constraints if isinstance(c, SignedDistances)))
    assert counts[1] == counts[0] - 1
    assert "FL_foot | quadruped/FR_foot: disabled by the SRDF" in problem.report()


def test_joint_positions_velocities_and_limits(tmp_path):
    scene = mbvi.Scene()
    scene.add_urdf(urdf(tmp_path), base="fixed", joints={"shoulder": 0.3, "elbow": 0.5}, velocity={"elbow": 2.0})
    problem = scene.build()
    np.testing.assert_allclose(problem.q0, [0.3, np.cos(0.5), np.sin(0.5)])
    np.testing.assert_allclose(problem.v0, [0, 2.0])
    assert problem.constraints.name(0) == "arm/shoulder lower limit"
    assert len([n for n in range(len(problem.constraints)) if "limit" in problem.constraints.name(n)]) == 2


def test_zero_outside_the_limits_starts_in_their_middle(tmp_path):
    path = urdf(tmp_path, change=lambda text: text.replace('lower="-2"', 'lower="1"'))
    scene = mbvi.Scene()
    scene.add_urdf(path, base="fixed")
    problem = scene.build()
    assert problem.q0[0] == 1.5
    assert "zero of joint shoulder: outside its limits" in problem.report()


def test_a_fixed_base_stands_where_it_is_put(tmp_path):
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    scene = mbvi.Scene()
    scene.add_urdf(urdf(tmp_path), base="fixed", position=(1, 2, 3), rotation=turn)
    system = scene.build().system
    place = system.placements(scene.build().q0, np.array([1]))[0]
    np.testing.assert_allclose(place[:3].T, turn, atol=1e-12)
    np.testing.assert_allclose(place[3], [1, 2, 3])


def test_a_robot_under_control_holds_its_pose(tmp_path):
    def hold(t, q, v):
        return np.array([-400 * q[0] - 40 * v[0], -100 * q[2] - 10 * v[1]])

    scene = mbvi.Scene()
    scene.add_urdf(urdf(tmp_path), base="fixed", joints={"shoulder": 0.1}, control=hold)
    run = mbvi.simulate(scene.build(), step=1e-3, duration=2.0)
    assert abs(run.v[-1]).max() < 1e-2


def test_restitution_by_pair_link_before_robot():
    scene = mbvi.Scene(restitution=0.1)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1), name="h")
    scene.add_spheres([[2, 0, 1], [2, 0, 2]], 0.1, 1.0, name="balls")
    scene.set_restitution("h", "floor", 0.5)
    scene.set_restitution("floor", "h/foot", 0.9)
    scene.set_restitution("balls", "balls", 0.7)
    problem = scene.build()
    by_name = {}
    for constraint in problem.constraints.constraints:
        if constraint.names:
            by_name.update(zip(constraint.names, constraint.restitution, strict=True))
    assert by_name["h/foot | floor"] == 0.9
    assert by_name["h/thigh_0 | floor"] == 0.5
    assert by_name["balls[0] | floor"] == 0.1
    assert problem.constraints.constraints[-1].restitution.tolist() == [0.7]


def test_two_of_the_same_robot_get_names_of_their_own():
    scene = mbvi.Scene()
    first = scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1))
    second = scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(1, 0, 1))
    assert (first, second) == ("hopper", "hopper_2")
    assert scene.add_box((1, 1, 1), position=(5, 0, 0)) == "box"
    assert scene.add_box((1, 1, 1), position=(7, 0, 0)) == "box_2"
    assert scene.add_box((1, 1, 1), position=(9, 0, 0)) == "box_3"
    assert scene.build().system.nv == 8 + 8 + 18


def test_a_mesh_becomes_its_convex_hull(tmp_path):
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = [
        (1, 2, 4),
        (1, 4, 3),
        (5, 7, 8),
        (5, 8, 6),
        (1, 5, 6),
        (1, 6, 2),
        (3, 4, 8),
        (3, 8, 7),
        (1, 3, 7),
        (1, 7, 5),
    ]
    faces += [(2, 6, 8), (2, 8, 4)]
    path = tmp_path / "cube.obj"
    path.write_text("\n".join([f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]))
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_mesh(path, mass=3.0, position=(0, 0, 0.5), scale=0.2)
    problem = scene.build()
    np.testing.assert_allclose(problem.q0[:3], [0.1, 0.1, 0.6])
    expected = np.diag([3.0] * 3 + [3.0 * 2 * 0.2**2 / 12] * 3)
    np.testing.assert_allclose(problem.system.metric(problem.q0).dense(), expected, atol=1e-12)
    run = mbvi.simulate(problem, step=1e-3, duration=0.6)
    assert len(run.impacts[0].constraints) == 4
    geometry = f'<mesh filename="{path.name}" scale="0.1 0.1 0.1"/>'
    robot = mbvi.Scene()
    robot.add_urdf(urdf(tmp_path, geometry=geometry), base="fixed")
    assert "mesh arm/upper: replaced by its convex hull of 8 vertices" in robot.build(()).report()


@pytest.mark.parametrize(
    ("add", "arguments", "points"),
    [
        ("add_ellipsoid", {"radii": (0.2, 0.1, 0.1)}, 1),
        ("add_capsule", {"radius": 0.1, "length": 0.3}, 1),
        ("add_cylinder", {"radius": 0.1, "length": 0.2}, 12),
    ],
)
def test_every_body_lands(add, arguments, points):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    getattr(scene, add)(mass=2.0, position=(0, 0, 0.5), **arguments)
    run = mbvi.simulate(scene.build(), step=1e-3, duration=0.5)
    assert len(run.impacts[0].constraints) >= points
    assert run.impacts[0].percussion.sum() == pytest.approx(2.0 * (9.81e-3 - run.impacts[0].before[0]), rel=1e-6)


BAD_SCENES = {
    "normal": (lambda s: s.add_halfspace((0, 0, 0)), "must not be zero"),
    "position": (lambda s: s.add_sphere(0.1, position=(0, 0)), r"position has shape \(2,\)"),
    "mass": (lambda s: s.add_box((1, 1, 1), mass=0.0), "mass must be positive"),
    "radius": (lambda s: s.add_sphere(np.nan), "radius must be positive"),
    "rotation": (lambda s: s.add_box((1, 1, 1), rotation=2 * np.eye(3)), "no rotation matrix"),
    "parted name": (lambda s: s.add_sphere(0.1, name="a/b"), "separate the parts of a name"),
    "name": (lambda s: [s.add_sphere(0.1, name="a") for _ in range(2)], "'a' is taken"),
    "base": (lambda s: s.add_urdf(ROBOTS / "hopper/hopper.urdf", base="flying"), "'free', 'fixed'"),
    "joint": (lambda s: s.add_urdf(ROBOTS / "hopper/hopper.urdf", joints={"ankle": 0.1}), "known are hip, knee"),
    "velocity": (
        lambda s: s.add_urdf(ROBOTS / "hopper/hopper.urdf", velocity={"hip": np.inf}),
        "must be a finite number",
    ),
    "pair": (lambda s: s.set_restitution("nobody", "floor", 0.5), "unknown name 'nobody'"),
    "spheres": (lambda s: s.add_spheres(np.zeros((3, 2)), 0.1, 1.0), r"must have \(n, 3\)"),
    "radii": (lambda s: s.add_spheres(np.zeros((3, 3)), [0.1, 0.2], 1.0), "one number or 3 of them"),
    "mesh": (lambda s: s.add_mesh("nowhere.stl"), "no such file"),
    "nothing": (lambda s: s.build(), "nothing in the scene moves"),
}


@pytest.mark.parametrize(("act", "message"), BAD_SCENES.values(), ids=BAD_SCENES)
def test_bad_scenes(act, message):
    with pytest.raises(mbvi.InputError, match=message):
        act(mbvi.Scene())


@pytest.mark.parametrize("e", [-0.1, 1.01, np.nan])
def test_restitution_outside_the_unit_interval(e):
    with pytest.raises(mbvi.InputError, match=r"\[0, 1\]"):
        mbvi.Scene(restitution=e)
    scene = mbvi.Scene()
    scene.add_sphere(0.1, name="a")
    with pytest.raises(mbvi.InputError, match=r"\[0, 1\]"):
        scene.set_restitution("a", "a", e)


NO_INERTIA = URDF[URDF.index('<inertial><origin xyz="0 0 -0.25"/>') :].split("</inertial>")[0] + "</inertial>"
BAD_URDFS = {
    "no XML": (lambda text: text[:-20], "is no XML"),
    "another root": (lambda text: "<sdf/>", "is SDF, for which Pinocchio's wheels have no parser"),
    "no inertia": (
        lambda text: text.replace(NO_INERTIA, ""),
        r"'lower' moves with joint 'elbow' but has no mass.* locked=\['elbow'\]",
    ),
    "a joint that turns no inertia": (
        lambda text: text.replace(
            NO_INERTIA,
            '<inertial><mass value="1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>',
        ),
        "singular at joint 'elbow': link 'lower'",
    ),
    "unphysical inertia": (lambda text: text.replace('ixx="0.1"', 'ixx="0.7"'), "'upper': unphysical inertia"),
    "negative inertia": (lambda text: text.replace('ixx="0.1"', 'ixx="-0.1"'), "'upper': unphysical inertia"),
    "incomplete inertia": (lambda text: text.replace('ixy="0" ', ""), "lacks a mass or one of the six"),
    "missing mesh": (
        lambda text: text.replace('<box size="0.1 0.1 0.8"/>', '<mesh filename="no.stl"/>'),
        "'no.stl' is not found",
    ),
    "a shape URDF does not know": (
        lambda text: text.replace('<box size="0.1 0.1 0.8"/>', '<capsule radius="1" length="1"/>'),
        "'upper' has 1 collision shapes, of which 1 cannot be read",
    ),
    "unknown link": (
        lambda text: text.replace('parent link="upper"', 'parent link="nobody"'),
        "cannot build the mechanism",
    ),
}


@pytest.mark.parametrize(("change", "message"), BAD_URDFS.values(), ids=BAD_URDFS)
def test_bad_urdfs(change, message, tmp_path):
    with pytest.raises(mbvi.UrdfError, match=message):
        mbvi.Scene().add_urdf(urdf(tmp_path, change=change), base="fixed")


def test_a_link_without_mass_behind_a_locked_joint_is_part_of_the_link_before(tmp_path):
    def mass_of(change, **more):
        scene = mbvi.Scene()
        scene.add_urdf(urdf(tmp_path, change=change), base="fixed", joints={"shoulder": 0.3}, **more)
        system = scene.build().system
        return system.metric(scene.build().q0).apply(np.eye(system.nv))

    def fixed(text):
        head, joint, tail = text.partition('<joint name="elbow" type="')
        return (head + joint + "fixed" + tail[tail.index('"') :]).replace(NO_INERTIA, "")

    found = mass_of(lambda text: text.replace(NO_INERTIA, ""), locked=["elbow"])
    np.testing.assert_allclose(found, mass_of(fixed), rtol=1e-14)
    assert found.shape == (1, 1)


def test_missing_urdf():
    with pytest.raises(mbvi.UrdfError, match="no such file"):
        mbvi.Scene().add_urdf("nowhere.urdf")


def test_a_start_beyond_a_joint_limit_is_refused(tmp_path):
    scene = mbvi.Scene()
    scene.add_urdf(urdf(tmp_path), base="fixed", joints={"shoulder": 2.5})
    with pytest.raises(mbvi.InadmissibleStartError, match=r"arm/shoulder upper limit is violated by 0\.5"):
        scene.build()


def ball(
    q0=(1.0,), v0=(0.0,), f=lambda q: q[0], gradient=lambda q: np.ones(1), mass=lambda q: np.eye(1), force=-9.81, **more
):
    system = mbvi.LagrangianSystem(mass, lambda t, q, v: np.array([force]), 1)
    return mbvi.Problem(system, [mbvi.GapFunction(f, gradient)], q0, v0, **more)


BAD_PROBLEMS = {
    "NaN in q0": ({"q0": [np.nan]}, "q0 must be finite"),
    "shape of q0": ({"q0": [1.0, 2.0]}, r"q0 has shape \(2,\)"),
    "shape of v0": ({"v0": [[1.0]]}, r"v0 has shape \(1, 1\)"),
    "words": ({"q0": ["up"]}, "q0 must be numbers of shape"),
    "e above one": ({"restitution": 1.5}, r"\[0, 1\]"),
    "e for two": ({"restitution": [0.5, 0.5]}, "one a constraint"),
    "gradient's shape": ({"gradient": lambda q: np.ones(3)}, r"the gradient of f 0 has shape \(3,\)"),
    "gap of nowhere": ({"f": lambda q: np.nan}, "not finite"),
    "shape of M": ({"mass": lambda q: np.eye(2)}, r"mass \(.*\) returned shape \(2, 2\)"),
    "infinite force": ({"force": np.inf}, "at the start force .* is not finite"),
    "indefinite M": ({"mass": lambda q: -np.eye(1)}, "not positive definite"),
}


@pytest.mark.parametrize(("arguments", "message"), BAD_PROBLEMS.values(), ids=BAD_PROBLEMS)
def test_bad_problems(arguments, message):
    with pytest.raises(mbvi.InputError, match=message):
        ball(**arguments)


def test_a_quaternion_of_another_length_is_refused():
    scene = mbvi.Scene()
    scene.add_box((1, 1, 1))
    problem = scene.build()
    with pytest.raises(mbvi.InputError, match="unit length"):
        mbvi.Problem(problem.system, [], [0, 0, 0, 0, 0, 0, 1.1], problem.v0)
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf")
    problem = scene.build()
    assert isinstance(problem.system, ArticulatedSystem)
    with pytest.raises(mbvi.InputError, match="unit length"):
        mbvi.Problem(problem.system, [], 2 * problem.q0 - [*[0] * 3, *[0] * 3, 0, 0, 0], problem.v0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"step": 0.0, "duration": 1.0}, "step must be"),
        ({"step": -1e-3, "duration": 1.0}, "step must be"),
        ({"step": np.nan, "duration": 1.0}, "step must be"),
        ({"step": 1e-3, "duration": 0.0}, "duration must be"),
        ({"step": 1e-3, "duration": 1e30}, "more than any run can take"),
        ({"step": 1e-3, "duration": 1.0, "every": 0}, "every must be"),
        ({"step": 1e-3, "duration": 1.0, "residual": 0.0}, "residual must be"),
        ({"scheme": mbvi.Paoli, "step": 1e-3, "duration": 1.0}, "object such as"),
    ],
)
def test_bad_arguments_of_simulate(arguments, message):
    with pytest.raises(mbvi.InputError, match=message):
        mbvi.simulate(ball(), **arguments)


def test_a_single_joint_strikes_a_wall(tmp_path):
    path = urdf(
        tmp_path, change=lambda text: text.replace('name="elbow" type="continuous"', 'name="elbow" type="fixed"')
    )
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((-1, 0, 0), -0.4)
    scene.add_urdf(path, base="fixed", joints={"shoulder": 0.5})
    problem = scene.build()
    assert problem.system.nv == 1
    assert mbvi.simulate(problem, step=1e-3, duration=1.0).impacts[0].before[0] < 0


def test_a_round_mesh_with_too_many_neighbours_is_thinned(rng):
    from mbvi.geometry.shapes.shapes import Hull

    angle = np.linspace(0, 2 * np.pi, 500, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(500)], axis=1)
    hull = Hull(np.concatenate([rim, [[0, 0, 1.0]]]))
    hull.coal()
    assert len(hull.vertices) < 500
    assert hull.bound == pytest.approx(1.0, abs=1e-9)


def test_forces_that_run_away_are_said():
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: 1e200 * v * (1 + v**2), 1)
    problem = mbvi.Problem(system, [], [0.0], [1.0])
    with np.errstate(over="ignore"), pytest.raises(mbvi.DivergedError, match="take a smaller step"):
        mbvi.simulate(problem, step=1e-3, duration=1.0)


def test_bad_files(tmp_path):
    with pytest.raises(mbvi.TrajectoryFileError, match="cannot be written"):
        mbvi.simulate(ball(), step=1e-3, duration=0.1, out=tmp_path / "no/such/folder/run.h5")
    with pytest.raises(mbvi.TrajectoryFileError, match="no such file"):
        mbvi.load(tmp_path / "run.h5")
    run = mbvi.simulate(ball(), step=1e-3, duration=0.1)
    with pytest.raises(mbvi.TrajectoryFileError, match="cannot be written"):
        run.save(tmp_path)
    run.save(tmp_path / "run.h5")
    data = (tmp_path / "run.h5").read_bytes()
    (tmp_path / "half.h5").write_bytes(data[: len(data) // 2])
    with pytest.raises(mbvi.TrajectoryFileError, match="truncated"):
        mbvi.load(tmp_path / "half.h5")
    (tmp_path / "text.h5").write_text("no HDF5")
    with pytest.raises(mbvi.TrajectoryFileError, match="truncated or no HDF5"):
        mbvi.load(tmp_path / "text.h5")
