"""Robots in the same scene as many spheres: block systems, sparse rows and dense ones."""

from itertools import islice

import numpy as np
import pytest

import mbvi
from mbvi import packing
from support.paths import ROBOTS

GRIPPER = """<?xml version="1.0"?>
<robot name="gripper">
  <link name="palm"/>
  <link name="left"><inertial><mass value="0.2"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
    </inertial><collision><geometry>{shape}</geometry></collision></link>
  <link name="right"><inertial><mass value="0.2"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
    </inertial><collision><geometry>{shape}</geometry></collision></link>
  <joint name="left_slide" type="prismatic"><parent link="palm"/><child link="left"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="right_slide" type="prismatic"><parent link="palm"/><child link="right"/><axis xyz="-1 0 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
</robot>"""
SHAPES = {
    "box": ('<box size="0.02 0.1 0.1"/>', 0.01),
    "sphere": ('<sphere radius="0.03"/>', 0.03),
    "cylinder": ('<cylinder radius="0.03" length="0.2"/>', 0.03),
}


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.StewartTrinkle()], ids=["Paoli", "StewartTrinkle"])
@pytest.mark.parametrize("others", [0, 40])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_gripper_presses_on_a_row_of_spheres_with_its_force_at_every_contact(shape, others, scheme, tmp_path):
    """Two fingers push with F from both sides: F h is what each contact carries, however many spheres there are."""
    force, h, n, r = 3.0, 1e-3, 4, 0.02
    geometry, half = SHAPES[shape]
    path = tmp_path / "gripper.urdf"
    path.write_text(GRIPPER.format(shape=geometry))
    scene = mbvi.Scene(gravity=(0, 0, 0))
    reach = n * r + half
    joints = {"left_slide": -reach, "right_slide": -reach}
    scene.add_urdf(path, base="fixed", joints=joints, control=lambda t, q, v: np.full(2, force))
    row = np.zeros((n, 3))
    row[:, 0] = (2 * np.arange(n) - n + 1) * r
    scene.add_spheres(row, r, mass=0.1, name="held")
    if others:
        scene.add_spheres(packing.lattice((others, 1, 1), 0.1, corner=(0, 9, 0)).positions, 0.1, mass=1.0, name="far")
    steps = mbvi.steps(scene.build(), scheme, step=h, residual=1e-9)
    step = next(islice(steps, 20, None))
    pressing = step.percussion > 0.0
    assert pressing.sum() == n + 1
    np.testing.assert_allclose(step.percussion[pressing], force * h, rtol=1e-6)
    np.testing.assert_allclose(step.v, 0.0, atol=1e-9)


SCHEMES = {
    "Paoli": mbvi.Paoli(),
    "Paoli lifted": mbvi.Paoli(project_positions=True),
    "Centered lifted": mbvi.Centered(project_positions=True),
    "SchatzmanPaoli": mbvi.SchatzmanPaoli(),
    "StewartTrinkle": mbvi.StewartTrinkle(),
}


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
def test_spheres_far_away_change_nothing_for_a_hopper_in_gravel(scheme):
    """Beyond 33 spheres rows are sparse and the projection another one: the same motion, to what it was asked for."""

    def landed(far):
        scene = mbvi.Scene()
        scene.add_halfspace((0, 0, 1), name="floor")
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.72), joints={"hip": -0.5, "knee": 1.0})
        bed = packing.layers((-0.25, -0.25, 0), (0.25, 0.25), 0.05, count=20, seed=3)
        scene.add_spheres(*bed, density=800.0, name="gravel")
        if far:
            scene.add_spheres(bed.positions + np.array([30.0, 0, 0]), bed.radii, density=800.0, name="far")
        return mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.25, residual=1e-10)

    near, both = landed(False), landed(True)
    count = near.q.shape[1]
    assert any("hopper" in name and "gravel" in name for i in near.impacts for name in i.constraints)
    np.testing.assert_allclose(both.q[:, :count], near.q, atol=1e-6)
    if isinstance(scheme, mbvi.Paoli):
        one, other = near.diagnosis(), both.diagnosis()
        assert one.horizon == other.horizon and other.energy_excess == pytest.approx(one.energy_excess, abs=1e-9)


def test_a_robot_on_a_lift_at_constant_speed_is_one_on_the_ground():
    """To the order of the step: on SE(3) the retraction carries a turning base along a helix."""

    def dropped(lift, h):
        scene = mbvi.Scene(restitution=0.2)
        motion = mbvi.motion.Translation((0.1, 0, lift)) if lift else None
        scene.add_halfspace((0, 0, 1), motion=motion)
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.5), joints={"hip": -0.5, "knee": 1.0})
        still = scene.build()
        v0 = still.v0 + np.concatenate([[0.1, 0, lift] if lift else [0, 0, 0], np.zeros(5)])
        problem = mbvi.Problem(still.system, still.constraints.constraints, still.q0, v0, length=still.length)
        run = mbvi.simulate(problem, mbvi.Paoli(), step=h, duration=0.3)
        return run, run.q[-1] - (0.3 * np.array([0.1, 0, lift, 0, 0, 0, 0, 0, 0]) if lift else 0.0)

    errors = []
    for h in (1e-3, 2.5e-4):
        (ground, q), (lift, p) = (dropped(speed, h) for speed in (0.0, 0.4))
        assert len(ground.impacts) > 1 and ground.impacts[0].constraints == lift.impacts[0].constraints
        errors.append(np.abs(p - q).max())
    # of some centimetres of travel
    assert errors[1] < errors[0] < 5e-5
