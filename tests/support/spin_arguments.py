"""Random arguments of the kernels of gyroscopic torques: bodies of any inertia, at rest, slow, and very fast."""

import numpy as np
import pinocchio as pin

from mbvi.system.free.coasting import _SMALL
from mbvi.system.free.spinning import free_links, principal
from mbvi.system.mechanisms.mechanism import free_joint


def random_inertias(rng, n):
    """Inertias of n bodies in random axes: of clouds of points, some of them flat or long."""
    found = []
    for _ in range(n):
        points = rng.normal(size=(8, 3)) * 10.0 ** rng.uniform(-1.5, 0.0, 3)
        points -= points.mean(axis=0)
        found.append(np.sum(points**2) * np.eye(3) - points.T @ points)
    return np.array(found)


def _speed(rng):
    return rng.choice([0.0, 1e-3, 1.0, 30.0, 1e5])


def _turning(rng):
    return principal(random_inertias(rng, 1))[2][0], 10.0 ** rng.uniform(-4.0, -1.0)


def _mean_spin(rng):
    # now and then too far for Newton's method, as of factors of no physical inertia
    factors, h = _turning(rng)
    return factors * rng.choice([1.0, 1.0, 50.0]), h, *(_speed(rng) * rng.normal(size=3))


def _spin(rng):
    state = rng.normal(size=(2, 3)) * [[_speed(rng)], [rng.choice([0.0, 1.0])]]
    return *_turning(rng), state


def _free_velocities(rng):
    inertias = random_inertias(rng, 3)
    inertias[1] = 0.4 * np.eye(3)
    axes, _, factors = principal(inertias)
    v = rng.normal(size=(3, 6))
    v[:, 3:] *= _speed(rng)
    return v.ravel(), rng.normal(size=(3, 3)), axes, factors, 1e-2, np.zeros((2, 3)), np.full(18, np.nan)


def model_of_free_links(rng):
    """A model of a robot and of bodies on both kinds of joints of six velocities."""
    pin.seed(int(rng.integers(2**31)))
    model = pin.Model()
    for k, inertia in enumerate(random_inertias(rng, 3)):
        joint = free_joint() if k == 1 else pin.JointModelFreeFlyer()
        added = model.addJoint(0, joint, pin.SE3.Random(), f"body {k}")
        centre = np.zeros(3) if k == 1 else rng.normal(size=3)
        model.appendBodyToJoint(added, pin.Inertia(rng.uniform(0.1, 5.0), centre, inertia), pin.SE3.Identity())
        if k == 0:
            # this one is no free body
            arm = model.addJoint(added, pin.JointModelRX(), pin.SE3.Random(), "arm")
            model.appendBodyToJoint(arm, pin.Inertia.Random(), pin.SE3.Identity())
    return model


def _spin_effects(rng):
    model = model_of_free_links(rng)
    return free_links(model), *(_speed(rng) * rng.normal(size=(2, model.nv))), 1e-2, *rng.normal(size=(2, model.nv))


def _remove_spin_effects(rng):
    bodies, _, at, _, _, effects = _spin_effects(rng)
    return bodies, at, effects


def _unit(rng):
    x = rng.normal(size=3)
    return x / np.linalg.norm(x)


def _coast_spin(rng):
    inertia = random_inertias(rng, 1) if rng.random() < 0.8 else 0.4 * np.eye(3)[None]
    _, moments, factors = principal(inertia)
    w = _speed(rng) * rng.normal(size=3)
    return moments[0], factors[0], 10.0 ** rng.uniform(-4.0, -1.0), w, np.full(4, np.nan), np.full(3, np.nan)


def _coast(rng):
    model = model_of_free_links(rng)
    v = _speed(rng) * rng.normal(size=model.nv)
    return free_links(model), 1e-2, v, *np.full((2, model.nv), np.nan)


SPIN_ARGUMENTS = {
    "mean_spin": _mean_spin,
    "rotated_back": lambda rng: (1e-2, *(_speed(rng) * rng.normal(size=3)), *rng.normal(size=3)),
    "spin": _spin,
    "free_velocities": _free_velocities,
    "spin_effects": _spin_effects,
    "remove_spin_effects": _remove_spin_effects,
    "add_effects": lambda rng: (principal(random_inertias(rng, 1))[0][0], *rng.normal(size=(3, 3)), rng.normal(size=6)),
    "turn_quaternion": lambda rng: (rng.normal(size=4), *rng.normal(size=4).tolist()),
    "coast_spin": _coast_spin,
    "screw_displacement": lambda rng: (rng.choice([0.5 * _SMALL, 1.0, 3.0]) * _unit(rng), *rng.normal(size=3).tolist()),
    "coast": _coast,
    "along": lambda rng: (
        principal(random_inertias(rng, 1))[0][0], rng.normal(size=6), bool(rng.integers(2)), *np.full((2, 3), np.nan)
    ),
    "add_cross": lambda rng: (float(rng.normal()), *rng.normal(size=(3, 3))),
}  # fmt: skip
