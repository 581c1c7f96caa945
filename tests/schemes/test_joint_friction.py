"""Dry friction of joints: the law in plain numpy, exact motions, sticking without creep, and in company of contacts."""

from itertools import pairwise, product

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from mbvi.projection import Projector, TreeFreeMotion, in_flight
from mbvi.projection.tree import damp_slowed
from support.paths import REAL_ROBOTS, ROBOTS

SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
]  # fmt: skip
every_scheme = pytest.mark.parametrize(
    "scheme", SCHEMES, ids=["paoli", "moreau_jean", "centered", "projecting", "piles"]
)
LIMIT = '<limit lower="-100" upper="100" effort="1" velocity="1"/>'
LINK = '<inertial><mass value="{}"/><inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>'


def chain(folder, joints, masses=(1.0, 0.5, 0.3)):
    """A chain of links below each other, written to a file; each joint is its kind, its axis and its other elements."""
    links, text = ["base"], '<link name="base"/>'
    for k, (kind, axis, others) in enumerate(joints):
        name = f"link {k}"
        inertial = LINK.format(masses[k]).replace("<mass", '<origin xyz="0 0 -.2"/><mass')
        ball = '<collision><origin xyz="0 0 -.4"/><geometry><sphere radius=".05"/></geometry></collision>'
        text += f'<link name="{name}">{inertial}{ball}</link><joint name="joint {k}" type="{kind}">'
        text += f'<parent link="{links[-1]}"/><child link="{name}"/><origin xyz="0 0 {-0.4 * (k > 0)}"/>'
        text += f'<axis xyz="{axis}"/>{others}</joint>'
        links.append(name)
    path = folder / "chain.urdf"
    path.write_text(f'<robot name="chain">{text}</robot>')
    return path


def dynamics(friction, damping=0.0):
    return f'<dynamics friction="{friction}" damping="{damping}"/>'


def arm(folder, e=0.0, mu=0.0, floor=None, damping=0.0, friction=(0.6, 0.2, 0.1)):
    kinds = [
        ("continuous", axis, dynamics(c, damping))
        for axis, c in zip(("0 1 0", "1 0 0", "0 1 0"), friction, strict=True)
    ]
    scene = mbvi.Scene(restitution=e, friction=mu)
    if floor is not None:
        scene.add_halfspace((0, 0, 1), floor, name="floor")
    path, joints = chain(folder, kinds), {"joint 0": 1.0, "joint 1": 0.5, "joint 2": -0.3}
    scene.add_urdf(path, "fixed", joints=joints, joint_friction=True)
    return scene.build()


def slider(folder, friction, speed=0.0, others="", gravity=(0, 0, 0), e=0.0):
    scene = mbvi.Scene(gravity=gravity, restitution=e)
    limit = others or LIMIT
    path = chain(folder, [("prismatic", "1 0 0", dynamics(friction) + limit)], masses=(2.0,))
    scene.add_urdf(path, "fixed", velocity={"joint 0": speed}, joint_friction=True)
    return scene.build()


def law_of_joints(M, x, c, J=None, lower=()):
    """argmin |w - x|_M^2 / 2 + c . |w| with J w >= lower, by trying all cases; the KKT conditions are sufficient."""
    J = np.zeros((0, len(x))) if J is None else J
    for signs, active in product(product((-1, 0, 1), repeat=len(x)), product((False, True), repeat=len(J))):
        s, on = np.array(signs), np.array(active, dtype=bool)
        held = np.vstack([np.eye(len(x))[s == 0], J[on]])
        goal = np.concatenate([np.zeros((s == 0).sum()), np.array(lower)[on]])
        size = len(x) + len(held)
        K = np.zeros((size, size))
        K[: len(x), : len(x)], K[: len(x), len(x) :], K[len(x) :, : len(x)] = M, held.T, held
        found, *_ = np.linalg.lstsq(K, np.concatenate([M @ x - c * s, goal]))
        w, force = found[: len(x)], -found[len(x) :]
        scale = 1e-12 * (1.0 + np.abs(found).max())
        kkt = np.abs(K @ found - np.concatenate([M @ x - c * s, goal])).max() <= scale
        stick, push = np.abs(force[: (s == 0).sum()]), force[(s == 0).sum() :]
        if kkt and (w * s >= -scale).all() and (stick <= c[s == 0] + scale).all() and (push >= -scale).all():
            if (J @ w >= np.array(lower) - scale).all():
                return w
    raise AssertionError("no case fits")


def test_the_velocity_in_flight_is_that_of_all_cases_tried(tmp_path, rng):
    """Some joints stick, some slip, and some are stopped within the step."""
    problem, h, kinds = arm(tmp_path), 1e-3, set()
    system, c = problem.system, h * np.array([0.6, 0.2, 0.1])
    for _ in range(150):
        q = system.integrate(problem.q0, rng.normal(size=3))
        v = rng.normal(size=3) * 10.0 ** rng.uniform(-5, 1, size=3)
        motion = system.free_motion(0.0, q, v, h)
        M = motion.metric.dense()
        w = in_flight(motion)
        expected = law_of_joints(M, motion.free, c)
        assert np.abs(w - expected).max() <= 1e-12 * np.abs(motion.free).max()
        assert ((w == 0.0) == (np.abs(expected) < 1e-13)).all()
        kinds.add(tuple(w == 0.0))
    assert len(kinds) >= 5


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_the_velocity_with_a_contact_is_that_of_all_cases_tried(tmp_path, rng, e):
    """The ball of the last link on the floor: a row, and the bounds of the joints."""
    problem, h, touched = arm(tmp_path, e, floor=-0.9), 1e-3, 0
    system, c = problem.system, h * np.array([0.6, 0.2, 0.1])
    for _ in range(400):
        q = system.integrate(problem.q0, 0.6 * rng.normal(size=3))
        v = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 0.5)
        after = system.integrate(q, h * v)
        rows = problem.constraints.active(h, after, problem.tolerance)
        if len(rows.gap) != 1:
            continue
        step = mbvi.Paoli().step(problem, 0.0, q, v, h, Projector())
        motion = system.free_motion(h, after, v, h)
        J = np.array(rows.jacobian)
        expected = law_of_joints(motion.metric.dense(), motion.free, c, J, -e * (J @ v))
        assert np.abs(step.v - expected).max() <= 1e-11 * (1.0 + np.abs(motion.free).max())
        touched += step.percussion[0] > 0.0
    assert touched >= 10


@every_scheme
@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_kernels_step_as_python_does(tmp_path, scheme, damping):
    """In flight, at a contact with friction that bounces, and at rest."""
    problem = arm(tmp_path, 0.4, 0.5, floor=-0.9, damping=damping)
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=1.5, progress=False)
    assert run.impacts
    for i in range(0, len(run.t) - 1, 6):
        step = scheme.step(problem, float(run.t[i]), np.array(run.q[i]), np.array(run.v[i]), 1e-3, Projector())
        assert np.abs(step.v - run.v[i + 1]).max() < 1e-9
        assert np.abs(step.q - run.q[i + 1]).max() < 1e-10


@every_scheme
def test_a_joint_below_its_friction_does_not_creep(tmp_path, scheme):
    """An arm that hangs at an angle: gravity asks for less than the friction, and no bit of q changes."""
    problem = arm(tmp_path, friction=(20.0, 20.0, 20.0))
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=5.0, progress=False)
    assert (run.q == run.q[0]).all()
    assert (run.v == 0.0).all()


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_joint_breaks_away_at_its_friction(tmp_path, share):
    """A slider on an incline of 1 N: it stays at c = 1 / 0.999 N, and moves at c = 1 / 1.001 N."""
    problem = slider(tmp_path, 1.0 / share, gravity=(0.5, 0, 0))
    run = mbvi.simulate(problem, mbvi.Centered(), step=1e-3, duration=1.0, progress=False)
    expected = 0.5 * (1.0 - 1.0 / share) / 2.0 if share > 1.0 else 0.0
    assert run.q[-1, 0] == pytest.approx(expected, rel=1e-9, abs=1e-300)


@every_scheme
def test_a_slider_stops_where_friction_says(tmp_path, scheme):
    """v0^2 m / (2 c), at the time v0 m / c; then it rests for good."""
    problem, errors = slider(tmp_path, 3.0, speed=1.0), []
    for h in (4e-3, 1e-3):
        run = mbvi.simulate(problem, scheme, step=h, duration=1.0, progress=False)
        errors.append(abs(run.q[-1, 0] - 1.0 / 3.0))
        stopped = run.t[np.flatnonzero(run.v[:, 0])[-1]]
        assert 2.0 / 3.0 - h <= stopped <= 2.0 / 3.0 + h
        assert (run.v[run.t > 2.0 / 3.0 + h] == 0.0).all()
    assert errors[1] < 1e-3
    assert errors[1] < 0.5 * errors[0] or errors[1] < 1e-6


def test_the_motion_while_it_slides_is_of_order_two(tmp_path):
    """The default's own steps, `Centered`, on a chain whose joints all keep sliding."""
    problem, ends = arm(tmp_path, friction=(0.05, 0.03, 0.02)), []
    moving = mbvi.Problem(problem.system, [], problem.q0, np.array([4.0, 3.0, 5.0]))
    for h in (4e-3, 2e-3, 1e-3, 5e-4):
        run = mbvi.simulate(moving, mbvi.Centered(), step=h, duration=0.1, progress=False)
        assert (run.v > 0.0).all()
        ends.append(np.array(run.v[-1]))
    differences = [np.abs(b - a).max() for a, b in pairwise(ends)]
    assert differences[0] > 3.5 * differences[1] > 3.5**2 * differences[2]


@every_scheme
def test_dry_friction_takes_energy_only(tmp_path, scheme):
    problem = arm(tmp_path)
    run = mbvi.simulate(problem, scheme, step=2.5e-4, duration=1.0, progress=False)
    total = run.energy()
    assert np.diff(total).max() < 1e-4 * np.ptp(total)
    assert total[-1] < total[0] - 0.1


def test_a_joint_at_its_limit_keeps_it(tmp_path):
    """A slider runs into its limit with e = 0.5, slides back, and stops."""
    limit = '<limit lower="-1" upper=".2" effort="1" velocity="1"/>'
    problem = slider(tmp_path, 1.0, speed=2.0, others=limit, e=0.5)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-4, duration=3.0, progress=False)
    impact = np.sqrt(4.0 - 2.0 * 0.2 * 0.5)
    assert len(run.impacts) == 1
    assert run.impacts[0].before[0] == pytest.approx(-impact, rel=1e-3)
    assert run.q[-1, 0] == pytest.approx(0.2 - (0.5 * impact) ** 2, abs=1e-3)
    assert run.v[-1, 0] == 0.0


def test_a_robot_stands_by_the_friction_of_its_joints():
    """Without a control: its joints hold it, and after its landing nothing moves any more."""
    scene = mbvi.Scene(friction=0.8)
    scene.add_halfspace((0, 0, 1), name="floor")
    legs, joints = ("FL", "FR", "RL", "RR"), {"hip": 0.0, "thigh": 0.6, "calf": -1.2}
    stance = {f"{leg}_{joint}_joint": x for leg in legs for joint, x in joints.items()}
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.36), joints=stance,
        joint_friction=dict.fromkeys(stance, 25.0),
    )  # fmt: skip
    run = mbvi.simulate(scene.build(), step=1e-3, duration=1.0, progress=False)
    assert (run.v[-200:, 6:] == 0.0).all()
    assert np.abs(run.v[-200:]).max() < 1e-9
    assert np.abs(run.q[-1, 7:] - run.q[0, 7:]).max() < 0.2


def test_a_robot_beside_a_ball_moves_as_alone(tmp_path):
    """In a scene of several parts, the ball far away."""
    runs = []
    for beside in (False, True):
        scene = mbvi.Scene()
        kinds = [("continuous", "0 1 0", dynamics(0.4)), ("continuous", "1 0 0", dynamics(0.1))]
        scene.add_urdf(chain(tmp_path, kinds), "fixed", joints={"joint 0": 1.0, "joint 1": 0.5}, joint_friction=True)
        if beside:
            scene.add_sphere(0.1, 1.0, position=(5, 0, 0))
        runs.append(mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=1.0, progress=False))
    nq = runs[0].q.shape[1]
    assert np.abs(runs[1].q[:, :nq] - runs[0].q).max() < 1e-12


def test_coupled_joints_share_their_friction(tmp_path):
    """Two equal sliders that are coupled: the friction of both holds, or neither."""
    scene = mbvi.Scene(gravity=(1, 0, 0))
    limit = '<limit lower="-9" upper="9" effort="1" velocity="1"/>'
    path = chain(tmp_path, [("prismatic", "1 0 0", dynamics(1.5) + limit)], masses=(2.0,))
    for name, friction in (("a", 2.5), ("b", 1.0)):
        scene.add_urdf(
            path, "fixed", name=name, position=(0, 3.0 * (name == "a"), 0), joint_friction={"joint 0": friction}
        )
    scene.couple("a/joint 0", "b/joint 0")
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=1.0, progress=False)
    # 4 N of weight against 3.5 N
    assert run.q[-1] == pytest.approx([0.0625, 0.0625], rel=1e-9)
    assert run.loop_gap().max() < 1e-12


@every_scheme
@pytest.mark.parametrize("how", ["brake", "weld"])
def test_what_an_equality_holds_has_no_friction_to_overcome(tmp_path, how, scheme):
    """The others move as if the joint had none; it stands still, whichever sign its rounding has."""
    path = chain(tmp_path, [("continuous", "0 1 0", ""), ("continuous", "0.6 0 0.8", ""), ("continuous", "1 0 0", "")])
    runs = []
    for friction in ({"joint 0": 0.3, "joint 1": 0.2}, {"joint 0": 0.3}):
        scene = mbvi.Scene()
        joints = {"joint 0": 1.0, "joint 1": 0.7, "joint 2": 0.4}
        scene.add_urdf(path, base="fixed", joints=joints, joint_friction=friction, name="arm")
        if how == "brake":
            scene.couple("arm/joint 1", "arm/joint 0", ratio=0.0, offset=0.7)
        else:
            scene.weld("arm/link 0", "arm/link 1")
        runs.append(mbvi.simulate(scene.build(), scheme, step=2e-3, duration=0.6))
    held, free = runs
    assert np.abs(held.v[:, 1]).max() < 1e-12
    assert np.abs(free.v[:, 0]).max() > 0.5
    np.testing.assert_allclose(held.v, free.v, rtol=0, atol=1e-9)


def test_rollouts_and_a_simulator_have_it_too(tmp_path):
    problem = arm(tmp_path, 0.4, 0.5, floor=-0.9)
    run = mbvi.simulate(problem, mbvi.Centered(), step=1e-3, duration=0.5, progress=False)
    simulator = mbvi.Simulator(problem, mbvi.Centered(), step=1e-3)
    simulator.step(500)
    assert np.array_equal(simulator.q, run.q[-1])


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True)], ids=["paoli", "projecting"])
def test_what_jams_beside_a_robot_has_no_restitution(tmp_path, scheme):
    """A wedge that is driven between two walls; an arm with dry friction hangs far away, and a ball keeps its e."""
    c, s = np.cos(0.15), np.sin(0.15)
    scene = mbvi.Scene(friction=0.5, restitution=0.5)
    for side in (c, -c):
        scene.add_halfspace((side, 0, s))
    scene.add_urdf(
        chain(tmp_path, [("continuous", "0 1 0", dynamics(0.4))]), "fixed", position=(0, 3, 5), joints={"joint 0": 1.0},
        joint_friction=True,
    )  # fmt: skip
    corners = [(sign * z * s / c, y, z) for z in (0.2, 0.4) for sign in (-1.0, 1.0) for y in (-0.1, 0.1)]
    scene.add_convex(np.array(corners), np.array([[0.0, 0.0, 0.05]]), 1.0)
    scene.add_box((0.04, 0.04, 0.04), position=(0, 1.0, 0.28), fixed=True)
    scene.add_sphere(0.02, 0.1, (0, 1.0, 0.37))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.11, progress=False)
    assert any("jammed" in note for note in run.notes)
    assert np.abs(run.v[-1, 1:7]).max() < 0.1
    fall = np.sqrt(2.0 * 9.81 * 0.05)
    assert run.v[-1, 9] == pytest.approx(0.5 * fall - 9.81 * (0.11 - fall / 9.81), abs=0.03)
    assert run.v[-1, 0] != 0.0


def test_it_is_kept_in_files(tmp_path):
    problem = arm(tmp_path)
    run = mbvi.simulate(problem, mbvi.Centered(), step=1e-3, duration=0.3, progress=False)
    run.save(tmp_path / "run.h5")
    again = mbvi.simulate(
        mbvi.load(tmp_path / "run.h5").problem, mbvi.Centered(), step=1e-3, duration=0.3, progress=False
    )
    assert np.array_equal(run.q, again.q)


def test_files_state_it_and_it_is_taken_in_where_asked(tmp_path):
    """By default a warning names it; `joint_friction=True` has that of the file, a mapping its own."""
    path = chain(tmp_path, [("continuous", "0 1 0", dynamics(0.4)), ("continuous", "0 1 0", dynamics(0.0))])
    frictions = []
    for given in (False, True, {"joint 1": 0.3}):
        scene = mbvi.Scene()
        scene.add_urdf(path, "fixed", joint_friction=given)
        problem = scene.build()
        assert ("dry friction" in str(problem.report())) == (given is False)
        frictions.append(problem.system.friction.tolist())
    assert frictions == [[0.0, 0.0], [0.4, 0.0], [0.0, 0.3]]


MODEL = """<mujoco><option gravity="1 0 0"/>{}
  <worldbody><body><joint name="j" type="slide" axis="1 0 0" frictionloss="1.5"/>
  <geom name="g" size=".1" mass="2"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("given", "flag", "friction"),
    [
        (True, "", 1.5),
        (False, "", 0.0),
        ({"j": 0.5}, "", 0.5),
        (True, '<option><flag frictionloss="disable"/></option>', 0.0),
    ],
    ids=["of the file", "left out", "given", "disabled"],
)
def test_models_of_mujoco_have_it_by_default(tmp_path, given, flag, friction):
    """A weight of 2 N pulls."""
    pytest.importorskip("mujoco")
    path = tmp_path / "model.xml"
    path.write_text(MODEL.format(flag))
    scene = mbvi.Scene(gravity=(1, 0, 0))
    scene.add_mjcf(path, joint_friction=given)
    problem = scene.build()
    assert problem.system.friction.tolist() == [friction]
    assert ("dry friction of j" in problem.report()) == (given is False)
    run = mbvi.simulate(problem, mbvi.Centered(), step=1e-3, duration=1.0, progress=False)
    assert run.v[-1, 0] == pytest.approx((2.0 - friction) / 2.0, rel=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"elbow": 1.0}, "no joint 'elbow'"),
        ({"joint 0": -1.0}, "joint 0"),
        ("much", "joint_friction must be a mapping"),
    ],
)
def test_what_is_no_friction_of_joints_is_refused(tmp_path, given, said):
    path = chain(tmp_path, [("continuous", "0 1 0", "")])
    with pytest.raises(mbvi.InputError, match=said):
        mbvi.Scene().add_urdf(path, "fixed", joint_friction=given)


@pytest.mark.parametrize("scheme", [mbvi.EventDriven(), mbvi.SchatzmanPaoli()], ids=["events", "schatzman_paoli"])
def test_schemes_that_do_not_know_it_say_so(tmp_path, scheme):
    with pytest.raises(mbvi.UnsuitableError, match="dry friction of joints"):
        mbvi.simulate(arm(tmp_path), scheme, step=1e-3, duration=0.1, progress=False)


@pytest.mark.slow(seconds=20)
@every_scheme
@pytest.mark.parametrize("name", ["talos_data/robots/talos_reduced.urdf", "tiago_description/robots/tiago.urdf"])
def test_published_robots_fall_with_the_friction_of_their_files(name, scheme):
    scene = mbvi.Scene(friction=0.6)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(REAL_ROBOTS / name, position=(0, 0, 1.1), joint_friction=True)
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.8, progress=False)
    assert run.impacts
    assert (run.v[-1, 6:] == 0.0).any()


@pytest.mark.parametrize(
    "scheme", [mbvi.Centered(), mbvi.Centered(project_positions=True)], ids=["plain", "projecting"]
)
def test_damping_and_dry_friction_together_are_of_order_two(tmp_path, scheme):
    """Of a slider, m dv/dt = -c - d v, as long as it slides."""
    c, d, m, speed, end = 1.5, 4.0, 2.0, 3.0, 0.5
    path = chain(tmp_path, [("prismatic", "1 0 0", dynamics(c, d) + LIMIT)], masses=(m,))
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(path, "fixed", velocity={"joint 0": speed}, joint_friction=True)
    problem = scene.build()
    exact = (speed + c / d) * np.exp(-d * end / m) - c / d
    off = [abs(mbvi.simulate(problem, scheme, step=h, duration=end, progress=False).v[-1, 0] - exact)
           for h in (0.02, 0.01, 0.005)]  # fmt: skip
    assert off[-1] < 1e-4 and all(3.8 < a / b < 4.2 for a, b in pairwise(off)), off


@pytest.mark.parametrize("damping", [1e2, 1e5])
def test_dry_friction_beside_stiff_damping_stops_a_slider_and_drives_none(tmp_path, damping):
    path = chain(tmp_path, [("prismatic", "1 0 0", dynamics(1.5, damping) + LIMIT)], masses=(2.0,))
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(path, "fixed", velocity={"joint 0": 3.0}, joint_friction=True)
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=0.02, duration=0.4, progress=False)
    assert (run.v[:, 0] >= 0.0).all() and (np.diff(run.v[:, 0]) <= 0.0).all() and run.v[-1, 0] == 0.0


@pytest.mark.parametrize("scheme", SCHEMES[2:4], ids=["plain", "projecting"])
def test_damping_beside_dry_friction_is_that_of_plain_numpy(tmp_path, scheme):
    """A step of an arm whose joints all slide, from the formulas of docs/howto/schemes.md."""
    h, d, c = 0.01, 0.4, np.array([0.06, 0.02, 0.01])
    problem = arm(tmp_path, damping=d, friction=c)
    q, v = problem.q0, np.array([1.5, -1.2, 2.0])
    run = mbvi.simulate(problem.at(q, v), scheme, step=h, duration=h, progress=False)
    model, middle = problem.system.model, pin.integrate(problem.system.model, q, 0.5 * h * v)
    data = model.createData()
    M = pin.crba(model, data, middle)
    M = np.triu(M) + np.triu(M, 1).T

    def stepped(w, damping, force):
        return w + np.linalg.solve(M + 0.5 * h * np.diag(damping), 0.5 * h * (force - damping * w))

    damping = np.full(3, d)
    free = stepped(v, damping, -pin.nonLinearEffects(model, data, middle, v))
    slowed = free - 0.5 * h * np.linalg.solve(M, c * np.sign(v))
    damping = damping * np.clip(slowed / free, 0.5, 1.5)
    force, ends = -pin.nonLinearEffects(model, data, middle, slowed), [v]
    for _ in range(4):
        ends.append(stepped(ends[-1], damping, force))
    expected = 2.0 * ends[3] - ends[4] - h * np.linalg.solve(M, c * np.sign(v))
    np.testing.assert_allclose(run.v[-1], expected, rtol=0, atol=1e-12)


def drawn_step(rng):
    """M, D, c, v and the damping of a step h without forces, as `Centered` has it."""
    n, h = int(rng.integers(1, 6)), 10.0 ** rng.uniform(-4, -1)
    B = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-1, 1, n)[:, None]
    M, parent, none = B @ B.T + 1e-3 * np.eye(n), np.arange(n) - 1, np.zeros(n)
    D = 10.0 ** rng.uniform(-3, 4, n) * (rng.random(n) < 0.8)
    c = 10.0 ** rng.uniform(-2, 3, n) * (rng.random(n) < 0.8) + 1e-9
    v, damping = rng.normal(size=n) * 10.0 ** rng.uniform(-2, 1, n), np.empty(n)
    half = TreeFreeMotion(M, D, parent, v, 0.5 * h, none, none, False, c)
    damp_slowed(D, half.free, in_flight(half), damping)
    return M, v, in_flight(TreeFreeMotion(M, damping, parent, v, h, none, none, True, c))


def test_damping_beside_dry_friction_never_raises_the_energy(rng):
    """Of any mass matrix, also far beyond the steps at which it is of order two."""
    for _ in range(1500):
        M, v, w = drawn_step(rng)
        assert w @ M @ w <= (1.0 + 1e-12) * (v @ M @ v)


@pytest.mark.parametrize("rounding", [1e-17, -1e-17])
def test_a_joint_at_rest_drives_no_other(tmp_path, rounding):
    """The second hangs and is damped; the speed of the first, which its friction holds, is rounding."""
    kinds = [("continuous", "0 1 0", dynamics(c, d)) for c, d in ((50.0, 0.0), (0.0, 5.0))]
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(chain(tmp_path, kinds), "fixed", velocity={"joint 0": rounding}, joint_friction=True)
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=0.01, duration=0.5, progress=False)
    assert np.abs(run.v[1:, 1]).max() <= 1e-16 and not run.v[1:, 0].any()


def _two_hinged_boxes(axis, first, second):
    """Two free boxes with a hinge of friction between them, and their angular velocities."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    between = np.array([0.2, 0.0, 0.0])
    scene.add_box((0.2,) * 3, position=(0, 0, 0), angular_velocity=first, name="a")
    moved = np.cross(first, between) + np.cross(second, between)
    scene.add_box((0.2,) * 3, position=tuple(2 * between), angular_velocity=second, velocity=moved, name="b")
    scene.hinge("a", "b", at=tuple(between), axis=axis, friction=0.2)
    return scene.build()


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.StewartTrinkle()], ids=str)
@pytest.mark.parametrize("slower", [0.0, 0.1])
def test_a_hinge_between_bodies_stops_its_own_turning_only(scheme, slower):
    """The friction is an inner torque: both go on together with the momentum they had."""
    problem = _two_hinged_boxes((0, 0, 1), (0, 0, 3.0), (0, 0, 3.0 - slower))
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.2)
    np.testing.assert_allclose(run.v[-1, [3, 4, 9, 10]], 0.0, atol=1e-12)
    assert abs(run.v[-1, 11] - run.v[-1, 5]) < 1e-10
    # a step along a chord takes a part of order h from the energy
    assert problem.system.kinetic_energy(run.q[-1], run.v[-1]) > run.energy()[0] * 0.995 - 0.01 * slower


@pytest.mark.slow
def test_a_spin_about_any_axis_passes_a_hinge(rng):
    """As one rigid body: the rate of the hinge is rounding, and so is what the law has to answer."""
    for _ in range(20):
        axis, spin = rng.normal(size=(2, 3))
        problem = _two_hinged_boxes(tuple(axis), tuple(3 * spin), tuple(3 * spin))
        run = mbvi.simulate(problem, mbvi.Centered(), step=1e-3, duration=0.05)
        np.testing.assert_allclose(run.v[-1, 3:6] @ run.v[-1, 3:6], run.v[-1, 9:12] @ run.v[-1, 9:12], rtol=1e-6)
        assert abs(run.energy()[-1] / run.energy()[0] - 1) < 1e-5
