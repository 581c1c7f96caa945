"""The derivative of an elastic bounce in MuJoCo: the product of the derivatives of its steps."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ..chart.gradients import DURATION, GRAVITY, HEIGHT, RADIUS, GradientRecord
from .in_mujoco import NAME, compiled_model

# omega h: a contact lasts 15 steps, and is stiffer at shorter ones
_SPRING = 0.2
# of the differences by which MuJoCo differentiates a step
_EPSILON = 1e-7


def measure(steps: Sequence[float]) -> list[GradientRecord]:
    """Return the records of MuJoCo at these steps [s]."""
    return [_bounce(h) for h in steps]


def _bounce(h: float) -> GradientRecord:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(mass=1.0, inertia=[0.4 * RADIUS**2] * 3, explicitinertial=True)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0])
    model = compiled_model(spec, np.array([0.0, 0.0, -GRAVITY]), [(np.array([0.0, 0.0, 1.0]), 0.0)], 1.0, h)
    model.geom_solref[:] = -((_SPRING / h) ** 2), 0.0
    data = mujoco.MjData(model)
    data.qpos[0] = HEIGHT
    product, step = np.eye(2), np.zeros((2, 2))
    for _ in range(round(DURATION / h)):
        mujoco.mjd_transitionFD(model, data, _EPSILON, True, step, None, None, None)
        product = step @ product
        mujoco.mj_step(model, data)
    setting = f"solref -({_SPRING:g} / h)^2 0, Euler, centered differences of {_EPSILON:g}"
    return GradientRecord(f"{NAME}, mjd_transitionFD", h, float(data.qpos[0]), float(product[0, 0]), setting)
