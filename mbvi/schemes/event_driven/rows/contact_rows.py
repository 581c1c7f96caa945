"""Gaps and gradients of every row of an admissible set, near or far, for `EventDriven`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from ....compiled import held
from ....constraints import AdmissibleSet, ConstraintFamily
from ....constraints.features.feature_kernels import Surfaces
from ....constraints.features.feature_motion import slip_biases
from ....constraints.features.pair_features import FeatureRows
from ....constraints.mechanism.held_rows import LIMIT, UNKNOWN, RowParts, unknown_parts
from ....constraints.rows import Array, Rows
from ....constraints.tangents import Tangents
from ....errors import UnsuitableError
from ....system.free.sparse_rows import dense
from ....system.parts import velocity_units
from .known_pairs import KnownPairs, searched_pairs
from .known_rows import KnownRows, known_rows
from .row_columns import SEARCHED, body_points, completed, extent, measured_by
from .row_sets import union, without

# most sets of rows whose division into families is kept
_MOST_SETS = 1000
# rows times velocities above which a row for every pair needs too much memory
_MOST_NUMBERS = 20_000_000
# length of the differences of order four that give (dJ/dt) v, in lengths of the scene and radians: truncation and
# rounding are both negligible there
_DIFFERENCE = 1e-3
# rounding of gaps, relative to the largest distance of a body from the origin
_ROUNDING = 1e-14


class SmoothRows:
    """Gaps and gradients of all rows, near or far; each row is a function of q with a fixed number.

    A shape over a half-space has one row for each of its support points. A pair of other shapes has one row, its
    distance, whose gradient jumps: `smooth` says so. Where such a pair touches, rows of its features are added behind
    all others.

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
    all : ndarray of int, shape (m,)
        All rows but those of features.
    smooth : ndarray of bool, shape (m,)
        Whether its gradient is continuous.
    featured : ndarray of bool, shape (m,)
        Whether the row is that of a pair whose features have rows where it touches.
    pair : ndarray of int, shape (m,)
        The row of the pair that a row belongs to: a row of a feature to another, each other row to itself.
    reach : ndarray, shape (m, nv)
        How fast each velocity can change the gap; infinite where that is not known.
    thickness : ndarray, shape (m,)
        How far bodies travel at least to pass through each other [m]; infinite where nothing is passed through.
    lever : ndarray, shape (m,)
        The factor that makes a length of a gap: 1, or the scene's length for an angle.
    rounding : ndarray, shape (m,)
        Error of a gap by rounding [m or rad].
    kernels : KnownRows or None
        What evaluates many of them at once, if the system is one mechanism.
    searched : KnownPairs or None
        The pairs of shapes that kernels search, if they are of one family.
    searched_pair : ndarray of int, shape (m,)
        The pair that each row is among them, `NO_PAIR` or `UNKNOWN_ROW`.
    friction : ndarray, shape (len(constraints),), or None
        What is added to the coefficient of friction of each constraint.

    Raises
    ------
    UnsuitableError
        If there are too many bodies for a row of every pair.
    """

    def __init__(self, constraints: AdmissibleSet, t: float, q: Array, length: float = 1.0) -> None:
        self._system, self._constraints = constraints.system, constraints
        self._units = velocity_units(constraints.system, length)
        self._parts: list[tuple[ConstraintFamily, slice]] = []
        nothing, none = np.zeros(0), np.zeros(0, bool)
        empty = np.zeros(0, np.int64), nothing, none, np.zeros((0, self._system.nv)), nothing, none
        columns: list[tuple[Array, ...]] = [empty]
        start = 0
        for family, first, e in constraints.numbered():
            if not family.tracked or family.size * self._system.nv > _MOST_NUMBERS:
                raise UnsuitableError("there are too many bodies for EventDriven: take StewartTrinkle or Centered")
            table = completed(family.row_table(t, q), e, self._system.nv)
            columns.append((table[0] + first, *table[1:]))
            self._parts.append((family, slice(start, start + len(table[0]))))
            start += len(table[0])
        self.number, self.restitution, self.smooth, self.reach, self.thickness, self.featured = map(
            np.concatenate, zip(*columns, strict=True)
        )
        self.all = self.pair = np.arange(start)
        self._features = FeatureRows(self._system)
        self.lever = np.broadcast_to(constraints.levers(self.number), (start,))
        self.rounding = _ROUNDING * max(length, extent(self._system, q)) / self.lever
        self.rounding[~self.smooth | self.featured] *= SEARCHED
        self.friction: Array | None = None
        self._splits: dict[bytes, list[tuple[ConstraintFamily | FeatureRows, Array]]] = {}
        self._surfaces: dict[bytes, Surfaces] = {}
        parts = self.parts(self.all)
        self.kernels = known_rows(self._system, parts)
        self._pairs: dict[int, KnownPairs] = {}
        if self.kernels is not None:
            for family, _ in self._parts:
                if (tables := family.loop_tables()) is not None:
                    bodies = family.bodies_of(np.arange(family.size))
                    self._pairs[id(family)] = KnownPairs(self.kernels.mechanism, bodies, *tables)
        known = None if self.kernels is None else self.kernels.known
        own = [(self._pairs[id(family)], rows) for family, rows in self._parts if id(family) in self._pairs]
        self.searched, self.searched_pair = searched_pairs(known, own, start)

    def with_features(self, q: Array, index: Array, kept: Array, tolerance: float) -> Array:
        """Return some rows that touch with those of features in place of their pairs, where they are known.

        Parameters
        ----------
        q : ndarray, shape (nq,)
            Configuration.
        index : ndarray of int, shape (k,)
            The rows, ascending.
        kept : ndarray of int
            Rows; of pairs that have features among them no others are sought.
        tolerance : float
            Gap at and below which a feature touches [m].
        """
        pairs = index[self.featured[index]]
        if not pairs.size:
            return index
        found, replaced = index, self.pair[kept[kept >= len(self.all)]]
        for pair in without(pairs, replaced).tolist():
            family, rows = next(part for part in self._parts if part[1].start <= pair < part[1].stop)
            new = len(self.all) + np.array(
                family.feature_rows(q, pair - rows.start, tolerance, self._features), dtype=np.int64
            )
            self._extend(pair, new)
            if len(new):
                found, replaced = union(found, new), np.append(replaced, pair)
        return without(found, replaced)

    def features_outside(self, q: Array, index: Array) -> Array:
        """Return how far the contact points of some rows of features are outside the shapes, shape (k,) [m]."""
        return self._features.outside(q, index - len(self.all))

    def surfaces(self, index: Array) -> Surfaces:
        """Return what some rows of features are on, as `held` does; kept, because the same sets recur."""
        key = index.tobytes()
        if key not in self._surfaces:
            if len(self._surfaces) >= _MOST_SETS:
                self._surfaces.clear()
            self._surfaces[key] = held(self._features.surfaces(index - len(self.all)))
        return self._surfaces[key]

    def _extend(self, pair: int, new: Array) -> None:
        """Give rows of features what their pair has."""
        if (count := int(new.max(initial=-1)) + 1 - len(self.pair)) <= 0:
            return
        for name in ("number", "restitution", "lever", "rounding"):
            column = getattr(self, name)
            setattr(self, name, np.append(column, np.full(count, column[pair])))
        self.pair = np.append(self.pair, np.full(count, pair))
        self.smooth = np.append(self.smooth, np.ones(count, bool))
        self.featured = np.append(self.featured, np.zeros(count, bool))
        if self.kernels is not None:
            self.kernels.add(self.parts(np.arange(len(self.pair) - count, len(self.pair))))

    def depths(self, index: Array, gap: Array) -> Array:
        """Return the greatest depths of contacts and of limits, shape (2,), where some rows have these gaps."""
        return self._constraints.depths(self.number[index], gap)

    def gaps(self, t: float, q: Array, index: Array) -> Array:
        """Return f(q) of some rows in ascending order, shape (k,) [m or rad]."""
        return self.measured(t, q, index, np.inf)

    def lower_bounds(self, t: float, q: Array, index: Array) -> Array:
        """Return lower bounds of f(q) of some rows in ascending order, shape (k,): positive ones, or f(q) itself."""
        return self.measured(t, q, index, 0.0)

    def measured(self, t: float, q: Array, index: Array, near: float) -> Array:
        """Return gaps of some rows, or lower bounds of those above `near`, which is zero or infinite."""
        if self.kernels is None:
            return self._each(index, lambda family, rows: measured_by(family, t, q, rows, near), np.zeros(0))
        found, known = np.empty(len(index)), self.kernels.known[index]
        if known.all():
            return self.kernels.gaps(q, index)
        if known.any():
            found[known] = self.kernels.gaps(q, index[known])
        found[~known] = np.concatenate(
            [
                measured_by(family, t, q, rows, near) if pairs is None else pairs.distances(q, rows, near)
                for family, rows, pairs in self.with_kernels(index[~known])
            ]
        )
        return found

    def with_kernels(self, index: Array) -> list[tuple[ConstraintFamily | FeatureRows, Array, KnownPairs | None]]:
        """Return the families of some rows, each with its own rows and the kernels that measure these, or None."""
        found = []
        for family, rows in self._split(index):
            pairs = self._pairs.get(id(family))
            found.append((family, rows, None if pairs is None or not pairs.known[rows].all() else pairs))
        return found

    def gradients(self, t: float, q: Array, index: Array) -> Array:
        """Return grad f of some rows in ascending order, shape (k, nv)."""
        if (kernels := self._kernels_of(index)) is not None:
            return kernels.gradients(q, index)
        none = np.zeros((0, self._system.nv))
        return self._each(index, lambda family, rows: family.row_gradient(t, q, rows), none)

    def bias(self, t: float, q: Array, v: Array, index: Array) -> Array:
        """Return (dJ/dt) v of some rows in ascending order, shape (k,): the change of their rates at constant v."""
        if (kernels := self._kernels_of(index)) is not None:
            return kernels.biases(q, v, index)
        bias = self._each(index, lambda family, rows: family.row_bias(t, q, v, rows), np.zeros(0))
        unknown = np.isnan(bias)
        if unknown.any():
            bias[unknown] = self._difference(lambda place: self.gradients(t, place, index[unknown]), q, v)
        return bias

    def _kernels_of(self, index: Array) -> KnownRows | None:
        """Return the kernels that know all of some rows, or None."""
        kernels = self.kernels
        return kernels if kernels is not None and kernels.known[index].all() else None

    def parts(self, index: Array) -> RowParts:
        """Return what some rows in ascending order are, for kernels."""
        found = [family.row_parts(rows) for family, rows in self._split(index)]
        return RowParts(*map(np.concatenate, zip(unknown_parts(0), *found, strict=True)))

    def rows(self, t: float, q: Array, index: Array) -> Rows:
        """Return some rows in ascending order with their tangents, as schemes of fixed steps have them."""
        J, nothing = self.gradients(t, q, index), np.zeros(len(index))
        rows = Rows(self.number[index], nothing, J, self.restitution[index], *self.points(t, q, index))
        return rows._replace(tangents=self._tangents_of(t, q, rows))

    def tangents(self, t: float, q: Array, index: Array) -> Tangents:
        """Return the tangents of some rows in ascending order, dense."""
        nothing = np.zeros(len(index))
        none = np.zeros((len(index), self._system.nv))
        rows = Rows(self.number[index], nothing, none, nothing, *self.points(t, q, index))
        tangents = self._tangents_of(t, q, rows)
        return tangents._replace(jacobian=dense(tangents.jacobian))

    def _tangents_of(self, t: float, q: Array, rows: Rows) -> Tangents:
        tangents = self._constraints.tangents_of(t, q, rows)
        if self.friction is None:
            return tangents
        return tangents._replace(friction=tangents.friction + self.friction[rows.constraint])

    def slips(self, t: float, q: Array, v: Array, index: Array) -> tuple[Array, Array, Array, Array]:
        """Return tangents T of some rows, shape (k, 2, nv), (dT/dt) v, shape (k, 2), their axes, (k, 2, 3), and mu.

        The rows ascend.
        """
        if (kernels := self._kernels_of(index)) is not None:
            mu = self._coefficients[self.number[index]]
            if self.friction is not None:
                mu = mu + self.friction[self.number[index]]
            return *kernels.slips(q, v, index, mu), mu
        tangents, bias = self.tangents(t, q, index), np.zeros((len(index), 2))
        parts = self.parts(index)
        known, unknown = (parts.kind != UNKNOWN) & (parts.kind != LIMIT), parts.kind == UNKNOWN
        if known.any():
            bias[known] = slip_biases(self._system, q, v, RowParts(*(column[known] for column in parts)))
        if unknown.any():
            rest = index[unknown]
            moved = self._difference(lambda place: np.asarray(self.tangents(t, place, rest).jacobian), q, v)
            bias[unknown] = moved.reshape(-1, 2)
        T = np.asarray(tangents.jacobian).reshape(len(index), 2, self._system.nv)
        return T, bias, tangents.axes, tangents.friction

    @cached_property
    def _coefficients(self) -> Array:
        """The coefficient of friction of each constraint."""
        return np.array([self._constraints.coefficient_of_friction(k) for k in range(len(self._constraints))])

    def _difference(self, gradients: Callable[[Array], Array], q: Array, v: Array) -> Array:
        """Return (dJ/dt) v by differences of gradients along v."""
        speed = float(np.linalg.norm(v / self._units))
        if speed == 0.0:
            return np.zeros(len(gradients(q)))
        s = _DIFFERENCE / max(speed, _DIFFERENCE)
        move = self._system.integrate
        rates = [gradients(move(q, k * s * v)) @ v for k in (-2.0, -1.0, 1.0, 2.0)]
        return np.asarray((rates[0] - 8 * rates[1] + 8 * rates[2] - rates[3]) / (12 * s))

    def bearing(self, t: float, q: Array, index: Array) -> Array:
        """Return of some rows that touch, ascending, which bear the load of all, shape (k,) of bool."""
        return self._each(index, lambda family, rows: family.bearing(t, q, rows), np.zeros(0, bool))

    def check(self, t: float, q: Array, index: Array) -> None:
        """Compare the gradients of some closed rows with differences, where a user gave them."""
        for family, rows in self._split(index):
            family.check_rows(t, q, rows)

    def body_points(self, index: Array) -> Array:
        """Return what `body_points` does of some rows in ascending order."""
        return body_points(self.parts(index))

    def points(self, t: float, q: Array, index: Array) -> tuple[Array, Array]:
        """Return contact points and normals of some rows, shapes (k, 3); NaN where a row is no contact."""
        if (kernels := self._kernels_of(index)) is not None:
            return kernels.points(q, index)
        both = self._each(index, lambda family, rows: np.hstack(family.row_points(t, q, rows)), np.zeros((0, 6)))
        if self.kernels is not None and (known := self.kernels.known[index]).any():
            # any point of a rim that lies flat may be the lowest: this is that of the gradient
            both[known] = np.hstack(self.kernels.points(q, index[known]))
        return both[:, :3], both[:, 3:]

    def _each(
        self, index: Array, evaluate: Callable[[ConstraintFamily | FeatureRows, Array], Array], nothing: Array
    ) -> Array:
        """Return what `evaluate` returns of the rows of each family, one family after the other."""
        found = [evaluate(family, rows) for family, rows in self._split(index)]
        return found[0] if len(found) == 1 else np.concatenate([nothing, *found])

    def _split(self, index: Array) -> list[tuple[ConstraintFamily | FeatureRows, Array]]:
        """Return the families of some rows, each with its own rows; kept, because the same sets recur."""
        key = index.tobytes()
        split = self._splits.get(key)
        if split is None:
            if len(self._splits) >= _MOST_SETS:
                self._splits.clear()
            parts: list[tuple[ConstraintFamily | FeatureRows, int]]
            parts = [*((family, rows.start) for family, rows in self._parts), (self._features, len(self.all))]
            ends = [*np.searchsorted(index, [start for _, start in parts]), len(index)]
            split = self._splits[key] = [
                (family, index[low:high] - start)
                for (family, start), low, high in zip(parts, ends[:-1], ends[1:], strict=True)
                if high > low
            ]
        return split
