"""Coulomb's law of one mechanism in one kernel gives what the same law gives in numpy, and no search is left out."""

import numpy as np
import pytest

import mbvi
from mbvi import motion
from mbvi.constraints.mechanism.state import MechanismState
from mbvi.constraints.rows import take
from mbvi.projection import FreeMotion, Projector
from mbvi.run.loop.made_records import mechanism_step
from mbvi.schemes.kernels.joint_friction import bounded_coulomb
from mbvi.schemes.kernels.phases import write_free_motion
from mbvi.schemes.positions import position_projection
from mbvi.schemes.step import closing_speeds, law
from mbvi.system.mechanisms.mechanism import place, weigh
from support.oracle import RobotOracle

QUADRUPED = "robots/quadruped/quadruped.urdf"
STEP, SCHEME = 1e-3, mbvi.Centered(project_positions=True)
BELT = motion.Translation((0.3, 0.0, 0.1))


STANCE = {
    f"{leg}_{joint}_joint": x for leg in ("FL", "FR", "RL", "RR") for joint, x in (("thigh", 0.6), ("calf", -1.2))
}


def landing(e=0.0, wall=None):
    """A quadruped with springs in its joints that lands on a slope while it moves forwards."""

    def control(t, q, v):
        return np.concatenate([np.zeros(6), 80.0 * (np.tile([0.0, 0.6, -1.2], 4) - q[7:]) - v[6:]])

    scene = mbvi.Scene(friction=0.7, restitution=e, gravity=(2.0, 0.0, -9.6))
    scene.add_halfspace((0, 0, 1), 0.0, name="floor", motion=wall)
    pose = {"position": (0, 0, 0.36), "base_velocity": (0.4, 0.1, -0.5, 0.0, 0.0, 0.0)}
    scene.add_urdf(QUADRUPED, control=control, joints=STANCE, **pose)
    return scene.build()


@pytest.mark.parametrize(("e", "wall"), [(0.0, None), (0.5, None), (0.3, BELT)], ids=["lands", "bounces", "on a belt"])
def test_the_kernel_gives_the_law_in_numpy(e, wall):
    problem = landing(e, wall)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.3, progress=False)
    compared = 0
    for t, q, v in list(zip(run.t, run.q, run.v, strict=True))[::2]:
        rows = problem.constraints.active(t, q, 1e-3)
        if not rows.tangents.friction.any():
            continue
        opened = closing_speeds(problem, rows, STEP)
        tree = problem.system.free_motion(t, q, v, STEP)
        found = law(Projector(), v, tree, rows, opened)
        assert Projector().friction.law(tree, rows, opened) is not None
        plain = law(Projector(), v, FreeMotion(tree.free, tree.metric), rows, opened)
        for a, b in zip(found[:-1], plain[:-1], strict=True):
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-12 * max(1.0, np.abs(b).max()))
        compared += 1
    assert compared >= 50


def test_rows_of_joint_limits_alone_have_no_law_of_friction():
    problem = landing()
    rows = problem.constraints.active(0.0, problem.q0, 0.5)
    rows = take(rows, np.flatnonzero(rows.constraint < 40)[:30])
    without = take(rows, rows.tangents.friction == 0.0)
    assert 0 < len(without.gap) < len(rows.gap) <= 32
    tree = problem.system.free_motion(0.0, problem.q0, problem.v0, STEP)
    assert Projector().friction.law(tree, without, None) is None
    assert Projector().friction.law(tree, rows, None) is not None


@pytest.mark.parametrize("scheme", [SCHEME, mbvi.Paoli(project_positions=True)], ids=repr)
def test_no_projection_is_left_out(scheme, monkeypatch):
    """Where gaps say that nothing has sunk, the searches find the same."""
    problem, may_sink = landing(), position_projection._may_sink
    run = mbvi.simulate(problem, scheme, step=STEP, duration=0.3, progress=False)
    left_out = 0
    for state in list(zip(run.t[:-1], run.q[:-1], run.v[:-1], strict=True))[::4]:
        answers = []
        with monkeypatch.context() as patched:
            patched.setattr(
                position_projection, "_may_sink", lambda *args, kept=answers: kept.append(may_sink(*args)) or kept[-1]
            )
            found = scheme.step(problem, *state, STEP, Projector())
            patched.setattr(position_projection, "_may_sink", lambda *args: True)
            searched = scheme.step(problem, *state, STEP, Projector())
        left_out += answers == [False]
        np.testing.assert_array_equal(found.q, searched.q)
        np.testing.assert_array_equal(found.v, searched.v)
        np.testing.assert_array_equal(found.rates, searched.rates)
        np.testing.assert_array_equal(found.active.gap, searched.active.gap)
    assert left_out >= 5


def contacts_about(problem, rng, k, rows):
    """Write k contacts of the world with random bodies at random points, most normals upwards; return their bounds."""
    q, n = problem.q0, rng.normal(size=(k, 3)) * [0.4, 0.4, 0.1] + [0.0, 0.0, 1.0]
    axes = np.linalg.qr(np.concatenate([n[:, :, None], rng.normal(size=(k, 3, 2))], axis=2))[0]
    point, body = q[:3] + rng.uniform(-0.3, 0.3, (k, 3)), rng.integers(1, problem.system.model.njoints, k)
    row = [problem.system.separation_rows(q, np.zeros(k, int), body, point, axes[:, :, c].copy()) for c in range(3)]
    rows.size[0], rows.J[:k], rows.mu[:k] = k, row[0] * np.sign(axes[:, 2, :1]), 0.6
    rows.T[0 : 2 * k : 2], rows.T[1 : 2 * k : 2] = row[1], row[2]
    return -rng.choice([0.0, 1.0, 5.0], k, p=[0.15, 0.25, 0.6])


@pytest.mark.parametrize("seed", range(12))
def test_the_law_of_many_contacts_is_that_of_those_which_would_close(seed):
    rng, problem, k = np.random.default_rng(seed), landing(), 40 + 3 * seed
    mechanism, memory = problem.system.mechanism(), MechanismState(problem.constraints)
    s = mechanism_step(problem, SCHEME, 1e-8, mechanism, memory, None)
    x, w, p = 0.5 * rng.normal(size=18) - 1.0 * (np.arange(18) == 2), np.zeros(18), np.full((k, 6), np.nan)
    lower = contacts_about(problem, rng, k, s.rows)
    place(s.mechanism, problem.q0.copy())
    weigh(s.mechanism, problem.q0.copy())
    assert write_free_motion(s, x, STEP, False)
    assert bounded_coulomb(s, s.rows, x, lower, STEP, 1e-11, w, p) == 0
    J, T, normal, tangent = s.rows.J[:k], s.rows.T[: 2 * k].reshape(k, 2, 18), p[:, 0], p[:, 1:3]
    impulse = J.T @ normal + np.einsum("kcn,kc->n", T, tangent)
    np.testing.assert_allclose(RobotOracle(problem).matrix(problem.q0) @ (w - x), impulse, atol=1e-9)
    u, slip = J @ w - lower, T @ w
    assert (normal > 0.0).sum() >= 3
    assert normal.min() >= 0.0 and u.min() >= -1e-9 and np.abs(normal * u).max() < 1e-9
    # inside the cone contacts stick, on it friction opposes the slip
    room = 0.6 * normal - np.linalg.norm(tangent, axis=1)
    speed = np.linalg.norm(slip, axis=1)
    assert room.min() > -1e-9 and np.abs(room * speed).max() < 1e-9
    assert np.abs(np.vecdot(tangent, slip) + np.linalg.norm(tangent, axis=1) * speed).max() < 1e-9
