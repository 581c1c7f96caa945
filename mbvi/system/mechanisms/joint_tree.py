"""Poses, Jacobian columns, mass matrix and nonlinear effects of a tree of joints, in kernels.

Usual joints are few kinds, each of which is a few lines here; Pinocchio, which knows every kind, takes twice to four
times as long. All sums are about the origin of each base, so that they are as exact far from the world's origin.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...compiled import kernel, record
from .frames import cross_product, turn_about, turn_by, turned

Array = np.ndarray

# kinds of joints: one axis, along which a body slides or about which it turns, by an angle or by its cosine and sine; a
# ball joint; a point that moves along its parent's axes; a body that moves so and turns as in a ball joint; a free base
# and a planar one, whose velocities are along their own axes
SLIDES, TURNS, WINDS, ROLLS, MOVES, FLIES, FREE, PLANAR = range(8)
KINDS = {
    "JointModelPX": SLIDES, "JointModelPY": SLIDES, "JointModelPZ": SLIDES, "JointModelPrismaticUnaligned": SLIDES,
    "JointModelRX": TURNS, "JointModelRY": TURNS, "JointModelRZ": TURNS, "JointModelRevoluteUnaligned": TURNS,
    "JointModelRUBX": WINDS, "JointModelRUBY": WINDS, "JointModelRUBZ": WINDS,
    "JointModelRevoluteUnboundedUnaligned": WINDS, "JointModelTranslation": MOVES, "JointModelSpherical": ROLLS,
    "JointModelFreeFlyer": FREE, "JointModelPlanar": PLANAR,
}  # fmt: skip


@record(
    "i8[::1], i8[::1], i8[::1], i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], i8[::1], f8[:,:,::1],"
    " f8[:,::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1],"
    " f8[:,::1]"
)
class JointTree(NamedTuple):
    """The joints of a model, and room for results; for one thread at a time. Joint 0 is the world.

    Attributes
    ----------
    kind, parent : ndarray of int, shape (n,)
        Kind of each joint, and the joint that carries it.
    first_q, first_v : ndarray of int, shapes (n,) and (n + 1,)
        Where the coordinates of each joint begin.
    fixed : ndarray, shape (n, 4, 3)
        Placement in the parent's frame, as `poses`.
    axis : ndarray, shape (n, 3)
        Axis of the joints that have one, in their frame.
    body : ndarray, shape (n, 10)
        Of the joint's body mass [kg], centre of mass [m], and the entries xx, xy, xz, yy, yz, zz of the inertia about
        it [kg m^2], in the joint's frame.
    gravity, armature : ndarray, shapes (3,) and (nv,)
        As of the model.
    carrier : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none.
    poses, columns, mass, effects : ndarray
        The results; see `Mechanism`.
    base, arm : ndarray, shape (n, 3)
        Origin of the base of each joint, and where the joint is from there, in the world's axes [m].
    motion : ndarray, shape (nv, 6)
        The Jacobian columns with the velocity of the base's origin.
    inertia, whole : ndarray, shape (n, 10)
        Mass, mass times position, and inertia of each body about the base's origin, in the world's axes; the same of
        each body with all that it carries.
    twist, rate, force : ndarray, shape (n, 6)
        Spatial velocities, accelerations without those of the joints, and forces, about the base's origin.
    """

    kind: Array
    parent: Array
    first_q: Array
    first_v: Array
    fixed: Array
    axis: Array
    body: Array
    gravity: Array
    armature: Array
    carrier: Array
    poses: Array
    columns: Array
    mass: Array
    effects: Array
    base: Array
    arm: Array
    motion: Array
    inertia: Array
    whole: Array
    twist: Array
    rate: Array
    force: Array


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], f8, f8, f8, b1)")
def write_column(
    motion: Array, column: Array, arm: Array, origin: Array, x: float, y: float, z: float, turns: bool
) -> None:  # fmt: skip
    """Write a row of `motion` and one of `columns` for a joint that slides along (x, y, z) or turns about it.

    `arm` and `origin`, shape (3,), lead to the joint from its base and from the world's origin.
    """
    if turns:
        motion[0], motion[1], motion[2] = cross_product(arm[0], arm[1], arm[2], x, y, z)
        column[0], column[1], column[2] = cross_product(origin[0], origin[1], origin[2], x, y, z)
        motion[3], motion[4], motion[5], column[3], column[4], column[5] = x, y, z, x, y, z
    else:
        motion[0], motion[1], motion[2], column[0], column[1], column[2] = x, y, z, x, y, z
        motion[3] = motion[4] = motion[5] = column[3] = column[4] = column[5] = 0.0


@kernel("void(JointTree, Array(f8, 1, 'C', True))")
def place_joints(tree: JointTree, q: Array) -> None:
    """Compute poses and Jacobian columns at q, shape (nq,)."""
    # what a record has is read again after every write
    kinds, parents, first_q, first_v, placements, axes = (
        tree.kind, tree.parent, tree.first_q, tree.first_v, tree.fixed, tree.axis,
    )  # fmt: skip
    poses, arms, bases, motion, columns = tree.poses, tree.arm, tree.base, tree.motion, tree.columns
    for i in range(1, len(kinds)):
        p, kind, j, k = parents[i], kinds[i], first_q[i], first_v[i]
        above, fixed, pose, axis, arm, base = poses[p], placements[i], poses[i], axes[i], arms[i], bases[i]
        for r in range(3):
            pose[r, 0], pose[r, 1], pose[r, 2] = turned(above, fixed[r, 0], fixed[r, 1], fixed[r, 2])
        x, y, z = turned(above, fixed[3, 0], fixed[3, 1], fixed[3, 2])
        a = b = c = 0.0
        if kind == SLIDES:
            a, b, c = turned(pose, q[j] * axis[0], q[j] * axis[1], q[j] * axis[2])
        elif kind >= MOVES:
            a, b, c = turned(pose, q[j], q[j + 1], q[j + 2] if kind != PLANAR else 0.0)
        x, y, z = x + a, y + b, z + c
        if p:
            arm[0], arm[1], arm[2] = arms[p, 0] + x, arms[p, 1] + y, arms[p, 2] + z
            base[0], base[1], base[2] = bases[p, 0], bases[p, 1], bases[p, 2]
        else:
            base[0], base[1], base[2] = x, y, z
        pose[3, 0], pose[3, 1], pose[3, 2] = base[0] + arm[0], base[1] + arm[1], base[2] + arm[2]
        if kind <= WINDS:
            a, b, c = turned(pose, axis[0], axis[1], axis[2])
            write_column(motion[k], columns[k], arm, pose[3], a, b, c, kind != SLIDES)
            if kind == TURNS:
                turn_about(pose, axis, np.sin(q[j]), np.cos(q[j]))
            elif kind == WINDS:
                turn_about(pose, axis, q[j + 1], q[j])
            continue
        if kind == FREE:
            turn_by(pose, q[j + 3], q[j + 4], q[j + 5], q[j + 6])
        elif kind == PLANAR:
            turn_about(pose, axis, q[j + 3], q[j + 2])
        moves, turns = 0 if kind == ROLLS else 2 if kind == PLANAR else 3, 1 if kind == PLANAR else 3
        for r in range(moves):
            write_column(motion[k], columns[k], arm, pose[3], pose[r, 0], pose[r, 1], pose[r, 2], False)
            k += 1
        if kind == ROLLS or kind == FLIES:
            turn_by(pose, q[j + moves], q[j + moves + 1], q[j + moves + 2], q[j + moves + 3])
        for r in range(3 - turns, 3 if kind != MOVES else 0):
            write_column(motion[k], columns[k], arm, pose[3], pose[r, 0], pose[r, 1], pose[r, 2], True)
            k += 1


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1])")
def write_inertia(pose: Array, arm: Array, body: Array, inertia: Array) -> None:
    """Write mass, mass times position and inertia of a body about its base's origin; see `JointTree`."""
    mass = body[0]
    x, y, z = turned(pose, body[1], body[2], body[3])
    x, y, z = x + arm[0], y + arm[1], z + arm[2]
    # R I: the inertia's rows are its columns
    a, b, c = turned(pose, body[4], body[5], body[6])
    d, e, f = turned(pose, body[5], body[7], body[8])
    g, h, k = turned(pose, body[6], body[8], body[9])
    P = pose
    inertia[0], inertia[1], inertia[2], inertia[3] = mass, mass * x, mass * y, mass * z
    inertia[4] = a * P[0, 0] + d * P[1, 0] + g * P[2, 0] + mass * (y * y + z * z)
    inertia[5] = a * P[0, 1] + d * P[1, 1] + g * P[2, 1] - mass * x * y
    inertia[6] = a * P[0, 2] + d * P[1, 2] + g * P[2, 2] - mass * x * z
    inertia[7] = b * P[0, 1] + e * P[1, 1] + h * P[2, 1] + mass * (x * x + z * z)
    inertia[8] = b * P[0, 2] + e * P[1, 2] + h * P[2, 2] - mass * y * z
    inertia[9] = c * P[0, 2] + f * P[1, 2] + k * P[2, 2] + mass * (x * x + y * y)


@kernel("UniTuple(f8, 6)(f8[::1], f8, f8, f8, f8, f8, f8)")
def momentum(
    inertia: Array, u: float, v: float, w: float, x: float, y: float, z: float
) -> tuple[float, float, float, float, float, float]:
    """Return the momentum of a body that moves with (u, v, w) and turns with (x, y, z): linear, then angular."""
    m, a, b, c = inertia[0], inertia[1], inertia[2], inertia[3]
    d, e, f = cross_product(x, y, z, a, b, c)
    g, h, k = cross_product(a, b, c, u, v, w)
    return (
        m * u + d, m * v + e, m * w + f,
        inertia[4] * x + inertia[5] * y + inertia[6] * z + g,
        inertia[5] * x + inertia[7] * y + inertia[8] * z + h,
        inertia[6] * x + inertia[8] * y + inertia[9] * z + k,
    )  # fmt: skip


@kernel("void(JointTree)")
def weigh_joints(tree: JointTree) -> None:
    """Compute the inertias, and the lower triangle of the mass matrix, where the joints are placed.

    Notes
    -----
    The composite-rigid-body algorithm: R. Featherstone, Rigid Body Dynamics Algorithms (2008), table 6.2.
    """
    n, parents, first_v, carrier, armature = len(tree.kind), tree.parent, tree.first_v, tree.carrier, tree.armature
    poses, arms, bodies, inertia, whole = tree.poses, tree.arm, tree.body, tree.inertia, tree.whole
    motion, mass = tree.motion, tree.mass
    for i in range(1, n):
        write_inertia(poses[i], arms[i], bodies[i], inertia[i])
        for r in range(10):
            whole[i, r] = inertia[i, r]
    for i in range(n - 1, 0, -1):
        p = parents[i]
        for k in range(first_v[i], first_v[i + 1]):
            a, b, c, d, e, f = momentum(
                whole[i], motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3], motion[k, 4], motion[k, 5]
            )  # fmt: skip
            j = k
            while j >= 0:
                s = motion[j]
                mass[k, j] = a * s[0] + b * s[1] + c * s[2] + d * s[3] + e * s[4] + f * s[5]
                j = carrier[j]
            mass[k, k] += armature[k]
        if p:
            for r in range(10):
                whole[p, r] += whole[i, r]


@kernel("void(JointTree, Array(f8, 1, 'C', True))")
def write_effects(tree: JointTree, v: Array) -> None:
    """Compute the nonlinear effects at v, shape (nv,), where the joints are placed and weighed.

    Notes
    -----
    The recursive Newton-Euler algorithm without accelerations of joints: Featherstone (2008), table 5.1.
    """
    n, kinds, parents, first_v, motion = len(tree.kind), tree.kind, tree.parent, tree.first_v, tree.motion
    inertia, twist, rate, force, effects = tree.inertia, tree.twist, tree.rate, tree.force, tree.effects
    for r in range(3):
        rate[0, r] = -tree.gravity[r]
    for i in range(1, n):
        V, A, k = twist[parents[i]], rate[parents[i]], first_v[i]
        u = w = z = a = b = c = d = e = f = 0.0
        for j in range(k, first_v[i + 1]):
            if j == k + 3 and kinds[i] == FLIES:
                # the point moves before the body turns
                d, e, f = u, w, z
            s, speed = motion[j], v[j]
            u, w, z = u + speed * s[0], w + speed * s[1], z + speed * s[2]
            a, b, c = a + speed * s[3], b + speed * s[4], c + speed * s[5]
        # V x of what the joint adds
        x0, x1, x2 = cross_product(V[3], V[4], V[5], u, w, z)
        y0, y1, y2 = cross_product(V[0] + d, V[1] + e, V[2] + f, a, b, c)
        z0, z1, z2 = cross_product(V[3], V[4], V[5], a, b, c)
        d, e, f, x0, x1, x2 = A[0] + x0 + y0, A[1] + x1 + y1, A[2] + x2 + y2, A[3] + z0, A[4] + z1, A[5] + z2
        u, w, z, a, b, c = V[0] + u, V[1] + w, V[2] + z, V[3] + a, V[4] + b, V[5] + c
        V, A, g, body = twist[i], rate[i], force[i], inertia[i]
        V[0], V[1], V[2], V[3], V[4], V[5] = u, w, z, a, b, c
        A[0], A[1], A[2], A[3], A[4], A[5] = d, e, f, x0, x1, x2
        # I A + V x I V
        g[0], g[1], g[2], g[3], g[4], g[5] = momentum(body, d, e, f, x0, x1, x2)
        d, e, f, y0, y1, y2 = momentum(body, u, w, z, a, b, c)
        x0, x1, x2 = cross_product(a, b, c, d, e, f)
        z0, z1, z2 = cross_product(u, w, z, d, e, f)
        y0, y1, y2 = cross_product(a, b, c, y0, y1, y2)
        g[0], g[1], g[2] = g[0] + x0, g[1] + x1, g[2] + x2
        g[3], g[4], g[5] = g[3] + y0 + z0, g[4] + y1 + z1, g[5] + y2 + z2
    for i in range(n - 1, 0, -1):
        p, g = parents[i], force[i]
        for k in range(first_v[i], first_v[i + 1]):
            s = motion[k]
            effects[k] = s[0] * g[0] + s[1] * g[1] + s[2] * g[2] + s[3] * g[3] + s[4] * g[4] + s[5] * g[5]
        if p:
            for r in range(6):
                force[p, r] += g[r]


def joint_tree(model: pin.Model, carrier: Array) -> JointTree:
    """Return the joints of a model; none, and no room, if one of them is of another kind.

    Parameters
    ----------
    model : pinocchio.Model
        The mechanism.
    carrier : ndarray of int, shape (nv,)
        See `JointTree`.
    """
    joints, nv = list(model.joints)[1:], model.nv
    kinds = [kind_of(joint) for joint in joints]
    if None in kinds:
        joints, kinds, nv = [], [], 0
    n = len(joints) + 1 if joints else 0
    fixed, axis, body = np.zeros((n, 4, 3)), np.zeros((n, 3)), np.zeros((n, 10))
    neutral, poses = pin.neutral(model), np.zeros((n, 4, 3))
    poses[:1, :3] = np.eye(3)
    for i, (joint, kind) in enumerate(zip(joints, kinds, strict=True), 1):
        place, inertia = model.jointPlacements[i], model.inertias[i]
        fixed[i, :3], fixed[i, 3] = place.rotation.T, place.translation
        body[i] = inertia.mass, *inertia.lever, *inertia.inertia[np.triu_indices(3)]
        if kind == PLANAR:
            axis[i, 2] = 1.0
        elif kind is not None and kind <= WINDS:
            data = joint.createData()
            joint.calc(data, neutral)
            axis[i] = np.asarray(data.S).reshape(2, 3)[0 if kind == SLIDES else 1]
    numbers: list[Array] = [
        np.array(each, dtype=np.int64)
        for each in (
            [0, *kinds][:n], list(model.parents)[:n], list(model.idx_qs)[:n], [*list(model.idx_vs)[:n], nv][: n + 1],
        )
    ]  # fmt: skip
    results: Any = poses, np.zeros((nv, 6)), np.zeros((nv, nv)), np.zeros(nv), *np.zeros((2, n, 3)), np.zeros((nv, 6))
    fields: Any = *numbers, fixed, axis, body, np.array(model.gravity.linear), np.array(model.armature, dtype=float)
    every: Any = *fields, carrier, *results, *np.zeros((2, n, 10)), *np.zeros((3, n, 6))
    return JointTree(*every)


def with_own_results(tree: JointTree) -> JointTree:
    """Return the same joints with room of their own."""
    first = JointTree._fields.index("poses")
    return JointTree(*tree[:first], *(room.copy() for room in tree[first:]))


def kind_of(joint: pin.JointModel) -> int | None:
    """Return the kind of a joint, or None if it is another one."""
    name = joint.shortname()
    if name != "JointModelComposite":
        return KINDS.get(name)
    parts = joint.extract()
    names = [part.shortname() for part in parts.joints]
    moved = any(not place.isIdentity(0.0) for place in parts.jointPlacements)
    return FLIES if names == ["JointModelTranslation", "JointModelSpherical"] and not moved else None
