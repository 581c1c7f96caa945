"""Springs and actuators of a MJCF are MuJoCo's, in Python and in kernels; what is not modelled is named."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.run.loop.loop_scope import control_of
from mbvi.scene.mjcf.model import load_mjcf
from mbvi.system.control_table import write_torque
from support.beside_mujoco import Beside, scene_of

mujoco = pytest.importorskip("mujoco")

ARM = """<mujoco model="arm"><compiler angle="radian"/><default><geom contype="0" conaffinity="0"/></default>
  <worldbody><body><joint name="s" axis="0 0 1" stiffness="2" springref=".3" damping=".1"/>
    <geom size=".1" pos=".3 0 0"/>
    <body pos=".4 0 0"><joint name="e" axis="0 1 0" ref=".2" armature=".01"/><geom size=".05" pos=".2 0 0"/>
      <body pos=".3 0 0"><joint name="w" type="slide" axis="0 0 1"/><geom size=".05"/></body></body></body></worldbody>
  <tendon><fixed name="t"><joint joint="e" coef="2"/><joint joint="w" coef="-1"/></fixed></tendon>
  <actuator><position name="hold" joint="s" kp="5" kv=".2" forcerange="-1 1" ctrlrange="-2 2"/>
    <motor tendon="t" gear="3"/><velocity joint="w" kv="3" gear="-2"/></actuator>
  <keyframe><key name="home" qpos=".1 .2 .3" ctrl=".4 -.5 .6"/></keyframe></mujoco>"""


def words(*values):
    return " ".join(f"{float(value):.6g}" for value in np.ravel(values))


def drawn_model(rng):
    """Return a chain of joints of all kinds, with springs, tendons and actuators of all kinds that are modelled."""
    kinds = ["hinge", "slide", "hinge", "ball", "slide", "hinge"]
    rng.shuffle(kinds)
    bodies, end, ball, scalar = "", "", f"j{kinds.index('ball')}", []
    for k, kind in enumerate(kinds):
        spring = f"stiffness='{words(5 * rng.random())}' damping='{words(rng.random())}'"
        if kind != "ball":
            scalar.append(f"j{k}")
            spring += (
                f" axis='{words(rng.normal(size=3))}' springref='{words(rng.normal())}' ref='{words(rng.normal())}'"
            )
            if len(scalar) in (1, 5):
                # no other actuator drives it
                spring += f" actuatorfrcrange='{words(-rng.random(), rng.random())}'"
        bodies += f"<body pos='{words(rng.normal(size=3))}' euler='{words(rng.normal(size=3))}'>"
        bodies += f"<joint name='j{k}' type='{kind}' pos='{words(0.1 * rng.normal(size=3))}' {spring}/>"
        bodies += f"<geom type='box' size='.1 .2 .05' pos='{words(0.1 * rng.normal(size=3))}'/>"
        end += "</body>"
    over = "".join(f"<joint joint='{name}' coef='{words(rng.normal())}'/>" for name in scalar[1:4])
    lengths = np.sort(rng.normal(size=2))
    tendons = f"<fixed name='t' stiffness='3' damping='.4' springlength='{words(lengths)}'>{over}</fixed>"
    tendons += f"<fixed name='u' stiffness='2' actuatorfrcrange='-.3 .4'>{over}</fixed>"

    def limited():
        low, high = -rng.random(2), rng.random(2)
        some = [f"ctrlrange='{words(low[0], high[0])}'", f"forcerange='{words(low[1], high[1])}'"]
        return " ".join(rng.choice(some, int(rng.integers(3)), replace=False))

    def gear():
        return f"gear='{words(rng.normal(size=3))}'"

    kp, kv = words(3 * rng.random()), words(rng.random())
    actuators = [
        f"<motor joint='{scalar[0]}' {gear()} {limited()}/>",
        f"<position jointinparent='{scalar[1]}' kp='{kp}' kv='{kv}' {gear()} {limited()}/>",
        f"<velocity tendon='t' kv='{kv}' {gear()} {limited()}/>",
        f"<position tendon='u' kp='{kp}' {gear()} {limited()}/>",
        f"<general joint='{ball}' {gear()} gainprm='2' biastype='affine' biasprm='.3 0 -.5' {limited()}/>",
        f"<general joint='{scalar[4]}' {gear()} gainprm='-2' biastype='affine' biasprm='.1 1 -.5' {limited()}/>",
    ]
    free = "<body><freejoint/><geom size='.3'/>" if rng.integers(2) else "<body><joint/><geom size='.3'/>"
    default = "<default><geom contype='0' conaffinity='0'/></default><compiler angle='radian'/>"
    return (
        f"<mujoco model='m'>{default}<worldbody>{free}{bodies}{end}</body></worldbody><tendon>{tendons}</tendon>"
        f"<actuator>{''.join(actuators)}</actuator></mujoco>"
    )


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 2**31))
def test_accelerations_are_mujocos(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    text = drawn_model(rng)
    scene, name, m = scene_of(text, tmp_path_factory.getbasetemp())
    problem = scene.build(())
    both = Beside(m, problem.model(name))
    for _ in range(5):
        qpos, qvel = both.random(rng)
        problem.ctrl[:] = ctrl = 2.0 * rng.normal(size=m.nu)
        q, v = both.q(qpos), both.turn(qpos) @ qvel
        theirs = both.acceleration(qpos, qvel, ctrl)
        ours = problem.system.acceleration(0.0, q, v)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10 * (1.0 + np.abs(theirs).max()))


def test_the_torque_is_the_law_with_both_limits(tmp_path):
    scene, name, _ = scene_of(ARM, tmp_path, ctrl={"hold": 0.5})
    problem = scene.build()
    q, v = np.array([0.4, 0.1, 0.3]), np.array([0.2, -0.3, 0.5])

    def torque():
        return problem.system.torque(0.0, q, v)

    spring = 2.0 * (0.3 - 0.4)
    np.testing.assert_allclose(torque(), [spring + 5 * (0.5 - 0.4) - 0.2 * 0.2, 0, -2 * 3 * (0 - -2 * 0.5)], atol=1e-15)
    assert problem.ctrl.names == ("hold", "t", "w") and dict(problem.ctrl) == {"hold": 0.5, "t": 0.0, "w": 0.0}
    problem.ctrl[:] = [1.9, 0.7, 0.0]
    # the force is at its limit; a tendon's force acts on both joints
    np.testing.assert_allclose(torque()[:2], [spring + 1.0, 2 * 3 * 0.7], atol=1e-15)
    np.testing.assert_allclose(torque()[2], -3 * 0.7 - 6 * 2 * 0.5, atol=1e-14)
    problem.ctrl["hold"] = -9.0
    q[0] = -2.1
    # the input is: 5 (-2 + 2.1)
    np.testing.assert_allclose(torque()[0], 2.0 * (0.3 + 2.1) + 0.5 - 0.04, atol=1e-14)
    np.testing.assert_array_equal(problem.ctrl.ranges, [[-2, 2], [-np.inf, np.inf], [-np.inf, np.inf]])
    np.testing.assert_array_equal(problem.ctrl[1:], [0.7, 0.0])
    assert "actuators hold, t, w" in problem.report() and "1 springs" in problem.report()
    found = load_mjcf(tmp_path / "model.xml", pin.SE3.Identity(), name)
    assert found.forces.friction == {}


def test_inputs_are_given_by_keyframe_name_array_and_function(tmp_path):
    home = {"hold": 0.4, "t": -0.5, "w": 0.6}
    for how, wanted in (
        ({"keyframe": "home"}, home), ({"keyframe": "home", "ctrl": {"t": 1}}, {**home, "t": 1.0}),
        ({"ctrl": [1, 2, 3]}, {"hold": 1, "t": 2, "w": 3}), ({}, dict.fromkeys(home, 0.0)),
    ):  # fmt: skip
        assert dict(scene_of(ARM, tmp_path, **how)[0].build().ctrl) == wanted
    scene, _, _ = scene_of(ARM, tmp_path, ctrl=lambda t, q, v: [t, q[0], v[1]])
    problem, (fixed, _, _) = scene.build(), scene_of(ARM, tmp_path, ctrl=[0.3, 0.1, 0.5])
    state = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])
    wanted = fixed.build().system.torque(0.0, *state)
    np.testing.assert_array_equal(problem.system.torque(0.3, *state), wanted)
    with pytest.raises(mbvi.InputError, match="computed by a function"):
        problem.ctrl["hold"] = 1.0


def test_problems_of_a_scene_and_copies_have_their_own_inputs(tmp_path):
    scene, _, _ = scene_of(ARM, tmp_path)
    first, second = scene.build(), scene.build()
    copies = [copy.deepcopy(first), pickle.loads(pickle.dumps(first))]
    first.ctrl["t"] = 0.5
    assert [one.ctrl["t"] for one in (first, first.at(first.q0, first.v0), second, *copies)] == [0.5, 0.5, 0, 0, 0]
    copies[1].ctrl["hold"] = 0.1
    np.testing.assert_allclose(copies[1].system.torque(0.0, np.zeros(3), np.zeros(3))[0], 0.6 + 0.5)
    scene.add_mjcf(tmp_path / "model.xml", name="other", position=(0, 0, 1))
    both = scene.build()
    assert both.ctrl.names[::3] == ("arm/hold", "other/hold")
    both.ctrl["other/t"] = 0.2
    assert both.ctrl[:].tolist() == [0, 0, 0, 0, 0.2, 0]


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered()], ids=str)
def test_kernels_and_python_take_the_same_steps(scheme, tmp_path):
    rng = np.random.default_rng(3)
    scene, _, _ = scene_of(drawn_model(rng), tmp_path)
    problem = scene.build()
    problem.ctrl[:] = rng.normal(size=6)
    problem = problem.at(problem.q0, 0.3 * rng.normal(size=problem.system.nv))
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.05)
    steps = mbvi.steps(problem, scheme, step=1e-3)
    for _ in range(50):
        last = next(steps)
    np.testing.assert_allclose(last.q, run.q[-1], atol=1e-12)
    np.testing.assert_allclose(last.v, run.v[-1], atol=1e-12)


@pytest.mark.filterwarnings("ignore:contacts of")
def test_several_robots_share_one_table(tmp_path):
    rng = np.random.default_rng(4)
    scene, _, _ = scene_of(drawn_model(rng), tmp_path)
    (tmp_path / "arm.xml").write_text(ARM)
    scene.add_mjcf(tmp_path / "arm.xml", control=mbvi.PDControl({"s": 0.1, "w": 0.2}, 3.0, 0.4))
    scene.add_mjcf(tmp_path / "arm.xml", position=(0, 0, 9))
    scene.add_urdf("robot:hopper", position=(9, 9, 9), control=mbvi.ConstantTorque([1.0, 2.0]))
    scene.add_box((1, 1, 1), position=(-9, 9, 9))
    problem = scene.build()
    problem.ctrl[:] = rng.normal(size=len(problem.ctrl))
    system = problem.system
    q, v = system.integrate(problem.q0, rng.normal(size=system.nv)), rng.normal(size=system.nv)
    table, acted = control_of(system)
    torque = np.full(system.nv, np.nan)
    write_torque(table, 0.0, q, v, torque)
    assert acted.tolist() == [0, system.nq, 0, system.nv]
    np.testing.assert_allclose(torque, system.torque(0.0, q, v), atol=1e-13)


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_springs_keep_the_energy(kind, tmp_path):
    text = f"""<mujoco model="m"><worldbody><body><joint name="a" type="{kind}" stiffness="4"/>
      <geom type="box" size=".1 .2 .3" pos=".3 .1 0" contype="0" conaffinity="0"/>
      <body pos=".5 0 0"><joint name="b" axis="0 1 0"/>
      <geom size=".1" pos=".2 0 0" contype="0" conaffinity="0"/></body></body></worldbody>
      <tendon><fixed stiffness="90" springlength="-.1 .2"><joint joint="b" coef="1"/></fixed></tendon></mujoco>"""
    scene, _, _ = scene_of(text, tmp_path)
    problem = scene.build()
    start = problem.at(problem.q0, np.linspace(2.0, -1.0, problem.system.nv))
    run = mbvi.simulate(start, mbvi.EventDriven(tolerance=1e-10), duration=1.0)
    assert np.ptp(run.energies()[0]) > 0.1
    np.testing.assert_allclose(run.energy(), run.energy()[0], atol=1e-7)


def test_the_motion_is_mujocos(tmp_path):
    scene, _, m = scene_of(ARM.replace('forcerange="-1 1"', ""), tmp_path, keyframe="home")
    problem = scene.build()
    m.opt.integrator, m.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 2.5e-4
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    for _ in range(800):
        mujoco.mj_step(m, d)
    run = mbvi.simulate(problem, mbvi.EventDriven(tolerance=1e-11), duration=0.2)
    np.testing.assert_allclose(run.q[-1], d.qpos, atol=1e-8)
    np.testing.assert_allclose(run.v[-1], d.qvel, atol=1e-8)


def test_a_rollout_takes_inputs_of_each_step_and_a_simulator_those_of_now(tmp_path):
    rng = np.random.default_rng(5)
    scene, _, _ = scene_of(ARM, tmp_path)
    problem = scene.build()
    ctrl, starts = rng.normal(size=(3, 20, 3)), np.zeros((3, 3))
    many = mbvi.rollout(problem, starts, starts, scheme=mbvi.Paoli(), steps=20, step=1e-3, ctrl=ctrl, threads=2)
    assert not many.status.any()
    simulator = mbvi.Simulator(problem, mbvi.Paoli(), step=1e-3)
    simulator.reset(starts[1], starts[1])
    for k in range(20):
        problem.ctrl[:] = ctrl[1, k]
        simulator.step()
        np.testing.assert_array_equal(simulator.q, many.q[1, k + 1])
    one = mbvi.rollout(problem, starts, starts, scheme=mbvi.Paoli(), steps=20, step=1e-3, ctrl=ctrl[2])
    np.testing.assert_array_equal(one.q[0], many.q[2])


def test_a_control_replaces_actuators_and_no_springs(tmp_path):
    torque = mbvi.ConstantTorque([1.0, 2.0, 3.0])
    scene, _, _ = scene_of(ARM, tmp_path, control=torque)
    problem = scene.build()
    np.testing.assert_allclose(problem.system.torque(0.0, np.zeros(3), np.ones(3)), [1.6, 2.0, 3.0])
    assert not problem.ctrl and "control acts in their place" in problem.report()
    start, each = (problem.q0[None], problem.v0[None]), np.tile([1.0, 2.0, 3.0], (3, 1))
    found = mbvi.rollout(problem, *start, scheme=mbvi.Paoli(), steps=3, control=each)
    np.testing.assert_array_equal(found.q[0], mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=3e-3).q)


def test_a_locked_joint_keeps_its_part_of_a_length(tmp_path):
    text = ARM.replace('<motor tendon="t" gear="3"/>', '<position tendon="t" kp="4"/>')
    text = text.replace('name="t"', 'name="t" stiffness="2" springlength=".1"')
    free, _, _ = scene_of(text, tmp_path, joints={"e": 0.4}, ctrl=[0.1, 0.2, 0.3])
    held, _, _ = scene_of(text, tmp_path, joints={"e": 0.4}, ctrl=[0.1, 0.2, 0.3], locked=["e"])
    whole, part = free.build(), held.build()
    q, v = np.array([0.2, 0.4, -0.3]), np.array([0.1, 0.0, 0.5])
    wanted = whole.system.torque(0.0, q, v)[[0, 2]]
    np.testing.assert_allclose(part.system.torque(0.0, q[[0, 2]], v[[0, 2]]), wanted, atol=1e-14)


def test_a_run_keeps_springs_and_actuators_in_its_file(tmp_path):
    scene, _, _ = scene_of(ARM, tmp_path)
    problem = scene.build()
    problem.ctrl["t"] = 0.3
    run = mbvi.simulate(problem, step=1e-3, duration=0.05, out=tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    assert not again.problem.not_kept and again.problem.report() == run.problem.report()
    assert dict(again.problem.ctrl) == {"hold": 0.0, "t": 0.3, "w": 0.0}
    np.testing.assert_array_equal(mbvi.simulate(again.problem, step=1e-3, duration=0.05).q, run.q)
    # what is set later is no part of the run
    problem.ctrl["t"] = 0.9
    run.save(tmp_path / "later.h5")
    assert mbvi.load(tmp_path / "later.h5").problem.ctrl["t"] == 0.3 and problem.ctrl["t"] == 0.9

    def drive(t, q, v):
        return [np.sin(t), 0.1, 0.2]

    scene, _, _ = scene_of(ARM, tmp_path, ctrl=drive)
    run = mbvi.simulate(scene.build(), step=1e-3, duration=0.05, out=tmp_path / "driven.h5")
    with pytest.warns(mbvi.MbviWarning, match="could not keep: control of robot 'arm'"):
        assert mbvi.load(tmp_path / "driven.h5").problem.not_kept == ("control of robot 'arm'",)
    again = mbvi.load(tmp_path / "driven.h5", control={"arm": drive})
    np.testing.assert_array_equal(mbvi.simulate(again.problem, step=1e-3, duration=0.05).q, run.q)


@pytest.mark.parametrize(
    ("ends", "wanted"),
    [
        ('tendon1="t" polycoef=".3 0 0 0 0"', ("arm/e", "arm/w", 0.5, 0.35)),
        ('tendon1="t" tendon2="u" polycoef="0 1 0 0 0"', ("arm/w", "", 0.0, -0.8)),
        ('tendon1="t" tendon2="u" polycoef="0 1 .5 0 0"', None),
    ],
)
def test_an_equality_of_fixed_tendons_couples_joints(ends, wanted, tmp_path):
    text = ARM.replace("</tendon>", '<fixed name="u"><joint joint="e" coef="2"/></fixed></tendon>')
    text = text.replace("</mujoco>", f'<equality><tendon name="c" {ends}/></equality></mujoco>')
    if wanted is None:
        with pytest.warns(mbvi.MbviWarning, match="equality constraint c"):
            scene_of(text, tmp_path)
        return
    scene, _, m = scene_of(text, tmp_path)
    (coupling,) = scene.build(resolve=True).scene.items.couplings
    assert (coupling.first, coupling.second) == wanted[:2]
    # MuJoCo's residual is zero at the coupling's own positions
    d = mujoco.MjData(m)
    q = {"arm/s": 0.0, "arm/w": 0.7, "arm/e": 0.2}
    q[coupling.first] = coupling.ratio * q.get(coupling.second, 0.0) + coupling.offset
    d.qpos[:] = q["arm/s"], q["arm/e"], q["arm/w"]
    mujoco.mj_forward(m, d)
    np.testing.assert_allclose(d.efc_pos[d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY], 0.0, atol=1e-14)


LEFT_OUT = """<mujoco model="m"><worldbody><site name="w"/>
  <body><joint name="a" frictionloss=".2" actuatorfrcrange="-1 1"/><geom size=".1" pos=".3 0 0"/><site name="s"/>
    <body pos="1 0 0"><joint name="b" type="ball"/><geom size=".1"/></body></body>
  <body pos="3 0 0"><freejoint name="f"/><geom size=".1"/></body></worldbody>
  <tendon><spatial name="rope"><site site="w"/><site site="s"/></spatial>
    <fixed name="t" limited="true" range="-1 1" frictionloss=".1"><joint joint="a" coef="1"/></fixed></tendon>
  <actuator><motor name="one" joint="a"/><motor name="two" joint="a"/><motor name="rope" tendon="rope"/>
    <motor name="site" site="s"/><general name="slow" joint="a" dyntype="filter"/>
    <muscle name="muscle" joint="a" lengthrange="0 1"/><general name="gain" joint="a" gaintype="affine"/>
    <motor name="free" joint="f"/><motor name="ball" jointinparent="b"/><motor name="off" joint="a" group="3"/>
    <position name="servo" joint="b" kp="1"/>
  </actuator></mujoco>"""


def test_what_is_not_modelled_is_named(tmp_path):
    text = LEFT_OUT.replace("<worldbody>", '<option actuatorgroupdisable="3"/><worldbody>', 1)
    with pytest.warns(mbvi.MbviWarning) as caught:
        scene, name, _ = scene_of(text, tmp_path)
    report, (warning,) = scene.build().report(), caught
    missing = ["rope", "site", "slow", "muscle", "gain", "free", "ball", "off", "servo"]
    for what in (
        *(f"actuator {one}" for one in missing), "tendon rope", "limits of tendon t", "dry friction of tendon t",
        "actuatorfrcrange of a",
    ):  # fmt: skip
        assert what in str(warning.message) and what in report, what
    assert "actuator one" not in report and scene.build().ctrl.names == ("one", "two")
    file = Path(tmp_path / "model.xml")
    assert load_mjcf(file, pin.SE3.Identity(), name).forces.friction == {"a": 0.2}


def test_actuators_of_groups_that_no_file_can_disable_act(tmp_path):
    for group in (-1, 31, 40):
        text = ARM.replace("<position ", f'<position group="{group}" ', 1)
        text = text.replace("<worldbody>", '<option actuatorgroupdisable="7 30"/><worldbody>', 1)
        scene, _, m = scene_of(text, tmp_path)
        assert m.actuator_group.tolist().count(group) == 1
        assert len(scene.build().ctrl) == m.nu


@pytest.mark.parametrize("flag", ["spring", "actuation", "clampctrl"])
def test_flags_are_honoured(flag, tmp_path, recwarn):
    text = ARM.replace("<worldbody>", f'<option><flag {flag}="disable"/></option><worldbody>')
    scene, name, m = scene_of(text, tmp_path)
    problem = scene.build()
    assert (flag == "actuation") == bool(len(recwarn)) == (len(problem.ctrl) == 0)
    if problem.ctrl:
        problem.ctrl[:] = [3.0, 0.5, 0.2]
    both = Beside(m, problem.model(name))
    qpos, qvel = np.array([0.4, 0.1, 0.3]), np.array([0.2, -0.3, 0.5])
    wanted = both.acceleration(qpos, qvel, [3.0, 0.5, 0.2])
    np.testing.assert_allclose(problem.system.acceleration(0.0, qpos, qvel), wanted, rtol=1e-11, atol=1e-10)


def test_stiff_actuators_are_named_before_the_first_step(tmp_path):
    scene, _, _ = scene_of(ARM.replace('kp="5" kv=".2"', 'kp="5" kv="9000"'), tmp_path)
    notes = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=2e-3).notes
    assert any("joint s has a stiffness of 5 and a damping of 9e+03" in note for note in notes)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"ctrl": {"none": 1.0}}, "no actuator 'none'; known are hold, t, w"),
        ({"ctrl": [1.0, 2.0]}, "ctrl"),
        ({"ctrl": {"t": np.nan}}, "ctrl"),
        ({"ctrl": {"t": 1.0}, "control": mbvi.ConstantTorque([0.0])}, "either control"),
    ],
)
def test_wrong_inputs_are_refused(wrong, said, tmp_path):
    with pytest.raises(mbvi.InputError, match=said):
        scene_of(ARM, tmp_path, **wrong)


def test_wrong_inputs_of_a_problem_are_refused(tmp_path):
    problem = scene_of(ARM, tmp_path)[0].build()
    for key, value in (("none", 1.0), (slice(None), [1.0]), ("t", [1.0, 2.0]), ("t", np.inf), (3, 1.0), (None, 1.0)):
        with pytest.raises(mbvi.InputError):
            problem.ctrl[key] = value
    assert not problem.ctrl[:].any()
    start = np.zeros((1, 3))
    for wrong in ({"ctrl": np.zeros((5, 2))}, {"ctrl": np.zeros((5, 3)), "control": np.zeros((5, 3))}):
        with pytest.raises(mbvi.InputError):
            mbvi.rollout(problem, start, start, steps=5, **wrong)
    with pytest.raises(mbvi.InputError, match=r"ctrl .* returned shape \(1,\); \(3,\) is expected"):
        scene_of(ARM, tmp_path, ctrl=lambda t, q, v: [1.0])[0].build()
