"""Couplings and mimic joints that are switched on and off at run time."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.results.run_data import arriving

STEP = 1e-3
SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
    mbvi.SchatzmanPaoli(),
]  # fmt: skip
LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="{1}" iyy="{1}" izz="{1}" ixy="0" ixz="0" iyz="0"/>
</inertial></link>"""
JOINT = """<joint name="{0}" type="{2}"><parent link="base"/><child link="{1}"/><axis xyz="0 0 1"/>
<limit effort="0" velocity="0" lower="-100" upper="100"/>{3}</joint>"""
INERTIA = {"motor": 0.02, "load": 0.3, "spare": 0.1}


@pytest.fixture
def gearbox(tmp_path):
    """Return a function that adds three flywheels on one base to a scene; the kind of their joints is given."""

    def added(scene, kind="revolute", mimic="", **options):
        links = "".join(LINK.format(name, inertia) for name, inertia in INERTIA.items())
        joints = "".join(JOINT.format(f"{n}_axle", n, kind, mimic if n == "spare" else "") for n in INERTIA)
        path = tmp_path / f"{kind}{len(mimic)}.urdf"
        path.write_text(f'<robot name="box"><link name="base"/>{links}{joints}</robot>')
        return scene.add_urdf(path, base="fixed", **options)

    return added


def run_of(problem, switch, scheme=None, duration=0.06, **options):
    return mbvi.simulate(
        problem, scheme or mbvi.Centered(), step=STEP, duration=duration, switch=switch, progress=False, **options
    )


def between(name, start, end):
    return lambda state: {name: start - 1e-9 < state.t < end - 1e-9}


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    st.sampled_from([-2.0, -0.5, 0.0, 1.0, 3.0]), st.lists(st.floats(-5.0, 5.0), min_size=16, max_size=16),
    st.lists(st.floats(-0.4, 0.4), min_size=12, max_size=12),
)  # fmt: skip
def test_a_gear_that_engages_is_the_plastic_impact_of_its_joints(ratio, v, aside):
    """The projection in plain numbers with M of Pinocchio, of two arms; the offset is that of the moment."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    for name in ("left", "right"):
        scene.add_urdf("robot:arm", base="fixed", name=name, position=(0, 3.0 * (name == "right"), 0))
    model = scene.build().model("left")
    joints = [model.names[j] for j in range(1, model.njoints)]
    scene.couple(f"left/{joints[1]}", f"right/{joints[2]}", ratio, name="gear", active=False)
    problem = scene.build()
    n = model.nv
    assert problem.system.nv == 2 * n == 16
    q = problem.q0.copy()
    q[np.r_[:6, 8:14]] += aside
    q[np.r_[6:8, 14:16]] = 0.02
    sim = mbvi.Simulator(problem.at(q, v), mbvi.Centered(), step=STEP)
    sim.switch({"gear": True})
    M = np.zeros((2 * n, 2 * n))
    for part in (slice(0, n), slice(n, 2 * n)):
        upper = np.triu(pin.crba(model, model.createData(), q[part]))
        M[part, part] = upper + np.triu(upper, 1).T
    row = np.zeros(2 * n)
    row[1], row[n + 2] = 1.0, -ratio
    response = np.linalg.solve(M, row)
    expected = v - response * (row @ v) / (row @ response)
    np.testing.assert_allclose(sim.v, expected, atol=1e-12)
    offset = q[1] - ratio * q[n + 2]
    sim.step(20)
    assert sim.q[1] - ratio * sim.q[n + 2] == pytest.approx(offset, abs=1e-12)


def test_a_shaft_couples_two_gears_in_turn(gearbox):
    """Flywheels have their momentum alone: closed form, the record of percussions, forces and the energy."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    name = gearbox(scene, velocity={"motor_axle": 5.0, "spare_axle": -1.0})
    scene.couple(f"{name}/load_axle", f"{name}/motor_axle", -2.0, 0.7, name="first", active=False)
    scene.couple(f"{name}/load_axle", f"{name}/motor_axle", 3.0, name="second", active=False)
    problem = scene.build()
    assert "first: box/load_axle = -2 box/motor_axle + 0.7, switched off" in problem.report()
    run = run_of(problem, lambda s: {"first": 0.0195 < s.t < 0.0395, "second": s.t > 0.0395})
    a, b, _ = INERTIA.values()

    def meshed(motor, load, ratio):
        speed = (a * motor + ratio * b * load) / (a + ratio**2 * b)
        return np.array([speed, ratio * speed])

    first = meshed(5.0, 0.0, -2.0)
    second = meshed(*first, 3.0)
    model = problem.model(name)
    order = [model.idx_vs[model.getJointId(f"{wheel}_axle")] for wheel in INERTIA]
    motor, load, spare = run.v[:, order].T
    np.testing.assert_allclose(np.array([motor, load])[:, 20:40].T, np.tile(first, (20, 1)), atol=1e-13)
    np.testing.assert_allclose(np.array([motor, load])[:, 40:].T, np.tile(second, (21, 1)), atol=1e-13)
    np.testing.assert_allclose(spare, -1.0, atol=1e-14)
    assert [i.constraints for i in run.impacts] == [("first",), ("second",)]
    for impact, pushed, gone in zip(run.impacts, (first, second), ((5.0, 0.0), first), strict=True):
        assert impact.percussion[0] == pytest.approx(b * abs(pushed[1] - gone[1]), abs=1e-13)
        lost = 0.5 * (a * gone[0] ** 2 + b * gone[1] ** 2 - a * pushed[0] ** 2 - b * pushed[1] ** 2)
        assert impact.energy_change == pytest.approx(-lost, abs=1e-13)
        assert 0.5 * impact.percussion @ (impact.before + impact.after) == pytest.approx(-lost, abs=1e-13)
        assert np.isnan(impact.point).all()
        np.testing.assert_allclose(impact.after, 0.0, atol=1e-13)
    places = run.q[:, order]
    for part, ratio in ((slice(20, 41), -2.0), (slice(40, 61), 3.0)):
        held = places[part, 1] - ratio * places[part, 0]
        np.testing.assert_allclose(held, held[0], atol=1e-13)
    assert run.loop_gap().max() < 1e-13
    assert not run.loop_forces("first")[:21].any()


def test_a_brake_stops_a_joint_that_turns_without_limits_where_it_is(gearbox):
    scene = mbvi.Scene(gravity=(0, 0, 0))
    name = gearbox(scene, "continuous", velocity={"load_axle": 40.0, "motor_axle": 1.0})
    scene.couple(f"{name}/load_axle", f"{name}/motor_axle", 0.0, name="brake", active=False)
    run = run_of(scene.build(), between("brake", 0.1, 0.15), duration=0.2)
    model = run.problem.model(name)
    joint = model.getJointId("load_axle")
    q, v = run.q[:, model.idx_qs[joint] :][:, :2], run.v[:, model.idx_vs[joint]]
    # 4 rad, more than half a turn
    np.testing.assert_allclose(q[100:151], np.tile([np.cos(4.0), np.sin(4.0)], (51, 1)), atol=1e-12)
    assert (v[:100] == pytest.approx(40.0)) and not v[100:].any()
    assert run.impacts[0].percussion[0] == pytest.approx(0.3 * 40.0, abs=1e-12)


def arms(**options):
    """Two arms above a floor, coupled with each other and each within itself."""
    scene = mbvi.Scene(restitution=0.5, **options)
    scene.add_halfspace((0, 0, 1), name="floor")
    for name in ("left", "right"):
        scene.add_urdf("robot:arm", base="fixed", name=name, position=(0, 3.0 * (name == "right"), 0))
    model = scene.build().model("left")
    first, second, third = (model.names[j] for j in (1, 2, 3))
    scene.couple(f"left/{second}", f"left/{third}", -1.0, name="within")
    scene.couple(f"left/{first}", f"right/{second}", 0.5, 0.1, name="between", active=False)
    return scene.build()


@pytest.mark.parametrize("alone", [True, False], ids=["within one robot", "also between two"])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_run_is_that_of_a_simulator(scheme, alone):
    rough = not isinstance(scheme, mbvi.SchatzmanPaoli)
    problem = arms(friction=0.3 if rough else 0.0)

    def switch(state):
        step = round(state.t / STEP)
        return {"within": not 15 <= step < 30} | ({} if alone else {"between": 20 <= step < 40})

    run, sim = run_of(problem, switch, scheme), mbvi.Simulator(problem, scheme, step=STEP)
    for k in range(61):
        np.testing.assert_array_equal(run.q[k], sim.q)
        np.testing.assert_array_equal(arriving(run)[k], sim.v)
        sim.switch(switch(type("State", (), {"t": k * STEP})))
        np.testing.assert_array_equal(run.v[k], sim.v)
        sim.step()
    assert len(run.record.switches) == (2 if alone else 4)
    assert np.abs(run.v[30] - arriving(run)[30]).max() > 1e-6


def test_a_mimic_joint_is_switched_off_and_follows_again(gearbox):
    """A mimic joint is a coupling with a name; it follows with the offset of the moment when it is switched on."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    name = gearbox(scene, mimic='<mimic joint="load_axle" multiplier="2" offset="0.5"/>', velocity={"load_axle": 1.0},
                   control=lambda t, q, v: [0.0, 0.0, 0.3])  # fmt: skip
    problem = scene.build()
    model = problem.model(name)
    load, spare = (model.idx_qs[model.getJointId(f"{wheel}_axle")] for wheel in ("load", "spare"))
    assert spare == 2
    run = run_of(problem, lambda s: {f"{name}_spare_axle": not 0.0195 < s.t < 0.0395})
    offset = run.q[:, spare] - 2.0 * run.q[:, load]
    np.testing.assert_allclose(offset[:21], 0.5, atol=1e-13)
    # 3 rad/s^2 of the one, none of the other
    np.testing.assert_allclose(run.v[40:, load] * 2.0, run.v[40:, spare], atol=1e-13)
    assert offset[40] == pytest.approx(0.5 + 0.5 * 3.0 * 0.02**2, abs=1e-12)
    np.testing.assert_allclose(offset[40:], offset[40], atol=1e-13)
    np.testing.assert_allclose(run.v[20:40, load], run.v[20, load], atol=1e-13)


@pytest.mark.parametrize("kind", ["joint", "tendon"])
def test_an_equality_of_a_mjcf_that_is_off_is_switched_on(tmp_path, kind):
    pytest.importorskip("mujoco")
    body = '<body pos="{1} 0 0"><joint name="{0}" axis="0 0 1"/><geom type="box" size=".1 .1 .1" mass="1"/></body>'
    tendons = "".join(f'<fixed name="t{n}"><joint joint="{n}" coef="1"/></fixed>' for n in "ab")
    sides = 'joint1="a" joint2="b"' if kind == "joint" else 'tendon1="ta" tendon2="tb"'
    (tmp_path / "pair.xml").write_text(
        f"<mujoco><worldbody>{body.format('a', 0)}{body.format('b', 1)}</worldbody><tendon>{tendons}</tendon>"
        f'<equality><{kind} name="gear" {sides} polycoef="0.3 -2 0 0 0" active="false"/></equality></mujoco>'
    )
    scene = mbvi.Scene()
    name = scene.add_mjcf(tmp_path / "pair.xml", velocity={"a": 3.0, "b": 1.0})
    run = run_of(scene.build(), between(f"{name}_gear", 0.02, 0.04))
    # both have one inertia: (3, 1) projected onto the multiples of (-2, 1)
    np.testing.assert_allclose(run.v[:20], np.tile([3.0, 1.0], (20, 1)), atol=1e-13)
    np.testing.assert_allclose(run.v[20:], np.tile([2.0, -1.0], (41, 1)), atol=1e-13)
    held = run.q[20:, 0] + 2.0 * run.q[20:, 1]
    np.testing.assert_allclose(held, 5.0 * 0.02, atol=1e-12)


def test_a_file_keeps_which_couplings_were_on(tmp_path):
    run = run_of(arms(friction=0.3), lambda s: {"within": s.t < 0.02, "between": s.t > 0.04}, out=tmp_path / "run.h5")
    kept = mbvi.load(tmp_path / "run.h5")
    np.testing.assert_array_equal(kept.loop_gap(), run.loop_gap())
    for name in ("within", "between"):
        np.testing.assert_array_equal(kept.loop_forces(name), run.loop_forces(name))
        assert run.loop_forces(name).any()
    assert [i.constraints for i in kept.impacts] == [i.constraints for i in run.impacts]
    (made,) = [item for item in kept.record.switches[-1].problem.scene.items.couplings if item.name == "between"]
    assert made.active
    assert made.offset == pytest.approx(run.q[-1, 0] - 0.5 * run.q[-1, 9], abs=1e-12)
    run.replay_html(tmp_path / "run.html")
    assert "between: left/" in (tmp_path / "run.html").read_text()
