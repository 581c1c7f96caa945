"""The diagnosis of runs in which connections are switched."""

import numpy as np
import pytest

import mbvi
from mbvi.results.diagnosis.diagnose import _Sums

STEP = 1e-3
SCHEMES = [mbvi.Paoli(), mbvi.Centered(), mbvi.Centered(project_positions=True)]


def resting_box(speed, e=0.5):
    """A box rests on its four corners; a ball beside it moves upwards or downwards."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.4, 0.2), 1.0, position=(0, 0, 0.1), name="box")
    scene.add_box((0.1, 0.1, 0.1), 0.5, position=(0, 0, 1.0), velocity=(0, 0, speed), name="ball")
    scene.weld("box", "ball", name="grasp", active=False)
    return scene.build()


def run_of(problem, scheme, switch, duration=0.1, **options):
    return mbvi.simulate(
        problem, scheme, step=STEP, duration=duration, switch=switch, progress=False, **options
    )  # fmt: skip


def grasp(state):
    return {"grasp": state.t > 0.0495}


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_attaching_is_no_impact_of_contacts_that_open(scheme):
    """What flies up takes the resting box along: four contacts before, none after, and no instant is an impact."""
    run = run_of(resting_box(8.0), scheme, grasp)
    assert [impact.constraints for impact in run.impacts] == [("grasp",)]
    found = run.diagnosis()
    assert found.switches == (run.record.switches[0].time,)
    assert "Connections were switched at t = 0.05 s" in found.report()
    assert found.horizon == np.inf and not any(instant.impact for instant in found.instants)
    assert found.instants[-1].until == pytest.approx(0.05, abs=2 * STEP)
    assert found.largest_percussion == run.impacts[0].percussion.max()
    assert found.energy_excess < 1e-9


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_contacts_that_close_when_bodies_are_attached_are_an_impact_of_what_they_are_together(tmp_path, scheme):
    """What falls pushes the box down: the corners close at the instant of the switch, on the body of both."""
    run = run_of(resting_box(-2.0), scheme, grasp)
    at = run.record.switches[0].time
    assert next(impact.constraints[0] for impact in run.impacts if impact.time == at) == "grasp"
    found = run.diagnosis()
    (instant,) = [one for one in found.instants if one.time == at and one.impact]
    assert len(instant.constraints) == 4 and not instant.condition_12
    assert found.horizon == at
    run.save(tmp_path / "run.h5")
    kept = mbvi.load(tmp_path / "run.h5").diagnosis()
    assert kept.horizon == at and kept.variation == found.variation
    assert kept.energy_excess == found.energy_excess
    # angles of corners on one rigid body of both, in plain numbers
    q = run.record.switches[0].q.reshape(2, 7)[:, :3]
    total, centre = 1.5, (q[0] + 0.5 * q[1]) / 1.5
    sizes, masses = np.array([[0.4, 0.4, 0.2], [0.1, 0.1, 0.1]]), (1.0, 0.5)
    inertia = np.zeros((3, 3))
    for m, size, x in zip(masses, sizes, q, strict=True):
        arm = x - centre
        inertia += m / 12.0 * np.diag(size @ size - size**2) + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    corners = np.array([(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.2, 0.2)])
    arms = np.cross(corners - centre, [0.0, 0.0, 1.0])
    gram = 1.0 / total + arms @ np.linalg.solve(inertia, arms.T)
    lengths = np.sqrt(np.diag(gram))
    angles = np.sort((np.arccos(gram / np.outer(lengths, lengths)))[np.triu_indices(4, 1)])
    np.testing.assert_allclose(np.sort(instant.angles[np.triu_indices(4, 1)]), angles, atol=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_parts_are_those_of_runs_of_each_problem(scheme):
    """Instants before a release are those of the run that holds on, those after it of a run from there."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.4, 0.2), 1.0, position=(0, 0, 0.12), name="box")
    scene.add_box((0.1, 0.1, 0.1), 0.5, position=(0, 0, 0.45), name="load")
    scene.weld("box", "load", name="glue")
    problem = scene.build()
    run = run_of(problem, scheme, lambda state: {"glue": state.t < 0.0995}, duration=0.3, every=3)
    (made,) = run.record.switches
    found = run.diagnosis()
    first = mbvi.simulate(problem, scheme, step=STEP, duration=0.1, progress=False).diagnosis()
    second = mbvi.simulate(made.problem, scheme, step=STEP, duration=0.2, progress=False).diagnosis()
    expected = [*first.instants, *second.instants]
    assert len(found.instants) == len(expected) > len(first.instants) > 0
    for one, other in zip(found.instants, expected, strict=True):
        assert (one.constraints, one.impact, one.condition_12) == (other.constraints, other.impact, other.condition_12)
        assert (one.time, one.until) == pytest.approx((other.time, other.until), abs=1e-9)
        np.testing.assert_allclose(one.angles, other.angles, atol=1e-7)
    assert found.variation == pytest.approx(first.variation + second.variation, rel=1e-6)
    assert found.horizon == first.horizon < 0.1


def test_the_jump_of_a_switch_counts_in_variation_and_energy(tmp_path):
    """Flywheels change their velocity at the gear alone; a file of the run says the same."""
    link = (
        '<link name="{0}"><inertial><mass value="1"/><inertia ixx="{1}" iyy="{1}" izz="{1}" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="{0}_axle" type="revolute"><parent link="base"/><child link="{0}"/>'
        '<axis xyz="0 0 1"/><limit effort="0" velocity="0" lower="-0.2" upper="9"/></joint>'
    )
    path = tmp_path / "box.urdf"
    path.write_text(f'<robot name="box"><link name="base"/>{link.format("a", 0.1)}{link.format("b", 0.3)}</robot>')
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    scene.add_urdf(path, base="fixed", velocity={"a_axle": -4.0})
    scene.couple("box/a_axle", "box/b_axle", name="gear", active=False)
    run = run_of(scene.build(), mbvi.Paoli(), lambda s: {"gear": 0.0195 < s.t < 0.0395}, duration=0.03)
    found = run.diagnosis()
    # both turn at -1, so that a loses 3 and b gains 1
    assert found.variation == pytest.approx(np.hypot(3.0, 1.0), abs=1e-12)
    assert found.energy_excess == 0.0
    assert found.largest_percussion == pytest.approx(0.3, abs=1e-12)
    run.save(tmp_path / "run.h5")
    assert mbvi.load(tmp_path / "run.h5").diagnosis().report() == found.report()
    run.report(tmp_path / "report.html")
    assert "Connections were switched at t = 0.02" in (tmp_path / "report.html").read_text()


def test_the_energy_that_attaching_loses_counts():
    """An energy gained later is an excess only beyond what attaching has lost."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    for name, x, speed in (("left", 0.0, 3.0), ("right", 1.0, 0.0)):
        scene.add_box((0.4, 0.4, 0.4), 1.0, position=(x, 0, 0), velocity=(speed, 0, 0), name=name)
    scene.weld("left", "right", name="grasp")
    problem, sums = scene.build(), _Sums(False)
    before = np.array([3.0, 0, 0, 0, 0, 0] + 6 * [0.0])
    together = problem.at(problem.q0, problem.system.tangent(problem.q0, before))
    sums.add_attaching(together, before)
    # half of 4.5 J is left
    sums.add_energy(2.0)
    assert sums.excess == 0.0
    sums.add_energy(0.75)
    assert sums.excess == pytest.approx(0.5, abs=1e-12)
