"""What the percussions of a step with projected positions leave out of the momentum of free bodies.

A step has one normal and one point of each contact: those at its end. The law acts along the normals in the middle, and
to project positions moves bodies. The wrenches here are what is missing, one of each contact: forces that act for the
time of the step and their moments about the origin [N s, N m s], on the body that the normal points to.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel, plain_array
from ...constraints import Rows
from ...constraints.mechanism.tables import RowBuffer
from ...constraints.tangents import along_axes
from ...problem import Problem
from ...system.free.free_body_table import FreeBodyTable
from ...system.free.free_momentum import write_full_rows
from ...system.free.sparse_rows import sparse_parts
from ...system.free.turning import write_rotation
from ...system.free.world_motion import add_spin, add_velocity, write_centre
from ...system.system import Array
from ..kernels.records import MechanismStep
from ..step import Step
from .free_impulses import acts_on_free_bodies


@kernel("void(f8[:,::1], f8[:,::1], f8[:,:,::1], f8[::1], f8[::1], f8[::1], f8, f8[:,::1])")
def add_wrenches(
    point: Array, normal: Array, axes: Array, percussion: Array, slip: Array, turn: Array, factor: float, wrench: Array
) -> None:
    """Add multiples of the wrenches of percussions to others, shape (k, 6).

    Parameters
    ----------
    point, normal, axes : ndarray, shapes (k, 3), (k, 3) and (k, 2, 3)
        Of the contacts; constraints without a normal, which is NaN, have no wrench.
    percussion : ndarray, shape (k,)
        Along the normals.
    slip : ndarray, shape (2 k,) or (0,)
        Along both tangents of each.
    turn : ndarray, shape (3 k,) or (0,)
        About the normal and both tangents of each.
    factor : float
        The multiple.
    """
    force = np.empty(3)
    for a in range(len(percussion)):
        if np.isnan(normal[a, 0]):
            continue
        for c in range(3):
            force[c] = factor * percussion[a] * normal[a, c]
            if len(slip) > 0:
                force[c] += factor * (slip[2 * a] * axes[a, 0, c] + slip[2 * a + 1] * axes[a, 1, c])
            if len(turn) > 0:
                about = turn[3 * a] * normal[a, c] + turn[3 * a + 1] * axes[a, 0, c] + turn[3 * a + 2] * axes[a, 1, c]
                wrench[a, 3 + c] += factor * about
            wrench[a, c] += force[c]
        for c in range(3):
            i, j = (c + 1) % 3, (c + 2) % 3
            wrench[a, 3 + c] += point[a, i] * force[j] - point[a, j] * force[i]


@kernel("void(FreeBodyTable, f8[::1], i4[::1], i4[::1], f8[:,::1], f8[::1], i8[:,::1], f8[:,::1], b1[::1], b1[::1])")
def write_ends(
    bodies: FreeBodyTable, data: Array, columns: Array, starts: Array, normal: Array, place: Array, ends: Array,
    sign: Array, grounded: Array, unknown: Array,
) -> None:  # fmt: skip
    """Write which free bodies each contact acts on, and which way.

    Parameters
    ----------
    bodies : FreeBodyTable
        The bodies.
    data, columns, starts : ndarray
        The gradients of the rows as sparse rows.
    normal : ndarray, shape (k, 3)
        Their normals.
    place : ndarray, shape (nq,)
        The configuration in whose axes the gradients are.
    ends : ndarray of int, shape (k, 2)
        Receives the bodies of each contact, -1 where there is none.
    sign : ndarray, shape (k, 2)
        Receives 1 for a body that the normal points to, and -1 for the other.
    grounded, unknown : ndarray of bool, shape (n,)
        Receive which bodies touch something else, and on which rows act that are no contacts of two bodies.
    """
    C = np.empty((3, 3))
    for a in range(len(starts) - 1):
        other, many = False, np.isnan(normal[a, 0])
        for c in range(2):
            ends[a, c], sign[a, c] = -1, 0.0
        for i in range(starts[a], starts[a + 1]):
            b = bodies.owner[columns[i]]
            if data[i] == 0.0:
                continue
            if b < 0:
                other = True
                continue
            c = 0 if ends[a, 0] < 0 or ends[a, 0] == b else 1
            many = many or (ends[a, c] >= 0 and ends[a, c] != b)
            ends[a, c], axis = b, columns[i] - bodies.v[b]
            if axis < 3:
                if bodies.turning[b]:
                    write_rotation(place, bodies.q[b] + 3, C)
                    for d in range(3):
                        sign[a, c] += C[axis, d] * data[i] * normal[a, d]
                else:
                    sign[a, c] += data[i] * normal[a, axis]
        for i in range(starts[a] if many else starts[a + 1], starts[a + 1]):
            if data[i] != 0.0 and bodies.owner[columns[i]] >= 0:
                unknown[bodies.owner[columns[i]]] = True
        for c in range(2):
            b = ends[a, c]
            sign[a, c] = 1.0 if sign[a, c] > 0.0 else -1.0
            if b >= 0 and (other or ends[a, 1] < 0):
                grounded[b] = True
            ends[a, c] = -1 if many else b


@kernel("void(FreeBodyTable, f8[::1], f8[::1], f8, f8[:,::1])")
def add_momenta(bodies: FreeBodyTable, q: Array, v: Array, factor: float, momentum: Array) -> None:
    """Add multiples of the momenta of bodies, and of the angular ones about the origin, shape (n, 6)."""
    centre, u = np.empty(3), np.empty(3)
    for b in range(len(bodies.mass)):
        u[0] = u[1] = u[2] = 0.0
        write_centre(bodies, b, q, centre)
        add_velocity(bodies, b, q, v, factor * bodies.mass[b], u)
        add_spin(bodies, b, q, v, factor, momentum[b, 3:])
        for c in range(3):
            i, j = (c + 1) % 3, (c + 2) % 3
            momentum[b, c] += u[c]
            momentum[b, 3 + c] += centre[i] * u[j] - centre[j] * u[i]


@kernel(
    "void(FreeBodyTable, f8[::1], i4[::1], i4[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1])"
)
def add_displaced(
    bodies: FreeBodyTable, data: Array, columns: Array, starts: Array, normal: Array, place: Array, before: Array,
    w: Array, q: Array, v: Array, known: Array, wrench: Array,
) -> None:  # fmt: skip
    """Add to the wrenches of contacts what a displacement changes of the momentum of their bodies.

    What it changes of a body is given to one of its contacts, and by that taken from the other body, from the ends of
    chains of bodies on. What remains at their beginning acts on what is fixed; it is zero where nothing is.

    Parameters
    ----------
    bodies, data, columns, starts, normal, place
        See `write_ends`.
    before, w : ndarray, shapes (nq,) and (nv,)
        Configuration and velocity before the displacement.
    q, v : ndarray, shapes (nq,) and (nv,)
        Those after it.
    known : ndarray, shape (k, 6)
        The wrenches that have acted meanwhile.
    wrench : ndarray, shape (k, 6)
        Those that are added to.
    """
    n, k = len(bodies.mass), len(starts) - 1
    ends, sign, order = np.empty((k, 2), np.int64), np.empty((k, 2)), np.empty(n, np.int64)
    grounded, unknown, reached = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    left, by, side, count = np.zeros((n, 6)), np.full(n, -1), np.zeros(n, np.int64), 0
    write_ends(bodies, data, columns, starts, normal, place, ends, sign, grounded, unknown)
    add_momenta(bodies, before, w, -1.0, left)
    add_momenta(bodies, q, v, 1.0, left)
    for a in range(k):
        for c in range(2):
            b = ends[a, c]
            for d in range(6 if b >= 0 else 0):
                left[b, d] -= sign[a, c] * known[a, d]
            if b >= 0 and grounded[b] and not reached[b] and ends[a, 1 - c] < 0:
                reached[b], by[b], side[b], order[count] = True, a, c, b
                count += 1
    root, more = 0, True
    while more:
        more = False
        for a in range(k):
            for c in range(2):
                b, other = ends[a, c], ends[a, 1 - c]
                if b >= 0 and other >= 0 and reached[other] and not reached[b]:
                    reached[b], by[b], side[b], order[count] = True, a, c, b
                    count += 1
                    more = True
        while not more and root < n:
            if not reached[root]:
                reached[root], order[count], more = True, root, True
                count += 1
            root += 1
    for i in range(n - 1, -1, -1):
        b = order[i]
        a = by[b]
        if a < 0 or unknown[b]:
            continue
        parent = ends[a, 1 - side[b]]
        for d in range(6):
            wrench[a, d] += sign[a, side[b]] * left[b, d]
            if parent >= 0:
                left[parent, d] += left[b, d]


@kernel("void(FreeBodyTable, f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def add_displaced_of_rows(
    bodies: FreeBodyTable, J: Array, normal: Array, place: Array, before: Array, w: Array, q: Array, v: Array,
    known: Array, wrench: Array,
) -> None:  # fmt: skip
    """Do what `add_displaced` does, for gradients as full rows, shape (k, nv)."""
    k, n = J.shape
    columns, starts = np.empty(k * n, np.int32), np.empty(k + 1, np.int32)
    write_full_rows(columns, starts)
    add_displaced(bodies, J.copy().reshape(k * n), columns, starts, normal, place, before, w, q, v, known, wrench)


@kernel("void(MechanismStep, RowBuffer, f8[::1], f8[::1], f8[::1], f8, f8[:,::1])")
def add_wrenches_of(
    s: MechanismStep, rows: RowBuffer, percussion: Array, slip: Array, turn: Array, factor: float, wrench: Array
) -> None:  # fmt: skip
    """Do what `add_wrenches` does for the first k rows of a buffer, where `percussion` has shape (k,).

    `slip` and `turn` are as those of the step: what they hold behind the percussions is not used.
    """
    k = len(percussion)
    along = slip[: 2 * k if len(rows.T) > 0 else 0]
    about = turn[: 3 * k if len(rows.R) > 0 else 0]
    add_wrenches(rows.point[:k], rows.normal[:k], rows.axes[:k], percussion, along, about, factor, wrench)


@kernel("void(MechanismStep, RowBuffer, i8[::1], f8[::1], f8[::1], f8[:,::1])")
def correct_turn(s: MechanismStep, there: RowBuffer, order: Array, slip: Array, turn: Array, own: Array) -> None:
    """Write by what the wrenches of the law differ from those that its percussions have at rows of the end.

    Parameters
    ----------
    s : MechanismStep
        With the rows and the percussions of the law; receives the corrections.
    there : RowBuffer
        The rows of the end.
    order : ndarray of int, shape (k,)
        Of each of them that of the law.
    slip, turn : ndarray
        Those of the law along the axes of the rows of the end.
    own : ndarray, shape (k, 6)
        Receives the wrenches there.
    """
    k = len(order)
    law, percussion = np.zeros((k, 6)), np.empty(k)
    add_wrenches_of(s, s.rows, s.rates[:k], s.slip, s.turn, 1.0, law)
    for i in range(k):
        percussion[i] = s.rates[order[i]]
        for c in range(6):
            own[i, c] = 0.0
    add_wrenches_of(s, there, percussion, slip, turn, 1.0, own)
    for i in range(k):
        acts = acts_on_free_bodies(s, there, i)
        for c in range(6):
            s.correction[i, c] = law[order[i], c] - own[i, c] if acts else 0.0


@kernel("void(MechanismStep, f8[::1], f8[:,::1])")
def correct_displaced(s: MechanismStep, q: Array, own: Array) -> None:
    """Add to the corrections what a displacement from the end of a step, `s.q`, to q changes; see `add_displaced`.

    `own`, shape (k, 6), are the wrenches that the percussions of the law have at the rows of the step.
    """
    k, room = len(own), s.room
    for i in range(k):
        for c in range(6):
            own[i, c] = -own[i, c]
    add_wrenches_of(s, s.rows, s.rates[:k], s.slip, s.turn, 1.0, own)
    rows, wrench = s.rows, s.correction[:k]
    add_displaced_of_rows(s.bodies, rows.J[:k], rows.normal[:k], room.end, s.q, room.after, q, s.v, own, wrench)
    s.corrected[0] = k


def with_corrections(problem: Problem, law: Step, before: Step, step: Step, order: Array, place: Array) -> Step:
    """Return a step with what its percussions leave out of the momentum of free bodies.

    Parameters
    ----------
    problem : Problem
        With the free bodies.
    law, before : Step
        The step with the rows of the law, and with the state at its end before positions are projected.
    step : Step
        The step after that.
    order : ndarray of int, shape (k,)
        Of each of its rows that of the law.
    place : ndarray, shape (nq,)
        The configuration in whose axes its gradients are.
    """
    bodies, to_space, k = problem.free_bodies, problem.in_space, len(order)
    if not len(bodies.q):
        return step
    J, w, v = step.active.jacobian, before.v, step.v
    if to_space is not None:
        J, w, v = J @ to_space.T, to_space @ w, to_space @ v
    data, columns, starts = sparse_parts(J)
    percussion, slip = law.percussion[order], None if law.slip is None else law.slip[0, order]
    wrench, turned = wrenches(law.active, order, percussion, slip), slip
    if slip is not None and law.active.tangents is not None and step.active.tangents is not None:
        turned = along_axes(slip, law.active.tangents.axes[order], step.active.tangents.axes)
    every = np.arange(k)
    own = wrenches(step.active, every, percussion, turned)
    known = wrenches(step.active, every, step.percussion, None if step.slip is None else step.slip[0]) - own
    acts = np.zeros(k, bool)
    acts[np.repeat(every, np.diff(starts))[(data != 0.0) & (bodies.owner[columns] >= 0)]] = True
    wrench = np.where(acts[:, None], wrench - own, 0.0)
    normal, places = plain_array(step.active.normal), (plain_array(place), plain_array(before.q))
    states = plain_array(w), plain_array(step.q), plain_array(v)
    add_displaced(bodies, data, columns, starts, normal, *places, *states, known, wrench)
    return step._replace(correction=wrench)


def wrenches(rows: Rows, index: Array, percussion: Array, slip: Array | None) -> Array:
    """Return the wrenches of percussions along some of the rows, shape (k, 6); `slip` is that of `Step`, or None."""
    k, wrench, tangents, none = len(index), np.zeros((len(index), 6)), rows.tangents, np.zeros(0)
    axes = np.zeros((k, 2, 3)) if tangents is None else plain_array(tangents.axes[index])
    along = none if slip is None else slip[:, :2].ravel()
    about = none if slip is None else slip[:, 2:].ravel()
    point, normal = plain_array(rows.point[index]), plain_array(rows.normal[index])
    add_wrenches(point, normal, axes, plain_array(percussion), along, about, 1.0, wrench)
    return wrench
