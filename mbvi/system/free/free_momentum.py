"""Momentum of free bodies across a displacement: kernels that keep it where bodies are moved out of each other.

A displacement at fixed velocities turns angular velocities, which are in the bodies' axes, and moves the arms of linear
momenta. `keep_momentum` undoes both.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..system import Array
from .free_body_table import FreeBodyTable
from .turning import write_rotation
from .world_motion import add_spin, add_velocity, set_spin, set_velocity, write_centre

# pivots below this part of the largest moment of inertia are rounding, as of two balls about the line of their centres
_SINGULAR = 1e-12
# a row is between two bodies if its forces cancel to this part
_CANCELS = 1e-9


@kernel("void(f8[:,::1], f8[::1])")
def solve_symmetric(A: Array, x: Array) -> None:
    """Solve A x = b for a positive semidefinite A of shape (3, 3), where b is in its range.

    x receives a solution in place of b; A is overwritten.
    """
    size, left = max(A[0, 0], A[1, 1], A[2, 2]), np.ones(3, np.bool_)
    order, count = np.zeros(3, np.int64), 0
    for _ in range(3):
        best = -1
        for c in range(3):
            if left[c] and A[c, c] > _SINGULAR * size and (best < 0 or A[c, c] > A[best, best]):
                best = c
        if best < 0:
            break
        left[best], order[count] = False, best
        count += 1
        for c in range(3):
            if left[c]:
                factor = A[c, best] / A[best, best]
                for d in range(3):
                    if left[d]:
                        A[c, d] -= factor * A[best, d]
                x[c] -= factor * x[best]
    for c in range(3):
        if left[c]:
            x[c] = 0.0
    for k in range(count - 1, -1, -1):
        c = order[k]
        for i in range(k + 1, count):
            x[c] -= A[c, order[i]] * x[order[i]]
        x[c] /= A[c, c]


@kernel("i8(i8[::1], i8)")
def root_of(group: Array, b: int) -> int:
    """Return the representative of the group of body b; `group`, shape (n,), leads from each body to another."""
    while group[b] != b:
        group[b] = group[group[b]]
        b = group[b]
    return b


@kernel("void(FreeBodyTable, f8[::1], i4[::1], i4[::1], f8[::1], i8[::1], b1[::1])")
def write_groups(
    bodies: FreeBodyTable, data: Array, columns: Array, starts: Array, place: Array, group: Array, loose: Array
) -> None:
    """Find which bodies rows join, and which of these groups touch nothing else.

    Parameters
    ----------
    bodies : FreeBodyTable
        The bodies.
    data, columns, starts : ndarray
        The gradients of the rows as sparse rows.
    place : ndarray, shape (nq,)
        The configuration in whose axes they are.
    group : ndarray of int, shape (n,)
        Receives a representative of each body's group.
    loose : ndarray of bool, shape (n,)
        Receives of representatives whether their group touches nothing else.
    """
    n = len(group)
    grounded, C = np.zeros(n, np.bool_), np.empty((3, 3))
    for b in range(n):
        group[b] = b
    for a in range(len(starts) - 1):
        first, other, size, total = -1, False, 0.0, np.zeros(3)
        for i in range(starts[a], starts[a + 1]):
            if data[i] != 0.0:
                b = bodies.owner[columns[i]]
                other = other or b < 0
                if b >= 0 and columns[i] < bodies.v[b] + 3:
                    c = columns[i] - bodies.v[b]
                    if bodies.turning[b]:
                        write_rotation(place, bodies.q[b] + 3, C)
                        for d in range(3):
                            total[d] += C[c, d] * data[i]
                    else:
                        total[c] += data[i]
                    size += abs(data[i])
        other = other or abs(total[0]) + abs(total[1]) + abs(total[2]) > _CANCELS * size
        for i in range(starts[a], starts[a + 1]):
            b = bodies.owner[columns[i]]
            if data[i] != 0.0 and b >= 0:
                if first >= 0:
                    group[root_of(group, b)] = root_of(group, first)
                first = b
                grounded[b] = grounded[b] or other
    for b in range(n):
        group[b], loose[b] = root_of(group, b), True
    for b in range(n):
        loose[group[b]] = loose[group[b]] and not grounded[b]


@kernel("void(FreeBodyTable, i8[::1], f8[::1], f8[:,::1])")
def write_centres(bodies: FreeBodyTable, group: Array, q: Array, centre: Array) -> None:
    """Write the centre of mass of each group of bodies at its representative, shape (n, 3)."""
    n = len(group)
    mass, own = np.zeros(n), np.empty(3)
    for b in range(n):
        for c in range(3):
            centre[b, c] = 0.0
    for b in range(n):
        mass[group[b]] += bodies.mass[b]
        write_centre(bodies, b, q, own)
        for c in range(3):
            centre[group[b], c] += bodies.mass[b] * own[c]
    for b in range(n):
        if group[b] == b:
            for c in range(3):
                centre[b, c] /= mass[b]


@kernel("void(FreeBodyTable, i8[::1], f8[:,::1], f8[::1], f8[::1], f8, f8[:,::1])")
def add_angular_momenta(
    bodies: FreeBodyTable, group: Array, centre: Array, q: Array, v: Array, factor: float, momentum: Array
) -> None:
    """Add multiples of the angular momenta of groups about their centres, shape (n, 3); see `write_centres`."""
    own, u = np.empty(3), np.empty(3)
    for b in range(len(group)):
        g, u[0], u[1], u[2] = group[b], 0.0, 0.0, 0.0
        write_centre(bodies, b, q, own)
        add_velocity(bodies, b, q, v, factor * bodies.mass[b], u)
        x, y, z = own[0] - centre[g, 0], own[1] - centre[g, 1], own[2] - centre[g, 2]
        momentum[g, 0] += y * u[2] - z * u[1]
        momentum[g, 1] += z * u[0] - x * u[2]
        momentum[g, 2] += x * u[1] - y * u[0]
        add_spin(bodies, b, q, v, factor, momentum[g])


@kernel("void(FreeBodyTable, i8[::1], f8[:,::1], f8[::1], f8[:,:,::1])")
def write_inertias(bodies: FreeBodyTable, group: Array, centre: Array, q: Array, inertia: Array) -> None:
    """Write the inertia of each group about its centre in the world, shape (n, 3, 3); see `write_centres`."""
    C, arm = np.empty((3, 3)), np.empty(3)
    for b in range(len(group)):
        for c in range(3):
            for d in range(3):
                inertia[b, c, d] = 0.0
    for b in range(len(group)):
        i, own = bodies.q[b], inertia[group[b]]
        write_centre(bodies, b, q, arm)
        for c in range(3):
            arm[c] -= centre[group[b], c]
        square = arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]
        for c in range(3):
            own[c, c] += bodies.mass[b] * square
            for d in range(3):
                own[c, d] -= bodies.mass[b] * arm[c] * arm[d]
        if bodies.turns[b]:
            write_rotation(q, i + 3, C)
            for c in range(3):
                for d in range(3):
                    for k in range(3):
                        for i in range(3):
                            own[c, d] += C[k, c] * bodies.inertia[b, k, i] * C[i, d]


@kernel("void(FreeBodyTable, i8[::1], b1[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], b1)")
def turn_groups(
    bodies: FreeBodyTable, group: Array, loose: Array, centre: Array, turn: Array, q: Array, out: Array, place: bool
) -> None:
    """Turn loose groups about their centres: add to velocities, or to places of centres, what a rotation gives.

    Parameters
    ----------
    bodies, group, loose, centre
        See `write_groups` and `write_centres`.
    turn : ndarray, shape (n, 3)
        Rotation vector of each representative in the world, or its rate [rad, rad/s].
    q : ndarray, shape (nq,)
        Configuration.
    out : ndarray
        Velocities, shape (nv,), or q.
    place : bool
        Whether it is q.
    """
    C, own, u = np.empty((3, 3)), np.empty(3), np.empty(3)
    for b in range(len(group)):
        g, i, j = group[b], bodies.q[b], bodies.v[b]
        if not loose[g]:
            continue
        write_centre(bodies, b, q, own)
        x, y, z, u[0], u[1], u[2] = own[0] - centre[g, 0], own[1] - centre[g, 1], own[2] - centre[g, 2], 0.0, 0.0, 0.0
        turned = turn[g, 1] * z - turn[g, 2] * y, turn[g, 2] * x - turn[g, 0] * z, turn[g, 0] * y - turn[g, 1] * x
        if place:
            for c in range(3):
                out[i + c] += turned[c]
            continue
        add_velocity(bodies, b, q, out, 1.0, u)
        if bodies.turns[b]:
            write_rotation(q, i + 3, C)
            for c in range(3):
                for d in range(3):
                    out[j + 3 + c] += C[c, d] * turn[g, d]
        for c in range(3):
            u[c] += turned[c]
        set_velocity(bodies, b, q, u, out)


@kernel("void(FreeBodyTable, i8[::1], b1[::1], f8[:,::1], f8[::1])")
def put_back_centres(bodies: FreeBodyTable, group: Array, loose: Array, centre: Array, q: Array) -> None:
    """Move loose groups that have links so that their centres of mass are given ones, shape (n, 3).

    A displacement moves the centre of such a link along a screw, and that of its group by its square.
    """
    n = len(group)
    moves, there = np.zeros(n, np.bool_), np.empty((n, 3))
    write_centres(bodies, group, q, there)
    for b in range(n):
        moves[group[b]] = moves[group[b]] or (loose[group[b]] and bodies.turning[b])
    for b in range(n):
        for c in range(3 if moves[group[b]] else 0):
            q[bodies.q[b] + c] += centre[group[b], c] - there[group[b], c]


@kernel("void(FreeBodyTable, f8[::1], i4[::1], i4[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def keep_momentum(
    bodies: FreeBodyTable, data: Array, columns: Array, starts: Array, before: Array, w: Array, place: Array, q: Array,
    v: Array,
) -> None:  # fmt: skip
    """Give free bodies after a displacement the momentum that they had before, and that of impulses at its contacts.

    A group of bodies that touch each other and nothing else keeps its angular momentum. Each of its bodies keeps its
    own about its centre, which the displacement would turn with its axes. What the displacement changed is removed by
    a rotation of the group about its centre, which changes no rate of a gap within it and is the least change of
    velocities in the kinetic metric. Bodies that touch something else keep their velocities, and with these their
    kinetic energy: a turned body cannot keep both.

    Parameters
    ----------
    bodies : FreeBodyTable
        The bodies.
    data, columns, starts : ndarray
        The gradients of the rows as sparse rows.
    before, w : ndarray, shapes (nq,) and (nv,)
        Configuration before the displacement, and the velocity there.
    place : ndarray, shape (nq,)
        The configuration in whose axes the gradients are.
    q : ndarray, shape (nq,)
        Configuration after it. The centres of groups that cannot turn, as of balls without rotations, are moved so that
        the displacement has no rotation about the centre of the group: no velocity would make up for it.
    v : ndarray, shape (nv,)
        The velocity w with the changes by impulses at `place`; receives the velocity at q.
    """
    n = len(bodies.mass)
    group, loose, rigid, centre = np.empty(n, np.int64), np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty((n, 3))
    momentum, moved, inertia, u = np.zeros((n, 3)), np.zeros(len(v)), np.empty((n, 3, 3)), np.empty(3)
    write_groups(bodies, data, columns, starts, place, group, loose)
    for b in range(n):
        spin = np.zeros(3)
        if bodies.turns[b] and loose[group[b]]:
            add_spin(bodies, b, before, w, 1.0, spin)
            add_spin(bodies, b, place, v, 1.0, spin)
            add_spin(bodies, b, place, w, -1.0, spin)
            if bodies.turning[b]:
                u[0] = u[1] = u[2] = 0.0
                add_velocity(bodies, b, before, w, 1.0, u)
                add_velocity(bodies, b, place, v, 1.0, u)
                add_velocity(bodies, b, place, w, -1.0, u)
            set_spin(bodies, b, q, spin, v)
            if bodies.turning[b]:
                set_velocity(bodies, b, q, u, v)
    write_centres(bodies, group, before, centre)
    add_angular_momenta(bodies, group, centre, before, w, 1.0, momentum)
    # groups of which no body turns
    rotation = np.zeros((n, 3))
    for b in range(n):
        rigid[b] = loose[b]
    for b in range(n):
        rigid[group[b]] = rigid[group[b]] and not bodies.turns[b]
        for c in range(0 if bodies.turning[b] else 3):
            moved[bodies.v[b] + c] = before[bodies.q[b] + c] - q[bodies.q[b] + c]
    add_angular_momenta(bodies, group, centre, before, moved, 1.0, rotation)
    write_inertias(bodies, group, centre, before, inertia)
    for b in range(n):
        if group[b] == b:
            solve_symmetric(inertia[b], rotation[b])
    turn_groups(bodies, group, rigid, centre, rotation, before, q, True)
    put_back_centres(bodies, group, loose, centre, q)
    write_centres(bodies, group, q, centre)
    add_angular_momenta(bodies, group, centre, q, v, -1.0, momentum)
    write_inertias(bodies, group, centre, q, inertia)
    for b in range(n):
        if group[b] == b:
            solve_symmetric(inertia[b], momentum[b])
    turn_groups(bodies, group, loose, centre, momentum, q, v, False)


@kernel("void(i4[::1], i4[::1])")
def write_full_rows(columns: Array, starts: Array) -> None:
    """Write the columns of full rows, shape (m n,), and where each row begins, shape (m + 1,), as of sparse rows."""
    m = len(starts) - 1
    n = len(columns) // max(m, 1)
    for i in range(len(columns)):
        columns[i] = i % n
    for a in range(m + 1):
        starts[a] = a * n


@kernel("void(FreeBodyTable, f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def keep_momentum_of_rows(
    bodies: FreeBodyTable, J: Array, before: Array, w: Array, place: Array, q: Array, v: Array
) -> None:
    """Do what `keep_momentum` does, for gradients as full rows, shape (m, nv)."""
    m, n = J.shape
    columns, starts = np.empty(m * n, np.int32), np.empty(m + 1, np.int32)
    write_full_rows(columns, starts)
    keep_momentum(bodies, J.copy().reshape(m * n), columns, starts, before, w, place, q, v)
