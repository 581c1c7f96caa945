"""What one part of a scene does leaves the impacts of the others as they are, where positions are projected."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.schemes.positions.moved_groups import find_moved_groups, moved_groups, restore_columns
from mbvi.system.parts import independent_parts

SCHEMES = [mbvi.Centered(project_positions=True), mbvi.MoreauJean(0.5, project_positions=True)]


def hopper(far, falling, friction=0.0):
    """A hopper that bounces; far away an arm whose fingers reach their limits, and a box in the air."""
    scene = mbvi.Scene(gravity=(0.5, 0.3, -9.0), restitution=0.3, friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(mbvi.robot("hopper"), position=(0, -1.2, 0.9), name="hop", joints={"knee": 0.4})
    if falling:
        scene.add_box((0.2, 0.2, 0.2), mass=1.0, position=(0, 0.9, 45), name="box")
    if far:
        scene.add_urdf(mbvi.robot("arm"), base="fixed", position=(40, 40, 5), name="far")
    problem = scene.build()
    return problem, problem.scene.places().of("hop")


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("step", [2e-3, 5e-4])
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: scheme.name)
def test_a_far_robot_and_a_box_in_the_air_change_no_impact(scheme, step, friction):
    alone, place = hopper(False, False, friction)
    expected = mbvi.simulate(alone, scheme, step=step, duration=0.39)
    assert expected.impacts
    problem, where = hopper(True, True, friction)
    run = mbvi.simulate(problem, scheme, step=step, duration=0.39)
    # another length of the scene moves tolerances, and friction is solved to a residual
    close = 1e-12 if friction == 0.0 else 1e-7
    np.testing.assert_allclose(run.v[:, where.v], expected.v[:, place.v], rtol=0, atol=close)
    mine = [one for one in run.impacts if any(name.startswith("hop") for name in one.constraints)]
    assert len(mine) == len(expected.impacts)
    for one, other in zip(mine, expected.impacts, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-12)
        np.testing.assert_allclose(one.percussion, other.percussion, rtol=close, atol=close)


TABLE = """<robot name="table"><link name="base"/><joint name="axle" type="continuous"><parent link="base"/>
  <child link="disc"/><axis xyz="0 0 1"/></joint><link name="disc"><inertial><mass value="2"/>
  <inertia ixx=".1" iyy=".1" izz=".2" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><cylinder radius=".8" length=".1"/></geometry></collision></link></robot>"""


@pytest.mark.parametrize("compiled", [True, False], ids=["loop", "python"])
@pytest.mark.parametrize("friction", [0.8, (0.8, 0.05, 0.01)], ids=["sliding", "torsion"])
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: scheme.name)
def test_what_friction_alone_connects_moves_as_one(tmp_path, monkeypatch, scheme, friction, compiled):
    """Normals do not turn a turntable, friction does: bodies on it keep the sum of their angular momenta about it."""
    if not compiled:
        monkeypatch.setattr("mbvi.run.loop.compiled_loop.is_compiled", lambda *_: False)
    (tmp_path / "table.urdf").write_text(TABLE)
    scene = mbvi.Scene(friction=friction)
    scene.add_urdf(tmp_path / "table.urdf", base="fixed", name="table")
    tilt = Rotation.from_euler("xy", [0.1, 0.15]).as_matrix()
    spin = {"rotation": tilt, "angular_velocity": (0, 0, 6.0)}
    scene.add_box((0.2, 0.2, 0.1), mass=1.0, position=(0.4, 0, 0.2), velocity=(0, -0.5, 0), name="box", **spin)
    scene.add_sphere(0.1, mass=1.0, position=(-0.3, 0.2, 0.3), velocity=(0.4, 0, 0), name="ball")
    problem = scene.build()
    run = mbvi.simulate(problem, scheme, step=4e-3, duration=0.4)
    box, ball, table = (problem.scene.places().of(name) for name in ("box", "ball", "table"))
    inertia = {"box": np.diag([0.05, 0.05, 0.08]) / 12.0, "ball": 0.004 * np.eye(3)}

    def momentum(q, v):
        total = 0.2 * v[table.v][0]
        for name, place in (("box", box), ("ball", ball)):
            turn, own = Rotation.from_quat(q[place.q][3:]).as_matrix(), v[place.v]
            total += np.cross(q[place.q][:3], own[:3])[2] + (turn @ inertia[name] @ own[3:])[2]
        return total

    found = np.array([momentum(q, v) for q, v in zip(run.q, run.v, strict=True)])
    assert abs(run.v[-1][table.v][0]) > 0.05
    # a step changes it by up to 1e-3, of the order of h; where the table keeps the velocity before, by .05
    assert np.abs(np.diff(found)).max() < 2e-3


@given(st.integers(0, 2**32 - 1))
def test_groups_are_those_of_all_paths(seed):
    """Against powers of the matrix that says which parts a row connects."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 6)), int(rng.integers(0, 8))
    part = rng.integers(0, n, 2 * n)
    # what equalities connect is not side by side; the last has the largest number
    part[-1] = n - 1
    J = np.where(rng.random((k, 2 * n)) < 0.3, rng.normal(size=(k, 2 * n)), 0.0)
    moved = np.where(rng.random(2 * n) < 0.2, 1.0, 0.0)
    acts = np.zeros((k, n), bool)
    for i, j in np.argwhere(J):
        acts[i, part[j]] = True
    paths = np.linalg.matrix_power(np.eye(n, dtype=int) + acts.T.astype(int) @ acts, n + 1) > 0
    touched = paths[:, np.unique(part[moved != 0.0])].any(axis=1)
    velocities, rows = touched[part], (acts & touched).any(axis=1)
    for form in (J, csr_array(J)):
        found = moved_groups(form, moved > 0.0, part)
        np.testing.assert_array_equal(found[0], velocities)
        np.testing.assert_array_equal(found[1], rows)
    written = np.empty(2 * n, bool), np.empty(k, bool)
    assert find_moved_groups(J, moved, 0.5, part, *written) == velocities.all()
    np.testing.assert_array_equal(written[0], velocities)
    np.testing.assert_array_equal(written[1], rows)


@pytest.mark.parametrize("width", [1, 2, 3])
def test_what_rows_had_comes_back_to_where_they_are_now(rng, width):
    """Four tables of three rows each, of which rows 0 and 2 were rows 2 and 1; row 1 keeps what it has."""
    before, values = rng.normal(size=(2, 4, 3, width))
    expected = values.copy()
    expected[:, 0], expected[:, 2] = before[:, 2], before[:, 1]
    found = values.ravel().copy()
    restore_columns(before.ravel(), found, np.array([2, 0, 1]), np.array([False, True, False]))
    np.testing.assert_array_equal(found, expected.ravel())


def test_parts_that_a_weld_joins_are_one_and_the_last_is_largest():
    """A bag that a hopper carries, with a free box between both in the order of the scene."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(mbvi.robot("hopper"), position=(0, 0, 0.56), joints={"knee": 0.4}, name="hopper")
    scene.add_box((0.1, 0.1, 0.1), mass=1.0, position=(2, 0, 0.2), name="box")
    scene.add_box((0.1, 0.1, 0.1), mass=0.2, position=(0.3, 0, 0.9), name="bag")
    scene.weld("hopper/trunk", "bag")
    problem = scene.build()
    part, places = independent_parts(problem.system), problem.scene.places()
    hopper, box, bag = (set(part[places.of(name).v].tolist()) for name in ("hopper", "box", "bag"))
    assert hopper == bag == {part.max()} == {part[-1]} != box
    # the record of an impact holds rows that are linked to those that close: of the box none of the hopper
    run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=1e-3, duration=0.3)
    of_box = [one for one in run.impacts if any(name.startswith("box") for name in one.constraints)]
    assert of_box
    assert all(name.startswith("box") for one in of_box for name in one.constraints)
