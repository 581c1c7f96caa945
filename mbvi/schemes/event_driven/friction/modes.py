"""Modes of closed contacts with friction, stick or slip, and the accelerations and forces within a mode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....system.system import Array
from ..rows.contact_rows import SmoothRows
from ..rows.row_sets import members
from ..runge_kutta import DEPENDENT, ContactEquations, Flow, RungeKuttaStep, least_percussion

# slip that counts as none, relative to the sum of its terms: more than their rounding
STILL = 1e-12
# effect of forces that dependent contacts may share at will on an acceleration, relative to that of all of them, above
# which the acceleration is not determined
_AMBIGUOUS = 1e-7
# a slip begins in a step in which it grows by more than the inverse of this; where the dense output is checked, and the
# weight of what it misses in other steps
_BEGINS, _CHECKED, _USUAL = 0.1, (0.3, 0.7, 0.95), 0.01


class ModeForces(NamedTuple):
    """Accelerations and contact forces within a mode.

    Attributes
    ----------
    acceleration : ndarray, shape (nv,)
        dv/dt.
    normal, tangential : ndarray, shapes (k,) and (k, 2)
        Contact forces [N, N m].
    unique : bool
        Whether the acceleration is unique.
    determined : bool
        Whether it is, or equally compliant contacts have one.
    """

    acceleration: Array
    normal: Array
    tangential: Array
    unique: bool
    determined: bool


class ModeEquations(NamedTuple):
    """What decides on the accelerations of k closed contacts with friction.

    Attributes
    ----------
    normals : ContactEquations
        Those without friction.
    T : ndarray, shape (k, 2, nv)
        Gradients of the tangents; zero rows where mu = 0.
    mu : ndarray, shape (k,)
        Coefficients of friction.
    slip : ndarray, shape (k, 2)
        T v [m/s].
    still : ndarray, shape (k,)
        Size of a slip that counts as none [m/s].
    along : ndarray, shape (k, 2)
        The values of T a that keep the slip constant.
    axes : ndarray, shape (k, 2, 3)
        The tangents in the world.
    """

    normals: ContactEquations
    T: Array
    mu: Array
    slip: Array
    still: Array
    along: Array
    axes: Array

    def forces(self, sticks: Array, way: Array) -> ModeForces:
        """Return accelerations and forces where some contacts stick and others slip in a direction, shape (k, 2).

        Closed contacts have J a = wanted, those that stick also T a = along, and those that slip the force
        -mu N way along their tangents. Where contacts depend on each other and slip in different directions, how they
        share their load decides on accelerations: forces are then those of equally compliant contacts.
        """
        free, metric, J, wanted, _ = self.normals
        k, slips = len(J), ~sticks & (self.mu > 0.0)
        kept, forced, held = rows_of_modes(J, self.T, self.mu, sticks, way)
        response = metric.solve_rows(forced)
        missing = np.concatenate([wanted, self.along[held]]) - kept @ free
        G, unique, determined = kept @ response.T, True, True
        if slips.any():
            f, _, rank, _ = np.linalg.lstsq(G, missing, rcond=DEPENDENT)
            if rank < len(f):
                _, _, axes = np.linalg.svd(G)
                # forces that move no closed contact must move nothing
                size = np.sqrt(np.maximum(np.einsum("ij,ij->i", response, forced), 0.0))
                loose = np.abs(np.einsum("ij,kj->ik", axes[rank:] @ response, forced))
                unique = bool((loose <= _AMBIGUOUS * size.max() * size).all())
                if not unique:
                    f, determined = self._compliant(G, missing, kept, held)
        else:
            f = least_percussion(G, missing)
        tangential = -(self.mu * f[:k])[:, None] * np.where(slips[:, None], way, 0.0)
        tangential[held] = f[k:]
        return ModeForces(free + f @ response, f[:k], tangential, unique, determined)

    def _compliant(self, G: Array, missing: Array, kept: Array, held: Array) -> tuple[Array, bool]:
        """Return the forces with G f = missing of equally compliant contacts, and whether there are such.

        They are the limit of those of `coulomb_law`: in units in which normals have unit length in the kinetic metric,
        no part of the forces is one that leaves all rows `kept` at rest.
        """
        metric, J = self.normals.metric, self.normals.J
        length = np.sqrt(np.einsum("ij,ij->i", metric.solve_rows(J), J))
        length = np.concatenate([length, np.repeat(length, 2)[held.ravel()]])
        axes, sizes, _ = np.linalg.svd(kept / length[:, None])
        loose = (axes[:, np.count_nonzero(sizes > DEPENDENT * sizes[0]) :] * length[:, None]).T
        if not len(loose):
            return np.linalg.lstsq(G, missing, rcond=DEPENDENT)[0], False
        loose *= np.abs(G).max() / np.abs(loose).max()
        targets = np.concatenate([missing, np.zeros(len(loose))])
        f, _, rank, _ = np.linalg.lstsq(np.concatenate([G, loose]), targets, rcond=DEPENDENT)
        return f, bool(rank == len(f))

    def turned(self, sticks: Array, way: Array, found: ModeForces) -> Array:
        """Return what unit turns of directions of slip change accelerations by, shape (k, nv).

        Rows are zero where contacts stick.
        """
        _, metric, J, _, _ = self.normals
        push = -np.where(sticks, 0.0, self.mu * found.normal)[:, None] * np.vecmat(aside(way), self.T)
        kept, forced, held = rows_of_modes(J, self.T, self.mu, sticks, way)
        alone, response = metric.solve_rows(push), metric.solve_rows(forced)
        G, missing = kept @ response.T, -kept @ alone.T
        if found.unique:
            f = np.linalg.lstsq(G, missing, rcond=DEPENDENT)[0]
        else:
            f = np.array([self._compliant(G, one, kept, held)[0] for one in missing.T]).T
        return np.asarray(alone + f.T @ response)


def aside(way: Array) -> Array:
    """Return directions turned by a quarter, shape (..., 2)."""
    return np.stack([-way[..., 1], way[..., 0]], axis=-1)


def rows_of_modes(J: Array, T: Array, mu: Array, sticks: Array, way: Array) -> tuple[Array, Array, Array]:
    """Return the rows that modes keep at a rate, those along which contacts push, and which tangents stick, (k, 2).

    The first two have the same shape: gradients of the k rows, then the tangents of those that stick. A contact that
    slips pushes along its gradient less mu times the direction of slip.
    """
    slips = ~sticks & (mu > 0.0)
    held = sticks[:, None] & T.any(axis=2)
    kept = np.concatenate([J, T[held]])
    forced = kept.copy()
    forced[: len(J)][slips] -= np.einsum("k,ki,kij->kj", mu[slips], way[slips], T[slips])
    return kept, forced, held


class ContactModes:
    """Which closed contacts stick, and in which direction the others slip.

    Parameters
    ----------
    flow : Flow
        The smooth motion.
    rows : SmoothRows
        The rows of all constraints.
    slow : float
        Slip that counts as none [m/s].
    faint : float
        Slip across the direction at the start of a step that does not turn it [m/s]. The turning of a body that slips
        slowly is damped so fast that rounding in it would grow, and contacts of one body slip in different directions.

    Attributes
    ----------
    system : System
        What moves.
    index : ndarray of int, shape (k,)
        The closed rows.
    sticks : ndarray of bool, shape (k,)
        Which of them stick.
    way : ndarray, shape (k, 3)
        Of the others the direction of slip at the start of the step: a unit vector in the world, because tangents turn
        about the normal as that turns, and even jump.
    stopped : int
        The closed row whose slip vanishes at the end of the last step, as an index of `index`; -1 if none does.
    undecided : bool
        Whether no mode could be found for the present contacts.
    begins : bool
        Whether a contact began to slip at the last event.
    start : tuple or None
        Equations and forces at the start of a step; None where nothing is closed.
    """

    def __init__(self, flow: Flow, rows: SmoothRows, slow: float, faint: float = 0.0) -> None:
        self._flow, self._rows, self._slow, self._faint, self.system = flow, rows, slow, faint, flow.system
        self.stopped, self.undecided, self.begins = -1, False, False
        self.start: tuple[ModeEquations, ModeForces] | None = None
        self.choose(np.zeros(0, np.int64), np.zeros(0, bool), np.zeros((0, 3)))

    def choose(self, index: Array, sticks: Array, way: Array) -> None:
        """Set the modes of closed rows."""
        self.index, self.sticks, self.way = index, sticks, way

    def equations(self, t: float, q: Array, v: Array, closed: Array) -> ModeEquations:
        """Return what decides on the accelerations of closed rows."""
        normals = self._flow.contact_equations(t, q, v, closed)
        T, bias, axes, mu = self._rows.slips(t, q, v, closed)
        still = STILL * (np.abs(T) @ np.abs(v)).sum(axis=1) + self._slow
        return ModeEquations(normals, T, mu, T @ v, still, -bias, axes)

    def directions(self, equations: ModeEquations) -> Array:
        """Return the directions of slip, shape (k, 2): those at the start of the step, turned with the slip.

        Beyond a stop they are those before it, so that the motion can be followed smoothly to the stop.
        """
        size, kept = np.linalg.norm(equations.slip, axis=1), self.kept_way(equations)
        moves = self._turns(equations, size, kept)
        way = np.where(moves[:, None], equations.slip / np.where(moves, size, 1.0)[:, None], kept)
        return np.where((np.vecdot(way, kept) < 0.0)[:, None], -way, way)

    def kept_way(self, equations: ModeEquations) -> Array:
        """Return the directions at the start of the step along the present tangents, shape (k, 2)."""
        kept = np.matvec(equations.axes, self.way)
        size = np.linalg.norm(kept, axis=1, keepdims=True)
        return kept / np.where(size > 0.0, size, 1.0)

    def _turns(self, equations: ModeEquations, size: Array, kept: Array) -> Array:
        """Return which slips, of sizes of shape (k,), have directions of their own, and not those that are kept."""
        along = np.vecdot(equations.slip, kept)[:, None] * kept
        return (size > equations.still) & (np.linalg.norm(equations.slip - along, axis=1) > self._faint)

    def forces(self, t: float, q: Array, v: Array, closed: Array) -> tuple[ModeEquations, ModeForces]:
        """Return the equations of closed rows in their modes, with accelerations and forces."""
        equations = self.equations(t, q, v, closed)
        if len(closed) != len(self.index) or (closed != self.index).any():
            # contacts that have come apart are closed no more
            kept = members(self.index, closed)
            self.choose(self.index[kept], self.sticks[kept], self.way[kept])
        return equations, equations.forces(self.sticks, self.directions(equations))

    def acceleration(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return dv/dt in the present modes, followed by dv/dt without contact forces."""
        equations, found = self.forces(t, q, v, closed)
        return np.concatenate([found.acceleration, equations.normals.free])

    def slip_and_rate(self, closed: Array, t: float, q: Array, v: Array) -> tuple[float, float, float]:
        """Return the slip of the row that stops, along its direction, the rate of that, and its rounding."""
        equations, found = self.forces(t, q, v, closed)
        k = self.stopped
        way = self.kept_way(equations)[k]
        rate = way @ (equations.T[k] @ found.acceleration - equations.along[k])
        return float(way @ equations.slip[k]), float(rate), float(equations.still[k])

    def defect(self, step: RungeKuttaStep, closed: Array, share: float, units: Array) -> float:
        """Return by how much the dense output up to a share of a step misses accelerations, if contacts slip.

        In units and a second, over the largest speed in these where that is above 1. Where a slip is small the force
        turns fast with it, which errors of the state at the end of the step do not tell. Where no slip begins or stops
        a small weight does: the turning of a body that slips is damped fast, and rounding in it may grow within a step.
        """
        if not closed.size or self.sticks.all():
            return 0.0
        largest, speed = 0.0, float(np.abs(step.v / units).max(initial=1.0))
        slip = np.linalg.norm(self.equations(step.t, step.q0, step.v0, closed).slip, axis=1)
        after = np.linalg.norm(self.equations(step.t + step.h, step.q, step.v, closed).slip, axis=1)
        usual = self.stopped < 0 and not (slip < _BEGINS * after)[~self.sticks].any()
        for node in (share * part for part in _CHECKED):
            q, v = step.at(self.system, node)
            miss = self.acceleration(step.t + node * step.h, q, v, closed)[: len(v)] - step.acceleration(node)
            largest = max(largest, share * step.h * float(np.abs(miss / units).max(initial=0.0)))
        return (_USUAL if usual else 1.0) * largest / speed

    def begin(self, t: float, q: Array, v: Array, closed: Array) -> bool:
        """Begin a step: keep the directions of slip; return whether accelerations are determined."""
        self.start = None
        if not closed.size or self.undecided:
            return not self.undecided
        equations, found = self.forces(t, q, v, closed)
        size = np.linalg.norm(equations.slip, axis=1)
        moves = ~self.sticks & self._turns(equations, size, self.kept_way(equations))
        self.way[moves] = np.vecmat(equations.slip[moves] / size[moves, None], equations.axes[moves])
        self.start = equations, found
        return found.determined
