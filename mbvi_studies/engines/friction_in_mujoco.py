"""Scenes with friction in MuJoCo: its pyramidal and elliptic cones, contacts as delivered or stiffer."""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np

from ..chart.friction import Rough
from .rig import State
from .variant import Variant

NAME = f"MuJoCo {mujoco.__version__}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (mujoco.FatalError, mujoco.UnexpectedError)


class RoughInMuJoCo:
    """A scene with friction.

    Parameters
    ----------
    rough : Rough
        The scene.
    h : float
        Time step [s].
    cone : mjtCone
        The cone of friction.
    ratio : float
        impratio: how much stiffer friction is than the normal direction.
    """

    def __init__(self, rough: Rough, h: float, cone: int, ratio: float = 1.0) -> None:
        # without this joint the root link would be part of the world
        floating = f'<joint name="floating" type="floating"><parent link="world"/><child link="{rough.base}"/></joint>'
        spec = mujoco.MjSpec.from_string(rough.urdf.replace("</robot>", f'<link name="world"/>{floating}</robot>'))
        spec.compiler.balanceinertia = False
        option = spec.option
        option.timestep, option.gravity, option.cone, option.impratio = h, rough.gravity, cone, ratio
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        mujoco.set_mju_user_warning(lambda text: None)
        for geom in spec.geoms:
            geom.contype, geom.conaffinity = 0, 1
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=1, conaffinity=0)
        for geom in spec.geoms:
            geom.condim, geom.friction[0] = 3, rough.mu
        self._model = spec.compile()
        self._data, self._rough = mujoco.MjData(self._model), rough
        joints = [self._model.joint(name) for name in rough.joints]
        self._q = np.array([int(j.qposadr[0]) for j in joints], dtype=int)
        self._v = np.array([int(j.dofadr[0]) for j in joints], dtype=int)
        start, data = rough.start, self._data
        data.qpos[:3], data.qpos[3:7], data.qpos[self._q] = start.position, start.quaternion[[3, 0, 1, 2]], start.angles
        # angular velocities are in the body's axes, which are those of the world if it turns
        assert not start.angular.any() or start.quaternion[3] == 1.0
        data.qvel[:3], data.qvel[3:6] = start.linear, start.angular

    def advance(self) -> None:
        """Advance by one step."""
        data = self._data
        if self._rough.stiffness:
            data.qfrc_applied[self._v] = self._rough.torque(data.qpos[self._q], data.qvel[self._v])
        mujoco.mj_step(self._model, data)

    def read(self) -> State:
        """Return the state."""
        q, v = self._data.qpos.copy(), self._data.qvel.copy()
        return State(q[:3], q[[4, 5, 6, 3]], q[self._q], v[:3], v[3:6], v[self._v])


_SETTING = "Newton solver, other options as delivered"
_PYRAMID = partial(RoughInMuJoCo, cone=mujoco.mjtCone.mjCONE_PYRAMIDAL)
_ELLIPSE = partial(RoughInMuJoCo, cone=mujoco.mjtCone.mjCONE_ELLIPTIC)
VARIANTS = (
    Variant(f"{NAME}, pyramidal cone", _SETTING, _PYRAMID),
    Variant(f"{NAME}, elliptic cone", _SETTING, _ELLIPSE),
    Variant(f"{NAME}, elliptic cone, impratio 10", _SETTING, partial(_ELLIPSE, ratio=10.0)),
)
