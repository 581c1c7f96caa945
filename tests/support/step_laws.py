"""Laws of one step of a robot, each as a number that is zero up to rounding; `RobotOracle` computes what they need."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from support.oracle import Free, RobotOracle


class Found(NamedTuple):
    """How far one step is from each law; speeds over the largest speed, percussions and momenta over the largest ones.

    gradient: rows against [n, p x n] of their own contact points. free: rates that forces alone lead to. balance:
    M (w - x) = J' p + T' p_t on ker J_e. bound: rows slower than Newton's bound. sign: percussions below zero.
    complementarity: percussions on rows faster than it. cone: tangential percussions above mu p. slip: percussions that
    do not oppose the slip at mu p. velocity: the velocity after, against the projection of its own.
    """

    gradient: float = 0.0
    free: float = 0.0
    balance: float = 0.0
    bound: float = 0.0
    sign: float = 0.0
    complementarity: float = 0.0
    cone: float = 0.0
    slip: float = 0.0
    velocity: float = 0.0


def names(problem, rows):
    return [problem.constraints.name(int(number)) for number in rows.constraint]


def check_step(oracle: RobotOracle, free: Free, v, step, lower) -> Found:
    """Hold a step against the laws.

    Parameters
    ----------
    free : Free
        Where the law acts, as the oracle has it.
    v : ndarray, shape (nv,)
        Velocity before.
    lower : callable
        lower(names, J) -> the least rates of the rows, shape (k,).
    """
    rows, nv = step.active, oracle.model.nv
    called = names(oracle.problem, rows)
    J = np.array([oracle.row(free.place, *one) for one in zip(called, rows.point, rows.normal, strict=True)])
    J = J.reshape(-1, nv)
    speed = max(1.0, float(np.abs(v).max()), float(np.abs(step.v).max()))
    momentum = float(np.abs(free.matrix @ np.full(nv, speed)).max())
    # reactions of equalities do no work on the velocities that these allow
    jump, N = oracle.basis.T @ free.matrix @ (step.v - free.velocity), oracle.basis
    if not len(J):
        return Found(balance=np.abs(jump).max() / momentum, velocity=np.abs(step.v - free.velocity).max() / speed)
    least = lower(called, J)
    p, excess = step.percussion, J @ step.v - least
    most = max(float(p.max()), 1e-12 * momentum)
    found = {
        "gradient": np.abs(J - rows.jacobian).max(),
        "free": np.abs(step.free - J @ free.velocity).max() / speed,
        "bound": max(0.0, -excess.min()) / speed,
        "sign": max(0.0, -p.min()) / most,
        "complementarity": np.abs(p * excess).max() / (most * speed),
    }
    sideways = np.zeros(nv)
    if rows.tangents is None:
        exact = oracle.project(free, J, least)
        found["velocity"] = np.abs(exact - step.v).max() / speed
    else:
        mu, tangential = rows.tangents.friction, step.slip[0]
        # joint limits have no point and no tangents
        T = np.zeros((len(J), 2, nv))
        for k, name in enumerate(called):
            if mu[k]:
                T[k] = rows.tangents.axes[k] @ oracle.relative(free.place, name, rows.point[k])
        slip, size = T @ step.v, np.hypot(*tangential.T)
        sideways = np.einsum("kiv,ki->v", T, tangential)
        found["gradient"] = max(found["gradient"], np.abs(T.reshape(-1, nv) - rows.tangents.jacobian).max())
        found["cone"] = max(0.0, (size - mu * p).max()) / most
        work = mu * p * np.hypot(*slip.T) + (tangential * slip).sum(axis=1)
        found["slip"] = np.abs(work).max() / (most * speed)
    found["balance"] = np.abs(jump - N.T @ (J.T @ p + sideways)).max() / momentum
    return Found(**{key: float(value) for key, value in found.items()})


def random_state(problem, oracle, rng, near=1e-3):
    """Return an admissible q and v: joints anywhere, some at a limit and moving into it, links near a wall."""
    model, outside = oracle.model, None
    for attempt in range(100):
        # links that are in each other's way in the middle of their joints' ranges are so everywhere
        part = 0.25 * 0.9**attempt
        q, v = pin.neutral(model), rng.normal(0.0, 2.0, model.nv)
        for joint in range(1, model.njoints):
            k, i = model.idx_qs[joint], model.idx_vs[joint]
            if model.nqs[joint] == 7:
                turn = rng.normal(size=4) * [0.3, 0.3, 1.0, 1.0]
                q[k : k + 7] = [*rng.uniform(-0.3, 0.3, 2), 3.0, *(turn / np.linalg.norm(turn))]
                v[i : i + 3] *= 0.35
            elif model.nqs[joint] == 2:
                angle = rng.uniform(-1.0, 1.0)
                q[k : k + 2] = np.cos(angle), np.sin(angle)
            else:
                low, high = model.lowerPositionLimit[k], model.upperPositionLimit[k]
                low, high = (low, high) if high - low < 20.0 else (-1.5, 1.5)
                q[k] = 0.5 * (low + high) + rng.uniform(-part, part) * (high - low)
                if rng.random() < 0.3:
                    up = rng.random() < 0.5
                    q[k] = np.clip(high - rng.uniform(0.0, near) if up else low + rng.uniform(0.0, near), low, high)
                    v[i] = abs(v[i]) if up else -abs(v[i])
        oracle.follow(q, v)
        if model.nqs[1] == 7 and oracle.walls:
            q[2] -= to_walls(oracle, q) - rng.uniform(0.0, near)
            if rng.random() < 0.8:
                down = [*rng.normal(0.0, 0.5, 2), -rng.uniform(0.2, 2.0)]
                v[:3] = pin.XYZQUATToSE3(q[:7]).rotation.T @ down
        elif to_walls(oracle, q) < 0.0:
            outside = q
            continue
        elif outside is not None:
            q = beside_a_wall(oracle, q, outside, rng.uniform(0.0, near))
        if problem.constraints.gap(0.0, q).min() >= 0.0:
            return q, v
    raise AssertionError("no admissible state was found")


def to_walls(oracle, q):
    """The least gap of a body that moves to a wall."""
    contacts = [gap for name, gap in oracle.gaps(q).items() if " | " in name and any(oracle.bodies(name))]
    return min(contacts, default=1.0)


def beside_a_wall(oracle, inside, outside, gap):
    """The configuration on the way between two at which the least gap to a wall is the given one."""
    way = pin.difference(oracle.model, inside, outside)
    near, far = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (near + far)
        if to_walls(oracle, pin.integrate(oracle.model, inside, middle * way)) > gap:
            near = middle
        else:
            far = middle
    return pin.integrate(oracle.model, inside, near * way)
