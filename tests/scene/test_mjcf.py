"""A MJCF in mbvi has MuJoCo's mass matrix, bias and free motion; what is not taken is named."""

import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.geometry.shapes.shapes import Hull
from support.beside_mujoco import Beside, full_mass, scene_of

mujoco = pytest.importorskip("mujoco")

FLOOR = '<geom name="floor" type="plane" size="1 1 .1"/>'
WALKER = """<mujoco model="walker">
  <compiler angle="degree" eulerseq="zyx" inertiafromgeom="auto"/>
  <default><joint armature=".03" damping=".1"/><geom density="700"/>
    <default class="arm"><joint axis="1 2 3" armature=".2"/></default></default>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="trunk" pos="0 0 1" euler="30 20 10"><freejoint/><geom type="box" size=".2 .1 .05"/>
      <body name="a" pos=".3 0 .01" quat="1 .2 .3 .1">
        <joint name="j1" axis="0 1 0" pos=".1 .02 0" ref="20" range="-90 90"/>
        <joint name="j2" type="slide" axis="1 1 0" ref=".1" range="-.5 .5" limited="true"/>
        <joint name="j3" class="arm" pos="0 .1 0"/>
        <geom type="capsule" fromto="0 0 0 .1 .2 .3" size=".04"/>
        <frame pos="0 .1 0" euler="0 0 40"><body name="b" pos=".4 .2 0">
          <joint name="ball" type="ball" pos="0 0 .1"/><geom type="ellipsoid" size=".1 .05 .07"/>
          <body name="weld" pos="0 0 .2"><geom type="cylinder" size=".04 .1"/></body>
        </body></frame>
      </body>
    </body>
  </worldbody></mujoco>"""
ARM = """<mujoco model="arm"><compiler angle="radian"/><worldbody>
  <body name="base" pos=".1 .2 .3" quat="1 1 0 0"><geom type="cylinder" size=".1 .05"/>
    <body name="upper" pos="0 .1 .2"><joint name="s" axis="0 0 1" range="-2 2" armature=".1"/>
      <inertial pos=".1 .02 0" mass="2" fullinertia=".02 .03 .04 .001 .002 .003"/>
      <body name="lower" pos=".4 0 0" axisangle="0 1 0 .4"><joint name="e" axis="0 1 0" ref=".3" springref=".1"/>
        <joint name="w" type="slide" axis="0 0 -1"/><geom type="capsule" size=".03 .1" pos=".1 0 0"/></body>
    </body></body></worldbody></mujoco>"""
LOOSE = """<mujoco model="loose"><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="one" pos="0 0 1"><joint type="free"/><geom type="sphere" size=".1"/></body>
  <body name="two" pos="1 0 1" euler="10 20 30"><freejoint/><geom type="box" size=".1 .2 .3" pos=".1 0 0"/>
    <body pos="0 0 .4"><joint axis="1 0 0"/><joint axis="0 1 0" pos=".1 0 0"/><geom size=".05" pos="0 0 .1"/></body>
  </body></worldbody></mujoco>"""


def beside(text, folder):
    scene, name, m = scene_of(text, folder)
    problem = scene.build(())
    model = problem.model(name)
    return problem, Beside(m, model)


@pytest.mark.parametrize("text", [WALKER, ARM, LOOSE], ids=["walker", "arm", "loose"])
def test_mass_matrix_and_bias_are_mujocos(text, tmp_path):
    problem, both = beside(text, tmp_path)
    rng = np.random.default_rng(0)
    for _ in range(20):
        both.check(*both.random(rng))
    np.testing.assert_allclose(problem.q0, both.q(both.m.qpos0), atol=1e-15)


numbers = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))
triples = st.tuples(numbers, numbers, numbers)
axes = triples.filter(lambda a: np.linalg.norm(a) > 0.1)
joints = st.fixed_dictionaries(
    {"type": st.sampled_from(["hinge", "slide", "ball"]), "pos": triples, "axis": axes, "ref": numbers}
)
shapes = st.sampled_from(
    ["sphere' size='.1", "box' size='.1 .2 .05", "capsule' size='.05 .1", "cylinder' size='.1 .03"]
)
bodies = st.lists(
    st.tuples(st.integers(0, 5), triples, triples, st.lists(joints, max_size=3), shapes, triples, numbers),
    min_size=1, max_size=5,
)  # fmt: skip


def words(values):
    return " ".join(map(str, values))


def written(given, free, degrees):
    """Return a MJCF of a random tree: each body hangs on one of those before it."""
    inner = [""] * len(given)
    for k in reversed(range(len(given))):
        parent, pos, euler, jointed, shape, offset, armature = given[k]
        some = [dict(j) for j in jointed]
        # MuJoCo allows one ball or any number of others
        if any(j["type"] == "ball" for j in some):
            some = [next(j for j in some if j["type"] == "ball")]
        if not some and k == 0 and not free:
            some = [{"type": "hinge", "pos": (0, 0, 0), "axis": (0, 0, 1), "ref": 0}]
        made = "<freejoint/>" if free and k == 0 else ""
        if not made:
            for j in some:
                ref = f" ref='{j['ref']}'" if j["type"] != "ball" else ""
                made += f"<joint type='{j['type']}' pos='{words(j['pos'])}' axis='{words(j['axis'])}'{ref}"
                made += f" armature='{0.1 + abs(armature)}' damping='{abs(armature)}'/>"
        geom = f"<geom type='{shape}' pos='{words(offset)}' euler='{words(offset)}' contype='0' conaffinity='0'/>"
        body = f"<body pos='{words(pos)}' euler='{words(euler)}'>{made}{geom}{inner[k]}</body>"
        if k:
            inner[parent % k] += body
    compiler = f"<compiler angle='{'degree' if degrees else 'radian'}'/>"
    return f"<mujoco>{compiler}<worldbody>{body}</worldbody></mujoco>"


@settings(max_examples=25, deadline=None, derandomize=True)
@given(bodies, st.booleans(), st.booleans(), st.integers(0, 1000))
def test_random_trees_have_mujocos_mass_matrix_and_bias(tmp_path_factory, given, free, degrees, seed):
    text = written(given, free, degrees)
    _, both = beside(text, tmp_path_factory.getbasetemp())
    both.check(*both.random(np.random.default_rng(seed)))


@pytest.mark.parametrize("text", [WALKER, ARM], ids=["walker", "arm"])
def test_motion_without_contact_is_mujocos(text, tmp_path):
    text = text.replace('range="-2 2"', "").replace("contype", "")
    problem, both = beside(text.replace("<geom ", '<geom contype="0" conaffinity="0" '), tmp_path)
    m, d = both.m, both.d
    rng = np.random.default_rng(1)
    m.opt.integrator, m.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 2.5e-4
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    d.qpos[:], d.qvel[:] = m.qpos0, 0.5 * rng.normal(size=m.nv)
    start = both.q(d.qpos), both.turn(d.qpos) @ d.qvel
    for _ in range(800):
        mujoco.mj_step(m, d)
    run = mbvi.simulate(problem.at(*start), mbvi.EventDriven(tolerance=1e-11), duration=0.2)
    np.testing.assert_allclose(problem.system.difference(run.q[-1], both.q(d.qpos)), 0.0, atol=1e-8)
    np.testing.assert_allclose(run.v[-1], both.turn(d.qpos) @ d.qvel, atol=1e-8)
    if not problem.system.damping.any():
        energy = run.energy()
        np.testing.assert_allclose(energy, energy[0], atol=1e-8 * np.abs(energy).max())


GEOMS = """<mujoco model="box"><asset><mesh name="tetra" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/></asset>
  <worldbody><geom name="floor" type="plane" size="1 1 .1" pos="0 0 -.5"/>
    <geom name="step" type="box" size=".1 .2 .3" pos="3 0 0"/>
    <body name="table" pos="-3 0 0"><geom type="cylinder" size=".2 .1"/></body>
    <body name="one" pos="0 0 1"><freejoint/><geom type="sphere" size=".1"/><geom type="mesh" mesh="tetra"/>
      <geom type="box" size=".3 .3 .3" contype="0" conaffinity="0" mass="0"/></body>
    <body name="two" pos="0 0 2"><freejoint/><geom type="capsule" size=".1 .2" friction=".4"/></body>
    <body name="three" pos="0 0 3"><freejoint/>
      <geom type="ellipsoid" size=".1 .2 .3" contype="2" conaffinity="2"/></body>
    <body name="four" pos="0 0 4"><freejoint/><geom type="box" size=".1 .1 .1" condim="1" priority="1"/></body>
  </worldbody><contact><exclude body1="one" body2="two"/></contact></mujoco>"""  # fmt: skip


def test_geoms_walls_and_filters_are_taken(tmp_path):
    scene, _, _ = scene_of(GEOMS, tmp_path)
    problem = scene.build(())
    shapes = {s.name: s for s in problem.scene.shapes}
    assert set(shapes) == {"box/one_0", "box/one_1", "box/two", "box/three", "box/four", "step", "table"}
    assert isinstance(shapes["box/one_1"].shape, Hull) and shapes["step"].body == shapes["table"].body == 0
    assert shapes["step"].shape.size == (0.2, 0.4, 0.6) and shapes["box/two"].shape.length == 0.4
    pairs = {family.name(k) for family in problem.constraints.families for k in range(family.count)}
    touch = {frozenset(pair.split("#")[0].split(" | ")) for pair in pairs}
    assert frozenset(("box/one_0", "box/two")) not in touch
    assert frozenset(("box/one_0", "box/four")) in touch
    # the third has masks of its own
    assert not any("box/three" in pair for pair in touch)
    assert {len(pair) for pair in touch} == {2}
    # the hull, in the frame that MuJoCo centred it in, is where the file has it
    hull = shapes["box/one_1"]
    corners = hull.shape.vertices @ hull.rotation.T + hull.position
    np.testing.assert_allclose(
        sorted(corners.round(6).tolist()), [[0, 0, 0], [0, 0, 0.1], [0, 0.1, 0], [0.1, 0, 0]], atol=1e-7
    )
    items = problem.scene.items
    assert items.friction_of("box/one_0", "floor") == 1.0 and items.friction_of("box/two", "floor") == 1.0
    assert items.friction_of("box/four", "floor") == 0.0
    assert "1 geoms without contact" in problem.report() and "excluded in the file" in problem.report()
    assert items.walls["floor"].offset == -0.5


def test_it_falls_on_its_floor_and_is_read_back(tmp_path):
    scene, _, _ = scene_of(LOOSE, tmp_path, position=(0.0, 0.0, -0.5))
    run = mbvi.simulate(scene.build(), duration=0.6, step=1e-3, out=tmp_path / "run.h5")
    assert {i.constraint if hasattr(i, "constraint") else i.constraints[0] for i in run.impacts}
    again = mbvi.load(tmp_path / "run.h5")
    np.testing.assert_array_equal(again.q, run.q)
    assert again.problem.scene is not None and again.problem.report() == run.problem.report()
    more = mbvi.simulate(again.problem, duration=0.1, step=1e-3)
    np.testing.assert_array_equal(more.q, run.q[:101])
    again.replay_html(tmp_path / "run.html")


def test_a_ball_joint_in_a_robot_that_falls(tmp_path):
    scene, _, _ = scene_of(WALKER, tmp_path, base_velocity=(0.1, 0.0, 0.0, 0.0, 0.0, 1.0), velocity={"j1": 1.0})
    problem = scene.build()
    run = mbvi.simulate(problem, duration=0.5, step=1e-3)
    assert run.impacts
    np.testing.assert_allclose(np.linalg.norm(run.q[:, -4:], axis=1), 1.0, atol=1e-12)
    mbvi.simulate(problem.at(run.q[100], run.v[100]), duration=0.01, step=1e-3)


def test_a_pose_moves_the_whole_file(tmp_path):
    R = pin.rpy.rpyToMatrix(0.0, 0.0, 0.7)
    scene, name, m = scene_of(ARM, tmp_path, position=(1.0, 2.0, 3.0), rotation=R)
    problem = scene.build(())
    model = problem.model(name)
    data, d = model.createData(), mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    pin.framesForwardKinematics(model, data, problem.q0)
    for body in ("upper", "lower"):
        frame = data.oMf[model.getFrameId(body)]
        np.testing.assert_allclose(frame.translation, R @ d.body(body).xpos + (1, 2, 3), atol=1e-14)


def test_forces_act_at_the_centre_of_mass_of_a_body(tmp_path):
    scene, _, m = scene_of(ARM, tmp_path)
    scene.add_force("arm/upper", lambda t, q, v: np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0]))
    problem = scene.build()
    d = mujoco.MjData(m)
    d.xfrc_applied[2, 1] = 3.0
    mujoco.mj_forward(m, d)
    np.testing.assert_allclose(problem.system.acceleration(0.0, problem.q0, problem.v0), d.qacc, atol=1e-9)


REST = """<mujoco model="rest"><option density="1.2"><flag gravity="disable"/></option>
  <asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 .1" elevation="0 0 0 1"/></asset>
  <worldbody><site name="s"/><light/><camera name="c"/>
    <body name="a" gravcomp="1"><joint name="j" stiffness="3" frictionloss=".1"/>
      <geom name="g" size=".1" margin=".01" solref=".01 1"/>
      <body name="b" pos="1 0 0"><joint name="k" type="ball" range="0 1" limited="true" frictionloss=".1"/>
        <geom size=".1" condim="6"/></body>
    </body>
    <body pos="9 0 0"><joint name="f" type="free" stiffness="2"/><geom size=".1"/></body>
    <body pos="7 0 0"><joint/><geom type="hfield" hfield="hills"/><geom size=".1"/></body>
    <body name="m" mocap="true" pos="5 0 0"><geom size=".1"/></body></worldbody>
  <tendon><fixed name="t" limited="true" range="0 1"><joint joint="j" coef="1"/></fixed></tendon>
  <equality><joint joint1="j"/></equality><actuator><motor joint="f"/></actuator><sensor><jointpos joint="j"/></sensor>
  <keyframe><key name="home"/></keyframe></mujoco>"""


def test_what_is_not_modelled_is_named_in_one_warning_and_in_the_report(tmp_path):
    file = tmp_path / "rest.xml"
    file.write_text(REST)
    scene = mbvi.Scene(gravity=(0, 0, -1))
    with pytest.warns(mbvi.MbviWarning) as caught:
        scene.add_mjcf(file)
    (warning,) = caught
    report = scene.build().report()
    moving = (
        "limits of tendon t", "actuator f", "1 mocap bodies", "springs of f", "dry friction of k",
        "limits of k", "gravity compensation of a", "margin of g", "torsional and rolling friction of a geom of b",
        "density", "height field", "gravity [0.0, 0.0, 0.0] of the file",
    )  # fmt: skip
    for words in moving:
        assert words in str(warning.message), words
        assert words in report, words
    softness = "softness (solref, solimp) of 1 geoms"
    for words in ("1 sites", "1 cameras", "1 lights", "1 sensors", "1 keyframes (home)", softness):
        assert words in report and words not in str(warning.message)


def test_softness_of_everything_that_is_rigid_is_in_the_report(tmp_path):
    text = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" solref=".1 1"/>
      <body pos="0 0 1"><joint range="-1 1" solreflimit=".1 1"/><geom name="ball" size=".1" pos="0 .3 0"/></body>
      <body name="free" pos="0 0 3"><freejoint/><geom size=".1"/></body></worldbody>
      <contact><pair geom1="floor" geom2="ball" solref=".1 1"/></contact>
      <equality><weld body1="free" solimp=".5 .6 .1"/></equality></mujoco>"""
    scene, _, _ = scene_of(text, tmp_path)
    assert "softness (solref, solimp) of 1 geoms and 1 joints and 1 pairs and 1 equalities" in scene.build().report()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco><worldbody><body><geom size='.1'/></body></worldbody></mujoco>", "nothing moves"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "MuJoCo refuses it: .*mass"),
        ("<mujoco><worldbod/></mujoco>", "MuJoCo refuses it"),
        ("<robot name='r'/>", "is a URDF: use add_urdf"),
        ("<sdf/>", "no MJCF"),
        ("<mujoco", "is no XML"),
        (None, "no such file"),
    ],
)
def test_files_that_are_no_model_are_refused(text, said, tmp_path):
    file = tmp_path / "x.xml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(mbvi.MjcfError, match=said):
        mbvi.Scene().add_mjcf(file)


def test_wrong_joints_and_bases_are_refused(tmp_path):
    for wrong in ({"joints": {"none": 1.0}}, {"base_velocity": np.ones(6)}, {"locked": ["none"]}, {"name": "a/b"}):
        with pytest.raises(mbvi.InputError):
            scene_of(ARM, tmp_path, **wrong)


def test_urdf_names_the_right_method_and_the_reason_against_sdf(tmp_path):
    for text, said in (("<mujoco/>", "use add_mjcf"), ("<sdf version='1.9'/>", "no parser: convert it to URDF")):
        file = tmp_path / "x.urdf"
        file.write_text(text)
        with pytest.raises(mbvi.UrdfError, match=re.escape(said)):
            mbvi.Scene().add_urdf(file)


@given(seed=st.integers(0, 2**31))
@settings(max_examples=10, deadline=None)
@pytest.mark.parametrize("text", [WALKER, LOOSE], ids=["walker", "loose"])
def test_a_keyframe_is_mujocos_state(tmp_path_factory, text, seed):
    rng = np.random.default_rng(seed)
    plain = mujoco.MjModel.from_xml_string(text)
    qpos = np.zeros(plain.nq)
    qpos[:] = plain.qpos0
    mujoco.mj_integratePos(plain, qpos, 0.2 * rng.normal(size=plain.nv), 1.0)
    qvel = rng.normal(size=plain.nv)
    numbers = f'qpos="{" ".join(map(repr, qpos.tolist()))}" qvel="{" ".join(map(repr, qvel.tolist()))}"'
    keyed = text.replace("</mujoco>", f'<keyframe><key/><key name="home" {numbers}/></keyframe></mujoco>')
    folder = tmp_path_factory.mktemp("keyframe")
    scene, name, m = scene_of(keyed, folder, keyframe="home")
    problem = scene.build((), resolve=True)
    start = problem.scene.items.robots[0]
    both = Beside(m, problem.model(name))
    np.testing.assert_allclose(start.q0, both.q(qpos), atol=1e-12)
    np.testing.assert_allclose(start.v0, both.turn(qpos) @ qvel, atol=1e-12)
    still, _, _ = (
        scene_of(keyed, folder, keyframe="home", base_velocity=np.zeros(6)) if text is WALKER else (scene, 0, 0)
    )
    assert text is not WALKER or not still.build((), resolve=True).v0[:6].any()


MOCAP = """<mujoco><worldbody><body name="hand" mocap="true" pos="1 0 1" euler="0 0 30">
  <geom type="box" size=".1 .2 .3"/></body><body pos="0 0 2"><freejoint/><geom size=".1"/></body></worldbody>
  <keyframe><key name="moved" mpos="3 1 2" mquat=".8 0 .6 0"/>
  <key name="as it is" qpos="0 0 3 1 0 0 0"/></keyframe></mujoco>"""


@pytest.mark.parametrize("keyframe", [None, "moved", "as it is"])
def test_a_mocap_body_stands_where_a_keyframe_puts_it(tmp_path, keyframe):
    with pytest.warns(mbvi.MbviWarning, match="1 mocap bodies"):
        scene, _, m = scene_of(MOCAP, tmp_path, keyframe=keyframe, position=(0, 0, 1))
    d = mujoco.MjData(m)
    if keyframe is not None:
        mujoco.mj_resetDataKeyframe(m, d, m.key(keyframe).id)
    mujoco.mj_forward(m, d)
    (hand,) = (item for item in scene._items.bodies if item.name == "hand")
    np.testing.assert_allclose(hand.position, d.geom_xpos[0] + [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(hand.rotation, d.geom_xmat[0].reshape(3, 3), atol=1e-15)


def test_unknown_keyframes_are_refused(tmp_path):
    with pytest.raises(mbvi.InputError, match="no keyframe 'home'; it has none"):
        scene_of(WALKER, tmp_path, keyframe="home")


def test_without_mujoco_the_error_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(mbvi.InputError, match=r"pip install 'mbvi\[mjcf\]'"):
        scene_of(ARM, tmp_path)


def test_a_locked_joint_holds_its_links_even_if_a_body_has_its_name(tmp_path):
    text = ARM.replace('name="s"', 'name="upper"').replace('name="w"', 'name="lower"')
    scene, _, m = scene_of(text, tmp_path, locked=["lower"], joints={"lower": 0.1, "upper": -0.2, "e": 0.7})
    problem = scene.build()
    assert problem.system.nv == 2
    d = mujoco.MjData(m)
    d.qpos[:] = -0.2, 0.7, 0.1
    mujoco.mj_forward(m, d)
    placed = next(s for s in problem.scene.shapes if s.name == "arm/lower")
    pose = problem.system.placements(problem.q0, np.array([placed.body]))[0]
    np.testing.assert_allclose(pose[:3].T @ placed.position + pose[3], d.geom_xpos[-1], atol=1e-14)
    mass = np.zeros((3, 3))
    full_mass(m, d, mass)
    model = problem.system.model
    ours = pin.crba(model, model.createData(), problem.q0, pin.Convention.WORLD)
    np.testing.assert_allclose(np.triu(ours), np.triu(mass[:2, :2]), atol=1e-14)


HILLS = """<mujoco><asset><hfield name="hills" nrow="3" ncol="4" size="2 1 .5 .1" elevation="0 .2 .4 1 .3 .9 .1 .2 .5 .6 .7 .8"/>
  {asset}</asset><worldbody><geom name="ground" type="hfield" hfield="{hfield}" pos=".3 -.2 .4" euler="0 0 30" friction=".7"/>
  <body name="ball" pos=".3 -.2 3"><freejoint/><geom size=".1" friction=".2"/></body></worldbody></mujoco>"""  # noqa: E501


def rays(m, places):
    """Heights of what MuJoCo sees from above."""
    d, hit = mujoco.MjData(m), np.zeros(1, np.int32)
    mujoco.mj_forward(m, d)
    down = np.array([0.0, 0.0, -1.0])
    return np.array([9.0 - mujoco.mj_ray(m, d, np.array([x, y, 9.0]), down, None, 1, 1, hit) for x, y in places])


@pytest.mark.parametrize("kind", ["elevation", "picture"])
def test_a_height_field_has_mujocos_heights(kind, tmp_path):
    rng = np.random.default_rng(3)
    if kind == "picture":
        from PIL import Image

        Image.fromarray(rng.integers(0, 256, (7, 5)).astype(np.uint8)).save(tmp_path / "hills.png")
    asset = '<hfield name="map" file="hills.png" size="2 1 .5 .1"/>' if kind == "picture" else ""
    file = tmp_path / "hills.xml"
    file.write_text(HILLS.format(asset=asset, hfield="map" if kind == "picture" else "hills"))
    m, scene = mujoco.MjModel.from_xml_path(str(file)), mbvi.Scene()
    scene.add_mjcf(file)
    problem = scene.build()
    assert "base and sides of ground" in problem.report() and "ground" in repr(scene)
    (family,) = problem.constraints.constraints
    assert family.friction_of(np.array([0])) == pytest.approx(0.7)
    turn = pin.rpy.rpyToMatrix(0.0, 0.0, np.pi / 6)
    inside = rng.uniform((-1.9, -0.9), (1.9, 0.9), (60, 2)) @ turn[:2, :2].T + (0.3, -0.2)
    q = problem.q0.copy()
    for (x, y), z in zip(inside, rays(m, inside), strict=True):
        # a point is on the surface where the sign of its distance changes
        q[:3] = x, y, z
        low, high = (family.gap(0.0, q + np.eye(7)[2] * dz)[0] + 0.1 for dz in (-1e-6, 1e-6))
        assert low < 0.0 < high
