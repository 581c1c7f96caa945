"""Every row of an admissible set, near or far: what a scheme that locates impacts follows along a motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...constraints.admissible_set import AdmissibleSet
from ...constraints.broad_phase import BroadPhasePairs
from ...constraints.given import Given
from ...constraints.half_space import HalfSpaceContacts
from ...constraints.joint_limit import JointLimits
from ...constraints.pairs import Contacts, Pairs
from ...constraints.rows import Array
from ...constraints.signed_distance import SignedDistances
from ...constraints.sphere_surface import SphereSurface
from ...constraints.sphere_walls import SphereWalls
from ...constraints.spheres import SphereContacts
from ...errors import UnsuitableError
from ...system.lengths import velocity_units

_MOST_SETS = 1000
# rows times velocities, beyond which a row for every pair is too much
_MOST_NUMBERS = 20_000_000
# length of the differences that give (dJ/dt) v, in lengths of the scene and radians: both errors of order four are at
# rounding there
_DIFFERENCE = 1e-3
# rounding of gaps, relative to how far things are from the origin
_ROUNDING = 1e-14


class SmoothRows:
    """Gaps and gradients of every row, each a function of the configuration with a number of its own.

    A shape over a half-space has one row for each point it can stand on. Where a gradient jumps (polyhedra against each
    other) there is one row a pair, its least distance.

    Parameters
    ----------
    constraints : AdmissibleSet
        K.
    t : float
        Time [s].
    q : ndarray, shape (nq,)
        A configuration.
    length : float
        Length of the scene [m].

    Attributes
    ----------
    number : ndarray of int, shape (m,)
        Which constraint each row belongs to.
    restitution : ndarray, shape (m,)
        e of each row.
    smooth : ndarray of bool, shape (m,)
        Whether its gradient is continuous.
    reach : ndarray, shape (m, nv)
        How fast each velocity can change the gap; infinite where that is not known.
    thickness : ndarray, shape (m,)
        What bodies travel at least in passing through each other [m]; infinite where nothing is passed through.
    lever : ndarray, shape (m,)
        What a gap is multiplied by to be a length: 1, or the scene's length for an angle.
    rounding : ndarray, shape (m,)
        What a gap is off by rounding [m or rad].

    Raises
    ------
    UnsuitableError
        If there are too many bodies for a row of every pair.
    """

    def __init__(self, constraints: AdmissibleSet, t: float, q: Array, length: float = 1.0) -> None:
        self._system = constraints.system
        self._units = velocity_units(constraints.system, length)
        self._parts: list[tuple[Any, slice]] = []
        columns: list[tuple[Array, ...]] = []
        start = 0
        self._given: dict[int, Given] = {}
        for constraint, first, e in constraints.numbered():
            if (
                isinstance(constraint, BroadPhasePairs)
                or getattr(constraint, "size", 0) * self._system.nv > _MOST_NUMBERS
            ):
                raise UnsuitableError("there are too many bodies for EventDriven: take StewartTrinkle or Centered")
            given = constraints.given(constraint)
            number, *described = _describe(constraint, e, self._system.nv, t, q)
            if given is not None:
                self._given[id(constraint)] = given
            columns.append((number + first, *described))
            self._parts.append((constraint, slice(start, start + len(number))))
            start += len(number)
        empty = (np.zeros(0, np.int64), np.zeros(0), np.zeros(0, bool), np.zeros((0, self._system.nv)), np.zeros(0))
        stacked = [np.concatenate(parts) for parts in zip(empty, *columns, strict=True)]
        self.number, self.restitution, self.smooth, self.reach, self.thickness = stacked
        self.all = np.arange(start)
        self.lever = np.broadcast_to(constraints.levers(self.number), (start,))
        self.rounding = _ROUNDING * max(length, _extent(self._system, q)) / self.lever
        self._known: dict[bytes, list[tuple[Any, Array]]] = {}

    def gaps(self, t: float, q: Array, index: Array) -> Array:
        """Return f(q) of some rows in ascending order, shape (k,) [m or rad]."""
        return self._each(t, q, index, self._gaps, np.zeros(0))

    def at_least(self, t: float, q: Array, index: Array) -> Array:
        """Return what f(q) of some rows in ascending order is at least, shape (k,): itself where it is not positive."""
        return self._each(t, q, index, self._bounds, np.zeros(0))

    def gradients(self, t: float, q: Array, index: Array) -> Array:
        """Return grad f of some rows in ascending order, shape (k, nv)."""
        return self._each(t, q, index, self._gradients, np.zeros((0, self._system.nv)))

    def bias(self, t: float, q: Array, v: Array, index: Array) -> Array:
        """Return (dJ/dt) v of some rows in ascending order, shape (k,): how fast their rates change at constant v."""
        parts = [
            constraint.bias(q, v, own) if isinstance(constraint, HalfSpaceContacts | JointLimits)
            else np.full(len(own), np.nan)
            for constraint, own in self._owners(index)
        ]  # fmt: skip
        bias = np.concatenate([np.zeros(0), *parts])
        unknown = np.isnan(bias)
        if unknown.any():
            bias[unknown] = self._difference(t, q, v, index[unknown])
        return bias

    def _difference(self, t: float, q: Array, v: Array, index: Array) -> Array:
        speed = float(np.linalg.norm(v / self._units))
        if speed == 0.0:
            return np.zeros(len(index))
        s = _DIFFERENCE / max(speed, _DIFFERENCE)
        move = self._system.integrate
        rates = [self.gradients(t, move(q, k * s * v), index) @ v for k in (-2.0, -1.0, 1.0, 2.0)]
        return np.asarray((rates[0] - 8 * rates[1] + 8 * rates[2] - rates[3]) / (12 * s))

    def touch(self, t: float, q: Array, index: Array) -> None:
        """Check the gradients that users gave of rows that touch; see `Given.touch`."""
        if self._given:
            for constraint, own in self._owners(index):
                given = self._given.get(id(constraint))
                if given is not None:
                    gap = given.gaps(t, q)
                    given.touch(t, q, own, gap, given.gradients(t, q))

    def points(self, t: float, q: Array, index: Array) -> tuple[Array, Array]:
        """Return contact points and normals of some rows, shapes (k, 3); NaN where a row is no contact."""
        both = self._each(t, q, index, self._places, np.zeros((0, 6)))
        return both[:, :3], both[:, 3:]

    def _each(self, t: float, q: Array, index: Array, ask: Any, nothing: Array) -> Array:
        found = [ask(constraint, t, q, own) for constraint, own in self._owners(index)]
        return found[0] if len(found) == 1 else np.concatenate([nothing, *found])

    def _owners(self, index: Array) -> list[tuple[Any, Array]]:
        """Return which of each constraint's own rows are asked for; the same few sets come again and again."""
        key = index.tobytes()
        owners = self._known.get(key)
        if owners is None:
            if len(self._known) >= _MOST_SETS:
                self._known.clear()
            ends = np.searchsorted(index, [rows.start for _, rows in self._parts] + [len(self.all)])
            owners = self._known[key] = [
                (constraint, index[low:high] - rows.start)
                for (constraint, rows), low, high in zip(self._parts, ends[:-1], ends[1:], strict=True)
                if high > low
            ]
        return owners

    def _gaps(self, constraint: Any, t: float, q: Array, own: Array) -> Array:
        if isinstance(constraint, Pairs):
            return _contacts(constraint, q, own)[1]
        given = self._given.get(id(constraint))
        if given is not None:
            return given.gaps(t, q)[own]
        return np.atleast_1d(np.asarray(constraint.gap(t, q), dtype=float))[own]

    def _bounds(self, constraint: Any, t: float, q: Array, own: Array) -> Array:
        if isinstance(constraint, SignedDistances):
            return constraint.at_least(q, own)
        return self._gaps(constraint, t, q, own)

    def _gradients(self, constraint: Any, t: float, q: Array, own: Array) -> Array:
        if isinstance(constraint, Pairs):
            pair, _, point, normal = _contacts(constraint, q, own)
            first, second = constraint.sides(pair)
            return self._system.separation_rows(q, first, second, point, normal)
        if isinstance(constraint, JointLimits):
            return constraint.rows(own)
        given = self._given.get(id(constraint))
        if given is not None:
            return given.gradients(t, q)[own]
        return np.atleast_2d(np.asarray(constraint.gradient(t, q), dtype=float))[own]

    def _places(self, constraint: Any, t: float, q: Array, own: Array) -> Array:
        if isinstance(constraint, Pairs):
            return np.concatenate(_contacts(constraint, q, own)[2:], axis=1)
        if isinstance(constraint, SphereContacts | SphereWalls | SphereSurface):
            return np.concatenate(constraint.places(q), axis=1)[own]
        return np.full((len(own), 6), np.nan)


def _extent(system: Any, q: Array) -> float:
    """Return how far bodies are from the origin at most [m]."""
    bodies = np.arange(1, len(system.bodies))
    return float(np.linalg.norm(system.placements(q, bodies)[:, 3], axis=1).max()) if bodies.size else 0.0


def _describe(constraint: Any, e: float, nv: int, t: float, q: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return number, restitution, smoothness, reach and thickness of each row of one constraint."""
    if isinstance(constraint, SphereContacts):
        i, j = np.triu_indices(constraint.count, 1)
        number, own = i * constraint.count + j, constraint.restitution_of(i, j)
        return number, own, np.ones(len(i), bool), constraint.reach_of(i, j), constraint.thickness_of(i, j)
    if isinstance(constraint, HalfSpaceContacts):
        pair = constraint.owner
        smooth = np.ones(len(pair), bool)
        return pair, constraint.restitution[pair], smooth, constraint.reach[pair], constraint.thickness[pair]
    if isinstance(constraint, SignedDistances):
        pair = np.arange(len(constraint.names))
        return pair, constraint.restitution, constraint.round, constraint.reach, constraint.thickness
    if isinstance(constraint, SphereWalls):
        number, own = np.arange(constraint.size), constraint.restitution
        return number, own, np.ones(len(number), bool), np.full((len(number), nv), np.inf), np.full(len(number), np.inf)
    if isinstance(constraint, SphereSurface):
        # which feature is nearest changes
        number = np.arange(constraint.size)
        jumping, reach = np.zeros(len(number), bool), np.full((len(number), nv), np.inf)
        return number, constraint.restitution, jumping, reach, np.full(len(number), np.inf)
    size = len(np.atleast_1d(constraint.gap(t, q)))
    own = np.broadcast_to(np.asarray(getattr(constraint, "restitution", e), dtype=float), (size,))
    known = isinstance(constraint, JointLimits)
    reach = np.abs(constraint.gradient(t, q)) if known else np.full((size, nv), np.inf)
    return np.arange(size), own, np.ones(size, bool), reach, np.full(size, np.inf)


def _contacts(constraint: Pairs, q: Array, own: Array) -> Contacts:
    """Return some rows of pairs: points over half-spaces, the nearest points of others."""
    return constraint.standing(q, own) if isinstance(constraint, HalfSpaceContacts) else constraint.nearest(q, own)
