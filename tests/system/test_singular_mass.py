"""A body on a gimbal without mass: its mass matrix is singular where two of the axes are parallel, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi

SIZE, MASS = (0.2, 0.3, 0.5), 2.0
# angles at which no two axes are parallel, and rates
ANGLES = {"yaw": 0.4, "pitch": 0.7, "roll": -0.3}
RATES = {"yaw": 1.0, "pitch": -0.5, "roll": 2.0}


def gimbal(tmp_path, axes="zxz", offset=0.0, tail=""):
    """Return a URDF file: a heavy base, two rings without mass, and a box `offset` above the pivot."""
    x, y, z = SIZE
    moments = [MASS / 12 * s for s in (y * y + z * z, x * x + z * z, x * x + y * y)]
    inertia = '<inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/>'.format(*moments)
    box = f'<inertial><origin xyz="0 0 {offset}"/><mass value="{MASS}"/>{inertia}</inertial>'
    base = '<inertial><mass value="5"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".2" iyz="0" izz=".3"/></inertial>'
    links = [("base", base), ("outer", ""), ("inner", ""), ("body", box)]
    text = "".join(f'<link name="{name}">{inside}</link>' for name, inside in links)
    for joint, axis, parent, child in zip(ANGLES, axes, [n for n, _ in links], [n for n, _ in links[1:]], strict=False):
        along = " ".join("1" if axis == a else "0" for a in "xyz")
        text += (
            f'<joint name="{joint}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
            f'<axis xyz="{along}"/></joint>'
        )
    path = tmp_path / "gimbal.urdf"
    path.write_text(f'<robot name="gimbal">{text}{tail}</robot>')
    return path


def on_gimbal(path, base, gravity=(0, 0, 0), **options):
    scene = mbvi.Scene(gravity=gravity)
    scene.add_urdf(path, base=base, **{"joints": ANGLES, "velocity": RATES, **options})
    return scene.build()


@pytest.mark.parametrize("axes", ["zxz", "zyz", "xyx"])
def test_on_a_gimbal_a_body_turns_as_a_free_one(tmp_path, axes):
    problem = on_gimbal(gimbal(tmp_path, axes), "fixed")
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-10), duration=0.5)
    place = problem.system.placements
    start = place(problem.q0, np.array([3]))[0, :3].T
    # angular velocity in the world: each rate about its axis where the joints before it have turned that
    spin, turn = np.zeros(3), Rotation.identity()
    for name, axis in zip(ANGLES, axes, strict=True):
        unit = np.eye(3)["xyz".index(axis)]
        spin += turn.apply(RATES[name] * unit)
        turn = turn * Rotation.from_rotvec(ANGLES[name] * unit)
    np.testing.assert_allclose(turn.as_matrix(), start, atol=1e-12)
    free = mbvi.Scene(gravity=(0, 0, 0))
    free.add_box(SIZE, mass=MASS, rotation=start, angular_velocity=spin)
    other = mbvi.simulate(free.build(), mbvi.EventDriven(1e-10), duration=0.5)
    end = Rotation.from_quat(other.q[-1, 3:7]).as_matrix()
    np.testing.assert_allclose(place(run.q[-1], np.array([3]))[0, :3].T, end, atol=1e-8)
    assert np.ptp(run.energy()) < 1e-8 * run.energy()[0]


@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("scheme", [mbvi.EventDriven(1e-9), mbvi.Centered(), mbvi.MoreauJean(), None])
def test_energy_stays_on_either_base(tmp_path, base, scheme):
    """Under gravity, the body off its pivot; with a scheme of order two the error is that of the step."""
    problem = on_gimbal(gimbal(tmp_path, offset=0.1), base, gravity=(0, 0, -9.81))
    options = {} if scheme is None or isinstance(scheme, mbvi.EventDriven) else {"step": 1e-4}
    run = mbvi.simulate(problem, scheme, duration=0.2, **options)
    bound = 1e-3 if options else 1e-5
    assert np.ptp(run.energy()) < bound * problem.system.kinetic_energy(problem.q0, problem.v0)


@pytest.mark.parametrize("base", ["fixed", "free"])
def test_the_given_configuration_counts(tmp_path, base):
    path = gimbal(tmp_path)
    with pytest.raises(mbvi.InputError, match=r"singular at the initial configuration, at joint 'roll'.*joints="):
        on_gimbal(path, base, joints={"pitch": 0.0}, velocity={})
    with pytest.raises(mbvi.InputError, match="singular at the initial configuration"):
        on_gimbal(path, base, joints={"pitch": np.pi}, velocity={})
    # a joint that is locked turns nothing
    problem = on_gimbal(path, base, joints={"pitch": 0.0}, velocity={}, locked=["roll"])
    assert problem.system.nv == 2 + 6 * (base == "free")
    run = mbvi.simulate(problem, step=1e-3, duration=1e-2)
    assert np.isfinite(run.q).all()


def test_singular_everywhere_is_no_matter_of_the_configuration(tmp_path):
    """A second joint along the first one's axis, with nothing between them."""
    with pytest.raises(mbvi.UrdfError, match="mass matrix is singular at joint 'pitch'"):
        on_gimbal(gimbal(tmp_path, "zzx"), "fixed")
