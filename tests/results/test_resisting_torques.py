"""The torques of torsional and rolling friction in recorded contacts, resultants, controls and files."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from mbvi.results.tables import table

G, R, M = 9.81, 0.1, 2.0
INERTIA = 0.4 * M * R**2
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.StewartTrinkle()]
TORSION, ROLLING = 0.02, 0.004


def balls(friction=(0.4, TORSION, ROLLING), e=0.0):
    """Two balls that roll and spin on a floor, and meet."""
    scene = mbvi.Scene(friction=friction, restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k, name in enumerate(("a", "b")):
        scene.add_sphere(R, M, position=(0.21 * k, 0.05 * k, R), name=name)
    problem = scene.build()
    return problem.at(problem.q0, [1.0, 0.2, 0, 3.0, 10.0, 8.0, -0.1, 0.2, 0, 3.0, -1.0, -6.0])


def run_of(problem, scheme=None, duration=0.1, **settings):
    scheme = mbvi.Paoli() if scheme is None else scheme
    return mbvi.simulate(problem, scheme, step=1e-3, duration=duration, record="contacts", progress=False, **settings)


def turning(run, ball, k):
    """Return the angular velocity of a ball after step k in the world."""
    q = run.q[k, 7 * ball : 7 * ball + 7]
    return pin.Quaternion(q[3:]).toRotationMatrix() @ run.v[k, 6 * ball + 3 : 6 * ball + 6]


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_forces_and_torques_are_the_change_of_momentum(e):
    run = run_of(balls(e=e))
    assert any("a | b" in impact.constraints for impact in run.impacts)
    without = run_of(balls((0.4, 0.0, 0.0), e))
    assert np.abs(run.v[-1] - without.v[-1]).max() > 0.1
    for ball, name in enumerate(("a", "b")):
        wrench, part = run.contact_forces(name), slice(6 * ball, 6 * ball + 6)
        assert np.abs(wrench[:, 3:]).max() > 0.0
        for k in range(1, len(run.t)):
            place = run.q[k, 7 * ball : 7 * ball + 7]
            turn = pin.Quaternion(place[3:]).toRotationMatrix()
            # `Paoli` applies its law at the configuration at the end of the step
            change = (run.v[k] - run.v[k - 1])[part] / 1e-3
            force, moment = wrench[k, :3], wrench[k, 3:] - np.cross(place[:3], wrench[k, :3])
            np.testing.assert_allclose(force, M * (change[:3] - np.array([0, 0, -G])), rtol=0, atol=1e-10)
            np.testing.assert_allclose(moment, INERTIA * turn @ change[3:], rtol=0, atol=1e-10)
    both = np.array([run.contact_forces(name) for name in ("a", "b", "floor")])
    np.testing.assert_allclose(both.sum(axis=0), 0.0, atol=1e-12 * np.abs(both).max())


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_torques_are_bounded_and_oppose_what_turns(scheme, every):
    run = run_of(balls(), scheme, every=every)
    rolled = 0
    for k, t in enumerate(run.t):
        for contact in run.contacts(t):
            if every > 1 and not contact.name.endswith("floor"):
                # percussions along several normals are added up
                continue
            about = contact.torque @ contact.normal
            across = contact.torque - about * contact.normal
            assert abs(about) <= TORSION * contact.force * (1 + 1e-9)
            assert np.linalg.norm(across) <= ROLLING * contact.force * (1 + 1e-9)
            if every == 1 and contact.name.endswith("floor"):
                omega = turning(run, "ab".index(contact.name[0]), k)
                flat = np.array([omega[0], omega[1], 0.0])
                expected = -ROLLING * contact.force * flat / np.linalg.norm(flat)
                # of schemes whose law acts at another configuration than the state's
                np.testing.assert_allclose(across, expected, atol=0.02 * ROLLING * contact.force)
                np.testing.assert_allclose(np.linalg.norm(across), ROLLING * contact.force, rtol=1e-9)
                rolled += 1
    assert rolled > 150 or every > 1


def test_a_ball_that_a_slope_holds_has_the_torque_that_holds_it():
    scene = mbvi.Scene(gravity=(0.3, 0, -G), friction=(0.5, 0.0, ROLLING))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(R, M, position=(0, 0, R), name="ball")
    contact = run_of(scene.build()).contacts(0.1)[0]
    np.testing.assert_allclose(contact.torque, [0, -0.3 * M * R, 0], atol=1e-12)
    assert contact.regime == "stick"


def test_without_it_there_is_no_torque():
    run = run_of(balls((0.4, 0.0, 0.0)))
    assert not np.array([contact.torque for contact in run.contacts(0.05)]).any()
    assert "angular/x" not in table(run, "contacts") and run.record.contacts.angular is None
    assert "angular/x" not in table(run, "impacts") and all(impact.angular is None for impact in run.impacts)
    smooth = mbvi.Scene()
    smooth.add_halfspace((0, 0, 1), name="floor")
    smooth.add_sphere(R, M, position=(0, 0, R), name="ball")
    assert run_of(smooth.build()).contacts(0.05)[0].torque is None


def test_the_simulator_and_controls_have_the_same_torques():
    problem = balls()
    run, sim = run_of(problem), mbvi.Simulator(problem, mbvi.Paoli(), step=1e-3)
    for _ in range(20):
        sim.step()
        for one, other in zip(sim.contacts, run.contacts(sim.t), strict=True):
            np.testing.assert_allclose(one.torque, other.torque, rtol=1e-12)
    assert all(contact.torque.any() for contact in sim.contacts)


def spinning(scheme, e=0.0):
    """A ball that falls on a floor, and spins, rolls and slides when it lands."""
    scene = mbvi.Scene(gravity=(0, 0, 0), friction=(0.4, TORSION, ROLLING), restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(R, M, position=(0, 0, R + 0.0205), name="ball")
    problem = scene.build()
    return run_of(problem.at(problem.q0, [0.5, 0.1, -2, 3.0, 10.0, 30.0]), scheme, duration=0.03)


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_the_angular_percussion_of_an_impact_is_the_change_of_spin(scheme, e):
    """Without gravity the only change of angular momentum in its step is that of the impact, about the centre."""
    run = spinning(scheme, e)
    (impact,) = run.impacts
    k = np.searchsorted(run.t, impact.time - 1e-9)
    change = INERTIA * (turning(run, 0, k) - turning(run, 0, k - 1))
    arm = np.cross([0, 0, -R], impact.percussion[0] * impact.normal[0] + impact.tangential[0])
    np.testing.assert_allclose(impact.angular[0] + arm, change, rtol=0, atol=1e-12)
    about, across = impact.angular[0, 2], np.linalg.norm(impact.angular[0, :2])
    np.testing.assert_allclose(about, -TORSION * impact.percussion[0], rtol=1e-9)
    np.testing.assert_allclose(across, ROLLING * impact.percussion[0], rtol=1e-9)


def test_the_torque_of_an_impact_is_infinite_where_there_is_one():
    """A body that starts into the floor has a percussion before the first step."""
    scene = mbvi.Scene(friction=(0.5, TORSION, 0.0))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(R, M, position=(0, 0, R), name="ball")
    problem = scene.build()
    start = problem.at(problem.q0, [0, 0, -1, 0, 0, 50])
    seen = mbvi.Simulator(start, mbvi.Paoli(), step=1e-3).contacts
    assert seen[0].force == np.inf
    np.testing.assert_array_equal(seen[0].torque, [0, 0, -np.inf])


@pytest.mark.parametrize("streamed", [False, True])
def test_files_keep_them_to_the_bit(streamed, tmp_path):
    path = tmp_path / "run.h5"
    run = run_of(balls(), every=3, **({"out": path} if streamed else {}))
    if not streamed:
        run.save(path)
    back = mbvi.load(path)
    np.testing.assert_array_equal(back.record.contacts.angular, run.record.contacts.angular)
    np.testing.assert_array_equal(back.contact_forces("a"), run.contact_forces("a"))
    np.testing.assert_array_equal(back.contacts(0.05)[0].torque, run.contacts(0.05)[0].torque)
    assert table(back, "contacts")["angular/z"].unit == "N m s"
    assert len(run.impacts) > 1 and run.impacts[0].angular.any()
    for one, other in zip(back.impacts, run.impacts, strict=True):
        np.testing.assert_array_equal(one.angular, other.angular)
    for name in ("impacts", "contacts"):
        np.testing.assert_array_equal(table(back, name)["angular/z"].values, table(run, name)["angular/z"].values)


def test_files_of_earlier_versions_load_with_a_note(tmp_path):
    run, path = run_of(balls()), tmp_path / "run.h5"
    record = replace(run.record, contacts=replace(run.record.contacts, angular=None))
    without = tuple(replace(impact, angular=None) for impact in run.impacts)
    for earlier in (replace(run, record=record), replace(run, impacts=without)):
        earlier.save(path)
        back = mbvi.load(path)
        assert any("torques of torsional and rolling friction are missing" in note for note in back.notes)
        back.save(tmp_path / "again.h5")
    np.testing.assert_array_equal(back.record.contacts.tangential, run.record.contacts.tangential)
    assert back.impacts[0].angular is None
    assert not any("torques" in note for note in run.notes)
