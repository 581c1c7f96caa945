"""Torsional and rolling friction: |torque| <= length * normal force, with exact sticking."""

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array

import mbvi
from mbvi.geometry.motion import Rotation
from mbvi.projection import DenseMetric
from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.coulomb.friction_sparse import project_frictional_sparse

G, R, M = 9.81, 0.1, 2.0
INERTIA = 0.4 * M * R**2
SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
]  # fmt: skip


def ball(friction, v=(0, 0, 0), spin=(0, 0, 0), tilt=0.0, e=0.0):
    """A ball on a floor that falls along x by an angle."""
    scene = mbvi.Scene(friction=friction, restitution=e, gravity=(G * np.sin(tilt), 0, -G * np.cos(tilt)))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(R, M, position=(0, 0, R), name="ball")
    problem = scene.build()
    return problem.at(problem.q0, np.concatenate([v, spin]))


def run_of(problem, scheme=None, step=1e-3, duration=0.5):
    return mbvi.simulate(problem, scheme, step=step, duration=duration, progress=False)


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_a_ball_rolls_to_rest_as_the_torque_says(scheme):
    length = 0.004
    slows = length * G * M / R / (M + INERTIA / R**2)
    run = run_of(ball((0.5, 0.0, length), (0.2, 0, 0), (0, 2.0, 0)), scheme, duration=1.0)
    still = run.t > 0.2 / slows + 2e-3
    np.testing.assert_allclose(run.v[:, 0], np.maximum(0.2 - slows * run.t, 0.0), atol=slows * 1e-3)
    rolling = run.t < 0.2 / slows - 2e-3
    np.testing.assert_allclose(run.v[rolling, 0], 0.2 - slows * run.t[rolling], atol=1e-12)
    assert still.sum() > 100 and np.abs(run.v[still]).max() < 1e-14
    assert np.ptp(run.q[still], axis=0).max() < 1e-15


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_a_spin_about_the_normal_stops_and_nothing_else_changes(scheme):
    length = 0.01
    slows = length * M * G / INERTIA
    run = run_of(ball((0.5, length, 0.0), spin=(0, 0, 5.0)), scheme)
    np.testing.assert_allclose(run.v[:, 5], np.maximum(5.0 - slows * run.t, 0.0), atol=slows * 1e-3)
    assert np.abs(run.v[-100:]).max() < 1e-14
    np.testing.assert_allclose(run.q[:, :3], [[0, 0, R]] * len(run.t), atol=1e-14)


def test_a_ball_stays_on_a_slope_up_to_length_over_radius():
    stays = run_of(ball((0.5, 0.0, 0.01), tilt=np.arctan(0.0999)), duration=2.0)
    assert np.ptp(stays.q, axis=0).max() < 1e-15
    rolls = run_of(ball((0.5, 0.0, 0.01), tilt=0.11), duration=1.0)
    expected = (M * G * np.sin(0.11) - 0.01 / R * M * G * np.cos(0.11)) / (M + INERTIA / R**2)
    assert rolls.v[-1, 0] == pytest.approx(expected, rel=1e-12)


def test_the_impact_of_a_spinning_ball_obeys_the_law():
    """One impact: the torque's percussion is the length times the normal one, or stops the spin."""
    for spin, left in ((50.0, 50.0 - 0.01 * M * (1 + 0.5) * 3.0 / INERTIA), (5.0, 0.0)):
        scene = mbvi.Scene(friction=(0.5, 0.01, 0.0), restitution=0.5, gravity=(0, 0, 0))
        scene.add_halfspace((0, 0, 1), name="floor")
        scene.add_sphere(R, M, position=(0, 0, R + 0.003), name="ball")
        problem = scene.build()
        run = run_of(problem.at(problem.q0, [0, 0, -3.0, 0, 0, spin]), mbvi.Paoli(), duration=0.01)
        np.testing.assert_allclose(run.v[-1], [0, 0, 1.5, 0, 0, left], atol=1e-12)


def test_four_corners_of_a_box_each_bear_their_torque():
    scene = mbvi.Scene(friction=(0.5, 0.02, 0.0))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05), name="box")
    problem = scene.build()
    run = run_of(problem.at(problem.q0, [0, 0, 0, 0, 0, 5.0]), mbvi.Paoli(), duration=0.02)
    torque = (5.0 - run.v[-1, 5]) / 0.02 * (0.2**2 + 0.2**2) / 12
    # friction at the corners, at half of the diagonal, and torsional friction
    assert torque == pytest.approx(G * (0.5 * 0.1 * np.sqrt(2.0) + 0.02), rel=1e-9)


def test_momentum_and_angular_momentum_of_two_balls_are_kept():
    scene = mbvi.Scene(friction=(0.3, 0.01, 0.005), restitution=0.4, gravity=(0, 0, 0))
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0), name="a")
    scene.add_sphere(0.2, 3.0, position=(0.31, 0.05, 0.02), name="b")
    problem = scene.build()
    v = np.array([2.0, 0.3, 0, 5.0, -3.0, 8.0, -1.0, 0, 0.2, 0, 4.0, 6.0])
    run = run_of(problem.at(problem.q0, v), mbvi.Paoli(), step=1e-4, duration=0.05)

    def momenta(k):
        q, v = run.q[k].reshape(2, 7), run.v[k].reshape(2, 6)
        linear, angular = np.zeros(3), np.zeros(3)
        for place, rate, mass, radius in zip(q, v, (1.0, 3.0), (0.1, 0.2), strict=True):
            turn = pin.Quaternion(place[3:]).toRotationMatrix()
            linear += mass * rate[:3]
            angular += mass * np.cross(place[:3], rate[:3]) + 0.4 * mass * radius**2 * (turn @ rate[3:])
        return np.concatenate([linear, angular])

    assert len(run.impacts) == 1
    assert np.abs(run.v[-1, 3:6] - v[3:6]).max() > 0.1
    np.testing.assert_allclose(momenta(-1), momenta(0), atol=1e-12)


def test_a_turntable_takes_a_ball_along():
    """Torsional friction is relative to what turns below; the spin grows by the torque up to that of the table."""
    scene = mbvi.Scene(friction=(0.5, 0.01, 0.0))
    scene.add_halfspace((0, 0, 1), name="table", motion=Rotation((0, 0, 1), 2.0))
    scene.add_sphere(R, M, position=(0, 0, R), name="ball")
    run = run_of(scene.build(), mbvi.Paoli())
    gains = 0.01 * M * G / INERTIA
    np.testing.assert_allclose(run.v[:, 5], np.minimum(gains * run.t, 2.0), atol=2 * gains * 1e-3)
    np.testing.assert_allclose(run.v[-1], [0, 0, 0, 0, 0, 2.0], atol=1e-12)


def drawn_problem(seed):
    """Contacts between two or three bodies, each with friction, some with torsion and rolling; for the law alone."""
    rng = np.random.default_rng(seed)
    bodies, m = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    nv = 6 * bodies
    mass = np.diag(np.exp(rng.normal(size=nv)))
    rows, mu, bound = [], [], []
    for _ in range(m):
        axes, at = np.linalg.qr(rng.normal(size=(3, 3)))[0], 0.3 * rng.normal(size=(2, 3))
        sides = rng.permutation(bodies)[:2]
        linear, angular = np.zeros((3, nv)), np.zeros((3, nv))
        for sign, body, arm in zip((1.0, -1.0), sides, at, strict=False):
            linear[:, 6 * body : 6 * body + 3] = sign * axes
            linear[:, 6 * body + 3 : 6 * body + 6] = sign * np.cross(arm, axes)
            angular[:, 6 * body + 3 : 6 * body + 6] = sign * axes
        own = len(mu)
        rows.append(linear)
        mu.append(rng.uniform(0.1, 0.7))
        bound.append(-1)
        if rng.random() < 0.8:
            rows.append(np.stack([np.zeros(nv), angular[0], np.zeros(nv)]))
            mu.append(rng.uniform(0.01, 0.1))
            bound.append(own)
        if rng.random() < 0.8:
            rows.append(np.concatenate([np.zeros((1, nv)), angular[1:]]))
            mu.append(rng.uniform(0.01, 0.1))
            bound.append(own)
    return rng.normal(size=nv), mass, np.concatenate(rows), np.array(mu), np.array(bound)


def check_law(x, mass, J, mu, bound, w, p, tolerance):
    """Check all cases of the law from its statement; nothing of the solver is used."""
    np.testing.assert_allclose(mass @ (w - x), J.T @ p, atol=tolerance)
    u, p = (J @ w).reshape(-1, 3), p.reshape(-1, 3)
    for a, other in enumerate(bound):
        normal = p[a, 0] if other < 0 else p[other, 0]
        across, slip = np.linalg.norm(p[a, 1:]), np.linalg.norm(u[a, 1:])
        assert across <= mu[a] * normal + tolerance
        if other < 0:
            assert p[a, 0] >= -tolerance and u[a, 0] >= -tolerance
            assert min(p[a, 0], u[a, 0]) <= tolerance
        # maximum dissipation: against the velocity, and at the bound unless that vanishes
        assert u[a, 1:] @ p[a, 1:] <= -mu[a] * normal * slip + tolerance


@given(st.integers(0, 10**6))
def test_the_law_holds_in_all_its_cases(seed):
    x, mass, J, mu, bound = drawn_problem(seed)
    m = len(mu)
    found = project_frictional(x, DenseMetric(mass), J, np.zeros(m), mu, 1e-9, bound=bound)
    check_law(x, mass, J, mu, bound, found.velocity, found.percussion, 1e-8)
    assert (found.percussion.reshape(-1, 3)[bound >= 0, 0] == 0.0).all()


@given(st.integers(0, 10**6))
def test_the_law_holds_for_sparse_rows(seed):
    x, mass, J, mu, bound = drawn_problem(seed)
    found = project_frictional_sparse(x, DenseMetric(mass), csr_array(J), np.zeros(len(J)), mu, 1e-9, bound=bound)
    check_law(x, mass, J, mu, bound, found.velocity, found.percussion, 1e-7)


def test_beside_dry_friction_of_joints(tmp_path):
    """A wheel on a hinge spins on its tip: the torques of its joint and of the floor add, and both hold it."""
    text = """<robot name="r"><link name="base"/><link name="slide"><inertial><mass value="0.5"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="top"><inertial><mass value="1.5"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>
      </inertial><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
      <joint name="z" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="0 0 1"/>
      <limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
      <joint name="turn" type="continuous"><parent link="slide"/><child link="top"/><axis xyz="0 0 1"/></joint>
      </robot>"""
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    scene = mbvi.Scene(friction=(0.5, 0.01, 0.0))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(file, base="fixed", position=(0, 0, 0.1), velocity={"turn": 1.0}, joint_friction={"turn": 0.3})
    run = run_of(scene.build(), mbvi.Paoli())
    slows = (0.3 + 0.01 * 2.0 * G) / 0.1
    np.testing.assert_allclose(run.v[:, 1], np.maximum(1.0 - slows * run.t, 0.0), atol=slows * 1e-3)
    assert run.v[100, 1] == pytest.approx(1.0 - 0.1 * slows, abs=1e-12)
    assert np.abs(run.v[-1]).max() < 1e-15


def test_settings_of_pairs_copies_and_files(tmp_path):
    scene = mbvi.Scene(friction=(0.5, 0.0, 0.004))
    scene.add_halfspace((0, 0, 1), name="floor")
    for k, name in enumerate(("a", "b", "c")):
        scene.add_sphere(R, M, position=(0, k, R), velocity=(0.2, 0, 0), name=name)
    scene.set_friction("b", "floor", 0.5)
    scene.set_friction("c", "floor", (0.5, 0.0, 0.002))
    problem = scene.build()
    v = problem.v0.reshape(3, 6).copy()
    v[:, 4] = 0.2 / R
    run = run_of(problem.at(problem.q0, v.ravel()), mbvi.Paoli(), duration=0.2)
    slows = G * M / R / (M + INERTIA / R**2)
    np.testing.assert_allclose(
        run.v[-1].reshape(3, 6)[:, 0], 0.2 - 0.2 * slows * np.array([0.004, 0.0, 0.002]), atol=1e-12
    )
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    for problem_again in (again.problem, pickle.loads(pickle.dumps(again.problem)), copy.deepcopy(again.problem)):
        repeated = run_of(problem_again, mbvi.Paoli(), duration=0.2)
        np.testing.assert_array_equal(repeated.v, run.v)
    assert "torsional and rolling friction, lengths 0 and 0; 0 and 0.002; 0 and 0.004 m" in problem.report()


BALL = """<mujoco><option cone="elliptic" timestep="0.00005"/>
  <default><geom friction="0.5 {torsion} {rolling}" condim="{dimensions}" solref="0.001 1"/>
  </default>
  <worldbody><geom type="plane" size="9 9 1"/><body pos="0 0 0.1"><freejoint/>
  <geom size="0.1" mass="2"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("dimensions", "spin", "speed"), [(4, 5.0, 0.0), (6, 0.0, 0.5), (3, 5.0, 0.0)])
def test_condim_of_mjcf_and_mujoco(dimensions, spin, speed, tmp_path):
    """The torque on a ball that spins or rolls, exactly; that of MuJoCo, whose contacts are soft, to 2 percent."""
    mujoco = pytest.importorskip("mujoco")
    text = BALL.format(torsion=0.01, rolling=0.002, dimensions=dimensions)
    file = tmp_path / "ball.xml"
    file.write_text(text)
    v = np.array([speed, 0, 0, 0, speed / R, spin])
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = v
    mujoco.mj_step(model, data, 1000)
    scene = mbvi.Scene()
    scene.add_mjcf(file, rolling_friction=True)
    problem = scene.build()
    run = run_of(problem.at(problem.q0, v), duration=0.05)
    # the angular momentum about the contact point, which the torque alone changes; MuJoCo has the velocity of the
    # centre in the world, where soft contacts let it move up and down, mbvi in the axes of the body
    data.qvel[2] = 0.0
    lost = []
    for after in (run.v[-1], data.qvel):
        (linear, angular), (before, turning) = (np.linalg.norm(x.reshape(2, 3), axis=1) for x in (after, v))
        lost.append(INERTIA * (turning - angular) + M * R * (before - linear))
    expected = 0.05 * {3: 0.0, 4: 0.01, 6: 0.002}[dimensions] * M * G
    assert lost[0] == pytest.approx(expected, rel=1e-4, abs=1e-12)
    assert lost[1] == pytest.approx(expected, rel=0.02, abs=1e-5)


def test_grains_at_rest_do_not_roll():
    """Ten balls on a slope, which rolling friction holds, in the solver of many contacts."""
    scene = mbvi.Scene(friction=(0.6, 0.0, 0.01), gravity=(0.9, 0, -9.7))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_spheres(np.array([[0.5 * k, 0.5 * j, R] for k in range(8) for j in range(6)]), R, M, name="balls")
    run = run_of(scene.build(), mbvi.Paoli(), duration=0.1)
    assert np.ptp(run.q, axis=0).max() < 1e-14
    rolling = mbvi.Scene(friction=0.6, gravity=(0.9, 0, -9.7))
    rolling.add_halfspace((0, 0, 1), name="floor")
    rolling.add_spheres(np.array([[0.5 * k, 0.5 * j, R] for k in range(8) for j in range(6)]), R, M, name="balls")
    assert np.ptp(run_of(rolling.build(), mbvi.Paoli(), duration=0.1).q, axis=0).max() > 1e-3


@pytest.mark.parametrize("friction", [(0.0, 0.1, 0.0), (0.5, -1.0, 0.0), (0.5, 0.1), (0.5, np.nan, 0.1), "much"])
def test_wrong_coefficients_are_refused(friction):
    with pytest.raises(mbvi.InputError):
        mbvi.Scene(friction=friction)


def test_the_energy_cap_is_refused():
    scene = mbvi.Scene(friction=(0.5, 0.1, 0.0), energy_cap=True)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(R, M, position=(0, 0, R), name="ball")
    with pytest.raises(mbvi.InputError, match="energy_cap"):
        scene.build()
