"""What the coordinates of a model move: which velocities carry others, are lengths or turn, and how far they reach."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .joint_tree import FLIES, FREE, MOVES, PLANAR, SLIDES, kind_of

Array = np.ndarray

# reach of velocities without a known bound; its square is finite, so that products with a zero velocity are no NaN
_UNBOUNDED = 1e150

# of each velocity of a joint its place in the vector that it is a component of
_VECTORS: dict[int | None, list[int]] = {
    FREE: [0, 1, 2, 0, 1, 2], FLIES: [0, 1, 2, 0, 1, 2], MOVES: [0, 1, 2], PLANAR: [0, 1, 0],
}  # fmt: skip

# joints whose armature Pinocchio 4.1 adds to the mass matrix and not to the kinetic energy
_ARMATURE_LEFT_OUT = ("JointModelRevoluteUnaligned",)


def carriers(model: pin.Model) -> Array:
    """Return the velocity that carries each one, shape (nv,) of int; -1 where there is none."""
    carrier, last = np.arange(-1, model.nv - 1), [-1]
    joints = zip(model.parents.tolist()[1:], model.idx_vs.tolist()[1:], model.nvs.tolist()[1:], strict=True)
    for parent, first, count in joints:
        # joints without velocities carry what their parents carry
        last.append(first + count - 1 if count else last[parent])
        carrier[first : first + min(count, 1)] = last[parent]
    return carrier


def straight_velocities(model: pin.Model) -> Array:
    """Return which velocities move bodies along directions that never turn, shape (nv,) of bool."""
    found, turned = np.zeros(model.nv, bool), [False]
    for joint, parent in zip(list(model.joints)[1:], model.parents.tolist()[1:], strict=True):
        kind, first = kind_of(joint), joint.idx_v
        if not turned[parent] and kind in (SLIDES, MOVES, FLIES):
            found[first : first + (1 if kind == SLIDES else 3)] = True
        turned.append(turned[parent] or kind not in (SLIDES, MOVES))
    return found


def first_components(model: pin.Model) -> Array:
    """Return the first component of the vector that each velocity is one of, shape (nv,) of int; see `parts`."""
    found = np.arange(model.nv)
    for joint in list(model.joints)[1:]:
        within = _VECTORS.get(kind_of(joint), [])
        found[joint.idx_v : joint.idx_v + len(within)] -= np.array(within, dtype=int)
    return found


def supports(model: pin.Model) -> Array:
    """Return 1 where a velocity moves a joint's body and 0 elsewhere, shape (njoints, nv)."""
    found = np.zeros((model.njoints, model.nv))
    for joint in range(1, model.njoints):
        for ancestor in list(model.supports[joint])[1:]:
            first = model.idx_vs[ancestor]
            found[joint, first : first + model.nvs[ancestor]] = 1.0
    return found


def lengths(model: pin.Model) -> Array:
    """Return which velocities only shift bodies, shape (nv,) of bool."""
    found, neutral = np.zeros(model.nv, bool), pin.neutral(model)
    for joint in list(model.joints)[1:]:
        # a screw joint turns as well
        data = joint.createData()
        joint.calc(data, neutral)
        turns = np.abs(np.asarray(data.S).reshape(6, -1)[3:]).max(axis=0) > 0.0
        found[joint.idx_v : joint.idx_v + joint.nv] = ~turns
    return found


def uncounted_armature(model: pin.Model) -> Array:
    """Return the armature of each velocity that Pinocchio leaves out of the kinetic energy, shape (nv,)."""
    found: Array = np.array(model.armature, dtype=float)
    for joint in list(model.joints)[1:]:
        if joint.shortname() not in _ARMATURE_LEFT_OUT:
            found[joint.idx_v : joint.idx_v + joint.nv] = 0.0
    return found


def reach(model: pin.Model, body: int, centre: Array, radius: float) -> Array:
    """Return the reach of a ball fixed to a body; see `System.reach`."""
    found = np.zeros(model.nv)
    distance = radius + float(np.linalg.norm(centre))
    for joint in reversed(list(model.supports[body])[1:]):
        first, width = model.idx_vs[joint], model.nvs[joint]
        found[first : first + width], travel = _joint_reach(model, joint, distance)
        distance += travel + float(np.linalg.norm(model.jointPlacements[joint].translation))
    return np.minimum(found, _UNBOUNDED)


def _joint_reach(model: pin.Model, joint: int, distance: float) -> tuple[Array, float]:
    """Return the reach of a joint's velocities, and the largest displacement of its frame by its own travel."""
    kind = model.joints[joint].shortname()
    width = model.nvs[joint]
    if "FreeFlyer" in kind:
        return np.array([1.0] * 3 + [distance] * 3), 0.0
    if "Planar" in kind:
        return np.array([1.0, 1.0, distance]), 0.0
    if "JointModelR" in kind or "Spherical" in kind:
        return np.full(width, distance), 0.0
    if "JointModelP" in kind and width == 1:
        first = model.idx_qs[joint]
        limits = np.abs([model.lowerPositionLimit[first], model.upperPositionLimit[first]])
        # a tenth more for penetration of the limit within a step
        return np.ones(1), 1.1 * float(limits.max()) if limits.max() < 1e10 else _UNBOUNDED
    return np.full(width, _UNBOUNDED), 0.0


def unit_groups(model: pin.Model) -> list[Array]:
    """Return where unit vectors lie in q; see `System.unit_groups`."""
    groups = []
    for joint in range(1, model.njoints):
        nq, nv, end = model.nqs[joint], model.nvs[joint], model.idx_qs[joint] + model.nqs[joint]
        # a free base, a base in a plane (cosine and sine), a joint without limits
        width = {(7, 6): 4, (4, 3): 2, (2, 1): 2}.get((nq, nv))
        if model.joints[joint].shortname() == "JointModelSpherical":
            width = 4
        if width is not None:
            groups.append(np.arange(end - width, end)[None, :])
    return groups
