"""Names what a MJCF holds and mbvi does not model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...arguments import listed
from ..reductions import Omission
from .file import disabled, mujoco_module
from .joint_forces import is_linear_spring
from .schema import unknown_parts

_FREE, _BALL, _SLIDE, _HINGE = range(4)
# most names in one entry
_MOST_NAMED = 8
# what a compiled file counts: the attribute, words for it, the kind of its names, why it is left out, and whether
# MuJoCo's motion needs it
_COUNTED = (
    ("nflex", "flexes", "", "bodies are rigid", True),
    ("nskin", "skins", "", "not shown", False),
    ("nplugin", "plugins", "", "not run", True),
    ("nmocap", "mocap bodies", "", "they stand still", True),
    ("nsensor", "sensors", "sensor", "read the run instead", False),
    ("nsite", "sites", "", "not kept", False),
    ("ncam", "cameras", "", "not kept", False),
    ("nlight", "lights", "", "not kept", False),
    ("nkey", "keyframes", "key", "start from one by keyframe", False),
)
# why it is left out
_ROLLING = "taken by add_mjcf(rolling_friction=True)"
# MuJoCo's defaults of soft constraints
_SOLREF, _SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
# flags that are honoured, or that act on nothing that is modelled: others are named
_HONOURED = (
    "CONTACT", "LIMIT", "CONSTRAINT", "DAMPER", "GRAVITY", "FILTERPARENT", "EQUALITY", "SPRING", "CLAMPCTRL",
    "ACTUATION", "FRICTIONLOSS",
)  # fmt: skip
_NO_EFFECT = (
    "PASSIVE", "SENSOR", "WARMSTART", "REFSAFE",
    "MIDPHASE", "NATIVECCD", "MULTICCD", "EULERDAMP", "AUTORESET", "ISLAND",
    "ENERGY", "FWDINV", "INVDISCRETE", "SLEEP", "DIAGEXACT", "IPC", "SPECULATIVE",
)  # fmt: skip


def left_out(m: Any, text: str, bodies: Sequence[str], rolling: bool) -> tuple[list[Omission], list[str]]:
    """Return what an MjModel holds that is not modelled, and those parts that change the motion in MuJoCo.

    `text` is its MJCF as MuJoCo writes it, `bodies` the names of its bodies. `rolling` is whether torsional and rolling
    friction are modelled.
    """
    omitted, ignored = [], []
    for attribute, words, kind, why, moves in _COUNTED:
        count = int(getattr(m, attribute, 0))
        if count:
            names = [getattr(m, kind)(k).name for k in range(count)] if kind else []
            named = f" ({listed(names, _MOST_NAMED)})" if any(names) else ""
            omitted.append(Omission(f"{count} {words}{named}", why))
            if moves:
                ignored.append(f"{count} {words}{named}")
    softened = _softened(m)
    if softened:
        omitted.append(Omission(f"softness (solref, solimp) of {softened}", "they are rigid here; e is given"))
    found = (*_of_joints(m), *_of_bodies(m, bodies), *_of_geoms(m, bodies, rolling), *_of_options(m))
    unknown = ((what, "mbvi does not know it") for what in unknown_parts(text))
    for what, why in (*found, *unknown):
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

    springs = [bool(m.jnt_stiffness[j]) and not is_linear_spring(m, j) for j in range(m.njnt)]
    several = np.array([width[int(k)] > 1 for k in m.jnt_type], dtype=bool)
    found = [
        ("springs", where(springs), "springs are linear, of hinges, slides and balls"),
        ("dry friction", where(np.array(rows(m.dof_frictionloss)) & several), "only hinges and slides have some"),
        ("limits", where((m.jnt_type == _BALL) & (m.jnt_limited != 0)), "ball joints have none"),
        ("margins of limits", where((m.jnt_margin != 0.0) & (m.jnt_limited != 0)), "limits bear at their values"),
        ("armature", where((m.jnt_type == _FREE) & np.array(rows(m.dof_armature))), "free joints have none"),
    ]
    if hasattr(m, "dof_dampingpoly"):
        found.append(("damping beyond the linear", where(rows(m.dof_dampingpoly)), "damping is linear"))
    for what, named, why in found:
        if named:
            yield f"{what} of {listed(named, _MOST_NAMED)}", why


def _of_bodies(m: Any, bodies: Sequence[str]) -> Iterator[tuple[str, str]]:
    lifted = [bodies[int(k)] for k in np.flatnonzero(m.body_gravcomp)]
    if lifted:
        yield f"gravity compensation of {listed(lifted, _MOST_NAMED)}", "add it by control"


def _of_geoms(m: Any, bodies: Sequence[str], rolling: bool) -> Iterator[tuple[str, str]]:
    if disabled(m, "CONTACT", "CONSTRAINT"):
        return
    touching = (m.geom_contype != 0) | (m.geom_conaffinity != 0)
    touching[[*m.pair_geom1.tolist(), *m.pair_geom2.tolist()]] = True
    geoms = [m.geom(g).name or f"a geom of {bodies[int(m.geom_bodyid[g])]}" for g in range(m.ngeom)]
    pairs = [f"pair {geoms[int(a)]} | {geoms[int(b)]}" for a, b in zip(m.pair_geom1, m.pair_geom2, strict=True)]
    slides, rolls = (m.pair_friction[:, k] != m.pair_friction[:, k + 1] for k in (0, 3))
    along = np.array(slides & (m.pair_dim > 1) | rolls & (m.pair_dim > 4) & rolling)
    for what, owners, values, why in (
        ("margin", geoms, m.geom_margin, "contacts close at distance 0"),
        ("gap", geoms, getattr(m, "geom_gap", ()), "contacts bear at distance 0"),
        ("torsional and rolling friction", geoms, () if rolling else m.geom_condim > 3, _ROLLING),
        ("adhesion", geoms, getattr(m, "geom_adhesion", ()), "contacts only push"),
        ("surface velocity (surfacevel)", geoms, getattr(m, "geom_surfacevel", ()), "surfaces move with their bodies"),
        ("margin", pairs, m.pair_margin, "contacts close at distance 0"),
        ("gap", pairs, m.pair_gap, "contacts bear at distance 0"),
        ("torsional and rolling friction", pairs, () if rolling else m.pair_dim > 3, _ROLLING),
        ("friction of two directions", pairs, along, "it is the same in all directions"),
        ("adhesion", pairs, getattr(m, "pair_adhesion", ()), "contacts only push"),
    ):
        each = np.asarray(values)
        if not each.size:
            continue
        there = each.reshape(len(owners), -1).any(axis=1) & (touching if owners is geoms else True)
        named = list(dict.fromkeys(owners[k] for k in np.flatnonzero(there)))
        if named:
            yield f"{what} of {listed(named, _MOST_NAMED)}", why


def _softened(m: Any) -> str:
    """Return how much in a file has other parameters of MuJoCo's soft constraints than its defaults, if anything."""
    found = []
    for kind, words, count in (
        ("geom", "geoms", m.ngeom), ("jnt", "joints", m.njnt), ("pair", "pairs", m.npair), ("eq", "equalities", m.neq)
    ):  # fmt: skip
        other = np.zeros(count, bool)
        for name, default in (("solref", _SOLREF), ("solimp", _SOLIMP)):
            values = np.asarray(getattr(m, f"{kind}_{name}")).reshape(count, len(default))
            other |= (values != default).any(axis=1)
        if other.any():
            found.append(f"{np.count_nonzero(other)} {words}")
    return " and ".join(found)


def _of_options(m: Any) -> Iterator[tuple[str, str]]:
    if m.opt.density or m.opt.viscosity or np.any(m.opt.wind):
        yield "air and water (density, viscosity, wind)", "add their forces by add_force"
    mujoco = mujoco_module()
    for bits, prefix, given in (
        (mujoco.mjtDisableBit, "mjDSBL_", m.opt.disableflags), (mujoco.mjtEnableBit, "mjENBL_", m.opt.enableflags)
    ):  # fmt: skip
        for name, bit in bits.__members__.items():
            flag = name.removeprefix(prefix)
            if name.startswith(prefix) and given & int(bit) and flag not in _HONOURED + _NO_EFFECT:
                yield f"flag {flag.lower()}", "set the scene instead"
