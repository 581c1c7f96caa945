"""Published robots that stand under a PD control of their joints, for `real_robots.py`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import mbvi
from mbvi.constraints import AdmissibleSet
from mbvi_studies.published_robots import published_robot

Array = np.ndarray

# speed over the floor: at rest a robot would repeat the same q, and what is kept for one q would answer [m/s]
_GLIDE = 0.1
# points up to this height carry the weight, because published soles are not quite flat [m]
_SOLE = 1e-3
_SIDES = ("left", "right")


def _legs(names: str, **angles: float) -> dict[str, float]:
    """Return the angles of all legs; those of a hind leg, whose name is in lower case, are reversed."""
    return {
        joint.format(leg.upper()): angle if leg.isupper() else -angle
        for leg in names.split()
        for joint, angle in angles.items()
    }


_TALOS = {f"leg_{side}_{k}_joint": x for side in _SIDES for k, x in ((3, -0.4), (4, 0.8), (5, -0.4))}
_TALOS |= {f"arm_{side}_2_joint": x for side, x in zip(_SIDES, (0.3, -0.3), strict=True)}
_TALOS |= {f"{part}_joint": x for side in _SIDES for part, x in ((f"arm_{side}_4", -0.5), (f"gripper_{side}", -0.2))}
_BENT = (("hip_pitch", -0.2), ("knee", 0.4), ("ankle_pitch", -0.2))
# joint angles [rad], and the most stiffness [N m/rad] and damping [N m s/rad] of a joint
STANCES: dict[str, tuple[dict[str, float], float, float]] = {
    "go2": (_legs("FL FR RL RR", **{"{}_thigh_joint": 0.8, "{}_calf_joint": -1.6}), 100.0, 3.0),
    "g1": ({f"{side}_{part}_joint": x for side in _SIDES for part, x in _BENT}, 300.0, 8.0),
    "talos": (_TALOS, 4000.0, 100.0),
    "solo12": (_legs("FL FR hl hr", **{"{}_HFE": 0.8, "{}_KFE": -1.6}), 10.0, 0.2),
    "anymal": (_legs("LF RF lh rh", **{"{}_HFE": 0.4, "{}_KFE": -0.8}), 300.0, 8.0),
}


class PD(NamedTuple):
    """The control of a stance, with the angles, torques that carry the weight, stiffness and damping of the joints."""

    angle: Array
    torque: Array
    stiffness: Array
    damping: Array

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques, shape (nv,), of which none act on the base."""
        out = np.zeros(len(v))
        out[6:] = self.torque - self.stiffness * (q[7:] - self.angle) - self.damping * v[6:]
        return out


def standing(name: str, step: float) -> tuple[mbvi.Problem, PD]:
    """Return a robot that glides on its feet, and the control that holds it in steps of a given length [s]."""
    joints, stiffness, damping = STANCES[name]
    free = published_robot(name, 0.0, joints=joints)
    system = free.system
    weight = system.force(free.t0, free.q0, np.zeros(system.nv))
    soles = AdmissibleSet(system, free.constraints.constraints, free.restitution)
    J = soles.active(free.t0, free.q0, _SOLE).jacobian
    # contact forces carry the six directions of the base, motors the rest; feet on a line leave one to neither
    weight += J.T @ np.linalg.lstsq(J[:, :6].T, -weight[:6], rcond=1e-6)[0]
    inertia = 1.0 / np.diag(np.linalg.inv(system.metric(free.q0).dense()))[6:]
    # a light joint has less, so that it does not overshoot within a step
    gains = np.minimum(stiffness, 0.1 * inertia / step**2), np.minimum(damping, 0.3 * inertia / step)
    control = PD(free.q0[7:], -weight[6:], *gains)
    problem = published_robot(name, 0.0, joints=joints, control=control)
    v0 = np.zeros(system.nv)
    v0[0] = _GLIDE
    return problem.at(problem.q0, v0), control
