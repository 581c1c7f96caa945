"""Random states of robots, with the rows of their contacts, as arguments of kernels."""

from functools import cache

import numpy as np
import pinocchio as pin

from mbvi.projection import DenseMetric
from mbvi.system import ArticulatedSystem
from support.robot_problems import is_free, path_of

MODELS = ["quadruped", "biped", "arm", "panda", "talos"]


@cache
def robot(name):
    free = is_free(name)
    model = pin.buildModelFromUrdf(str(path_of(name)), *([pin.JointModelFreeFlyer()] if free else []))
    if name == "arm":
        model.damping = np.linspace(0.1, 2.0, model.nv)
    return ArticulatedSystem(model, name)


def moving_robot(rng):
    """One of the robots, a configuration and a velocity; its arrays are at that configuration."""
    system = robot(rng.choice(MODELS))
    neutral = pin.neutral(system.model)
    q = system.integrate(neutral, rng.normal(size=system.nv))
    system.metric(q)
    return system, q, rng.normal(size=system.nv)


def rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def unit(rng, *shape):
    vectors = rng.normal(size=(*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def contact_rows(rng, system, q):
    """Gradients of contacts and joint limits; every other time four points of one face stand on the same plane."""
    m = int(rng.integers(1, 6))
    second = rng.integers(1, len(system.bodies), m)
    first = np.where(rng.random(m) < 0.5, 0, rng.integers(0, len(system.bodies), m))
    point, normal = rng.normal(size=(m, 3)), unit(rng, m)
    if rng.random() < 0.5:
        face = rotation(rng) * 0.2
        corners = [a * face[0] + b * face[1] for a in (-1, 1) for b in (-1, 1)]
        second, first = np.append(second, [second[0]] * 4), np.append(first, [0] * 4)
        point = np.vstack([point, point[0] + np.array(corners)])
        normal = np.vstack([normal, [face[2] / 0.2] * 4])
    rows = system.separation_rows(q, first.astype(np.int64), second.astype(np.int64), point, normal)
    # bodies that no joint moves against each other have no row
    rows = rows[np.abs(rows).max(axis=1) > 1e-3]
    limit = np.zeros((1, system.nv))
    limit[0, rng.integers(system.nv)] = rng.choice([-1.0, 1.0])
    return np.ascontiguousarray(np.vstack([rows, limit]))


def cone(rng):
    """Gradients of a robot or of random numbers, and a metric; a velocity before and one after the forces."""
    if rng.random() < 0.7:
        system, q, v = moving_robot(rng)
        J, metric = contact_rows(rng, system, q), system.metric(q)
    else:
        m, n = rng.integers(1, 7, size=2)
        B, J, v = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=n)
        if m > 1 and rng.random() < 0.5:
            J[1] = rng.choice([1.0, 2.0, -1.0]) * J[0]
        metric = DenseMetric(B @ B.T + np.eye(n))
    return J, metric, v, v + 1e-2 * rng.normal(size=len(v))


def restitution(rng, m):
    return np.full(m, rng.choice([0.0, 0.3, 1.0])) if rng.random() < 0.7 else rng.choice([0.0, 0.3, 1.0], size=m)
