"""Connections that are switched on and off while `simulate` runs."""

import base64
import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.results.run_data import arriving
from support.suction import suction_cup

STEP = 1e-3
MASSES = (2.0, 1.0)
SIZES = ((0.2, 0.3, 0.4), (0.3, 0.1, 0.2))
INERTIAS = [
    m / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) for m, (a, b, c) in zip(MASSES, SIZES, strict=True)
]
SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
    mbvi.SchatzmanPaoli(),
]  # fmt: skip
FLYING = np.array([1.0, 0, 0.5, 0.3, -1.0, 2.0, -1.0, 0.2, 0, 3.0, 0.5, -0.7])


def two_boxes(v=FLYING, gravity=(0, 0, 0), **options):
    """Two boxes that fly and spin, and a weld of both that is off."""
    scene = mbvi.Scene(gravity=gravity, **options)
    scene.add_box(SIZES[0], MASSES[0], position=(0, 0, 0), name="a")
    scene.add_box(SIZES[1], MASSES[1], position=(0.5, 0.2, 0.1), name="b")
    scene.weld("a", "b", name="grasp", active=False)
    problem = scene.build()
    return problem.at(problem.q0, v)


def between(start, end, name="grasp"):
    """Return a function that has a connection on from one time to another."""
    return lambda state: {name: start - 1e-9 < state.t < end - 1e-9}


def run_of(problem, scheme=None, duration=0.06, switch=None, **options):
    switch = between(0.02, 0.04) if switch is None else switch
    return mbvi.simulate(
        problem, scheme or mbvi.Centered(), step=STEP, duration=duration, switch=switch, progress=False, **options
    )


def rotation(quaternion):
    return pin.Quaternion(quaternion).toRotationMatrix()


def falling_boxes():
    """Two boxes that a weld may hold fall on a floor with friction; the first hangs from the world by a hinge."""
    scene = mbvi.Scene(restitution=0.5, friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.12), velocity=(0.5, 0, 0), name="a")
    scene.add_box((0.1, 0.1, 0.1), 0.5, position=(0.2, 0, 0.07), name="b")
    scene.weld("a", "b", name="grasp", active=False)
    scene.hinge("world", "a", at=(0, 0.1, 0.12), axis=(0, 1, 0), name="pin")
    return scene.build()


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=12))
def test_attaching_is_the_plastic_impact_of_two_bodies(v):
    """One rigid body with both momenta, in plain numbers; the record has the percussion, the moment and the energy."""
    v = np.array(v)
    run = run_of(two_boxes(v), duration=0.03, switch=between(0.02, 1.0))
    (made,) = run.record.switches
    before, after = made.before.reshape(2, 6), made.after.reshape(2, 6)
    places = made.q.reshape(2, 7)
    turns = [rotation(place[3:]) for place in places]

    def momenta(rates):
        linear = sum(m * rate[:3] for m, rate in zip(MASSES, rates, strict=True))
        parts = zip(MASSES, INERTIAS, turns, places, rates, strict=True)
        return linear, sum(m * np.cross(x[:3], u[:3]) + R @ inertia @ u[3:] for m, inertia, R, x, u in parts)

    def energy(rates):
        parts = zip(MASSES, INERTIAS, rates, strict=True)
        return sum(0.5 * m * u[:3] @ u[:3] + 0.5 * u[3:] @ inertia @ u[3:] for m, inertia, u in parts)

    linear, angular = momenta(before)
    centre = sum(m * x[:3] for m, x in zip(MASSES, places, strict=True)) / 3.0
    whole = sum(
        R @ inertia @ R.T
        + m * ((x[:3] - centre) @ (x[:3] - centre) * np.eye(3) - np.outer(x[:3] - centre, x[:3] - centre))
        for m, inertia, R, x in zip(MASSES, INERTIAS, turns, places, strict=True)
    )
    spin = np.linalg.solve(whole, angular - np.cross(centre, linear))
    for R, place, rate in zip(turns, places, after, strict=True):
        np.testing.assert_allclose(rate[:3], linear / 3.0 + np.cross(spin, place[:3] - centre), atol=1e-11)
        np.testing.assert_allclose(R @ rate[3:], spin, atol=1e-11)
    jump = MASSES[1] * (after[1, :3] - before[1, :3])
    turned = turns[1] @ INERTIAS[1] @ (after[1, 3:] - before[1, 3:])
    if np.abs(made.after - made.before).max() < 1e-6:
        return
    (impact,) = run.impacts
    assert impact.time == pytest.approx(0.02, abs=1e-12)
    assert set(impact.constraints) == {"grasp"}
    assert impact.energy_change == pytest.approx(energy(after) - energy(before), abs=1e-11)
    assert impact.energy_change == pytest.approx(0.5 * impact.percussion @ (impact.before + impact.after), abs=1e-11)
    np.testing.assert_allclose(impact.after, 0.0, atol=1e-11)
    contact = np.isfinite(impact.point[:, 0])
    pushed = (impact.percussion[contact, None] * impact.normal[contact]).sum(axis=0)
    np.testing.assert_allclose(pushed, jump, atol=1e-11)
    np.testing.assert_allclose(impact.point[contact], places[1:, :3][: contact.sum()], atol=1e-12)
    assert impact.percussion[~contact].sum() == pytest.approx(np.linalg.norm(turned), abs=1e-11)


def test_release_keeps_velocities_and_the_bodies_fly_on_alone():
    run = run_of(two_boxes())
    release = run.record.switches[1]
    assert release.connections == {"grasp": False}
    np.testing.assert_array_equal(release.before, release.after)
    assert len(run.impacts) == 1
    # as long as they are held they are one body; then both centres fly straight on
    held, free = (relative(run.q[k]) for k in (40, 60))
    np.testing.assert_allclose(held, relative(run.q[20]), atol=1e-13)
    assert np.abs(free - held).max() > 1e-4
    places, rates = run.q[40].reshape(2, 7)[:, :3], run.v[40].reshape(2, 6)[:, :3]
    np.testing.assert_allclose(run.q[60].reshape(2, 7)[:, :3], places + 0.02 * rates, atol=1e-14)


def relative(q):
    a, b = (pin.XYZQUATToSE3(place) for place in q.reshape(2, 7))
    return (a.inverse() * b).homogeneous


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_run_is_that_of_a_simulator(scheme):
    """Byte for byte, of free bodies, with contacts where the scheme has friction."""
    rough = not isinstance(scheme, mbvi.SchatzmanPaoli)
    problem = falling_boxes() if rough else two_boxes(gravity=(0, 0, -9.81))

    def switch(state):
        step = round(state.t / STEP)
        return {"grasp": 20 <= step < 40} | ({"pin": step < 30} if rough else {})

    run, sim = run_of(problem, scheme, switch=switch), mbvi.Simulator(problem, scheme, step=STEP)
    for k in range(61):
        np.testing.assert_array_equal(run.q[k], sim.q)
        if k in (20, 30, 40):
            np.testing.assert_array_equal(arriving(run)[k], sim.v)
            sim.switch(switch(type("State", (), {"t": k * STEP})))
        np.testing.assert_array_equal(run.v[k], sim.v)
        sim.step()
    assert len(run.record.switches) == (3 if rough else 2)


def test_the_run_of_a_robot_is_that_of_a_simulator():
    """Byte for byte in compiled code, under gravity and a control that depends on time; the held link stands still."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    track = mbvi.PDControl(np.array([[0.0] * 8, [0.3] * 8]), stiffness=1.0, damping=0.1, times=np.array([0.0, 0.05]))
    scene.add_urdf("robot:arm", base="fixed", name="arm", control=track)
    scene.weld("world", "arm/wrist", name="clamp", active=False)
    problem = scene.build()
    scheme = mbvi.Centered()
    run = run_of(problem, scheme, switch=between(0.02, 0.04, "clamp"))
    sim = mbvi.Simulator(problem, scheme, step=STEP)
    sim.step(20)
    sim.switch({"clamp": True})
    sim.step(20)
    np.testing.assert_array_equal(run.q[40], sim.q)
    sim.switch({"clamp": False})
    sim.step(20)
    np.testing.assert_array_equal(run.q[60], sim.q)
    np.testing.assert_array_equal(run.v[60], sim.v)
    model = problem.model("arm")
    data = model.createData()

    def place(q):
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[model.getFrameId("wrist")].homogeneous

    np.testing.assert_allclose(place(run.q[40]), place(run.q[20]), atol=1e-12)
    assert np.abs(place(run.q[20]) - place(run.q[0])).max() > 1e-4
    assert np.abs(place(run.q[60]) - place(run.q[40])).max() > 1e-4


def test_a_suction_cup_grasps_what_it_touches():
    """A control with a state: the cup comes down, holds the load when it touches it, and lifts it."""
    problem, gripper = suction_cup()
    run = run_of(problem, mbvi.Centered(project_positions=True), duration=2.0, switch=gripper.grasp)
    (made,) = run.record.switches
    # the law acts up to a step before the cup touches
    assert 0.11 - 1e-9 < made.q[9] < 0.11 + STEP * abs(run.v[run.t < made.time, 8]).max()
    assert run.q[-1, 9] == pytest.approx(0.3, abs=1e-2)
    assert run.q[-1, 9] - run.q[-1, 2] == pytest.approx(made.q[9] - made.q[2], abs=1e-12)
    # the force that carries the load, on it
    np.testing.assert_allclose(run.loop_forces("suction")[-1, :3], [0, 0, 0.1 * 9.81], atol=1e-2)
    k = int(np.searchsorted(run.t, made.time))
    assert not run.loop_forces("suction")[: k + 1].any()


@pytest.mark.parametrize("scheme", [mbvi.Centered(), mbvi.Paoli()], ids=repr)
def test_a_point_is_held_where_the_first_body_has_it(scheme):
    """A box on a hook falls for a while when it is let go, and swings on a longer rope afterwards."""
    scene = mbvi.Scene()
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0.3, 0, 1.0), name="load")
    scene.connect("world", "load", at=(0, 0, 1.0), name="hook")
    run = run_of(scene.build(), scheme, switch=lambda state: {"hook": not 0.05 < state.t < 0.15}, duration=0.3)
    rope = np.linalg.norm(run.q[:, :3] - [0, 0, 1.0], axis=1)
    np.testing.assert_allclose(rope[run.t < 0.05], 0.3, atol=1e-12)
    on = run.t > run.record.switches[1].time
    np.testing.assert_allclose(rope[on], rope[on][0], atol=1e-12)
    assert rope[-1] > 0.31
    assert np.abs(run.q[on, 2][-1] - run.q[on, 2][0]) > 1e-2
    assert run.loop_gap().max() < 1e-12
    # in free fall the energy at consistent times is constant
    falls = (run.t > 0.0515) & (run.t < 0.1495)
    np.testing.assert_allclose(run.energy()[falls], run.energy()[60], rtol=1e-12)


def test_an_equality_of_a_mjcf_is_switched(tmp_path):
    """Two bodies that a file welds come apart, and are held where they are when the weld is switched on again."""
    body = '<body name="{0}" pos="{1} 0 0"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>'
    (tmp_path / "pair.xml").write_text(
        f'<mujoco><option gravity="0 0 0"/><worldbody>{body.format("f", 0)}{body.format("g", 0.5)}</worldbody>'
        '<equality><weld name="hold" body1="f" body2="g"/></equality></mujoco>'
    )
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_mjcf(tmp_path / "pair.xml", name="pair")
    problem = scene.build()
    # free bases move in their own frames
    problem = problem.at(problem.q0, [0, 0, 0.3, 0, 0, 2.0, 0, 1.0, 0.3, 0, 0, 2.0])
    run = run_of(problem, switch=lambda state: {"pair_hold": not 0.0195 < state.t < 0.0395})
    start, held = relative(run.q[0]), relative(run.q[40])
    np.testing.assert_allclose(relative(run.q[20]), start, atol=1e-12)
    assert np.abs(held - start).max() > 1e-4
    np.testing.assert_allclose(relative(run.q[60]), held, atol=1e-12)
    np.testing.assert_allclose(run.q[60, [2, 9]], 0.06 * 0.3, atol=1e-12)


def test_limits_of_a_hinge_are_counted_from_where_it_was_switched_on():
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0), angular_velocity=(0, 0, 2.0), name="wheel")
    scene.hinge("world", "wheel", at=(0, 0, 0), axis=(0, 0, 1), name="axle", limits=(-0.1, 0.1), active=False)
    run = run_of(scene.build(), switch=lambda state: {"axle": state.t > 0.0995}, duration=0.3)
    angle = 2.0 * np.arctan2(run.q[:, 5], run.q[:, 6])
    # turned by 0.2 rad before, and by 0.1 rad up to the limit
    assert angle[100] == pytest.approx(0.2, abs=1e-9)
    assert angle[-1] == pytest.approx(0.3, abs=2.1e-3)
    assert [impact.constraints for impact in run.impacts] == [("axle upper limit",)]


def test_states_at_switches_are_recorded_in_thinned_runs():
    problem = two_boxes()
    run, thin = run_of(problem), run_of(problem, every=7)
    assert sorted({0, 20, 40, 60} | set(range(0, 60, 7))) == [round(t / STEP) for t in thin.t]
    which = np.searchsorted(run.t, thin.t - 1e-9)
    np.testing.assert_array_equal(thin.q, run.q[which])
    np.testing.assert_array_equal(thin.v, run.v[which])
    np.testing.assert_allclose(thin.energy(), run.energy()[which], rtol=1e-6)
    # the velocity between two states is not that after the next one is attached
    np.testing.assert_array_equal(run.at(0.0198)[1], run.record.switches[0].before)
    np.testing.assert_array_equal(run.at([0.0198, 0.02])[1], [run.record.switches[0].before, run.v[20]])
    for t in (0.0215, 0.0385):
        np.testing.assert_allclose(relative(run.at(t)[0]), relative(run.q[20]), atol=1e-12)


def test_a_file_keeps_which_connections_were_on(tmp_path):
    run = run_of(falling_boxes(), mbvi.Paoli(), record="contacts", every=3, out=tmp_path / "run.h5", duration=0.2,
                 switch=lambda s: {"grasp": 0.05 < s.t < 0.15, "pin": s.t < 0.1})  # fmt: skip
    run.save(tmp_path / "saved.h5")
    notes = [note for note in run.notes if "switched" in note]
    assert notes == [
        "connections were switched at t = 0.051 s: grasp on",
        "connections were switched at t = 0.1 s: pin off",
        "connections were switched at t = 0.15 s: grasp off",
    ]
    for name in ("run.h5", "saved.h5"):
        kept = mbvi.load(tmp_path / name)
        assert kept.notes == run.notes
        assert [str(one) for one in kept.record.switches] == [str(one) for one in run.record.switches]
        np.testing.assert_array_equal(kept.loop_gap(), run.loop_gap())
        np.testing.assert_array_equal(kept.loop_forces("pin"), run.loop_forces("pin"))
        np.testing.assert_array_equal(kept.energy(), run.energy())
        np.testing.assert_array_equal(kept.at(0.1234)[0], run.at(0.1234)[0])
        assert [i.constraints for i in kept.impacts] == [i.constraints for i in run.impacts]
        np.testing.assert_array_equal(kept.contact_forces("a"), run.contact_forces("a"))
        with pytest.raises(mbvi.InputError, match="functions that acted or switched"):
            kept.error_estimate()
    run.replay_html(tmp_path / "run.html")
    assert "t = 0.1 s: pin off" in (tmp_path / "run.html").read_text()
    run.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert notes[1] in page
    (line,) = re.findall(r"mbvi\.simulate\(.*\)", page)
    assert "duration=0.2" in line and line.endswith("switch=...)"), line
    (tmp_path / "start.h5").write_bytes(base64.b64decode(re.search('x-hdf5;base64,([^"]*)', page)[1]))
    np.testing.assert_array_equal(mbvi.load(tmp_path / "start.h5").problem.q0, run.problem.q0)


def test_released_bodies_collide_and_contacts_keep_their_names():
    """A box that is glued above another one falls onto it, and rests there; their pair is none before."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 3.0, position=(0, 0, 0.1), name="below")
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0.26), name="above")
    scene.weld("below", "above", name="glue")
    run = run_of(scene.build(), mbvi.Centered(project_positions=True), duration=0.2, record="contacts",
                 switch=lambda state: {"glue": state.t < 0.05})  # fmt: skip
    assert run.q[-1, 9] == pytest.approx(0.25, abs=1e-6)
    assert {name for impact in run.impacts for name in impact.constraints} == {"below | above", "below | floor"}
    for k, on_above in ((40, 0.0), (190, 9.81)):
        np.testing.assert_allclose(run.contact_forces("floor")[k, 2], -4.0 * 9.81, rtol=1e-6)
        np.testing.assert_allclose(run.contact_forces("above")[k, 2], on_above, atol=1e-6)


def test_the_error_estimate_switches_too():
    estimate = run_of(two_boxes()).error_estimate()
    assert 0.0 < estimate.largest < 1e-2
    assert estimate.fork == np.inf and not estimate.caveat


def test_what_cannot_be_switched_is_refused():
    problem = two_boxes()
    for found, words in (
        ({"glue": True}, "returned 'glue'; connections are grasp"),
        ({"grasp": 1}, "returned 1 for grasp; True or False is expected"),
        (["grasp"], "a dict of bool by connection, or None, is expected"),
    ):
        with pytest.raises(mbvi.InputError, match=words):
            run_of(problem, switch=lambda state, found=found: found)
    with pytest.raises(mbvi.InputError, match="build the problem from a Scene"):
        run_of(mbvi.reference.bouncing_ball(0.5).problem, mbvi.Paoli())
    run = mbvi.simulate(problem, duration=0.06, switch=between(0.02, 0.04), progress=False)
    assert "connections are switched" in run.notes[0]
    sim = mbvi.Simulator(problem, mbvi.Paoli(), step=STEP)
    with pytest.raises(mbvi.InputError, match="'glue' is no connection of the scene; known are grasp"):
        sim.switch({"glue": True})
