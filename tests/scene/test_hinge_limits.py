"""Limits of hinges that connect bodies: exact motions, a joint of a URDF with the same limits, and gradients."""

import numpy as np
import pytest

import mbvi

every_scheme = pytest.mark.parametrize(
    "scheme",
    [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle()],
    ids=["paoli", "moreau_jean", "centered", "projecting", "piles"],
)
LINK = """<link name="{}"><inertial><origin xyz="0 0 -.25"/><mass value="{}"/>
  <inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="0 0 {}"/>
  <axis xyz="0 1 0"/><limit lower="{}" upper="{}" effort="1" velocity="1"/></joint>"""


def door(e, speed=2.0, limits=(-0.5, 0.3), axis=(0, 0, 1)):
    """A box that turns about a hinge at its edge, without gravity."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e)
    turn = speed * np.array(axis)
    arm = np.array([0.4, 0.0, 0.0])
    scene.add_box((0.8, 0.04, 0.3), 3.0, position=arm, name="leaf", velocity=np.cross(turn, arm), angular_velocity=turn)
    scene.hinge("world", "leaf", at=(0, 0, 0), axis=axis, name="hinge", limits=limits)
    return scene.build()


@every_scheme
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_door_stops_at_its_limits(scheme, e):
    """It reaches 0.3 rad at 0.15 s, and turns back at e times its speed."""
    run = mbvi.simulate(door(e), scheme, step=1e-3, duration=0.25, progress=False)
    assert [impact.constraints for impact in run.impacts] == [("hinge upper limit",)]
    assert run.impacts[0].time == pytest.approx(0.15, abs=2e-3)
    # at e = 0 an impact of StewartTrinkle lasts two steps, and the record holds the first
    if e > 0.0 or not isinstance(scheme, mbvi.StewartTrinkle):
        assert run.impacts[0].after == pytest.approx(-e * run.impacts[0].before, abs=1e-12)
    # the speed of a body that a hinge turns is of order h
    assert run.v[-1, 5] == pytest.approx(-2.0 * e, abs=2e-3)
    assert run.limit_violation().max() < 2.5e-3
    assert run.penetration().max() == 0.0


def test_error_control_finds_both_limits_exactly():
    """At e = 1 the door goes between its limits for ever: at 0.15 s, then every 0.4 s."""
    run = mbvi.simulate(door(1.0), mbvi.EventDriven(1e-9), duration=1.0, progress=False)
    assert [impact.time for impact in run.impacts] == pytest.approx([0.15, 0.55, 0.95], abs=1e-8)
    assert run.impacts[1].constraints == ("hinge lower limit",)


def test_limits_of_a_hinge_are_those_of_a_joint(tmp_path):
    """Two links in a chain over their limits, from a file and as boxes with hinges: the same motion."""
    links, joints = '<link name="base"/>', ""
    size, masses, limits = (0.1, 0.1, 0.5), (1.0, 0.6), ((-0.6, 0.6), (-0.2, 0.4))
    for k, mass in enumerate(masses):
        x, y, z = (mass * (a * a + b * b) / 12.0 for a, b in ((0.1, 0.5), (0.1, 0.5), (0.1, 0.1)))
        links += LINK.format(f"l{k}", mass, x, y, z)
        joints += JOINT.format(f"j{k}", f"l{k - 1}" if k else "base", f"l{k}", -0.5 * k, *limits[k])
    path = tmp_path / "chain.urdf"
    path.write_text(f'<robot name="chain">{links}{joints}</robot>')
    of_file, of_boxes = mbvi.Scene(restitution=0.5), mbvi.Scene(restitution=0.5)
    of_file.add_urdf(path, "fixed", velocity={"j0": 3.0, "j1": 1.0})
    for k, (mass, turn) in enumerate(zip(masses, (3.0, 4.0), strict=True)):
        # both joints' rates move the second link
        speed = -3.0 * 0.25 if k == 0 else -3.0 * 0.5 - turn * 0.25
        of_boxes.add_box(
            size,
            mass,
            position=(0, 0, -0.25 - 0.5 * k),
            name=f"l{k}",
            velocity=(speed, 0, 0),
            angular_velocity=(0, turn, 0),
        )
        first = f"l{k - 1}" if k else "world"
        of_boxes.hinge(first, f"l{k}", at=(0, 0, -0.5 * k), axis=(0, 1, 0), limits=limits[k])
    runs = [
        mbvi.simulate(scene.build(), mbvi.EventDriven(1e-9), duration=0.6, progress=False)
        for scene in (of_file, of_boxes)
    ]
    assert len(runs[0].impacts) >= 4
    assert [i.time for i in runs[1].impacts] == pytest.approx([i.time for i in runs[0].impacts], abs=1e-6)
    quaternion = runs[1].q[-1, [4, 6, 11, 13]]
    angles = 2.0 * np.arctan2(quaternion[::2], quaternion[1::2])
    assert [angles[0], angles[1] - angles[0]] == pytest.approx(runs[0].q[-1], abs=1e-6)


def test_gradients_are_those_of_the_angles(rng):
    """Between two bodies that move in space."""
    scene = mbvi.Scene()
    for name, x in (("a", 0.0), ("b", 0.5)):
        scene.add_box((0.3, 0.2, 0.1), 1.0, position=(x, 0, 0), name=name)
    scene.hinge("a", "b", at=(0.25, 0, 0), axis=(0.2, 1.0, 0.1), limits=(-1.0, 2.0))
    problem = scene.build()
    (family,) = [f for f in problem.constraints.families if type(f).__name__ == "HingeLimits"]
    for _ in range(20):
        q = problem.system.integrate(problem.q0, 0.5 * rng.normal(size=12))
        # displacements close the hinge again
        dv, h = problem.system.tangent(q, rng.normal(size=12)), 1e-6
        ends = [family.gap(0.0, problem.system.integrate(q, s * h * dv)) for s in (1.0, -1.0)]
        assert family.gradient(0.0, q) @ dv == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-7)


def test_an_impact_at_a_limit_between_two_bodies_keeps_both_momenta():
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5)
    scene.add_box((0.3, 0.2, 0.1), 1.0, position=(0, 0, 0), name="a", velocity=(0, 0, 1))
    scene.add_box((0.3, 0.2, 0.1), 2.0, position=(0.4, 0, 0), name="b", angular_velocity=(0, 2, 0))
    scene.hinge("a", "b", at=(0.2, 0, 0), axis=(0, 1, 0), limits=(-0.1, 0.1))
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=1.0, progress=False)
    assert len(run.impacts) >= 2
    momentum = run.v[:, :3] + 2.0 * run.v[:, 6:9]
    assert np.abs(momentum - momentum[0]).max() < 1e-12


def test_files_keep_limits(tmp_path):
    run = mbvi.simulate(door(0.5), mbvi.Centered(), step=1e-3, duration=0.2, progress=False)
    run.save(tmp_path / "run.h5")
    again = mbvi.simulate(
        mbvi.load(tmp_path / "run.h5").problem, mbvi.Centered(), step=1e-3, duration=0.2, progress=False
    )
    assert np.array_equal(run.q, again.q)


@pytest.mark.parametrize("limits", [(0.1, 0.3), (-0.3, -0.1), (-4.0, 0.0), (0.3, -0.3)])
def test_limits_that_leave_out_the_start_are_refused(limits):
    with pytest.raises(mbvi.InputError, match="limits must hold the start"):
        door(0.0, limits=limits)
