"""Springs, damping, dry friction and controls of hinges that close loops."""

import numpy as np
import pytest

import mbvi
from support.four_bar import CENTRES, places
from support.four_bar_torque import boxes, crank_at, held_by, mjcfs

PROJECTING = mbvi.Centered(project_positions=True)
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.StewartTrinkle(), PROJECTING]
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=["paoli", "moreau_jean", "piles", "projecting"])
SPRING, DAMPED = {"stiffness": 3.0, "rest": 0.4}, {"damping": 0.5}
ACTING = [DAMPED, {"damping": 50.0}, SPRING | DAMPED]


def door(speed=0.0, **acting):
    """A box that turns about a hinge at its edge, without gravity, and its moment of inertia about it."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box(
        (0.8, 0.04, 0.3), 3.0, position=(0.4, 0, 0), name="leaf", velocity=(0, 0.4 * speed, 0),
        angular_velocity=(0, 0, speed),
    )  # fmt: skip
    scene.hinge("world", "leaf", at=(0, 0, 0), axis=(0, 0, 1), name="hinge", **acting)
    return scene.build(), 3.0 * ((0.8**2 + 0.04**2) / 12.0 + 0.4**2)


def opened(q):
    """The angle of the door."""
    return 2.0 * np.arctan2(q[..., 5], q[..., 6])


@pytest.mark.parametrize("acting", ACTING, ids=str)
def test_a_four_bar_moves_as_in_its_crank_angle(acting):
    """`EventDriven` within its tolerance, `Centered` at order 2."""
    problem, end = boxes(**acting), places(crank_at(0.3, **acting))[0]
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=0.3)
    assert np.abs(run.q[-1][CENTRES] - end).max() <= 1e-8
    errors = []
    for step in (4e-3, 2e-3):
        run = mbvi.simulate(problem, mbvi.Centered(), step=step, duration=0.3)
        errors.append(np.abs(run.q[-1][CENTRES] - end).max())
        assert run.loop_gap().max() <= 1e-12
    assert 3.4 < errors[0] / errors[1] < 4.6, errors


@each_scheme
def test_all_schemes_converge_with_dry_friction(scheme):
    """Order 2 while the hinge slips with `Centered`, else 1."""
    acting = SPRING | {"friction": 1.0}
    problem, end = boxes(**acting), places(crank_at(0.3, **acting))[0]
    errors = []
    for step in (4e-3, 2e-3):
        run = mbvi.simulate(problem, scheme, step=step, duration=0.3)
        errors.append(np.abs(run.q[-1][CENTRES] - end).max())
    order = 2 if scheme is PROJECTING else 1
    assert errors[1] < (0.02 if order == 1 else 1e-3) and abs(np.log2(errors[0] / errors[1]) - order) < 0.2, errors


@each_scheme
def test_dry_friction_holds_exactly_up_to_its_largest_torque(scheme):
    most = held_by()
    held = mbvi.simulate(boxes(friction=1.001 * most), scheme, step=1e-3, duration=0.1)
    assert np.abs(held.v).max() <= 1e-12 and np.abs(held.q - held.q[0]).max() <= 1e-12
    slips = mbvi.simulate(boxes(friction=0.999 * most), scheme, step=1e-3, duration=0.1)
    assert np.abs(slips.v[-1]).max() > 1e-4


@each_scheme
def test_impacts_leave_the_loop_closed(scheme):
    run = mbvi.simulate(boxes(0.5, -0.3, friction=2.0, **SPRING, **DAMPED), scheme, step=4e-3, duration=0.6)
    assert run.impacts
    assert run.loop_gap().max() <= 1e-12
    assert (run.impacts[0].after > 0.0).all()


def test_elastic_impacts_keep_the_energy_of_the_spring():
    problem = boxes(1.0, -0.3, stiffness=3.0, rest=0.4)
    assert problem.system.potential_energy(0.0, problem.q0) == pytest.approx(
        boxes(1.0, -0.3).system.potential_energy(0.0, problem.q0) + 0.5 * 3.0 * 0.4**2, abs=1e-13
    )
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=1.0)
    assert run.impacts
    assert np.ptp(run.energy()) <= 1e-7
    # `Centered` moves by its order, and comes back
    swings, _ = door(2.0, stiffness=5.0)
    energy = mbvi.simulate(swings, mbvi.Centered(), step=1e-2, duration=20.0).energy()
    early, late = np.ptp(energy[:500]), np.ptp(energy[-500:])
    assert late == pytest.approx(early, rel=1e-2) and early < 1e-2 * energy[0]


@pytest.mark.parametrize("z", [0.1, 10.0, 1e4])
def test_damping_decays_as_that_of_joints(z):
    """1 / (1 + z) in a step with z = h d / I, with `Centered` (1 + z) / (1 + z / 2)^4; so slow that nothing turns."""
    h, speed = 1e-3, 1e-7
    inertia = door()[1]
    problem, _ = door(speed, damping=z * inertia / h)
    for scheme, decay in ((mbvi.Paoli(), 1.0 / (1.0 + z)), (mbvi.Centered(), (1.0 + z) / (1.0 + 0.5 * z) ** 4)):
        run = mbvi.simulate(problem, scheme, step=h, duration=h)
        assert run.v[-1, 5] == pytest.approx(decay * speed, abs=1e-9 * speed)


@each_scheme
def test_damping_never_raises_the_energy(scheme):
    for damping in (0.01, 1.0, 100.0, 1e4):
        run = mbvi.simulate(door(2.0, damping=damping)[0], scheme, step=1e-2, duration=0.5)
        energy = run.energy()
        assert np.diff(energy).max() <= 1e-13 * energy[0]


# a joint of a file and a hinge of the scene, each with the other's place in the tree
@pytest.mark.parametrize("acting", [SPRING, DAMPED, {"friction": 0.5}, SPRING | DAMPED | {"friction": 0.5}], ids=str)
def test_a_closing_hinge_moves_as_a_joint_with_the_same_options(tmp_path, acting):
    pytest.importorskip("mujoco")
    closing, joint = mjcfs(tmp_path, **acting)
    if "friction" not in acting:
        runs = [mbvi.simulate(one, mbvi.EventDriven(1e-10), duration=0.3) for one in (closing, joint)]
        assert runs[0].q[-1, 0] == pytest.approx(runs[1].q[-1, 0], abs=1e-10)
        assert runs[0].energy()[-1] - runs[0].energy()[0] == pytest.approx(
            runs[1].energy()[-1] - runs[1].energy()[0], abs=1e-8
        )
    apart = []
    for step in (4e-3, 2e-3):
        runs = [mbvi.simulate(one, PROJECTING, step=step, duration=0.3) for one in (closing, joint)]
        apart.append(abs(runs[0].q[-1, 0] - runs[1].q[-1, 0]))
    assert apart[1] < 1e-4 and apart[0] / apart[1] > 3.4, apart


def test_a_control_turns_the_hinge():
    torque = mbvi.ConstantTorque([0.3])
    problem, inertia = door(control=torque)
    sim = mbvi.Simulator(problem, mbvi.Centered(), step=1e-3)
    sim.step(100)
    assert sim.v[5] == pytest.approx(0.3 / inertia * 0.1, rel=1e-3)
    torque.torque[:] = -0.3
    sim.step(100)
    assert sim.v[5] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    "control",
    [
        mbvi.PDControl([0.5], 20.0, 5.0),
        mbvi.PDControl({"hinge": 0.5}, {"hinge": 20.0}, 5.0),
        lambda t, q, v: 20.0 * (0.5 - q) - 5.0 * v,
    ],
    ids=["pd", "by name", "function"],
)
def test_a_controlled_door_moves_as_its_equation(control):
    """I a'' = 20 (0.5 - a) - 5 a'."""
    problem, inertia = door(control=control)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=1.0)
    decay, rate = 2.5 / inertia, np.sqrt(20.0 / inertia - (2.5 / inertia) ** 2 + 0j)
    shape = np.cosh(1j * rate) + decay / rate * np.sin(rate)
    assert opened(run.q[-1]) == pytest.approx(0.5 * (1.0 - np.exp(-decay) * shape.real), abs=1e-8)


def test_a_spring_acts_the_shorter_way_to_its_rest():
    problem, _ = door(stiffness=2.0, rest=3.0)
    angles = np.array([-0.3, 0.0, 3.0, 3.2])
    for angle, stretched in zip(angles, [2.0 * np.pi - 3.3, -3.0, 0.0, 0.2], strict=True):
        c, s = np.cos(angle), np.sin(angle)
        q = np.array([0.4 * c, 0.4 * s, 0.0, 0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)])
        assert problem.system.potential_energy(0.0, q) == pytest.approx(stretched**2, abs=1e-12)


def test_the_step_is_short_enough_for_a_stiff_spring():
    problem, inertia = door(0.1, stiffness=1e6)
    run = mbvi.simulate(problem, duration=0.02)
    assert run.step * np.sqrt(1e6 / inertia) < 0.5
    assert "hinge" in " ".join(run.notes)


def test_forces_of_the_loop_leave_out_the_torque_about_the_axis():
    """A spring holds the door against gravity: the hinge bears its weight, and the moment across its axis is zero."""
    scene = mbvi.Scene()
    scene.add_box((0.8, 0.04, 0.3), 3.0, position=(0.4, 0, 0), name="leaf")
    lifted = 3.0 * 9.81 * 0.4
    scene.hinge("world", "leaf", at=(0, 0, 0), axis=(0, 1, 0), name="hinge", stiffness=1000.0, rest=-lifted / 1000.0)
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.01)
    assert np.abs(run.v).max() <= 1e-12
    np.testing.assert_allclose(run.loop_forces("hinge")[1:], [[0, 0, 3.0 * 9.81, 0, 0, 0]] * 10, atol=1e-9)


def test_files_keep_what_acts(tmp_path):
    problem, _ = door(1.0, stiffness=2.0, rest=0.1, damping=0.2, friction=0.05, control=lambda t, q, v: -0.1 * q)
    run = mbvi.simulate(problem, PROJECTING, step=1e-3, duration=0.1)
    run.save(tmp_path / "run.h5")
    with pytest.warns(mbvi.MbviWarning, match="could not keep: control of hinge 'hinge'"):
        mbvi.load(tmp_path / "run.h5")
    problem = mbvi.load(tmp_path / "run.h5", control={"hinge": lambda t, q, v: -0.1 * q}).problem
    again = mbvi.simulate(problem, PROJECTING, step=1e-3, duration=0.1)
    assert np.array_equal(run.q, again.q)


def test_a_released_hinge_acts_no_more():
    sim = mbvi.Simulator(door(1.0, stiffness=50.0, damping=5.0)[0], mbvi.Centered(), step=1e-3)
    sim.step(10)
    sim.detach("hinge")
    before = sim.v.copy()
    sim.step(10)
    np.testing.assert_allclose(sim.v, before, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("acting", "told"),
    [
        ({"stiffness": -1.0}, "stiffness"),
        ({"rest": 3.2}, "rest"),
        ({"damping": np.nan}, "damping"),
        ({"friction": "much"}, "friction"),
        ({"control": 3.0}, "control"),
        ({"control": mbvi.ConstantTorque([1.0, 2.0])}, "the control of hinge acts on 2 velocities; it has 1"),
        ({"control": mbvi.PDControl({"knee": 0.1}, 1.0, 1.0)}, "knee"),
    ],
    ids=lambda given: given if isinstance(given, str) else next(iter(given)),
)
def test_wrong_options_are_refused(acting, told):
    with pytest.raises(mbvi.InputError, match=told):
        door(**acting)


def test_a_control_that_returns_something_else_is_refused():
    for returned, told in ((np.zeros(2), r"shape \(2,\)"), (np.array([np.nan]), "not finite")):
        with pytest.raises(mbvi.InputError, match=f"the control of hinge .*{told}"):
            door(control=lambda t, q, v, tau=returned: tau)


def test_error_control_refuses_dry_friction_of_hinges():
    with pytest.raises(mbvi.UnsuitableError, match="no dry friction"):
        mbvi.simulate(door(friction=0.1)[0], mbvi.EventDriven(1e-6), duration=0.1)
