"""Adapter to MuJoCo: soft contacts, as stiff as the step allows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import mujoco
import numpy as np

from mbvi.geometry.shapes.shapes import Sphere

from .bodies import Bodies, Poses, rotated
from .rig import Array, Rig, State

NAME = f"MuJoCo {mujoco.__version__}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (mujoco.FatalError, mujoco.UnexpectedError)
_TOLERANCE = 1e-12
_RIGID = (0.9999, 0.9999, 0.001, 0.5, 2.0)
# omega h for 0 < e < 1; stiffer contacts last three steps, and their restitution depends on the phase in the step
_SPRING = 0.2
# omega h for e = 0: damping stops the body, and the spring removes the penetration
_CREEP = 0.02
_PHASES = np.linspace(0.02, 0.98, 49)


class MuJoCo:
    """A rig in MuJoCo."""

    continuous = False

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        text = rig.urdf
        if rig.free:
            # without this joint the root link would be part of the world
            floating = (
                f'<joint name="floating" type="floating"><parent link="world"/><child link="{rig.base}"/></joint>'
            )
            text = text.replace("</robot>", f'<link name="world"/>{floating}</robot>')
        spec = mujoco.MjSpec.from_string(text)
        for geom in spec.geoms:
            geom.contype, geom.conaffinity = 0, 1
        self.model = compiled_model(spec, np.array([0.0, 0.0, -9.81]), rig.planes, e, h)
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in rig.joints]
        self._q = np.array([int(j.qposadr[0]) for j in joints], dtype=int)
        self._v = np.array([int(j.dofadr[0]) for j in joints], dtype=int)
        self._free = rig.free
        self.settings = f"{_settings(e)}, contacts with the planes only"

    def start(self, state: State) -> None:
        """Set the state."""
        mujoco.mj_resetData(self.model, self.data)
        if self._free:
            x, y, z, w = state.quaternion
            self.data.qpos[:7] = *state.position, w, x, y, z
            self.data.qvel[:3] = state.linear
            self.data.qvel[3:6] = _rotated(self.data.qpos[3:7], state.angular, -1.0)
        self.data.qpos[self._q], self.data.qvel[self._v] = state.angles, state.rates

    def advance(self) -> None:
        """Advance by one step."""
        mujoco.mj_step(self.model, self.data)

    def many(self, count: int) -> None:
        """Take several steps in one call."""
        mujoco.mj_step(self.model, self.data, nstep=count)

    def read(self) -> State:
        """Return the state."""
        q, v = self.data.qpos.copy(), self.data.qvel.copy()
        if not self._free:
            still = np.zeros(3)
            return State(still, np.array([0.0, 0.0, 0.0, 1.0]), q[self._q], still, still, v[self._v])
        spin = _rotated(q[3:7], v[3:6], 1.0)
        return State(q[:3], q[[4, 5, 6, 3]], q[self._q], v[:3], spin, v[self._v])


Peer = MuJoCo


class MuJoCoBodies:
    """Free bodies in MuJoCo: balls with three slide joints, other bodies with a free joint."""

    continuous = False

    def __init__(self, model: Bodies, h: float) -> None:
        spec = mujoco.MjSpec()
        box, ball = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
        for body in model.bodies:
            here = spec.worldbody.add_body(mass=body.mass, inertia=body.inertia, explicitinertial=True)
            if body.turns:
                here.add_freejoint()
            else:
                for axis in np.eye(3):
                    here.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
            shape = body.shape
            for place in body.places:
                if isinstance(shape, Sphere):
                    here.add_geom(type=ball, size=[shape.radius, 0, 0], pos=place)
                else:
                    here.add_geom(type=box, size=0.5 * np.array(shape.size), pos=place)
        for solid, centre in model.fixed:
            spec.worldbody.add_geom(type=box, size=0.5 * np.array(solid.size), pos=centre)
        self.model = compiled_model(spec, model.gravity, model.planes, model.e, h)
        self.data = mujoco.MjData(self.model)
        first = self.model.body_jntadr[1:]
        self._q = self.model.jnt_qposadr[first][:, None] + np.arange(3)
        self._v = self.model.jnt_dofadr[first][:, None] + np.arange(3)
        self._turning = np.flatnonzero([body.turns for body in model.bodies])
        self._quaternion = self._q[self._turning, :1] + np.array([4, 5, 6, 3])
        self._spin = self._v[self._turning] + 3
        self._still = np.tile([0.0, 0.0, 0.0, 1.0], (len(model.bodies), 1))
        self.settings = _settings(model.e)

    def start(self, state: Poses) -> None:
        """Set poses and velocities."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self._q], self.data.qvel[self._v] = state.position, state.linear
        turns = state.quaternion[self._turning]
        self.data.qpos[self._quaternion] = turns
        # in the body's own axes
        self.data.qvel[self._spin] = rotated(turns, state.angular[self._turning], -1.0)

    def advance(self) -> None:
        """Advance by one step."""
        mujoco.mj_step(self.model, self.data)

    def read(self) -> Poses:
        """Return poses and velocities."""
        q, v = self.data.qpos, self.data.qvel
        turns, spins = self._still.copy(), np.zeros((len(self._still), 3))
        turns[self._turning] = q[self._quaternion]
        spins[self._turning] = rotated(turns[self._turning], v[self._spin])
        return Poses(q[self._q], turns, v[self._v], spins)


Free = MuJoCoBodies


def compiled_model(
    spec: mujoco.MjSpec, gravity: Array, planes: Sequence[tuple[Array, float]], e: float, h: float
) -> mujoco.MjModel:
    """Return the compiled model, with planes, contacts and options."""
    spec.compiler.balanceinertia = False
    spec.option.timestep, spec.option.gravity = h, gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.tolerance, spec.option.iterations = _TOLERANCE, 100
    # a run that diverges must be visible: no reset, and no log file
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    mujoco.set_mju_user_warning(lambda text: None)
    for normal, offset in planes:
        z = np.zeros(4)
        mujoco.mju_quatZ2Vec(z, normal)
        plane = mujoco.mjtGeom.mjGEOM_PLANE
        spec.worldbody.add_geom(
            type=plane, size=[0, 0, 1], pos=offset * normal, quat=z, contype=1, conaffinity=0, margin=0.0
        )
    for geom in spec.geoms:
        geom.condim, geom.solref, geom.solimp = 1, _solref(e, h), _RIGID
    return spec.compile()


def _settings(e: float) -> str:
    return (
        f"solref {_solref_in_words(e)}, solimp {' '.join(map(str, _RIGID))}, condim 1, Euler, Newton solver with "
        f"tolerance {_TOLERANCE:g}"
    )


def _rotated(quaternion: Array, vector: Array, sense: float) -> Array:
    result, turn = np.zeros(3), quaternion * np.array([1.0, sense, sense, sense])
    mujoco.mju_rotVecQuat(result, np.ascontiguousarray(vector, dtype=float), turn)
    return result


def _stiffness(e: float) -> float:
    """Return omega h: at 1 an elastic impact is exact; with damping a contact needs more steps."""
    return 1.0 if e == 1.0 else _SPRING if e > 0.0 else _CREEP


def _solref_in_words(e: float) -> str:
    k, b = _stiffness(e), _damping(e)
    return f"-({k:g} / h)^2 -{b:.4g} / h, which is omega h = {k:g} with b from e"


def _solref(e: float, h: float) -> tuple[float, float]:
    """Return solref: stiffness, and the damping that gives the restitution e."""
    return -((_stiffness(e) / h) ** 2), -_damping(e) / h


@lru_cache
def _damping(e: float) -> float:
    """Return b h that gives the restitution e in the mean over the phase of the impact in its step."""
    if e == 0.0:
        # removes the whole speed in one step
        return 1.0
    low, high = 0.0, 2.0 * _stiffness(e)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _mean_restitution(middle, _stiffness(e) ** 2) > e else (low, middle)
    return low


def _mean_restitution(b: float, k: float) -> float:
    """Return the mean speed after a contact that begins at speed -1, in steps of MuJoCo's Euler method, h = 1."""
    speeds = []
    for depth in _PHASES:
        r, v = -depth, -1.0
        while r < 0.0:
            # no tension
            impulse = max(-b * v - k * r, 0.0)
            if impulse == 0.0 and v <= 0.0:
                break
            v += impulse
            r += v
        speeds.append(max(v, 0.0))
    return float(np.mean(speeds))
