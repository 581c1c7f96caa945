"""Connections and couplings as users write them, from files, in reports and in saved runs."""

import numpy as np
import pytest

import mbvi
from support.four_bar import four_bar
from support.paths import ROBOTS


def pendulum(**scene):
    made = mbvi.Scene(**scene)
    made.add_box((0.1, 0.1, 0.4), position=(0, 0, -0.2), name="rod")
    made.add_sphere(0.1, position=(0, 0, -0.5), name="bob")
    return made


def test_what_is_connected_is_in_the_report_and_passes_through_each_other():
    scene = pendulum()
    assert scene.connect("world", "rod", at=(0, 0, 0)) == "connection"
    assert scene.connect("rod", "bob", at=(0, 0, -0.5), name="end") == "end"
    report = scene.build().report()
    assert "connection: world and rod share a point" in report and "end: rod and bob share a point" in report
    assert "pairs of bob and rod: excluded" in report


def test_a_pendulum_of_connected_bodies_swings_with_its_period():
    """A rod and a ball at its end on a fixed point: small angles, an exact frequency of a compound pendulum."""
    scene = pendulum()
    scene.connect("world", "rod", at=(0, 0, 0))
    scene.connect("rod", "bob", at=(0, 0, -0.5))
    problem = scene.build()
    # rod about the pivot, and the ball as a point; the tilt at the start is an initial velocity
    inertia = 1.0 / 12.0 * (0.4**2 + 0.1**2) + 0.2**2 + 0.5**2
    omega = np.sqrt(9.81 * (0.2 + 0.5) / inertia)
    v = problem.system.tangent(problem.q0, np.array([0, 0, 0, 0, 1e-3, 0, 0, 0, 0.0]))
    run = mbvi.simulate(problem.at(problem.q0, v), mbvi.Centered(), step=1e-3, duration=3.0 * np.pi / omega)
    bob = run.q[:, 7]
    crossings = np.flatnonzero(np.diff(np.sign(bob[1:]))) + 1
    assert abs(run.t[crossings[0]] - np.pi / omega) < 3e-3
    assert run.loop_gap().max() <= 1e-13


def test_a_saved_run_has_its_connections(tmp_path):
    scene = four_bar(0.5, floor=-0.3)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3)
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    assert again.problem.report() == run.problem.report()
    np.testing.assert_array_equal(again.loop_gap(), run.loop_gap())
    more = mbvi.simulate(again.problem, mbvi.Paoli(), step=1e-3, duration=0.3)
    np.testing.assert_array_equal(more.q, run.q)


def test_a_saved_robot_has_its_couplings(tmp_path):
    scene = mbvi.Scene()
    scene.add_urdf("robot:quadruped", position=(0, 0, 1))
    scene.couple("quadruped/FL_thigh_joint", "quadruped/FR_thigh_joint", ratio=-1.0, offset=0.2, name="gait")
    problem = scene.build()
    assert "gait: quadruped/FL_thigh_joint = -1 quadruped/FR_thigh_joint + 0.2" in problem.report()
    assert problem.report().count("the start was moved to close loops and couplings: quadruped: ") == 1
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05)
    assert any("to close loops and couplings" in note for note in run.notes)
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5").problem
    np.testing.assert_array_equal(again.q0, problem.q0)
    assert again.report() == problem.report()


MJCF = """<mujoco><option timestep="0.001"/><worldbody>
  <body name="a" pos="0 0 1"><joint name="p" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .4 0 0" size=".02"/>
    <body name="b" pos=".4 0 0"><joint name="q" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 .3" size=".02"/>
    </body></body>
  <body name="c" pos="1 0 1"><joint name="r" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .5" size=".02"/></body>
  <body name="d" pos="0 1 1"><joint name="s" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body>
  <body name="f" pos="3 0 1"><freejoint/><geom size=".1"/></body>
  <body name="g" pos="3 .5 1"><freejoint/><geom size=".1"/></body>
  </worldbody><contact><exclude body1="a" body2="b"/></contact><equality>{equality}</equality></mujoco>"""
EQUALITIES = {
    "connect": '<connect body1="b" body2="c" anchor=".3 0 .3"/>',
    "connect to the world": '<connect body1="b" anchor=".1 0 .1"/>',
    "weld": '<weld body1="f" body2="g"/>',
    "joint": '<joint joint1="p" joint2="s" polycoef="0.1 -2 0 0 0"/>',
    "held joint": '<joint joint1="s" polycoef="0 0 0 0 0"/>',
}


@pytest.mark.parametrize("equality", EQUALITIES.values(), ids=EQUALITIES)
def test_an_equality_of_a_mjcf_holds_as_in_mujoco(tmp_path, equality):
    """Accelerations at the start are those that MuJoCo's constraints lead to as they become stiff."""
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "model.xml").write_text(MJCF.format(equality=equality))
    scene = mbvi.Scene()
    scene.add_mjcf(tmp_path / "model.xml")
    problem = scene.build()
    q, v = problem.q0, np.zeros(problem.system.nv)
    found = problem.system.acceleration(0.0, q, v)
    assert np.abs(problem.system.gaps(q)).max() <= 1e-13
    # the same equations, with the rows that MuJoCo has
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    d = mujoco.MjData(m)
    hinges = [m.jnt_qposadr[j] for j in range(m.njnt) if m.jnt_type[j] == 3]
    d.qpos[hinges] = q[: len(hinges)]
    mujoco.mj_forward(m, d)
    M = np.zeros((m.nv, m.nv))
    # older versions take the sparse matrix instead of the data
    mujoco.mj_fullM(m, d, M) if not hasattr(d, "qM") else mujoco.mj_fullM(m, M, d.qM)
    J = np.zeros((d.nefc, m.nv))
    J[:] = d.efc_J.reshape(-1, m.nv) if not mujoco.mj_isSparse(m) else _dense(mujoco, m, d)
    free = np.linalg.solve(M, d.qfrc_bias * -1.0)
    response = J @ np.linalg.solve(M, J.T)
    expected = free - np.linalg.solve(M, J.T @ np.linalg.lstsq(response, J @ free, rcond=1e-12)[0])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)


WELDS = ("", 'relpose=".4 .5 .6 1 0 0 0"', 'relpose=".4 .5 .6 1 0 0 .5"')
FREE_BODIES = """<mujoco><worldbody><body name="a" pos="1 0 0"><freejoint/><geom size=".1"/></body>
  <body name="b" pos="1 .7 0" euler="0 0 30"><freejoint/><geom size=".1"/></body></worldbody>
  <equality>{}</equality></mujoco>"""


@pytest.mark.parametrize("other", ['body2="b"', ""], ids=["bodies", "world"])
@pytest.mark.parametrize("relpose", WELDS, ids=["as they are", "apart", "turned"])
@pytest.mark.parametrize("torque", ["", 'torquescale="0"'], ids=["weld", "point"])
def test_a_weld_with_an_anchor_is_closed_where_mujoco_closes_it(tmp_path, other, relpose, torque):
    """By MuJoCo's own residual at the start; without a torque a weld holds its point only."""
    mujoco = pytest.importorskip("mujoco")
    weld = f'<weld body1="a" {other} anchor=".1 .2 .3" {relpose} {torque}/>'
    (tmp_path / "model.xml").write_text(FREE_BODIES.format(weld))
    scene = mbvi.Scene()
    scene.add_mjcf(tmp_path / "model.xml")
    problem = scene.build()
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    d, q = mujoco.MjData(m), problem.q0
    # quaternions begin with w in MuJoCo
    d.qpos[:] = np.concatenate([np.r_[part[:3], part[6], part[3:6]] for part in (q[:7], q[7:])])
    mujoco.mj_forward(m, d)
    rows = 3 if torque else 6
    assert np.abs(d.efc_pos[:6]).max() <= 1e-12
    assert len(problem.system.gaps(q)) == rows


def test_a_weld_that_closes_upside_down_is_refused(tmp_path):
    """Its rows are zero there, too. It starts a quarter of a turn from either."""
    pytest.importorskip("mujoco")
    (tmp_path / "model.xml").write_text(FREE_BODIES.format('<weld body1="a" relpose=".4 .5 .6 1 0 0 1"/>'))
    scene = mbvi.Scene()
    scene.add_mjcf(tmp_path / "model.xml")
    with pytest.raises(mbvi.InadmissibleStartError, match="turned by 180 degrees relative to world"):
        scene.build()


@pytest.mark.parametrize("angle", [1.8, 2.0, 3.0])
def test_a_weld_that_would_close_upside_down_is_refused_with_what_it_is_off_by(tmp_path, angle):
    pytest.importorskip("mujoco")
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    weld = f'<weld body1="a" relpose=".4 .5 .6 {c} 0 0 {s}"/>'
    (tmp_path / "model.xml").write_text(FREE_BODIES.format(weld))
    scene = mbvi.Scene()
    scene.add_mjcf(tmp_path / "model.xml")
    words = f"is off by {angle:.3g} rad at the start.*turned by 180 degrees relative to world; start within 1 rad"
    with pytest.raises(mbvi.InadmissibleStartError, match=words):
        scene.build()


def test_an_equality_of_bodies_that_move_as_one_is_left_out(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "model.xml").write_text("""<mujoco><worldbody><body name="a"><joint/><geom size=".1"/>
      <body name="b" pos="0 0 1"><geom size=".1"/></body></body><body name="w" pos="1 0 0"><geom size=".1"/></body>
      </worldbody><equality><weld name="one" body1="w"/><connect name="two" body1="a" body2="b" anchor="0 0 1"/>
      </equality></mujoco>""")
    scene = mbvi.Scene()
    with pytest.warns(mbvi.MbviWarning, match="equality constraint one.*equality constraint two"):
        scene.add_mjcf(tmp_path / "model.xml")
    assert not scene.build(resolve=True).system.equalities


def _dense(mujoco, m, d):
    J = np.zeros((d.nefc, m.nv))
    mujoco.mju_sparse2dense(J, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
    return J


@pytest.mark.parametrize("kind", ["weld", "connect"])
def test_an_equality_that_is_off_can_be_switched_on(tmp_path, kind):
    """Both fall on their own before, and as one body after: the second has a spin."""
    pytest.importorskip("mujoco")
    more = 'anchor="0 .3 0"' if kind == "connect" else ""
    (tmp_path / "model.xml").write_text(
        MJCF.format(equality=f'<{kind} name="w" body1="f" body2="g" active="false" {more}/>')
    )
    scene = mbvi.Scene()
    name = scene.add_mjcf(tmp_path / "model.xml", name="m")
    problem = scene.build()
    assert not len(problem.system.gaps(problem.q0))
    v0, nv = problem.v0.copy(), problem.system.nv
    v0[nv - 4 :] = 0.5, 2.0, -1.0, 3.0
    run = mbvi.simulate(
        problem.at(problem.q0, v0), mbvi.Paoli(), step=1e-3, duration=0.2,
        switch=lambda state: {f"{name}_w": state.t > 0.0995}, progress=False,
    )  # fmt: skip
    f, g = (problem.system.bodies.index(f"{name}/{body}_joint") for body in "fg")

    def relative(q):
        poses = problem.system.placements(q, np.array([f, g]))
        origin = (poses[1, 3] - poses[0, 3]) @ poses[0, :3].T
        return origin, poses[1, :3] @ poses[0, :3].T

    (start, _), (on, turned), (end, turned_at_end) = (relative(run.q[k]) for k in (0, 100, 200))
    assert np.abs(on - start).max() > 1e-2
    if kind == "weld":
        np.testing.assert_allclose(end, on, atol=1e-12)
        np.testing.assert_allclose(turned_at_end, turned, atol=1e-12)
    else:
        # the anchor, in both
        anchor = np.array([0.0, 0.3, 0.0])
        np.testing.assert_allclose(end + ((anchor - on) @ turned.T) @ turned_at_end, anchor, atol=1e-12)
        assert np.abs(turned_at_end - turned).max() > 1e-2


def test_a_loop_that_nothing_closes_raises(tmp_path):
    pytest.importorskip("mujoco")
    apart = '<joint joint1="p" joint2="s"/><joint joint1="p" joint2="s" polycoef="1 1 0 0 0"/>'
    (tmp_path / "model.xml").write_text(MJCF.format(equality=apart))
    scene = mbvi.Scene()
    scene.add_mjcf(tmp_path / "model.xml")
    with pytest.raises(mbvi.InadmissibleStartError, match="open by 1 at the start, and no motion closes them"):
        scene.build()


def test_a_state_that_opens_loops_is_refused():
    problem = four_bar().build()
    q = problem.q0.copy()
    q[0] += 0.1
    with pytest.raises(mbvi.InadmissibleStartError, match=r"opens loops or couplings, by 0\.1"):
        problem.at(q, problem.v0, check=True)


def test_connected_bodies_in_a_plane_are_built_in_space():
    scene = pendulum(plane="xz")
    scene.connect("rod", "bob", at=(0, 0, -0.5))
    with pytest.raises(mbvi.InputError, match="bodies that move in a plane cannot be connected"):
        scene.build()
    assert scene.build(reduce=[]).system.nv == 9


def mistakes():
    at = {"at": (0, 0, 0)}
    yield "unknown body", lambda s: s.connect("rod", "nothing", **at), "'nothing' is no body of this scene"
    yield "a robot", lambda s: s.weld("rod", "hopper"), "hopper is a robot; name one of its links: hopper/trunk"
    yield "itself", lambda s: s.weld("rod", "rod"), "rod and rod is one body: there is nothing to connect"
    yield "two of the world", lambda s: s.connect("world", "wall", **at), "world and wall do not move"
    yield "a wall that moves", lambda s: s.weld("rod", "table"), "table has a prescribed motion"
    yield "no point", lambda s: s.connect("rod", "bob", at=(0, 0)), "at"
    yield "no axis", lambda s: s.hinge("rod", "bob", axis=(0, 0, 0), **at), "axis is zero"
    yield "the name of the world", lambda s: s.add_box((1, 1, 1), name="world"), "the name 'world' is taken"
    yield "a name twice", lambda s: s.connect("rod", "bob", name="rod", **at), "the name 'rod' is taken"
    yield (
        "unknown joint",
        lambda s: s.couple("hopper/hip", "hopper/ankle"),
        "'hopper/ankle' is no joint with one degree",
    )
    yield "no robot", lambda s: s.couple("hopper/hip", "rod"), "'rod' is no joint with one degree of freedom"
    yield "one joint", lambda s: s.couple("hopper/hip", "hopper/hip"), "hopper/hip cannot be coupled with itself"
    yield "no number", lambda s: s.couple("hopper/hip", "hopper/knee", ratio=np.nan), "ratio"


@pytest.mark.parametrize(("call", "told"), [m[1:] for m in mistakes()], ids=[m[0] for m in mistakes()])
def test_a_connection_that_cannot_be_is_refused(call, told):
    scene = pendulum()
    scene.add_box((1, 1, 1), position=(9, 0, 0), fixed=True, name="wall")
    table = mbvi.motion.Translation((1, 0, 0))
    scene.add_box((1, 1, 1), position=(9, 9, 0), fixed=True, motion=table, name="table")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(5, 0, 1))
    with pytest.raises(mbvi.InputError, match=told):
        call(scene)


def test_a_sphere_that_does_not_turn_is_held_at_its_centre():
    scene = pendulum()
    scene.connect("rod", "bob", at=(0, 0, -0.4))
    with pytest.raises(
        mbvi.InputError, match="connection would turn bob, which has no rotation in a scene without fric"
    ):
        scene.build()
    rough = pendulum(friction=0.3)
    rough.connect("rod", "bob", at=(0, 0, -0.4))
    assert rough.build().system.nv == 12


def test_too_many_bodies_cannot_be_connected():
    scene = pendulum()
    scene.add_spheres(np.random.default_rng(0).uniform(1, 200, size=(300, 3)), 0.1, mass=1.0)
    scene.connect("rod", "bob", at=(0, 0, -0.5))
    with pytest.raises(mbvi.InputError, match="bodies of at most 600 velocities can be connected"):
        scene.build()
