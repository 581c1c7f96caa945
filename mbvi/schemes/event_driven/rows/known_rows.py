"""Gaps, gradients and (dJ/dt) v of the rows of one mechanism, several rows by one call of a kernel."""

from __future__ import annotations

import numpy as np

from ....compiled import held, kernel, plain_array
from ....constraints.features.feature_kernels import touch
from ....constraints.mechanism.held_rows import (
    LIMIT,
    UNKNOWN,
    RowParts,
    RowRoom,
    evaluate_row,
    row_room,
    unknown_parts,
    write_gaps_of,
    write_row,
    write_slip,
)
from ....system import System
from ....system.mechanisms.articulated import ArticulatedSystem
from ....system.mechanisms.joined import can_be_joined, joined
from ....system.mechanisms.mechanism import Mechanism, evaluate_nonlinear_effects, place, weigh
from ....system.parts import parts_of
from ....system.system import Array


@kernel("void(Mechanism, RowParts, i8[::1], f8[::1], f8[::1])")
def gaps_at(m: Mechanism, rows: RowParts, index: Array, q: Array, gap: Array) -> None:
    """Write the gaps of some of the rows at q, shape (k,)."""
    place(m, q)
    write_gaps_of(m, rows, index, q, gap)


@kernel("void(Mechanism, RowParts, RowRoom, i8[::1], f8[::1], f8[:,::1])")
def gradients_at(m: Mechanism, rows: RowParts, room: RowRoom, index: Array, q: Array, J: Array) -> None:
    """Write the gradients of some of the rows at q, shape (k, nv)."""
    place(m, q)
    for i in range(len(index)):
        r = index[i]
        evaluate_row(m, rows.kind[r], rows.sides[r], rows.parts[r], rows.radius[r], q, room, J[i])


@kernel("void(Mechanism, RowParts, RowRoom, i8[::1], f8[::1], f8[::1], f8[:,::1], f8[::1])")
def biases_at(
    m: Mechanism, rows: RowParts, room: RowRoom, index: Array, q: Array, v: Array, J: Array, bias: Array
) -> None:  # fmt: skip
    """Write gradients and (dJ/dt) v of some of the rows at q and v, shapes (k, nv) and (k,)."""
    weigh(m, q)
    evaluate_nonlinear_effects(m, q, v)
    for i in range(len(index)):
        r = index[i]
        bias[i] = write_row(m, rows.kind[r], rows.sides[r], rows.parts[r], rows.radius[r], room, J[i])


@kernel("void(Mechanism, RowParts, RowRoom, i8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def points_at(m: Mechanism, rows: RowParts, room: RowRoom, index: Array, q: Array, point: Array, normal: Array) -> None:
    """Write contact points and normals of some of the rows at q, shapes (k, 3); NaN of limits of joints."""
    place(m, q)
    for i in range(len(index)):
        r = index[i]
        if rows.kind[r] == LIMIT:
            for c in range(3):
                point[i, c] = normal[i, c] = np.nan
            continue
        places = m.poses[rows.sides[r, 0]], m.poses[rows.sides[r, 1]]
        touch(rows.kind[r], rows.parts[r], rows.radius[r], places[0], places[1], room.along, point[i], normal[i])
        for c in range(3):
            point[i, c] += rows.shift[r] * normal[i, c]


@kernel(
    "void(Mechanism, RowParts, RowRoom, i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,:,::1], f8[:,::1],"
    " f8[:,:,::1])"
)
def slips_at(
    m: Mechanism, rows: RowParts, room: RowRoom, index: Array, mu: Array, q: Array, v: Array, J: Array, T: Array,
    bias: Array, axes: Array,
) -> None:  # fmt: skip
    """Write tangents T, (dT/dt) v and axes of some of the rows at q and v; 0 where mu is 0.

    Their shapes are (k, 2, nv), (k, 2) and (k, 2, 3). `J`, shape (nv,), is room.
    """
    weigh(m, q)
    evaluate_nonlinear_effects(m, q, v)
    for i in range(len(index)):
        r = index[i]
        if mu[i] > 0.0 and rows.kind[r] != LIMIT:
            write_row(m, rows.kind[r], rows.sides[r], rows.parts[r], rows.radius[r], room, J)
            write_slip(m, rows.kind[r], rows.sides[r], rows.radius[r], rows.shift[r], room, T[i], bias[i])
            for c in range(2):
                for k in range(3):
                    axes[i, c, k] = room.axes[c, k]
        else:
            for c in range(2):
                bias[i, c] = 0.0
                for k in range(len(J)):
                    T[i, c, k] = 0.0
                for k in range(3):
                    axes[i, c, k] = 0.0


class KnownRows:
    """The rows of one mechanism that kernels know.

    Parameters
    ----------
    system : ArticulatedSystem
        The mechanism.
    mechanism : Mechanism
        A record of its own.
    parts : RowParts
        What all rows are.

    Attributes
    ----------
    system
        The same.
    mechanism, parts
        The same, as `held` returns them.
    room : RowRoom
        Room.
    known : ndarray of bool, shape (m,)
        Which rows kernels know.
    """

    def __init__(self, system: ArticulatedSystem, mechanism: Mechanism, parts: RowParts) -> None:
        self.system, self.mechanism, self._nv = system, held(mechanism), len(mechanism.parent)
        self.room, self._all = held(row_room()), unknown_parts(0)
        self.add(parts)

    def add(self, parts: RowParts) -> None:
        """Add rows behind the others."""
        parts = self._all = RowParts(*map(np.concatenate, zip(self._all, parts, strict=True)))
        self.parts, self.known = held(parts), parts.kind != UNKNOWN

    def parts_of(self, index: Array) -> RowParts:
        """Return what some rows are."""
        return RowParts(*(column[index] for column in self._all))

    def gaps(self, q: Array, index: Array) -> Array:
        """Return the gaps of some rows at q, shape (k,)."""
        gap = np.empty(len(index))
        gaps_at(self.mechanism, self.parts, index, plain_array(q), gap)
        return gap

    def gradients(self, q: Array, index: Array) -> Array:
        """Return the gradients of some rows at q, shape (k, nv)."""
        J = np.empty((len(index), self._nv))
        gradients_at(self.mechanism, self.parts, self.room, index, plain_array(q), J)
        return J

    def points(self, q: Array, index: Array) -> tuple[Array, Array]:
        """Return contact points and normals of some rows at q, shapes (k, 3); NaN where a row is no contact."""
        point, normal = np.empty((2, len(index), 3))
        points_at(self.mechanism, self.parts, self.room, index, plain_array(q), point, normal)
        return point, normal

    def slips(self, q: Array, v: Array, index: Array, mu: Array) -> tuple[Array, Array, Array]:
        """Return tangents T, (dT/dt) v and axes of some rows at q and v; 0 where mu is 0.

        Their shapes are (k, 2, nv), (k, 2) and (k, 2, 3).
        """
        T, bias, axes = (np.empty((len(index), 2, *last)) for last in ((self._nv,), (), (3,)))
        room = np.empty(self._nv)
        state = plain_array(q), plain_array(v)
        slips_at(self.mechanism, self.parts, self.room, index, mu, *state, room, T, bias, axes)
        return T, bias, axes

    def biases(self, q: Array, v: Array, index: Array) -> Array:
        """Return (dJ/dt) v of some rows at q and v, shape (k,)."""
        J, bias = np.empty((len(index), self._nv)), np.empty(len(index))
        biases_at(self.mechanism, self.parts, self.room, index, plain_array(q), plain_array(v), J, bias)
        return bias


def known_rows(system: System, parts: RowParts) -> KnownRows | None:
    """Return the rows of a system that moves as one mechanism of usual joints without equalities, else None.

    Controls, springs and forces from outside may act on a single mechanism. Several mechanisms or free bodies on which
    any of these act have no such rows.
    """
    whole = system
    if not isinstance(system, ArticulatedSystem):
        acted = (part.controlled or getattr(part, "springs", None) for part in parts_of(system))
        if system.whole is not None or system.controlled or system.loaded or any(acted) or not can_be_joined(system):
            return None
        whole = joined(system)
    if not isinstance(whole, ArticulatedSystem) or whole.equalities:
        return None
    mechanism = whole.mechanism()
    return None if mechanism is None or not len(mechanism.tree.kind) else KnownRows(whole, mechanism, parts)
