"""The record of a mechanism: what kernels need in order to call Pinocchio and to use its results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...compiled import kernel, record
from ...projection.tree_factor import DEPENDENT, factor_mass, least_change, span_equalities
from ..free.coasting import coast
from ..free.spinning import FreeLinks
from .by_address.memory import results_in_place
from .by_address.pinocchio_address import array_of_calls, crba, nonlinear_effects, retract
from .equalities import FIRST_FINDS, FOUND, Equalities, Equality, equalities_of, write_gaps, write_rows
from .joint_tree import JointTree, place_joints, weigh_joints, with_own_results, write_effects

Array = np.ndarray

# most iterations that close equalities, and the part of the gaps above which one counts as slow
_MOST_CLOSING, _SLOW = 50, 1e-3
# most times that a displacement is halved
_MOST_HALVINGS = 10
# relative gaps of equalities below this count as closed, and those that no longer fall below so many times of it
_CLOSED, _ROUNDING = 1e-14, 30.0
# part of a row, over the relative gap, that others must leave of it, and the largest such part
_NEARLY, _MOST_NEARLY = 30.0, 0.03


@record(
    "i8[::1], JointTree, f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[::1],"
    " FreeLinks, Equalities"
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
    mass : ndarray, shape (nv + m, nv)
        M in its lower triangle, where `weigh` was called last, then the rows of the m equalities.
    effects : ndarray, shape (nv,)
        Nonlinear effects, as `evaluate_nonlinear_effects` has computed them.
    damping, friction : ndarray, shape (nv,)
        Diagonal of D, and the largest torques of dry friction [N, N m].
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none.
    placed : ndarray, shape (nq,)
        Where `place` has placed the mechanism; NaN at first.
    free : FreeLinks
        Its links that are free bodies.
    equalities : Equalities
        The equalities c(q) = 0.
    """

    calls: Array
    tree: JointTree
    poses: Array
    columns: Array
    support: Array
    mass: Array
    effects: Array
    damping: Array
    friction: Array
    parent: Array
    placed: Array
    free: FreeLinks
    equalities: Equalities


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
    """Place a mechanism at q, shape (nq,), and compute its mass matrix and the rows of its equalities there."""
    place(mechanism, q)
    if len(mechanism.tree.kind):
        weigh_joints(mechanism.tree)
    e, mass = mechanism.equalities, mechanism.mass
    if len(e.gap) > 0:
        for i in range(len(e.found)):
            for j in range(i + 1):
                mass[i, j] = e.found[i, j]
        write_rows(e, mechanism.poses, mechanism.columns, mechanism.support, mass)


@kernel("void(Mechanism, f8[::1], f8[::1])")
def evaluate_nonlinear_effects(mechanism: Mechanism, q: Array, v: Array) -> None:
    """Compute the nonlinear effects at v, shape (nv,), and at q, where the mechanism was weighed last."""
    if len(mechanism.tree.kind):
        write_effects(mechanism.tree, v)
    else:
        nonlinear_effects(mechanism.calls, q, v)


@kernel("void(Mechanism, f8[::1], f8[::1], f8[::1])")
def carry(mechanism: Mechanism, q: Array, dv: Array, new: Array) -> None:
    """Write q + dv along the retraction to `new`, shapes (nq,), (nv,), (nq,), and close the equalities there."""
    retract(mechanism.calls, q, dv, new)
    if len(mechanism.equalities.gap) > 0:
        close(mechanism, new)


@kernel("void(Mechanism, f8[::1], f8[::1], f8, f8[::1], f8[::1], f8[::1])")
def glide(mechanism: Mechanism, q: Array, v: Array, h: float, displacement: Array, new: Array, after: Array) -> None:
    """Move from q along v for a time on which nothing acts; see `coast`, and `carry` for the configuration `new`."""
    coast(mechanism.free, h, v, displacement, after)
    carry(mechanism, q, displacement, new)


@kernel("void(f8[:,::1], f8[:,::1])")
def copy_matrix(matrix: Array, to: Array) -> None:
    """Copy a matrix to one of the same shape."""
    for i in range(len(matrix)):
        for j in range(matrix.shape[1]):
            to[i, j] = matrix[i, j]


@kernel("void(Mechanism, f8[::1])")
def close(mechanism: Mechanism, q: Array) -> None:
    """Move q, shape (nq,), to where the equalities hold, by the least displacements; to NaN where none is found.

    Newton's method in the kinetic metric: each displacement d is the least |d|_M with J_e d = -c(q). M and J_e are
    evaluated again where the gaps have not fallen fast. Of closings that share them, the first evaluates them for all.
    The mass matrix of the mechanism stays as it was.
    """
    m, e = mechanism, mechanism.equalities
    place(m, q)
    largest, slow, weighed = write_gaps(e, m.poses, q), e.shared[0] != FOUND, False
    for _ in range(_MOST_CLOSING):
        # written so that a NaN goes on
        if largest <= _CLOSED:
            break
        if slow:
            if not weighed:
                copy_matrix(m.mass, e.kept)
                weighed = True
            weigh(m, q)
            if factor_mass(m.mass, 0.0, m.damping, m.parent, e.L):
                break
            # rows depend on each other where the equalities hold, and nearly so nearby
            least = max(DEPENDENT, min(_NEARLY * largest, _MOST_NEARLY))
            span_equalities(m.mass, m.parent, least, e.L, e.R)
            if e.shared[0] == FIRST_FINDS:
                e.shared[0] = FOUND
        least_change(e.L, m.parent, e.R, e.gap, e.moved)
        before = largest
        for k in range(len(q)):
            e.place[k] = q[k]
        # far from where they hold, a whole displacement may open them further
        for _ in range(_MOST_HALVINGS):
            retract(m.calls, e.place, e.moved, q)
            place(m, q)
            largest = write_gaps(e, m.poses, q)
            if largest < before or before <= _ROUNDING * _CLOSED:
                break
            for k in range(len(e.moved)):
                e.moved[k] *= 0.5
        slow = not largest < _SLOW * before
        if largest > 0.1 * before and largest <= _ROUNDING * _CLOSED:
            break
    if weighed:
        copy_matrix(e.kept, m.mass)
    if not largest <= _ROUNDING * _CLOSED:
        for k in range(len(q)):
            q[k] = np.nan


def dry_friction(model: pin.Model) -> Array:
    """Return the largest torques of the dry friction of a model's joints, shape (nv,) [N, N m]."""
    return np.array(model.upperDryFrictionLimit, dtype=float)


def free_joint() -> pin.JointModelComposite:
    """Return a joint with the q, v and retraction of a free body: it moves the centre and then turns about it."""
    joint = pin.JointModelComposite()
    joint.addJoint(pin.JointModelTranslation())
    joint.addJoint(pin.JointModelSpherical())
    return joint


def mechanism(
    model: pin.Model, data: pin.Data, support: Array, tree: JointTree, free: FreeLinks,
    rows: Sequence[Equality] = (),
) -> Mechanism | None:  # fmt: skip
    """Return the record of a mechanism, or None if results do not lie where they are expected.

    Parameters
    ----------
    model, data : pinocchio.Model, pinocchio.Data
        The mechanism, and what holds Pinocchio's results.
    support, free : ndarray and FreeLinks
        See `Mechanism`.
    tree : JointTree
        See `joint_tree`; the record has results of its own, and room.
    rows : sequence of PointRows or CoupledJoints
        Its equalities.

    Raises
    ------
    OSError
        If Pinocchio cannot be called by address.
    """
    free = free._replace(state=free.state.copy(), room=free.room.copy(), turn=free.turn.copy())
    calls, tree = array_of_calls(model, data), with_own_results(tree)
    damping, friction = np.array(model.damping, dtype=float), dry_friction(model)
    found = None
    if len(tree.kind):
        poses, columns, mass, effects = tree.poses, tree.columns, tree.mass, tree.effects
    else:
        results = results_in_place(model, data)
        if results is None:
            return None
        poses, columns, mass, effects = results
        found = mass
    equalities = equalities_of(rows, model.nq, model.nv, found)
    if len(equalities.gap):
        mass = np.zeros(equalities.L.shape)
        if len(tree.kind):
            tree = tree._replace(mass=mass[: model.nv])
    return Mechanism(
        calls, tree, poses, columns, support, mass, effects, damping, friction, tree.carrier,
        np.full(model.nq, np.nan), free, equalities,
    )  # fmt: skip
