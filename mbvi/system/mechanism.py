"""The record of a mechanism: what kernels need in order to call Pinocchio and to use its results."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..compiled import kernel, record
from .memory import Memory, motions_view, vector_view
from .pinocchio_address import array_of_calls, crba
from .spinning import FreeLinks, free_links

Array = np.ndarray


@record(
    "i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[::1], i8[::1],"
    " f8[::1], FreeLinks"
)
class Mechanism(NamedTuple):
    """One model with one `pin.Data`; kept by its arrays, and for one thread at a time.

    Attributes
    ----------
    calls : ndarray of int
        First argument of the kernels of `pinocchio_address`.
    poses, columns, mass : ndarray
        Results of `crba`; see `Memory`.
    support : ndarray, shape (njoints, nv)
        1 where a velocity moves a body, else 0.
    effects : ndarray, shape (nv,)
        Result of `nonlinear_effects`.
    acceleration : ndarray, shape (nv,)
        Result of `aba`, which overwrites the poses and the columns.
    twists, rates : ndarray, shape (njoints, 6)
        Results of `forward_kinematics`: linear, then angular velocity of each joint's frame in this frame, and their
        rates. Other functions overwrite them.
    damping : ndarray, shape (nv,)
        Diagonal of D.
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none.
    placed : ndarray, shape (nq,)
        Where `place` has placed the mechanism; NaN at first.
    free : FreeLinks
        Its links that are free bodies.
    """

    calls: Array
    poses: Array
    columns: Array
    support: Array
    mass: Array
    effects: Array
    acceleration: Array
    twists: Array
    rates: Array
    damping: Array
    parent: Array
    placed: Array
    free: FreeLinks


@kernel("void(Mechanism, f8[::1])")
def place(mechanism: Mechanism, q: Array) -> None:
    """Compute poses, Jacobian columns and mass matrix at q, shape (nq,), unless they are those at q."""
    same = True
    for k in range(len(q)):
        same = same and mechanism.placed[k] == q[k]
    if not same:
        crba(mechanism.calls, q)
        for k in range(len(q)):
            mechanism.placed[k] = q[k]


def free_joint() -> pin.JointModelComposite:
    """Return a joint with the q, v and retraction of a free body: it moves the centre and then turns about it."""
    joint = pin.JointModelComposite()
    joint.addJoint(pin.JointModelTranslation())
    joint.addJoint(pin.JointModelSpherical())
    return joint


def mechanism(model: pin.Model, data: pin.Data, support: Array, parent: Array) -> Mechanism | None:
    """Return the record of a mechanism, or None if results do not lie where they are expected.

    Parameters
    ----------
    model, data : pinocchio.Model, pinocchio.Data
        The mechanism, and what holds the results.
    support, parent : ndarray
        As of `Mechanism`.

    Raises
    ------
    OSError
        If Pinocchio cannot be called by address.
    """
    memory = Memory(model, data)
    effects, acceleration = vector_view(data, lambda: data.nle), vector_view(data, lambda: data.ddq)
    twists, rates = motions_view(data, data.v), motions_view(data, data.a)
    if not memory.in_place or effects is None or acceleration is None or twists is None or rates is None:
        return None
    return Mechanism(
        array_of_calls(model, data), memory.poses, memory.columns, support, memory.mass, effects, acceleration, twists,
        rates, np.array(model.damping, dtype=float), parent, np.full(model.nq, np.nan),
        free_links(model),
    )  # fmt: skip
