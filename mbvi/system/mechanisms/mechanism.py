"""The record of a mechanism: what kernels need in order to call Pinocchio and to use its results."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...compiled import kernel, record
from ..free.spinning import FreeLinks
from .joint_tree import JointTree, place_joints, weigh_joints, with_own_results, write_effects
from .memory import results_in_place
from .pinocchio_address import array_of_calls, crba, nonlinear_effects

Array = np.ndarray


@record(
    "i8[::1], JointTree, f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], i8[::1], f8[::1], FreeLinks"
)
class Mechanism(NamedTuple):
    """One model with one `pin.Data`; kept by its arrays, and for one thread at a time.

    Attributes
    ----------
    calls : ndarray of int
        First argument of the kernels of `pinocchio_address`.
    tree : JointTree
        Computes the following; of no joints where Pinocchio does.
    poses : ndarray, shape (njoints, 4, 3)
        Of each joint's frame in the world the three columns of the rotation, then the origin [m].
    columns : ndarray, shape (nv, 6)
        Row k is the Jacobian column of velocity k: velocity of the world's origin, then angular velocity.
    support : ndarray, shape (njoints, nv)
        1 where a velocity moves a body, else 0.
    mass : ndarray, shape (nv, nv)
        M in its lower triangle, where `weigh` was called last.
    effects : ndarray, shape (nv,)
        Nonlinear effects, as `evaluate_nonlinear_effects` has computed them.
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
    tree: JointTree
    poses: Array
    columns: Array
    support: Array
    mass: Array
    effects: Array
    damping: Array
    parent: Array
    placed: Array
    free: FreeLinks


@kernel("void(Mechanism, f8[::1])")
def place(mechanism: Mechanism, q: Array) -> None:
    """Compute poses and Jacobian columns at q, shape (nq,), unless they are those at q."""
    same = True
    for k in range(len(q)):
        same = same and mechanism.placed[k] == q[k]
    if not same:
        if len(mechanism.tree.kind):
            place_joints(mechanism.tree, q)
        else:
            crba(mechanism.calls, q)
        for k in range(len(q)):
            mechanism.placed[k] = q[k]


@kernel("void(Mechanism, f8[::1])")
def weigh(mechanism: Mechanism, q: Array) -> None:
    """Place a mechanism at q, shape (nq,), and compute its mass matrix there."""
    place(mechanism, q)
    if len(mechanism.tree.kind):
        weigh_joints(mechanism.tree)


@kernel("void(Mechanism, f8[::1], f8[::1])")
def evaluate_nonlinear_effects(mechanism: Mechanism, q: Array, v: Array) -> None:
    """Compute the nonlinear effects at v, shape (nv,), and at q, where the mechanism was weighed last."""
    if len(mechanism.tree.kind):
        write_effects(mechanism.tree, v)
    else:
        nonlinear_effects(mechanism.calls, q, v)


def free_joint() -> pin.JointModelComposite:
    """Return a joint with the q, v and retraction of a free body: it moves the centre and then turns about it."""
    joint = pin.JointModelComposite()
    joint.addJoint(pin.JointModelTranslation())
    joint.addJoint(pin.JointModelSpherical())
    return joint


def mechanism(model: pin.Model, data: pin.Data, support: Array, tree: JointTree, free: FreeLinks) -> Mechanism | None:
    """Return the record of a mechanism, or None if results do not lie where they are expected.

    Parameters
    ----------
    model, data : pinocchio.Model, pinocchio.Data
        The mechanism, and what holds Pinocchio's results.
    support, free : ndarray and FreeLinks
        See `Mechanism`.
    tree : JointTree
        See `joint_tree`; the record has results of its own, and room.

    Raises
    ------
    OSError
        If Pinocchio cannot be called by address.
    """
    free = free._replace(state=free.state.copy(), room=free.room.copy())
    calls, tree, damping = array_of_calls(model, data), with_own_results(tree), np.array(model.damping, dtype=float)
    if len(tree.kind):
        poses, columns, mass, effects = tree.poses, tree.columns, tree.mass, tree.effects
    else:
        found = results_in_place(model, data)
        if found is None:
            return None
        poses, columns, mass, effects = found
    return Mechanism(
        calls, tree, poses, columns, support, mass, effects, damping, tree.carrier, np.full(model.nq, np.nan),
        free,
    )  # fmt: skip
