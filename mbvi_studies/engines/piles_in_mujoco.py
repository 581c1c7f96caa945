"""Piles in MuJoCo, by its conjugate gradients, with contacts as delivered or as stiff as the step permits."""

from __future__ import annotations

import mujoco
import numpy as np

from mbvi.geometry.shapes.shapes import Box, Capsule, Sphere

from ..chart.errors import Array
from ..chart.piles import Pile, PilePoses
from .variant import Variant

# memory of the largest pile [bytes]
_MEMORY = 8 << 30
NAME = f"MuJoCo {mujoco.__version__}"


def variants(pile: Pile) -> tuple[Variant[Pile, PilePoses], ...]:
    """Return how MuJoCo is set: contacts as stiff as its documentation permits, 2 h, and as delivered."""
    setting = "CG solver, condim 1, with friction condim 3 and the elliptic cone, other options as delivered"
    return (
        Variant(f"{NAME}, solref 2 h", setting, lambda pile, h: PileInMuJoCo(pile, h, 2.0 * h)),
        Variant(f"{NAME}, solref 0.02 s", setting, PileInMuJoCo),
    )


class PileInMuJoCo:
    """A pile: without friction spheres on three slide joints each, other bodies free.

    Parameters
    ----------
    pile : Pile
        The pile.
    h : float
        Time step [s].
    time_constant : float, optional
        Of contacts [s]; by default as delivered.
    """

    def __init__(self, pile: Pile, h: float, time_constant: float | None = None) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.solver = h, mujoco.mjtSolver.mjSOL_CG
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.memory = _MEMORY
        for normal, offset in pile.planes:
            turn = np.zeros(4)
            mujoco.mju_quatZ2Vec(turn, normal)
            kind = mujoco.mjtGeom.mjGEOM_PLANE
            spec.worldbody.add_geom(type=kind, pos=offset * normal, size=[0, 0, 1], quat=turn)
        for shape, centre, turn in zip(pile.shapes, pile.centres, pile.turns, strict=True):
            _add(spec, shape, centre, turn, bool(pile.mu))
        for geom in spec.geoms:
            geom.condim, geom.friction[0] = 3 if pile.mu else 1, pile.mu
            if time_constant is not None:
                geom.solref = [time_constant, 1.0]
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._turning, self._start = pile.turning, pile.centres[pile.turning :]
        self._still = pile.turns[pile.turning :]

    def advance(self) -> None:
        """Advance by one step."""
        mujoco.mj_step(self._model, self._data)

    def read(self) -> PilePoses:
        """Return the poses of all bodies."""
        poses = self._data.qpos[: 7 * self._turning].reshape(-1, 7)
        moved = self._data.qpos[7 * self._turning :].reshape(-1, 3)
        turns = poses[:, [4, 5, 6, 3]]
        return np.concatenate([poses[:, :3], self._start + moved]), np.concatenate([turns, self._still])


def _add(spec: mujoco.MjSpec, shape: Box | Capsule | Sphere, centre: Array, turn: Array, rough: bool) -> None:
    kinds = mujoco.mjtGeom
    if isinstance(shape, Sphere) and not rough:
        # without rotation, which would turn the axes of its joints
        body = spec.worldbody.add_body(pos=centre)
        for axis in np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        body.add_geom(type=kinds.mjGEOM_SPHERE, size=[shape.radius, 0, 0], mass=1.0)
        return
    body = spec.worldbody.add_body(pos=centre, quat=turn[[3, 0, 1, 2]])
    body.add_freejoint()
    if isinstance(shape, Sphere):
        body.add_geom(type=kinds.mjGEOM_SPHERE, size=[shape.radius, 0, 0], mass=1.0)
    elif isinstance(shape, Box):
        body.add_geom(type=kinds.mjGEOM_BOX, size=0.5 * np.array(shape.size), mass=1.0)
    else:
        body.add_geom(type=kinds.mjGEOM_CAPSULE, size=[shape.radius, 0.5 * shape.length, 0], mass=1.0)
