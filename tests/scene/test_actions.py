"""Controls that see the whole scene, external forces on bodies, and the model that is simulated."""

from __future__ import annotations

import copy
import pickle
import re
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.system import ActuatedSystem
from support.paths import ROBOTS, real_robot

HOPPER, QUADRUPED = ROBOTS / "hopper/hopper.urdf", ROBOTS / "quadruped/quadruped.urdf"
ARM, PENDULUM = ROBOTS / "arm/arm.urdf", ROBOTS / "double_pendulum/double_pendulum.urdf"
# of each scheme the time by which what v gains in a step reaches q late, in steps: q = a t (t - late h) / 2
SCHEMES = {
    "paoli": (mbvi.Paoli(), 1.0),
    "moreau-jean": (mbvi.MoreauJean(), 0.0),
    "centered": (mbvi.Centered(), 0.0),
    "centered, projected": (mbvi.Centered(project_positions=True), 0.0),
    "schatzman-paoli": (mbvi.SchatzmanPaoli(), 0.0),
    "stewart-trinkle": (mbvi.StewartTrinkle(), -1.0),
    "event-driven": (mbvi.EventDriven(1e-9), 0.0),
}
every_scheme = pytest.mark.parametrize("name", SCHEMES)
CART = """<robot name="cart"><link name="rail"/><link name="cart"><inertial><origin xyz="0.1 0.2 0.3"/>
<mass value="{mass}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-50" upper="50" effort="1" velocity="1"/></joint></robot>"""


def run(problem, name, duration, h=2e-3, **options):
    scheme = SCHEMES[name][0]
    step = None if isinstance(scheme, mbvi.EventDriven) else h
    return mbvi.simulate(problem, scheme, step=step, duration=duration, **options)


def constant(*values):
    """Return a force or control that is always the same."""
    return lambda *_: np.array(values)


@pytest.fixture
def carts(tmp_path):
    """Return a scene of two carts on rails along x, 2 and 3 kg."""

    def make(joints=(0.0, 1.0), velocity=(0.0, 0.0), **options):
        scene = mbvi.Scene(gravity=(0, 0, 0), **options)
        for k, mass in enumerate((2.0, 3.0)):
            path = tmp_path / f"cart{k}.urdf"
            path.write_text(CART.format(mass=mass))
            start = {"joints": {"slide": joints[k]}, "velocity": {"slide": velocity[k]}}
            scene.add_urdf(path, base="fixed", position=(0, 5.0 * k, 0), name=f"cart{k}", **start)
        return scene

    return make


# closed forms


@every_scheme
def test_ball_under_a_constant_force_follows_the_parabola_of_its_scheme(name):
    g, force, mass, h, duration = np.array([0.3, -0.2, -9.81]), np.array([1.0, 2.0, 7.0]), 0.4, 2e-3, 0.5
    scene = mbvi.Scene(gravity=g)
    scene.add_sphere(0.1, mass=mass, velocity=(1, 0, 0), name="ball")
    scene.add_spheres(np.array([[5.0, 0, 0], [9.0, 0, 0]]), 0.1, mass=np.array([mass, 2 * mass]), name="grains")
    scene.add_box((1, 1, 1), mass=mass, position=(0, 9, 0), name="box")
    scene.add_force("ball", constant(*force, 0, 0, 0))
    scene.add_force("grains", lambda t, q, v: np.array([force, force]))
    scene.add_force("grains[1]", constant(*force))
    scene.add_force("box", constant(*force / 2, 0, 0, 0))
    scene.add_force("box", constant(*force / 2, 0, 0, 0))
    result = run(scene.build(), name, duration, h)
    a, late = g + force / mass, SCHEMES[name][1]
    moved = 0.5 * a * duration * (duration - late * h)
    # in q the box comes first, then ball and grains
    np.testing.assert_allclose(result.q[-1, :3] - [0, 9, 0], moved, rtol=1e-9)
    np.testing.assert_allclose(result.q[-1, 7:10], moved + np.array([duration, 0, 0]), rtol=1e-9)
    np.testing.assert_allclose(result.q[-1, 10:].reshape(2, 3) - [[5, 0, 0], [9, 0, 0]], [moved, moved], rtol=1e-9)
    # the first increment of that scheme is half as long
    v = result.v[-1, 6:9] - [1, 0, 0]
    np.testing.assert_allclose(v, a * (duration - (name == "schatzman-paoli") * h / 2), rtol=1e-9)


@given(turn=st.tuples(*[st.floats(-3, 3)] * 3), axis=st.integers(0, 2), torque=st.floats(-2, 2), planar=st.booleans())
def test_box_under_a_constant_torque_about_a_principal_axis_turns_evenly_faster(turn, axis, torque, planar):
    rotation, axis = (np.eye(3), 1) if planar else (pin.exp3(np.array(turn)), axis)
    scene = mbvi.Scene(gravity=(0, 0, 0), plane="xz" if planar else None)
    scene.add_box((0.1, 0.2, 0.4), mass=2.0, rotation=rotation, name="box")
    scene.add_force("box", constant(0, 0, 0, *torque * rotation[:, axis]))
    problem = scene.build()
    moment = (0.2**2 + 0.4**2, 0.1**2 + 0.4**2, 0.1**2 + 0.2**2)[axis] * 2.0 / 12.0
    rate, duration = torque / moment, 0.25
    result = mbvi.simulate(problem, mbvi.Centered(), step=5e-3, duration=duration)
    expected = rotation @ pin.exp3(0.5 * rate * duration**2 * np.eye(3)[axis])
    np.testing.assert_allclose(pin.Quaternion(result.q[-1, 3:7]).matrix(), expected, atol=1e-9)


@every_scheme
def test_spring_and_damper_between_two_robots_is_the_same_system_given_by_functions(carts, name):
    k, c, rest = 30.0, 0.0 if name.startswith("centered") else 0.7, 0.5

    def pull(x, v):
        return k * (x[1] - x[0] - rest) + c * (v[1] - v[0])

    def spring(state):
        x, v = (np.array([values["cart0"][0], values["cart1"][0]]) for values in (state.q, state.v))
        f = pull(x, v)
        return {"cart0": [f], "cart1": np.array([-f])}

    scene = carts(velocity=(0.4, -0.1))
    scene.add_control(spring)
    given_as_functions = mbvi.Problem(
        mbvi.LagrangianSystem(
            mass=lambda q: np.diag([2.0, 3.0]), force=lambda t, q, v: pull(q, v) * np.array([1.0, -1.0]), dim=2
        ),
        [],
        [0.0, 1.0],
        [0.4, -0.1],
    )
    ours, theirs = (run(p, name, 1.0) for p in (scene.build(), given_as_functions))
    tolerance = 1e-8 if name == "event-driven" else 1e-12
    np.testing.assert_allclose(ours.at(1.0), theirs.at(1.0), atol=tolerance)
    assert np.abs(ours.v[-1]).max() > 0.1


@every_scheme
def test_drag_and_spring_on_a_sphere_is_the_same_system_given_by_functions(name):
    def force(t, q, v):
        return -20.0 * q - 0.8 * v + np.array([np.sin(5 * t), 0.0, 0.0])

    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_sphere(0.1, mass=1.5, position=(0.3, 0, 0.1), velocity=(0, 1, 0), name="ball")
    scene.add_force("ball", force)
    mass = 1.5 * np.eye(3)
    system = mbvi.LagrangianSystem(mass=lambda q: mass, force=force, dim=3)
    theirs = run(mbvi.Problem(system, [], [0.3, 0, 0.1], [0, 1, 0]), name, 1.0)
    ours = run(scene.build(), name, 1.0)
    np.testing.assert_allclose(ours.at(1.0), theirs.at(1.0), atol=1e-8 if name == "event-driven" else 1e-12)


def test_centered_takes_forces_that_change_with_v_half_a_step_on():
    def error(h):
        scene = mbvi.Scene(gravity=(0, 0, 0))
        scene.add_sphere(0.1, mass=1.0, velocity=(1, 0, 0), name="ball")
        scene.add_force("ball", lambda t, q, v: -3.0 * v)
        return abs(mbvi.simulate(scene.build(), mbvi.Centered(), step=h, duration=1.0).v[-1, 0] - np.exp(-3.0))

    errors = [error(h) for h in (0.02, 0.01, 0.005)]
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize("robot", [ARM, real_robot("panda_description/urdf/panda.urdf")], ids=["arm", "panda"])
def test_gravity_compensation_by_the_model_holds_a_robot_still(robot):
    scene = mbvi.Scene()
    scene.add_urdf(HOPPER, position=(3, 0, 2), name="other")
    lock = ["panda_finger_joint1"] if "panda" in robot.name else []
    name = scene.add_urdf(robot, base="fixed", name="arm", locked=lock)
    models = {}

    def hold(state):
        if not models:
            return {}
        model, data = models["arm"]
        return {name: pin.computeGeneralizedGravity(model, data, state.q[name])}

    scene.add_control(hold)
    problem = scene.build()
    model = problem.model(name)
    models["arm"] = model, model.createData()
    result = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.3)
    arm = slice(problem.system.nv - model.nv, None)
    assert np.abs(result.v[:, arm]).max() < 1e-11
    models.clear()
    assert np.abs(mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.3).v[-1, arm]).max() > 0.1


# virtual work

# of each case: URDF, base, locked joints
MECHANISMS = {
    "free": (QUADRUPED, "free", ()),
    "locked": (QUADRUPED, "free", ("FL_calf_joint", "RR_hip_joint")),
    "fixed": (ARM, "fixed", ()),
}


@pytest.fixture(scope="module", params=MECHANISMS)
def pushed(request):
    """Return a problem whose links take the wrenches of a dict, that dict, the full model and where its joints lock."""
    path, base, locked = MECHANISMS[request.param]
    full = pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if base == "free" else []))
    wrenches, at = {}, dict.fromkeys(locked, -1.0 if locked else 0.0)
    at |= {k: 0.1 for k in locked if "hip" in k}
    scene = mbvi.Scene()
    scene.add_urdf(HOPPER, position=(3, 0, 3))
    scene.add_urdf(path, base=base, name="robot", locked=locked, joints=at, position=(0, 0, 3))
    for frame in full.frames:
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 0:
            act = (lambda name: lambda t, q, v: wrenches.get(name, np.zeros(6)))(frame.name)
            scene.add_force(f"robot/{frame.name}", act)
    return scene.build(), wrenches, full, at, path


@given(seed=st.integers(0, 2**32 - 1))
def test_force_on_a_link_does_the_work_of_its_centre_of_mass(pushed, seed):
    """Independent of the scene: the URDF's full model, and differences of where the link's frame is."""
    problem, wrenches, full, at, path = pushed
    rng = np.random.default_rng(seed)
    links = [f.name for f in full.frames if f.type == pin.FrameType.BODY and f.parentJoint > 0]
    name, wrench, model = links[rng.integers(len(links))], rng.normal(size=6), problem.model("robot")
    nq, nv = problem.system.nq - model.nq, problem.system.nv - model.nv
    q, v = problem.q0.copy(), np.concatenate([np.zeros(nv), rng.normal(size=model.nv)])
    q[nq:] = pin.integrate(model, q[nq:], rng.normal(size=model.nv))
    # the same state at two times, with a force and without
    wrenches[name] = wrench
    power = problem.system.force(1.0, q, v) @ v
    wrenches.clear()
    power -= problem.system.force(2.0, q, v) @ v
    velocity = velocity_of_link(full, model, name, centre_of_mass(path, name), at, q[nq:], v[nv:])
    np.testing.assert_allclose(power, wrench @ velocity, rtol=1e-6, atol=1e-6)


def centre_of_mass(path, link):
    """Return a link's centre of mass in its own frame, as its URDF says."""
    origin = ElementTree.parse(path).find(f"link[@name='{link}']/inertial/origin")
    return np.zeros(3) if origin is None else np.array(origin.get("xyz").split(), dtype=float)


def velocity_of_link(full, model, link, centre, at, q, v):
    """Return by differences the velocity of a point of a link and its angular velocity, both in the world."""

    def pose(s):
        here, all_joints, data = pin.integrate(model, q, s * v), pin.neutral(full), full.createData()
        for k in range(1, full.njoints):
            where = slice(full.idx_qs[k], full.idx_qs[k] + full.nqs[k])
            if full.names[k] in at:
                all_joints[where] = at[full.names[k]]
            else:
                j = model.getJointId(full.names[k])
                all_joints[where] = here[model.idx_qs[j] : model.idx_qs[j] + model.nqs[j]]
        pin.framesForwardKinematics(full, data, all_joints)
        place = data.oMf[full.getFrameId(link, pin.FrameType.BODY)]
        # the arm's base stands 3 m up: velocities do not know
        return place.act(centre), place.rotation

    s = 1e-6
    (x0, R0), (x1, R1) = pose(-s), pose(s)
    return np.concatenate([(x1 - x0) / (2 * s), pin.log3(R1 @ R0.T) / (2 * s)])


# planar scenes and reductions


def planar_scene(push, control=None):
    scene = mbvi.Scene(plane="xz", restitution=0.3)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(HOPPER, position=(0, 0, 0.9), name="hopper")
    scene.add_box((0.3, 0.5, 0.2), mass=1.5, position=(2, 0, 1), angular_velocity=(0, 2.0, 0), name="box")
    scene.add_boxes(np.array([[4.0, 0, 1], [6, 0, 1]]), (0.2, 0.2, 0.2), mass=1.0, name="boxes")
    scene.add_sphere(0.1, mass=0.5, position=(8, 0, 1), velocity=(0.5, 0, 0), name="ball")
    scene.add_spheres(np.array([[10.0, 0, 1], [12, 0, 1]]), 0.1, mass=1.0, name="balls")
    for name in ("hopper/trunk", "hopper/foot", "box", "boxes", "boxes[1]", "ball", "balls", "balls[0]"):
        scene.add_force(name, push(name))
    if control is not None:
        scene.add_control(control)
    return scene


def wavering(name):
    """Return a force in the plane xz that depends on time and state, as that of a body, of spheres or of groups."""
    size = (6,) if name in ("box", "boxes[1]") or "/" in name else (3,) if name in ("ball", "balls[0]") else None
    size = size or ((2, 6) if name == "boxes" else (2, 3))

    def force(t, q, v):
        out = np.zeros(size)
        out[..., 0], out[..., 2] = 2.0 * np.cos(8 * t), 1.0
        if "/" not in name:
            assert q.shape == (*size[:-1], 7 if size[-1] == 6 else 3) and v.shape == size
            out[..., :3] -= 0.3 * v[..., :3]
        if size[-1] == 6:
            out[..., 4] = 0.1 if "/" in name else 0.1 - 0.02 * v[..., 4]
        return out

    return force


@pytest.mark.parametrize("scheme", ["centered", "paoli"])
def test_planar_scene_under_forces_moves_as_in_space(scheme):
    """And a control is shown the same configurations and velocities of bodies in both."""
    shown = {}

    def watch(where):
        def control(state):
            names = [name for name in state.q if name != "hopper"] + ["boxes[0]", "balls[1]"]
            values = [(state.q[name].copy(), state.v[name].copy()) for name in names]
            shown.setdefault(where, {})[state.t] = values

        return control

    runs = {}
    for where, reduce in (("plane", mbvi.REDUCTIONS), ("space", set(mbvi.REDUCTIONS) - {"plane"})):
        problem = planar_scene(wavering, watch(where)).build(reduce=reduce)
        runs[where] = run(problem, scheme, 0.4)
        assert np.abs(runs[where].v).max() > 1.0 and runs[where].impacts
    assert list(shown["plane"]) == list(shown["space"])
    for t, there in shown["space"].items():
        for flat, full in zip(shown["plane"][t], there, strict=True):
            for a, b in zip(flat, full, strict=True):
                assert a.shape == b.shape
                np.testing.assert_allclose(a, b, atol=1e-8)
    flat, full = runs["plane"], runs["space"]
    # the base's place, then of both all that follows the hopper
    np.testing.assert_allclose(flat.q[:, :2], full.q[:, [0, 2]], atol=1e-8)
    np.testing.assert_allclose(flat.q[:, 6:], full.q[:, 9:], atol=1e-8)


@pytest.mark.parametrize("reduce", [mbvi.REDUCTIONS, ()], ids=["plane", "space"])
@pytest.mark.parametrize(
    "name, entry",
    [(name, entry) for name in ("box", "boxes", "hopper/foot") for entry in (1, 3, 5)] + [("ball", 1), ("balls[0]", 1)],
)
def test_force_that_leaves_the_plane_is_refused(name, entry, reduce):
    scene, wrench = planar_scene(wavering), np.zeros(3 if "ball" in name else 6)
    wrench[[0, entry]] = 1.0, 1e-3
    scene.add_force(name, lambda t, q, v: np.broadcast_to(wrench, v.shape) if name == "boxes" else wrench)
    with pytest.raises(mbvi.InputError, match=rf"the force on {re.escape(name)} at t = 0 s leaves the plane"):
        scene.build(reduce=reduce)


# few bodies do not sleep in the compiled loop
@pytest.mark.usefixtures("python_steps")
def test_force_wakes_a_body_that_would_sleep_and_others_go_on_sleeping():
    def make(reduce):
        scene = mbvi.Scene()
        scene.add_halfspace((0, 0, 1))
        for k in range(3):
            scene.add_box((1, 1, 1), mass=2.0, position=(3.0 * k, 0, 0.5), name=f"box{k}")
        # of the last two one rests on the other, so that they are one island
        scene.add_box((0.5, 0.5, 0.5), position=(6, 0, 1.25), name="on top")
        scene.add_force("box0", lambda t, q, v: [3.0 * (t > 0.2), 0, 0, 0, 0, 0])
        scene.add_force("on top", lambda t, q, v: [0, 0, 4.0 * (t > 0.2) * 9.81, 0, 0, 0])
        return scene.build(reduce=reduce)

    asleep, awake = (
        mbvi.simulate(make(reduce), mbvi.Centered(project_positions=True), step=2e-3, duration=0.6)
        for reduce in (mbvi.REDUCTIONS, set(mbvi.REDUCTIONS) - {"rest"})
    )
    np.testing.assert_allclose(asleep.q, awake.q, atol=1e-12)
    np.testing.assert_allclose(asleep.q[-1, :3], [0.5 * 1.5 * 0.4**2, 0, 0.5], rtol=2e-2)
    assert asleep.q[-1, 21 + 2] > 1.25 + 0.5
    later = asleep.q[asleep.t > 0.1]
    np.testing.assert_array_equal(later[:, 7:14], later[:1, 7:14].repeat(len(later), 0))


# contacts


def hopper_scene(control, restitution=0.0, box=True):
    scene = mbvi.Scene(restitution=restitution)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(HOPPER, position=(0, 0, 0.8), joints={"knee": 0.4}, name="hopper")
    if box:
        scene.add_box((0.2, 0.2, 0.2), mass=1.0, position=(1, 0, 0.3), name="box")
    scene.add_control(control)
    return scene.build()


@every_scheme
def test_contact_is_seen_one_step_after_touchdown(name):
    """And under EventDriven at the impact itself, with its percussion and an infinite force."""
    log = []

    def push_off(state):
        touching = [k for k in state.contacts if k.name == "hopper/foot | floor"]
        log.append((state.t, touching, state.q["hopper"]))
        # straightens the knee as soon as the foot has touched, once
        pushing = any(seen for _, seen, _ in log)
        return {"hopper": [0.0] * 6 + [0.0, -4.0 * pushing]}

    problem = hopper_scene(push_off, box=name == "centered")
    log.clear()
    result = run(problem, name, 0.4, h=1e-3)
    struck = next(i for i in result.impacts if "hopper/foot | floor" in i.constraints)
    t, seen, _ = next(one for one in log if one[1])
    h = result.step
    # where in a step each scheme looks at forces, after the one in which the impact is
    share = {"moreau-jean": 0.5, "centered": 0.5, "centered, projected": 0.5, "paoli": 1.0}.get(name, 0.0)
    assert t == pytest.approx(struck.time + share * h, abs=1e-9)
    assert not any(one[1] for one in log if one[0] < struck.time)
    k = struck.constraints.index("hopper/foot | floor")
    contact = next(c for c in seen if np.allclose(c.point, struck.point[k]))
    if name == "schatzman-paoli":
        # its impacts take two steps, and a contact has the percussion of one
        assert 0.0 < contact.percussion < struck.percussion[k]
    else:
        assert contact.percussion == pytest.approx(struck.percussion[k], rel=1e-12)
    assert contact.force == (np.inf if name == "event-driven" else contact.percussion / h)
    np.testing.assert_array_equal(contact.normal, struck.normal[k])
    # pushing shows
    idle = run(hopper_scene(lambda state: None, box=name == "centered"), name, 0.4, h=1e-3)
    assert abs(result.q[-1, 2] - idle.q[-1, 2]) > 1e-3


@pytest.mark.parametrize(
    "name, restitution",
    [(n, e) for n in SCHEMES for e in (0.0, 0.4) if n != "event-driven" and not (e and n == "stewart-trinkle")],
)
def test_contacts_seen_are_those_of_the_steps_taken_by_hand(name, restitution):
    seen, h = {}, 1e-3
    problem = hopper_scene(lambda state: seen.__setitem__(state.t, state.contacts), restitution)
    seen.clear()
    steps = mbvi.steps(problem, SCHEMES[name][0], step=h)
    known, many = (), 0
    for step, _ in zip(steps, range(400), strict=False):
        # what was seen while this step was taken is what the last one left
        assert all(repr(contacts) == repr(known) for contacts in map(as_tuples, seen.values()))
        seen.clear()
        rows = step.active
        known = tuple(
            (problem.constraints.name(int(k)), *x, *n, float(p), float(p / h))
            for k, x, n, p in zip(rows.constraint, rows.point, rows.normal, step.percussion, strict=True)
            if p > 0.0
        )
        many += bool(known)
    assert many > 5


def as_tuples(contacts):
    return tuple((c.name, *c.point, *c.normal, c.percussion, c.force) for c in contacts)


@pytest.mark.filterwarnings("ignore:contacts of cart")
def test_event_driven_control_sees_an_impact_until_the_next_smooth_step_has_ended(carts):
    """The force that it then exerts on a cart acts for exactly that one step."""
    push, scene = 8.0, carts(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, -5, 0.5), velocity=(0, 0, -1), name="ball")
    scene.add_control(lambda state: {"cart0": [push * len(state.contacts)]})
    result = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-9), duration=2.0)
    (impact,) = result.impacts
    after = int(np.searchsorted(result.t, impact.time, side="right"))
    length = result.t[after] - result.t[after - 1]
    assert length > 0.0 and result.t[-1] > result.t[after]
    np.testing.assert_array_equal(result.v[:after, 0], 0.0)
    np.testing.assert_allclose(result.v[after:, 0], push / 2.0 * length, rtol=1e-12)


@every_scheme
def test_resting_contacts_carry_the_weight_in_what_a_control_sees(name):
    forces = []

    def weigh(state):
        forces.append(sum(c.force for c in state.contacts if c.name == "box | floor"))

    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.3, 0.1), mass=3.0, position=(0, 0, 0.05), name="box")
    scene.add_force("box", lambda t, q, v: [0, 0, -2.0 - t, 0, 0, 0])
    scene.add_control(weigh)
    problem = scene.build()
    run(problem, name, 0.2)
    assert forces[-1] == pytest.approx(3.0 * 9.81 + 2.2, abs=5e-3)
    assert forces[0] == 0


def test_cut_steps_are_seen_too_and_a_force_drives_nothing_through_a_wall():
    seen, scheme = [], mbvi.Paoli(project_positions=True)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((0.02, 1, 1), fixed=True, name="wall")
    scene.add_box((0.05, 0.05, 0.05), mass=0.1, position=(-0.5, 0.1, 0), name="bullet")
    scene.add_force("bullet", constant(500.0, 0, 0, 0, 0, 0))
    scene.add_control(lambda state: seen.append((state.t, [c.force for c in state.contacts])))
    problem = scene.build()
    all_seen, known, before, short = [], [], 0.0, 0
    seen.clear()
    for step in mbvi.steps(problem, scheme, step=5e-3):
        assert all(forces == pytest.approx(known, rel=1e-9) for _, forces in seen)
        all_seen += seen
        seen.clear()
        length, before = step.t - before, step.t
        known, short = [p / length for p in step.percussion if p > 0.0], short + (length < 4.9e-3)
        if step.t > 0.1 - 1e-9:
            break
    assert short > 1
    result = mbvi.simulate(problem, scheme, step=5e-3, duration=0.1)
    assert any("shortened" in note for note in result.notes)
    assert result.q[:, 0].max() < -0.03 and result.q[-1, 0] == pytest.approx(-0.035, abs=1e-3)
    # by hand every part of a step is shown
    assert len(seen) == len(all_seen) > 0.1 / 5e-3
    for (t, forces), (t_known, forces_known) in zip(seen, all_seen, strict=True):
        assert t == pytest.approx(t_known) and forces == pytest.approx(forces_known, rel=1e-6)
    assert sum(seen[-1][1]) == pytest.approx(500.0, rel=1e-6)


# errors


def test_what_a_control_returns_is_checked_at_the_step_where_it_is_returned():
    scene = mbvi.Scene()
    scene.add_urdf(HOPPER, position=(0, 0, 2), name="hopper")
    scene.add_sphere(0.1, position=(3, 0, 0), name="ball")
    answers = {"now": None}

    def balance(state):
        return answers["now"] if state.t > 0.01 else {}

    scene.add_control(balance)
    problem = scene.build()
    for answer, words in (
        ({"hoper": np.zeros(8)}, "'hoper'; robots are hopper"),
        ({"ball": np.zeros(3)}, "'ball'; robots"),
        ({3: np.zeros(8)}, "torques of 3"),
        ({"hopper": np.zeros(3)}, r"returned shape \(3,\); \(8,\) is expected"),
        ({"hopper": 1.0}, r"returned shape \(\)"),
        ({"hopper": [np.nan] * 8}, "of hopper, is not finite"),
        ({"hopper": np.full(8, np.inf)}, "of hopper, is not finite"),
        ({"hopper": "abc"}, "must return real numbers; it returned 'abc'"),
        ({"hopper": None}, "must return real numbers; it returned None"),
        (np.zeros(8), "a dict of torques by robot"),
        ("hopper", "a dict of torques by robot"),
        (7, "a dict of torques by robot"),
    ):
        answers["now"] = answer
        with pytest.raises(mbvi.MbviError, match=rf"the control of the scene balance.*{words}") as caught:
            mbvi.simulate(problem, mbvi.Paoli(), step=2e-3, duration=0.1)
        assert "at t = 0.012 s" in str(caught.value)
        assert isinstance(caught.value, mbvi.DivergedError if "finite" in words else mbvi.InputError)
    for answer in (None, {}, {"hopper": [0] * 8}):
        answers["now"] = answer
        mbvi.simulate(problem, mbvi.Paoli(), step=2e-3, duration=0.1)


def test_what_a_force_returns_is_checked_at_the_step_where_it_is_returned():
    answers = {}
    scene = mbvi.Scene()
    scene.add_urdf(HOPPER, position=(0, 0, 2), name="hopper")
    scene.add_spheres(np.array([[3.0, 0, 0], [4, 0, 0]]), 0.1, 1.0, name="balls")
    scene.add_sphere(0.1, position=(5, 0, 0), name="ball")
    scene.add_box((1, 1, 1), position=(8, 0, 0), name="box")
    rest = {"hopper/foot": np.zeros(6), "balls": np.zeros((2, 3)), "ball": np.zeros(3), "box": np.zeros(6)}
    for name in rest:
        scene.add_force(name, lambda t, q, v, name=name: answers[name] if t > 0.01 else rest[name])
    problem = scene.build()
    for name, good in rest.items():
        wrong = [np.zeros(4), np.zeros((3, 6)), 1.0, "a", None, np.full(good.shape, np.nan), [[1.0], [1.0, 2.0]]]
        if good.shape[-1] == 3:
            # a moment, on what has no rotation
            wrong.append(np.ones((*good.shape[:-1], 6)))
        for value in wrong:
            answers |= rest | {name: value}
            with pytest.raises(mbvi.MbviError, match=rf"the force on {name} (is not finite )?at t = 0.012 s"):
                mbvi.simulate(problem, mbvi.Paoli(), step=2e-3, duration=0.1)
    answers |= rest | {"ball": np.zeros(6), "balls": np.zeros((2, 6))}
    mbvi.simulate(problem, mbvi.Paoli(), step=2e-3, duration=0.1)


def test_force_on_what_does_not_move_or_is_not_there_is_refused():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((1, 1, 1), fixed=True, name="table")
    scene.add_sphere(0.1, motion=mbvi.motion.Translation((1, 0, 0)), name="driven")
    scene.add_boxes(np.array([[0, 0, 5.0]]), (1, 1, 1), mass=1.0, name="crates")
    scene.add_urdf(ARM, base="fixed", position=(9, 0, 0), name="arm", locked=["joint1"])
    scene.add_urdf(HOPPER, position=(-9, 0, 3), name="hopper")
    for name in ("floor", "table", "driven", "arm/base", "arm/shoulder"):
        with pytest.raises(mbvi.InputError, match=f"'{name}' is part of the world.* crates, arm/upper_arm.* hopper/"):
            scene.add_force(name, constant(0, 0, 0, 0, 0, 0))
    for name in ("nothing", "crates[1]", "arm/none", "", "box", 3, None, ("crates",)):
        with pytest.raises(mbvi.InputError):
            scene.add_force(name, constant(0, 0, 0, 0, 0, 0))
    with pytest.raises(mbvi.InputError, match="hopper is a robot; name one of its links: hopper/trunk, hopper/thigh"):
        scene.add_force("hopper", constant(0, 0, 0, 0, 0, 0))
    for function in (None, 3.0, np.zeros(6), "force", {}):
        with pytest.raises(mbvi.InputError, match="force must be a function"):
            scene.add_force("crates", function)
        with pytest.raises(mbvi.InputError, match="control must be a function"):
            scene.add_control(function)
    for name in ("crates", "crates[0]", "arm/upper_arm", "hopper/foot"):
        scene.add_force(name, constant(0, 0, 0, 0, 0, 0) if name != "crates" else lambda t, q, v: np.zeros((1, 6)))
    scene.build()


def test_state_names_what_there_is():
    seen = []
    scene = hopper_items()
    scene.add_control(lambda state: seen.append(state))
    scene.build()
    state = seen[0]
    assert list(state.q) == list(state.v) == ["hopper", "box", "crates", "ball"] and len(state.q) == 4
    assert state.t == 0.0 and state.contacts == ()
    assert "crates[1]" in state.q and "floor" not in state.q and state.v.get("table") is None
    np.testing.assert_array_equal(state.q["crates"][1], state.q["crates[1]"])
    np.testing.assert_array_equal(state.v["box"], [0.1, 0.2, 0.3, 1, 2, 3])
    np.testing.assert_array_equal(state.q["box"], [5, 0, 0.9, 0, 0, 0, 1])
    mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.002)
    for one in seen:
        for values in (*one.q.values(), *one.v.values(), one.q["crates[0]"]):
            with pytest.raises(ValueError, match="read-only"):
                values[0] = 1.0
    with pytest.raises(mbvi.InputError, match="'floor' moves in this scene; those that do are hopper, box, crates"):
        state.q["floor"]
    with pytest.raises((AttributeError, TypeError)):
        state.t = 1.0
    assert "hopper" in repr(state)


def hopper_items():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((1, 1, 1), position=(-5, 0, 1), fixed=True, name="table")
    scene.add_urdf(HOPPER, position=(0, 0, 0.55), name="hopper")
    scene.add_box((1, 1, 1), position=(5, 0, 0.9), velocity=(0.1, 0.2, 0.3), angular_velocity=(1, 2, 3), name="box")
    scene.add_boxes(np.array([[8.0, 0, 1], [10, 0, 1]]), (1, 1, 1), mass=1.0, name="crates")
    scene.add_sphere(0.1, position=(3, 0, 0.15), name="ball")
    return scene


# runs


def feedback(state):
    """Depend on everything: time, another body, contacts."""
    push = sum(c.percussion for c in state.contacts)
    tau = np.zeros(8)
    tau[6:] = np.sin(9 * state.t) + state.q["ball"][2] - 0.1 * state.v["hopper"][6:]
    tau[7] -= min(push, 2.0)
    return {"hopper": tau}


def drag(t, q, v):
    return np.concatenate([-0.4 * v[:3], np.zeros(3)])


def acted_scene():
    scene = hopper_items()
    scene.add_control(feedback)
    scene.add_force("ball", drag)
    scene.add_force("hopper/shin", shin_force)
    return scene


@every_scheme
def test_a_run_repeats_to_the_byte(name):
    one, two = acted_scene().build(), acted_scene().build()
    first, again, other = run(one, name, 0.2), run(one, name, 0.2), run(two, name, 0.2)
    assert first.impacts
    for result in (again, other):
        assert result.q.tobytes() == first.q.tobytes() and result.v.tobytes() == first.v.tobytes()


def test_controls_and_forces_add_up_with_a_robots_own_control():
    tau = np.linspace(-1, 1, 8)

    def last(own, shares, force):
        scene = mbvi.Scene()
        scene.add_urdf(HOPPER, position=(0, 0, 2), name="hopper", control=None if own is None else lambda *_: own)
        for share in shares:
            scene.add_control(lambda state, share=share: {"hopper": share})
        if force:
            scene.add_force("hopper/trunk", constant(1, 2, 3, 0.1, 0.2, 0.3))
            scene.add_force("hopper/trunk", constant(-1, -2, -3, -0.1, -0.2, -0.3))
        return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1).q[-1]

    alone = last(tau, [], False)
    for own, shares, force in ((None, [tau], False), (0.5 * tau, [0.25 * tau] * 2, False), (tau, [], True)):
        np.testing.assert_allclose(last(own, shares, force), alone, atol=1e-13)


@every_scheme
def test_a_control_of_one_robot_moves_it_as_its_own_control_does(name):
    def law(t, q, v):
        return np.concatenate([np.zeros(6), 0.3 * np.cos(5 * t) - 0.05 * v[6:]])

    def make(whole):
        scene = mbvi.Scene(restitution=0.0)
        scene.add_halfspace((0, 0, 1))
        scene.add_urdf(HOPPER, position=(0, 0, 0.8), name="hopper", control=None if whole else law)
        if whole:
            scene.add_control(lambda state: {"hopper": law(state.t, state.q["hopper"], state.v["hopper"])})
        return scene.build()

    ours, theirs = run(make(True), name, 0.4), run(make(False), name, 0.4)
    assert len(ours.impacts) == len(theirs.impacts) > 0
    np.testing.assert_allclose(ours.at(0.4)[0], theirs.at(0.4)[0], atol=1e-6 if name == "event-driven" else 1e-13)


@pytest.mark.parametrize("name", ["paoli", "centered", "centered, projected", "moreau-jean", "stewart-trinkle"])
def test_a_control_is_called_once_a_step(name):
    times = []
    problem = hopper_scene(lambda state: times.append(state.t))
    times.clear()
    run(problem, name, 0.4, h=1e-3)
    assert len(times) == len(set(times)) == 400


@every_scheme
@pytest.mark.parametrize("control", [False, True])
def test_diagnosis_counts_the_work_of_forces_and_controls(name, control):
    """With walls that lose nothing, what a strong force adds is no excess of the impacts."""
    scene = mbvi.Scene(restitution=0.0 if name == "stewart-trinkle" else 1.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, mass=1.0, position=(0, 0, 0.5), name="ball")
    scene.add_force("ball", lambda t, q, v: [3.0, 0, -40.0 + 20.0 * t])
    if control:
        scene.add_control(lambda state: None)
    result = run(scene.build(), name, 0.6)
    assert len(result.impacts) > 0
    assert result.diagnosis().energy_excess < 1e-9


def test_diagnosis_steps_again_to_what_a_thinned_run_left_out_with_the_contacts_there_were():
    problem = acted_scene().build()
    full, thin = (run(problem, "paoli", 0.4, every=every) for every in (1, 7))
    one, other = full.diagnosis(), thin.diagnosis()
    assert one.variation == pytest.approx(other.variation, rel=1e-12)
    assert one.energy_excess == pytest.approx(other.energy_excess, abs=1e-12)


def test_default_scheme_takes_fixed_steps_where_controls_or_forces_act():
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_sphere(0.1, mass=1.0, position=(0, 0, 0), name="ball")
    assert mbvi.simulate(scene.build(), duration=0.1).scheme == "EventDriven"
    scene.add_force("ball", lambda t, q, v: -9e4 * q)
    result = mbvi.simulate(scene.build(), duration=0.1)
    # of the spring, 0.2 / omega
    assert result.scheme == "Centered" and result.step == 5e-4
    assert "a force may switch" in result.notes[0] and "the forces, 300 1/s" in result.notes[0]
    strong = mbvi.Scene(gravity=(0, 0, 0))
    strong.add_sphere(0.1, mass=1.0, name="ball")
    strong.add_force("ball", constant(2e4, 0, 0))
    assert mbvi.simulate(strong.build(), duration=0.1).step < 1e-4


# the model that is simulated, and copies


def test_model_is_that_of_the_robot_that_is_simulated():
    scene = mbvi.Scene(gravity=(0, 0, -1.5))
    scene.add_box((1, 1, 1), name="box")
    scene.add_urdf(QUADRUPED, position=(5, 0, 1), name="a")
    scene.add_urdf(QUADRUPED, position=(9, 0, 1), name="b", locked=["FL_hip_joint", "RR_hip_joint"])
    problem = scene.build()
    a, b = problem.model("a"), problem.model("b")
    assert isinstance(a, pin.Model) and a.nv == 18 and b.nv == 16 and "FL_hip_joint" not in list(b.names)
    np.testing.assert_array_equal(b.gravity.linear, [0, 0, -1.5])
    for wrong in ("box", "c", None, 3, ""):
        with pytest.raises(mbvi.InputError, match="a, b"):
            problem.model(wrong)
    a.gravity.linear = np.zeros(3)
    np.testing.assert_array_equal(problem.model("a").gravity.linear, [0, 0, -1.5])
    single = mbvi.Scene(plane="xz")
    single.add_urdf(HOPPER, position=(0, 0, 1))
    assert single.build().model().nv == 5 and single.build(reduce=()).model("hopper").nv == 8
    none = mbvi.Problem(mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.zeros(1), 1), [], [0.0], [0.0])
    with pytest.raises(mbvi.InputError, match="known are none"):
        none.model("robot")


def test_joints_without_range_stay_where_a_control_or_a_force_counts_them(tmp_path):
    def size(act):
        scene = mbvi.Scene()
        scene.add_urdf(stiff(tmp_path), position=(0, 0, 2), name="hopper")
        act(scene)
        problem = scene.build()
        return problem.model().nv, problem.system.nv

    assert size(lambda scene: None) == (7, 7)
    assert size(lambda scene: scene.add_control(lambda state: {"hopper": np.zeros(8)})) == (8, 8)
    assert size(lambda scene: scene.add_force("hopper/foot", lambda t, q, v: np.zeros(6) + 0 * v[7])) == (8, 8)


def stiff(folder):
    """Return the hopper's URDF with a knee that has no range."""
    tree = ElementTree.parse(HOPPER)
    limit = tree.find("joint[@name='knee']/limit")
    limit.set("lower", "0.5")
    limit.set("upper", "0.5")
    path = folder / "stiff.urdf"
    tree.write(path)
    return path


def test_nothing_is_added_where_nothing_acts():
    assert not isinstance(hopper_items().build().system, ActuatedSystem)
    assert isinstance(acted_scene().build().system, ActuatedSystem)


def test_report_names_controls_and_forces():
    report = acted_scene().build().report()
    assert "a control of the scene, feedback" in report and "a force on ball, drag" in report
    assert "1 free body" not in report and "3 free bodies" in report and "hopper: free base" in report


@pytest.mark.parametrize("name", ["centered, projected", "event-driven"])
def test_problem_with_functions_of_a_module_is_copied_and_pickled(name):
    problem = saved_scene().build()
    first = run(problem, name, 0.15)
    for again in (copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        assert run(again, name, 0.15).q.tobytes() == first.q.tobytes()


# files


def saved_scene():
    scene = acted_scene()
    scene.add_urdf(HOPPER, position=(20, 0, 2), name="other", control=own_control)
    scene.add_force("ball", drag)
    return scene


def own_control(t, q, v):
    return np.concatenate([np.zeros(6), -0.1 * v[6:]])


def shin_force(t, q, v):
    return [0.2, 0, 0.1 * q[2], 0, 0, 0]


@pytest.mark.parametrize("name", ["paoli", "event-driven"])
def test_file_names_the_functions_it_cannot_keep_and_takes_them_again(name, tmp_path):
    run_before, path = run(saved_scene().build(), name, 0.15, out=tmp_path / "run.h5"), tmp_path / "run.h5"
    lost = ["control of robot 'other'", "control of the scene", "force on 'ball'", "force on 'hopper/shin'"]
    with pytest.warns(mbvi.MbviWarning, match="could not keep"):
        loaded = mbvi.load(path)
    assert list(loaded.problem.not_kept) == lost
    for use in (lambda p: run(p, name, 0.1), lambda p: next(mbvi.steps(p, step=1e-3))):
        with pytest.raises(mbvi.InputError, match="control of the scene, force on 'ball', force on 'hopper/shin'"):
            use(loaded.problem)
    np.testing.assert_array_equal(loaded.q, run_before.q)
    # a file of a problem with functions missing names them too
    with pytest.warns(mbvi.MbviWarning, match="could not keep"):
        loaded.save(tmp_path / "again.h5")
        again = mbvi.load(tmp_path / "again.h5")
    assert list(again.problem.not_kept) == lost
    forces = {"ball": [drag, drag], "hopper/shin": shin_force}
    for given_back, left in (
        ({"control": feedback}, [lost[0], *lost[2:]]),
        ({"control": [feedback], "force": {"ball": (drag, drag)}}, [lost[0], lost[3]]),
        ({"control": {"other": own_control}, "force": forces}, [lost[1]]),
    ):
        with pytest.warns(mbvi.MbviWarning, match="could not keep"):
            partly = mbvi.load(path, **given_back)
        assert list(partly.problem.not_kept) == left
    whole = mbvi.load(tmp_path / "again.h5", control=[{"other": own_control}, feedback], force=forces)
    assert not whole.problem.not_kept
    repeated = run(whole.problem, name, 0.15)
    assert repeated.q.tobytes() == run_before.q.tobytes() and repeated.v.tobytes() == run_before.v.tobytes()


def test_functions_that_a_file_has_no_place_for_are_refused(tmp_path):
    path = tmp_path / "run.h5"
    run(saved_scene().build(), "paoli", 0.01, out=path)
    for wrong, words in (
        ({"control": {"hopper": own_control}}, "'hopper'; what had a control in .* is: 'other'"),
        ({"control": [feedback, feedback]}, "gives 2 functions control.* had 1 of them"),
        ({"control": 3}, "must be a function"),
        ({"control": [3]}, "must be a function"),
        ({"control": {"other": 3}}, "must be a function"),
        ({"force": drag}, "force must be a dict"),
        ({"force": {"ball": drag}}, "gives 1 functions for 'ball'; .* had 2"),
        ({"force": {"box": drag}}, "'box'; what a force acted on in .* is: 'ball', 'hopper/shin'"),
        ({"force": {"hopper/shin": 3}}, "must be a function"),
    ):
        with pytest.raises(mbvi.InputError, match=words):
            mbvi.load(path, **wrong)
    plain = tmp_path / "plain.h5"
    run(hopper_items().build(), "paoli", 0.01, out=plain)
    with pytest.raises(mbvi.InputError, match="had 0 of them"):
        mbvi.load(plain, control=feedback)
