"""Connections that are switched within the steps of schemes that choose their lengths."""

import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import mbvi
from mbvi.results.plots.quantities import panels
from mbvi.results.run_data import arriving, states_at_switches
from support.suction import suction_cup

SCHEMES = [mbvi.EventDriven(1e-8), mbvi.Adaptive(1e-4)]
every_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=lambda one: one.name)
MASSES, SIZES = (2.0, 1.0), ((0.2, 0.3, 0.4), (0.3, 0.1, 0.2))
FLYING = np.array([1.0, 0, 0.5, 0.3, -1.0, 2.0, -1.0, 0.2, 0, 3.0, 0.5, -0.7])


def two_boxes(v=FLYING, gravity=(0, 0, 0)):
    """Two boxes that fly and spin, and a weld of both that is off."""
    scene = mbvi.Scene(gravity=gravity)
    scene.add_box(SIZES[0], MASSES[0], position=(0, 0, 0), name="a")
    scene.add_box(SIZES[1], MASSES[1], position=(0.5, 0.2, 0.1), name="b")
    scene.weld("a", "b", name="grasp", active=False)
    problem = scene.build()
    return problem.at(problem.q0, v)


def run_of(problem, switch, duration, scheme=SCHEMES[0], **options):
    return mbvi.simulate(problem, scheme, duration=duration, switch=switch, progress=False, **options)


def between(start, end, name="grasp"):
    return lambda state: {name: start <= state.t < end}


def relative(q):
    a, b = (pin.XYZQUATToSE3(place) for place in q.reshape(2, 7))
    return (a.inverse() * b).homogeneous


def projected(q, v, masses=MASSES, sizes=SIZES):
    """Return the nearest velocity in the kinetic metric that keeps the pose of two free boxes, in plain numbers."""
    M = np.zeros((12, 12))
    for k, (m, (a, b, c)) in enumerate(zip(masses, sizes, strict=True)):
        M[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = m * np.eye(3)
        turning = m / 12.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
        M[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = turning
    x, turns = q.reshape(2, 7)[:, :3], [pin.Quaternion(place[3:]).toRotationMatrix() for place in q.reshape(2, 7)]
    arm = x[1] - x[0]
    cross = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    J = np.zeros((6, 12))
    # v_b = v_a + w x arm, with angular velocities of the bodies in the world
    J[:3, :3], J[:3, 3:6], J[:3, 6:9] = -np.eye(3), cross @ turns[0], np.eye(3)
    J[3:, 3:6], J[3:, 9:] = -turns[0], turns[1]
    W = np.linalg.solve(M, J.T)
    return v - W @ np.linalg.solve(J @ W, J @ v)


@every_scheme
@settings(max_examples=6, deadline=None, derandomize=True)
@given(st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=12))
def test_welding_in_flight_is_the_projection_at_exactly_its_time(scheme, v):
    """The jump is the nearest velocity, energy and momenta are those of one body; the record says so."""
    run = run_of(two_boxes(np.array(v)), between(0.0173, 1.0), 0.05, scheme)
    (made,) = run.record.switches
    assert made.time == 0.0173
    k = states_at_switches(run)[0]
    assert run.t[k] == 0.0173
    flown = [[0, 0, 0], [0.5, 0.2, 0.1]] + 0.0173 * np.array(v).reshape(2, 6)[:, :3]
    np.testing.assert_allclose(made.q.reshape(2, 7)[:, :3], flown, atol=1e-12)
    np.testing.assert_array_equal(run.v[k], made.after)
    np.testing.assert_allclose(made.after, projected(made.q, made.before), atol=1e-12)
    held = relative(made.q)
    # at recorded states and, with its error of interpolation, between them
    for t, error in ((0.0173, 1e-12), (0.03, 10 * scheme.tolerance), (0.05, 1e-12)):
        np.testing.assert_allclose(relative(run.at(t)[0]), held, atol=error)
    if run.impacts:
        (impact,) = run.impacts
        assert impact.time == 0.0173 and set(impact.constraints) == {"grasp"}
        change = run.energy()[k] - run.energy()[k - 1]
        assert impact.energy_change == pytest.approx(change, abs=1e-12)


@every_scheme
def test_states_on_both_sides_of_a_switch_are_those_of_the_motion_before_and_after(scheme):
    run = run_of(two_boxes(), between(0.02, 0.04), 0.06, scheme)
    on, off = run.record.switches
    assert (on.time, off.time) == (0.02, 0.04)
    np.testing.assert_array_equal(off.before, off.after)
    for one, velocity in zip((on, off), (on.before, off.before), strict=True):
        q, v = run.at(one.time - 1e-12)
        np.testing.assert_allclose(v, velocity, atol=1e-9)
        np.testing.assert_allclose(q, one.q, atol=1e-10)
        np.testing.assert_array_equal(run.at(one.time)[1], one.after)
    np.testing.assert_allclose(arriving(run)[states_at_switches(run)], [on.before, off.before], atol=0.0)
    # both centres fly straight before and after
    places, rates = off.q.reshape(2, 7)[:, :3], off.after.reshape(2, 6)[:, :3]
    np.testing.assert_allclose(run.at(0.055)[0].reshape(2, 7)[:, :3], places + 0.015 * rates, atol=1e-13)
    np.testing.assert_allclose(run.at(0.015)[0].reshape(2, 7)[1, :3], [0.485, 0.203, 0.1], atol=1e-13)
    notes = tuple(note for note in run.notes if "switched" in note)
    assert notes == (
        "connections were switched at t = 0.02 s: grasp on",
        "connections were switched at t = 0.04 s: grasp off",
    )


def pendulum():
    """A box on a hook of the world, 0.3 m beside it, which turns about y."""
    scene = mbvi.Scene()
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0.3, 0, 1.0), name="load")
    scene.hinge("world", "load", at=(0, 0, 1.0), axis=(0, 1, 0), name="hook")
    return scene.build()


@every_scheme
def test_a_pendulum_that_is_let_go_at_a_place_flies_off_as_a_parabola(scheme):
    """The time at which it gets there is that of scipy's solution of the pendulum's equation."""
    run = run_of(pendulum(), lambda state: {"hook": state.q["load"][0] > 0.1}, 0.5, scheme)
    inertia = 0.1**2 / 6.0 + 0.3**2
    passes = lambda t, y: 0.3 * np.cos(y[0]) - 0.1  # noqa: E731
    passes.terminal = True
    exact = solve_ivp(
        lambda t, y: [y[1], 9.81 * 0.3 * np.cos(y[0]) / inertia], (0.0, 1.0), [0.0, 0.0], "DOP853", events=passes,
        rtol=1e-12, atol=1e-13,
    )  # fmt: skip
    (made,) = run.record.switches
    assert made.time == pytest.approx(exact.t_events[0][0], abs=10 * scheme.tolerance)
    angle, speed = exact.y_events[0][0]
    leaving = 0.3 * speed * np.array([-np.sin(angle), 0.0, -np.cos(angle)])
    np.testing.assert_allclose(made.after[:3], leaving, atol=10 * scheme.tolerance * np.abs(made.after).max())
    np.testing.assert_array_equal(made.before, made.after)
    assert not run.impacts
    for t in (made.time + 0.01, 0.5):
        flown = t - made.time
        parabola = made.q[:3] + flown * made.after[:3] - [0, 0, 0.5 * 9.81 * flown**2]
        np.testing.assert_allclose(run.at(t)[0][:3], parabola, atol=1e-12)
    assert run.loop_gap().max() < 1e-12
    np.testing.assert_allclose(run.energy(), run.energy()[0], rtol=10 * scheme.tolerance)


LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="{1}" iyy="{1}" izz="{1}" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="{0}_axle" type="revolute"><parent link="base"/><child link="{0}"/><axis xyz="0 0 1"/>
<limit effort="0" velocity="0" lower="-100" upper="100"/></joint>"""


@every_scheme
def test_a_gear_engages_between_two_spinning_joints_and_comes_off(tmp_path, scheme):
    """The momentum about both axles, weighted by the ratio, is kept; the offset is that of the moment."""
    (tmp_path / "box.urdf").write_text(
        f'<robot name="box"><link name="base"/>{LINK.format("motor", 0.02)}{LINK.format("load", 0.3)}</robot>'
    )
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(tmp_path / "box.urdf", base="fixed", velocity={"motor_axle": 5.0, "load_axle": 1.0})
    scene.couple("box/load_axle", "box/motor_axle", -2.0, 0.7, name="gear", active=False)
    run = run_of(scene.build(), between(0.1, 0.3, "gear"), 0.4, scheme)
    model = run.problem.model("box")
    order = [model.idx_vs[model.getJointId(f"{wheel}_axle")] for wheel in ("motor", "load")]
    a, b = 0.02, 0.3
    motor = (a * 5.0 - 2.0 * b * 1.0) / (a + 4.0 * b)
    together = np.array([motor, -2.0 * motor])
    for t, q, v in (
        (0.05, [0.25, 0.05], [5.0, 1.0]),
        (0.1, [0.5, 0.1], together),
        (0.25, [0.5, 0.1] + 0.15 * together, together),
        (0.4, [0.5, 0.1] + 0.3 * together, together),
    ):
        found = run.at(t)
        np.testing.assert_allclose(found[0][order], q, atol=1e-12)
        np.testing.assert_allclose(found[1][order], v, atol=1e-12)
    (impact,) = run.impacts
    assert (impact.time, impact.constraints) == (0.1, ("gear",))
    assert impact.percussion[0] == pytest.approx(b * abs(together[1] - 1.0), abs=1e-12)
    lost = 0.5 * (a * 25.0 + b - a * together[0] ** 2 - b * together[1] ** 2)
    assert impact.energy_change == pytest.approx(-lost, abs=1e-12)
    assert [one.time for one in run.record.switches] == [0.1, 0.3]


def resting_box(velocity, **options):
    """A box rests on its four corners; another one moves above it."""
    scene = mbvi.Scene(**options)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.4, 0.2), 1.0, position=(0, 0, 0.1), name="box")
    scene.add_box((0.1, 0.1, 0.1), 0.5, position=(0, 0, 1.0), velocity=velocity, name="ball")
    scene.weld("box", "ball", name="grasp", active=False)
    return scene.build()


@every_scheme
def test_contacts_open_where_what_is_attached_flies_up(scheme):
    run = run_of(resting_box((0, 0, 8.0), restitution=0.5), between(0.05, 1.0), 0.1, scheme, record="contacts")
    assert [(impact.time, impact.constraints) for impact in run.impacts] == [(0.05, ("grasp",))]
    up = 0.5 * (8.0 - 9.81 * 0.05) / 1.5
    for t in (0.05, 0.08, 0.1):
        flown = t - 0.05
        q, v = run.at(t)
        np.testing.assert_allclose(v[[2, 8]], up - 9.81 * flown, atol=1e-11)
        assert q[2] == pytest.approx(0.1 + up * flown - 0.5 * 9.81 * flown**2, abs=1e-11)
    force, at = run.contact_forces("box")[:, 2], run.t <= 0.05
    np.testing.assert_allclose(force[at][1:], 9.81, rtol=1e-9)
    assert not force[~at].any()


@every_scheme
def test_contacts_that_close_when_bodies_are_attached_bounce_as_one_body(tmp_path, scheme):
    """The connection acts first, then the law of the contacts, with the mass of both; a file keeps both impacts."""
    run = run_of(resting_box((0, 0, -2.0), restitution=0.5), between(0.05, 1.0), 0.1, scheme)
    down = 0.5 * (-2.0 - 9.81 * 0.05) / 1.5
    first, second = run.impacts
    assert (first.time, second.time) == (0.05, 0.05)
    assert first.constraints == ("grasp",) and set(second.constraints) == {"box | floor"}
    assert first.percussion[0] == pytest.approx(abs(down), abs=1e-11)
    assert second.percussion.sum() == pytest.approx(1.5 * 1.5 * abs(down), abs=1e-11)
    assert second.energy_change == pytest.approx(-0.75 * 0.5 * 1.5 * down**2, abs=1e-11)
    np.testing.assert_allclose(run.at(0.05)[1][[2, 8]], -0.5 * down, atol=1e-11)
    found = run.diagnosis()
    assert found.switches == (0.05,) and found.horizon == 0.05 and found.energy_excess < 1e-9
    run.save(tmp_path / "run.h5")
    kept = mbvi.load(tmp_path / "run.h5")
    assert kept.diagnosis().report() == found.report()
    np.testing.assert_array_equal(kept.at(0.07)[0], run.at(0.07)[0])


@every_scheme
def test_friction_acts_where_attached_bodies_strike_the_floor(scheme):
    """Newton's law, Coulomb's cone, and the balance of momentum of what is one body, in plain numbers."""
    problem = resting_box((1.0, 0.2, -2.0), friction=0.3)
    run = run_of(problem, between(0.05, 1.0), 0.06, scheme)
    (made,) = run.record.switches
    strike = next(impact for impact in run.impacts if set(impact.constraints) == {"box | floor"})
    assert strike.time == 0.05
    joined = projected(made.q, made.before, (1.0, 0.5), ((0.4, 0.4, 0.2), (0.1, 0.1, 0.1)))
    k = np.searchsorted(run.t, 0.05, side="right") - 1
    after = run.v[k]

    def momentum(v):
        return v[:3] * 1.0 + v[6:9] * 0.5

    pushed = (strike.percussion[:, None] * strike.normal + strike.tangential).sum(axis=0)
    np.testing.assert_allclose(momentum(after) - momentum(joined), pushed, atol=1e-9)
    along = np.linalg.norm(strike.tangential, axis=1)
    assert (along <= 0.3 * strike.percussion + 1e-9).all() and along.max() > 1e-2
    assert (np.einsum("ij,ij->i", strike.tangential, strike.slip_after) <= 1e-9).all()
    np.testing.assert_allclose(strike.after[strike.percussion > 1e-9], 0.0, atol=1e-9)


@every_scheme
def test_what_is_glued_where_it_strikes_stays_there(scheme):
    """The function sees the contacts of a located impact, at whose time it switches."""
    scene = mbvi.Scene(restitution=0.8)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.3), name="box")
    scene.weld("world", "box", name="glue", active=False)
    run = run_of(scene.build(), lambda state: {"glue": True} if state.contacts else None, 0.5, scheme)
    falls = np.sqrt(0.4 / 9.81)
    (made,) = run.record.switches
    assert made.time == run.impacts[0].time == run.impacts[1].time == pytest.approx(falls, abs=scheme.tolerance)
    assert [set(impact.constraints) for impact in run.impacts] == [{"box | floor"}, {"glue"}]
    up = 0.8 * 9.81 * falls
    assert made.before[2] == pytest.approx(up, abs=20 * scheme.tolerance)
    np.testing.assert_allclose(made.after, 0.0, atol=1e-12)
    np.testing.assert_allclose(run.v[states_at_switches(run)[0] :], 0.0, atol=1e-12)
    assert run.impacts[1].energy_change == pytest.approx(-0.5 * up**2, abs=100 * scheme.tolerance)
    assert run.diagnosis().variation == pytest.approx(9.81 * falls + 1.8 * 9.81 * falls + up, abs=1e-3)


@every_scheme
def test_a_function_with_a_memory_switches_within_a_millisecond(scheme):
    """It has an answer of its own wherever it has been asked before: the time is where it was asked first."""

    class Latch:
        on = False

        def __call__(self, state):
            self.on = self.on or bool(state.q["b"][0] < 0.47)
            return {"grasp": self.on}

    run = run_of(two_boxes(), Latch(), 0.06, scheme)
    (made,) = run.record.switches
    assert 0.03 <= made.time <= 0.031 + 1e-12
    assert made.q[7] == pytest.approx(0.5 - made.time, abs=1e-12)


@every_scheme
@pytest.mark.parametrize("start", [0.0, 0.02])
def test_the_fixed_steps_converge_to_it(scheme, start):
    """Boxes on a hinge and a weld fall onto a floor with friction and restitution."""
    scene = mbvi.Scene(restitution=0.5, friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.12), velocity=(0.5, 0, 0), name="a")
    scene.add_box((0.1, 0.1, 0.1), 0.5, position=(0.2, 0, 0.07), name="b")
    scene.weld("a", "b", name="grasp", active=False)
    scene.hinge("world", "a", at=(0, 0.1, 0.12), axis=(0, 1, 0), name="pin")
    problem = scene.build()

    def switch(state):
        return {"grasp": start - 1e-9 <= state.t < 0.04 - 1e-9, "pin": state.t < 0.03 - 1e-9}

    run = run_of(problem, switch, 0.08, scheme)
    errors = []
    for h in (4e-4, 4e-5):
        fixed = mbvi.simulate(problem, mbvi.Centered(), step=h, duration=0.08, switch=switch, progress=False)
        errors.append(np.abs(fixed.q[-1] - run.q[-1]).max())
    assert errors[1] < 0.4 * errors[0] and errors[1] < 2e-4


def switched_boxes(scheme, **options):
    """A box that is glued above another one on the floor falls onto it, rests there and is glued again."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 3.0, position=(0, 0, 0.1), name="below")
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0.26), name="above")
    scene.weld("below", "above", name="glue")
    return run_of(scene.build(), lambda state: {"glue": not 0.05 <= state.t < 0.15}, 0.2, scheme, **options)


@every_scheme
@pytest.mark.parametrize("every", [1, 4])
def test_a_file_keeps_what_was_switched_and_all_that_follows_from_it(tmp_path, scheme, every):
    run = switched_boxes(scheme, record="contacts", every=every, out=tmp_path / "run.h5")
    run.save(tmp_path / "saved.h5")
    assert [str(one) for one in run.record.switches] == ["t = 0.05 s: glue off", "t = 0.15 s: glue on"]
    names = {name for impact in run.impacts for name in impact.constraints}
    assert {"below | above"} <= names <= {"below | above", "below | floor", "glue"}
    for name in ("run.h5", "saved.h5"):
        kept = mbvi.load(tmp_path / name)
        assert kept.notes == run.notes
        assert [str(one) for one in kept.record.switches] == [str(one) for one in run.record.switches]
        for t in (0.049, 0.07, 0.15, 0.17):
            np.testing.assert_array_equal(kept.at(t)[0], run.at(t)[0])
            np.testing.assert_array_equal(kept.at(t)[1], run.at(t)[1])
        np.testing.assert_array_equal(kept.loop_gap(), run.loop_gap())
        np.testing.assert_array_equal(kept.energy(), run.energy())
        np.testing.assert_array_equal(kept.contact_forces("floor"), run.contact_forces("floor"))
        assert [impact.constraints for impact in kept.impacts] == [impact.constraints for impact in run.impacts]
        assert kept.diagnosis().report() == run.diagnosis().report()
        with pytest.raises(mbvi.InputError, match="functions that acted or switched"):
            kept.error_estimate()
    assert run.loop_gap().max() < 1e-12
    # all of both bodies rests on the floor as long as they are held
    floor = run.contact_forces("floor")[:, 2]
    np.testing.assert_allclose(floor[1 : int(np.searchsorted(run.t, 0.05)) + 1], -4.0 * 9.81, rtol=1e-6)
    above = run.contact_forces("above")[:, 2]
    np.testing.assert_allclose(above[np.searchsorted(run.t, 0.15)], 9.81, rtol=1e-6)
    assert not above[(run.t <= 0.05) | (run.t > 0.15)].any()
    run.replay_html(tmp_path / "run.html")
    assert "t = 0.05 s: glue off" in (tmp_path / "run.html").read_text()
    run.report(tmp_path / "report.html")
    (line,) = re.findall(r"mbvi\.simulate\(.*\)", (tmp_path / "report.html").read_text())
    assert "duration=0.2" in line and line.endswith("switch=...)"), line


@every_scheme
def test_states_of_a_thinned_run_are_those_of_the_whole_one(scheme):
    whole, thin = (switched_boxes(scheme, every=every) for every in (1, 4))
    assert len(thin.t) < len(whole.t) and set(thin.t) < set(whole.t)
    assert {0.05, 0.15, 0.2} <= set(thin.t)
    for t in set(thin.t):
        # after all impacts at that time
        np.testing.assert_array_equal(thin.at(t)[0], whole.at(t)[0])
        np.testing.assert_array_equal(thin.at(t)[1], whole.at(t)[1])


@every_scheme
def test_the_plot_of_energies_is_of_what_is_connected(scheme):
    """A pendulum that is let go keeps its energy, also between the recorded states."""
    run = run_of(pendulum(), lambda state: {"hook": state.q["load"][0] > 0.1}, 0.5, scheme)
    energy = next(panel for panel in panels(run, None, "")[0] if panel.title == "Energy")
    total = next(curve for curve in energy.curves if curve.name == "total")
    assert len(total.t) > 10
    np.testing.assert_allclose(total.y, 9.81, atol=1e-3)


@every_scheme
def test_forces_of_loops_are_refused_by_name(scheme):
    run = run_of(two_boxes(), between(0.02, 0.04), 0.06, scheme)
    with pytest.raises(mbvi.InputError, match=f"{scheme.name} takes no steps of one length"):
        run.loop_forces("grasp")


@pytest.mark.parametrize("scheme", [mbvi.EventDriven(1e-8), mbvi.Adaptive(1e-3)], ids=lambda one: one.name)
def test_the_error_estimate_switches_too(scheme):
    estimate = run_of(pendulum(), lambda state: {"hook": state.q["load"][0] > 0.1}, 0.5, scheme).error_estimate()
    assert 0.0 < estimate.largest < 10 * scheme.tolerance
    assert estimate.fork == np.inf


def test_a_derivative_across_a_switch_is_refused():
    """`sensitivity` has no switch."""
    with pytest.raises(TypeError, match="switch"):
        mbvi.sensitivity(two_boxes(), SCHEMES[0], duration=0.06, switch=between(0.02, 1.0))


@every_scheme
def test_an_error_of_the_function_carries_the_run_so_far(scheme):
    with pytest.raises(mbvi.InputError, match="'glue'; connections are grasp") as caught:
        run_of(two_boxes(), lambda state: {"glue" if state.t > 0.03 else "grasp": state.t >= 0.01}, 0.06, scheme)
    run = caught.value.run
    assert not run.complete and 0.01 <= run.t[-1] <= 0.03
    assert [one.time for one in run.record.switches] == [0.01]


@every_scheme
def test_a_suction_cup_that_also_controls_holds_what_it_touches(scheme):
    """The function and the force are of one object with a memory: the cup comes down, touches, holds and lifts."""
    problem, gripper = suction_cup()
    run = run_of(problem, gripper.grasp, 2.0, scheme)
    (made,) = run.record.switches
    assert made.q[9] == pytest.approx(0.11, abs=scheme.tolerance)
    first = run.impacts[0]
    assert "load | cup" in first.constraints
    assert made.time == first.time
    # 0.3 kg on a spring of 20 N/m with a damper of 4 N s/m
    assert run.q[-1, 9] == pytest.approx(0.3, abs=1e-3)
    held = slice(states_at_switches(run)[0], None)
    np.testing.assert_allclose(run.q[held, 9] - run.q[held, 2], made.q[9] - made.q[2], atol=1e-11)


def test_a_switch_within_steps_of_paoli_comes_at_the_end_of_one():
    """A cylinder stands on another one, where gradients jump."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_cylinder(0.3, 0.2, 4.0, position=(0, 0, 0.1), name="table")
    scene.add_cylinder(0.1, 0.3, 1.0, position=(0, 0, 0.35), name="can")
    scene.add_box((0.1, 0.1, 0.1), 0.5, position=(0, 0, 1.0), name="load")
    scene.weld("can", "load", name="grasp", active=False)
    run = run_of(scene.build(), between(0.0203, 1.0), 0.03)
    assert any("were taken by the paper's scheme" in note for note in run.notes)
    (made,) = run.record.switches
    assert 0.0203 <= made.time <= 0.0204 + 1e-12
    down = -0.5 * 9.81 * made.time / 1.5
    np.testing.assert_allclose(made.after[[8, 14]], down, atol=1e-3)
