"""Names what a MJCF holds and mbvi does not model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from .mjcf_file import mujoco_module
from .reductions import Omission

_FREE, _BALL, _SLIDE, _HINGE = range(4)
# most names in one entry
_MOST_NAMED = 8
# what a compiled file counts: the attribute, words for it, why it is left out, and whether MuJoCo's motion needs it
_COUNTED = (
    ("ntendon", "tendons", "not modelled", True),
    ("neq", "equality constraints", "not modelled", True),
    ("nu", "actuators", "give their torques by control", True),
    ("nflex", "flexes", "bodies are rigid", True),
    ("nskin", "skins", "not shown", False),
    ("nplugin", "plugins", "not run", True),
    ("nmocap", "mocap bodies", "they stand still", True),
    ("nsensor", "sensors", "read the run instead", False),
    ("nsite", "sites", "not kept", False),
    ("ncam", "cameras", "not kept", False),
    ("nlight", "lights", "not kept", False),
    ("nkey", "keyframes", "give joints and velocity", False),
)
# MuJoCo's defaults of soft constraints
_SOLREF, _SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
_FLAGS = ("CONTACT", "LIMIT", "GRAVITY", "CONSTRAINT", "DAMPER")


def left_out(m: Any, bodies: Sequence[str]) -> tuple[list[Omission], list[str]]:
    """Return what an MjModel holds that is not modelled, and those parts that change the motion in MuJoCo."""
    omitted, ignored = [], []
    for attribute, words, why, moves in _COUNTED:
        count = int(getattr(m, attribute, 0))
        if count:
            omitted.append(Omission(f"{count} {words}", why))
            if moves:
                ignored.append(f"{count} {words}")
    softened = _softened(m)
    if softened:
        omitted.append(
            Omission(f"softness (solref, solimp) of {softened}", "contacts and limits are rigid; e is given")
        )
    for what, why in (*_of_joints(m), *_of_bodies(m, bodies), *_of_geoms(m), *_of_options(m)):
        omitted.append(Omission(what, why))
        ignored.append(what)
    return omitted, ignored


def _of_joints(m: Any) -> Iterator[tuple[str, str]]:
    names = [m.joint(j).name or f"joint {j}" for j in range(m.njnt)]
    width = {_FREE: 6, _BALL: 3, _SLIDE: 1, _HINGE: 1}
    dofs = [slice(int(d), int(d) + width[int(k)]) for d, k in zip(m.jnt_dofadr, m.jnt_type, strict=True)]

    def where(mask: Any) -> list[str]:
        return [name for name, chosen in zip(names, mask, strict=True) if chosen]

    def rows(values: Any) -> list[bool]:
        return [bool(np.any(values[dof])) for dof in dofs]

    springs = np.array(m.jnt_stiffness) != 0.0
    for extra in ("jnt_stiffnesspoly",):
        if hasattr(m, extra):
            springs = springs | (getattr(m, extra) != 0.0).any(axis=1)
    found = [
        ("springs", where(springs), "add their torques by control"),
        ("dry friction", where(rows(m.dof_frictionloss)), "joints have none"),
        ("limits", where((m.jnt_type == _BALL) & (m.jnt_limited != 0)), "ball joints have none"),
        ("armature", where((m.jnt_type == _FREE) & np.array(rows(m.dof_armature))), "free joints have none"),
    ]
    if hasattr(m, "dof_dampingpoly"):
        found.append(("damping beyond the linear", where(rows(m.dof_dampingpoly)), "damping is linear"))
    for what, named, why in found:
        if named:
            yield f"{what} of {_listed(named)}", why


def _of_bodies(m: Any, bodies: Sequence[str]) -> Iterator[tuple[str, str]]:
    lifted = [bodies[int(k)] for k in np.flatnonzero(m.body_gravcomp)]
    if lifted:
        yield f"gravity compensation of {_listed(lifted)}", "add it by control"


def _of_geoms(m: Any) -> Iterator[tuple[str, str]]:
    touching = (m.geom_contype != 0) | (m.geom_conaffinity != 0)
    for what, values, why in (
        ("margin", m.geom_margin, "contacts close at distance 0"),
        ("torsional and rolling friction", m.geom_condim > 3, "friction is Coulomb's at a point"),
        ("adhesion", getattr(m, "geom_adhesion", np.zeros(m.ngeom)), "contacts only push"),
    ):
        count = int(np.count_nonzero(np.asarray(values).reshape(m.ngeom, -1).any(axis=1) & touching))
        if count:
            yield f"{what} of {count} geoms", why


def _softened(m: Any) -> str:
    """Return how many geoms and joints have other parameters of MuJoCo's soft constraints than its defaults, if any."""
    found = []
    for kind, count in (("geom", m.ngeom), ("jnt", m.njnt)):
        other = np.zeros(count, bool)
        for name, default in (("solref", _SOLREF), ("solimp", _SOLIMP)):
            values = np.asarray(getattr(m, f"{kind}_{name}")).reshape(count, len(default))
            other |= (values != default).any(axis=1)
        if other.any():
            found.append(f"{np.count_nonzero(other)} {'geoms' if kind == 'geom' else 'joints'}")
    return " and ".join(found)


def _of_options(m: Any) -> Iterator[tuple[str, str]]:
    if m.opt.density or m.opt.viscosity or np.any(m.opt.wind):
        yield "air and water (density, viscosity, wind)", "add their forces by add_force"
    bits = mujoco_module().mjtDisableBit
    off = [word.lower() for word in _FLAGS if m.opt.disableflags & int(getattr(bits, f"mjDSBL_{word}", 0))]
    if off:
        yield f"flags that disable {', '.join(off)}", "set the scene instead"


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
