"""The base class of all constraint families: what a family provides, with a default for all but gaps and gradients."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from ..system import System
from .families.candidates import PairCandidates
from .features.feature_motion import places_of
from .features.pair_features import FeatureRows
from .mechanism.held_rows import RowParts, unknown_parts
from .relative_ways import PairBalls
from .rotations import rotation_rows
from .row_table import RowTable
from .rows import NO_POINT, Array, Rows
from .tangents import Tangents, axes_of, tangents_of_mechanism


class ConstraintFamily(ABC):
    """Constraints f_a(q) >= 0 of one kind, evaluated together.

    A new family derives from this class and defines `gap` and `gradient`. All else has a default. The groups of methods
    below serve, in this order, every scheme, the cache, `EventDriven`, the tunnelling guard, sleeping and the report.

    Arrays that a family returns are C-contiguous, of float64, or of int64 where they hold numbers. A family does not
    write to them afterwards. Arrays that it is given it neither changes nor keeps.

    Attributes
    ----------
    system : System
        What moves the bodies; families without bodies have none.
    size : int
        How many constraints the family has: they are numbered from 0 to size - 1.
    names : sequence of str
        Names of the constraints; a constraint beyond the last one gets a name by its number in the problem.
    restitution : ndarray, shape (size,), or float
        e of each constraint; NaN where the problem's own applies.
    friction : ndarray, shape (size,), or float
        Coefficient of Coulomb friction of each constraint, or the largest of them where `friction_of` knows each; NaN
        where the problem's own applies. A family with friction provides `bodies_of` or `tangents`.
    smooth : ndarray of bool, shape (size,), or bool
        Whether the gradient of each constraint is continuous.
    lever : ndarray, shape (size,), or float
        The factor by which a gap becomes a length: the scene's length [m/rad] for an angle, otherwise 1.
    of_joints : bool
        Whether the constraints are limits of joints, which are no contacts.
    moving : bool
        Whether gaps change with time at a fixed q; `rate` says how fast.
    frame, at_rest : MovingFrame or None, and ConstraintFamily or None
        The frame of walls that move together, and their family in it, where they stand still.
    thickness : ndarray, shape (size,), or float
        The least travel within which bodies can pass through each other [m]; infinite where nothing is to be checked.
    isotropic : bool
        Whether `reach` also bounds gaps with the length of a vector in the place of its components' absolute values.
    hollow : bool
        Whether bodies of a pair may touch, part, and touch elsewhere within a step: one is not convex.
    tracked : bool
        Whether the rows can be listed one by one, as `EventDriven` needs them.
    skips_resting : bool
        Whether the family can leave out bodies at rest; see `skip_resting`.
    some_rest : bool
        Whether it leaves some out now.
    functions : tuple of callable
        The functions of a user that the family evaluates, for the description in a file.
    """

    system: System
    size: int = 1
    names: Sequence[str] = ()
    restitution: Array | float = np.nan
    friction: Array | float = 0.0
    smooth: Array | bool = True
    lever: Array | float = 1.0
    of_joints: bool = False
    moving: bool = False
    frame: Any = None
    at_rest: Any = None
    thickness: Array | float = np.inf
    isotropic: bool = False
    hollow: bool = False
    tracked: bool = True
    skips_resting: bool = False
    some_rest: bool = False
    functions: tuple[Callable[..., Any], ...] = ()
    # contacts that are returned again while nothing moves
    kept: Any = None
    # written by `contacts`, returned by `clearance`
    _clearance: float = -np.inf

    @property
    def count(self) -> int:
        """How many constraints there are: less than `size` if some numbers have none, as pairs i n + j with i >= j."""
        return self.size

    def all_pairs(self) -> Array:
        """Return the numbers of the constraints, ascending: all below `size`, unless a family knows which there are."""
        return np.arange(self.size)

    def name(self, number: int) -> str:
        """Return the name of one constraint; "" where it has none of its own."""
        return str(self.names[number]) if number < len(self.names) else ""

    def check(self, t: float, q: Array) -> None:  # noqa: B027
        """Raise `InputError` if gaps or gradients at the start of a run are wrong."""

    # for every scheme

    @abstractmethod
    def gap(self, t: float, q: Array) -> Array:
        """Return f(q) of every constraint, shape (size,) [m or rad]."""

    @abstractmethod
    def gradient(self, t: float, q: Array) -> Array:
        """Return grad f(q) of every constraint in the tangent space, shape (size, nv)."""

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return the contact point and the normal of every constraint that `gap` returns, shapes (size, 3).

        Only walls with a prescribed motion need them; see `MovingWalls`.
        """
        raise NotImplementedError

    def rate(self, t: float, q: Array) -> Array | None:
        """Return df/dt of every constraint at a fixed q, shape (size,) [m/s or rad/s]; None if nothing moves."""
        return None

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows whose gap is at most the tolerance, or None if there are none.

        One constraint may have several rows: those of a flat face that lies on another. The tolerance is a length [m],
        with which gaps of angles are compared after multiplication by their `lever`. The default evaluates `gap`, and
        `gradient` where a row is within the tolerance.
        """
        gap = self.gap(t, q)
        lengths = gap * self.lever
        near = np.flatnonzero(lengths <= tolerance)
        if not near.size:
            self._clearance = float(lengths.min(initial=np.inf)) - tolerance
            return None
        # an active row must be returned at every step, so that no step can be skipped
        self._clearance = -np.inf
        rate, nowhere = self.rate(t, q), np.tile(NO_POINT, (near.size, 1))
        e = np.full(gap.shape, self.restitution)[near]
        jacobian = np.asarray(self.gradient(t, q)[near])
        return Rows(near, gap[near], jacobian, e, nowhere, nowhere, None if rate is None else rate[near])

    # for friction

    def friction_of(self, numbers: Array) -> Array:
        """Return the coefficients of friction of some constraints, shape (k,); NaN where the problem's own applies."""
        mu = np.asarray(self.friction, dtype=float)
        return np.full(len(numbers), mu) if mu.ndim == 0 else mu[numbers]

    def restitution_of(self, numbers: Array) -> Array:
        """Return e of some constraints, shape (k,); NaN where the problem's own applies."""
        e = np.asarray(self.restitution, dtype=float)
        return np.full(len(numbers), e) if e.ndim == 0 else e[numbers]

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the first and the second body of some constraints, shapes (k,); 0 is the world."""
        raise NotImplementedError

    def tangents(self, t: float, q: Array, rows: Rows, friction: Array) -> Tangents:
        """Return the tangents of some rows, with numbers of the family, whose coefficients are given."""
        first, second = self.bodies_of(rows.constraint)
        if self.system.single_mechanism:
            kinematics = self.system.kinematics(q)
            return tangents_of_mechanism(kinematics, (first, second), rows.point, rows.normal, friction)
        axes, first, second = axes_of(rows.normal), first.repeat(2), second.repeat(2)
        jacobian = self.system.separation_rows(q, first, second, rows.point.repeat(2, 0), axes.reshape(-1, 3))
        return Tangents(friction, axes, jacobian, None)

    def rotations(self, t: float, q: Array, rows: Rows, axes: Array) -> tuple[Any, Array | None]:
        """Return the rows and the rates at v = 0 of relative angular velocities; see `rotation_rows`."""
        system = self.system
        return rotation_rows(partial(system.separation_rows, q), self.bodies_of(rows.constraint), rows, axes), None

    # for records: contacts that move with their bodies

    def poses_of(self, numbers: Array, t: float, q: Array) -> Array | None:
        """Return the poses of the first and the second bodies of some constraints, shape (2, k, 4, 3); None without.

        See `System.placements`; the world's is the identity.
        """
        if type(self).bodies_of is ConstraintFamily.bodies_of:
            return None
        return places_of(self.system, q, np.concatenate(self.bodies_of(numbers))).reshape(2, -1, 4, 3)

    # for the cache

    def reach(self) -> Array | None:
        """Return bounds of the entries of each gradient, shape (size, nv); None where no bound is known.

        Between two configurations a gap falls by no more than reach . |difference|.
        """
        return None

    def reach_of(self, numbers: Array) -> Array | None:
        """Return the reach of some constraints, shape (k, nv), also of a family that has too many to list all."""
        reach = self.reach()
        return None if reach is None else reach[numbers]

    def envelope(self) -> Array | None:
        """Return the largest reach of any constraint as a length, shape (nv,); None: every step queries the family."""
        reach = self.reach()
        return None if reach is None else np.max((reach.T * self.lever).T, axis=0, initial=0.0)

    def bending_envelope(self) -> Array | None:
        """Return the largest reach, shape (nv,), also where every step queries the family; None if not known."""
        return self.envelope()

    def changes_of_walls(self, times: tuple[float, float, float], q: Array, points: Array) -> Array:
        """Return the larger of both changes of the walls' velocity between three times, shape (k,) [m/s].

        `points`, shape (k, 3), are where bodies that may touch the walls are at the second time and at q.
        """
        return np.zeros(len(points))

    def clearance(self) -> float:
        """Return how far any gap may fall before `contacts` must be called again [m].

        It is read directly after each call of `contacts`. If it is negative, `contacts` is called at the next step.
        """
        return self._clearance

    def pair_candidates(self) -> PairCandidates | None:
        """Return a new table of candidates, if the family has clearances for single pairs; None otherwise."""
        return None

    def contacts_among(self, q: Array, tolerance: float, candidates: PairCandidates) -> Rows | None:
        """Return the rows of the candidates within the tolerance, or None; write the clearances of the candidates."""
        raise NotImplementedError

    # for EventDriven: rows with a number of their own, each a function of q

    def row_table(self, t: float, q: Array) -> RowTable:
        """Return the table of all rows; by default one row for each constraint."""
        shape = np.shape(self.gap(t, q))
        e, smooth = np.full(shape, self.restitution), np.full(shape, self.smooth)
        thickness = np.full(shape, self.thickness)
        return RowTable(np.arange(len(e)), e, smooth, self.reach(), thickness)

    def row_gap(self, t: float, q: Array, rows: Array) -> Array:
        """Return the gaps of some rows in ascending order, shape (k,) [m or rad]."""
        return np.asarray(self.gap(t, q)[rows])

    def row_lower_bound(self, t: float, q: Array, rows: Array) -> Array:
        """Return lower bounds of some gaps, shape (k,); a bound that is not positive must be the gap itself."""
        return self.row_gap(t, q, rows)

    def row_gradient(self, t: float, q: Array, rows: Array) -> Array:
        """Return the gradients of some rows, shape (k, nv)."""
        return np.asarray(self.gradient(t, q)[rows])

    def row_bias(self, t: float, q: Array, v: Array, rows: Array) -> Array:
        """Return (dJ/dt) v of some rows, shape (k,); NaN where the caller shall take differences of gradients."""
        return np.full(len(rows), np.nan)

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return contact points and normals of some rows, shapes (k, 3); NaN where a row is no contact."""
        nowhere = np.full((len(rows), 3), np.nan)
        return nowhere, nowhere

    def bearing(self, t: float, q: Array, rows: Array) -> Array:
        """Return of some rows that touch, ascending, which bear the load of all, shape (k,) of bool; by default all."""
        return np.ones(len(rows), bool)

    def feature_rows(self, q: Array, row: int, tolerance: float, features: FeatureRows) -> list[int]:
        """Add to `features` the rows of a touching pair of `row_table` whose gradient jumps; return their numbers.

        None are returned where features are unclear.
        """
        return []

    def row_parts(self, rows: Array) -> RowParts:
        """Return what some rows are, for kernels; by default these do not know them."""
        return unknown_parts(len(rows))

    def loop_tables(self) -> tuple[tuple[Array, ...], Any] | None:  # noqa: B027
        """Return what `write_distances` takes, if the rows are distances of pairs of shapes, else None."""

    def check_rows(self, t: float, q: Array, rows: Array) -> None:  # noqa: B027
        """Raise `InputError` if the gradients of some rows that are closed are wrong."""

    # for the tunnelling guard

    def least_displacement(self) -> float:
        """Return a bound: no body passes through another if no entry of a displacement is larger."""
        return self._least_displacement

    @cached_property
    def _least_displacement(self) -> float:
        # the tunnelling guard of every run needs it
        envelope = self.envelope()
        total = 0.0 if envelope is None else float(envelope.sum())
        return float(np.min(self.thickness, initial=np.inf)) / total if total > 0.0 else np.inf

    def passed_share(self) -> Array | None:
        """Return the reach in thicknesses, shape (nv, size), or None where the pairs are too many to be listed."""
        reach = self.reach()
        return None if reach is None else np.asarray(reach.T / self.thickness)

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the constraints whose bodies may pass through each other on a displacement from q, shape (nv,).

        Returns
        -------
        pairs : ndarray of int, shape (k,)
            Their numbers.
        travel, thickness : ndarray, shape (k,)
            The most that the bodies of each travel towards each other, and their thickness [m].
        """
        reach = self.reach()
        if reach is None:
            return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
        travel, thickness = reach @ np.abs(displacement), np.full(len(reach), self.thickness)
        pairs = np.flatnonzero(travel > thickness)
        return pairs, travel[pairs], thickness[pairs]

    def balls_of(self, numbers: Array) -> PairBalls | None:
        """Return balls of the bodies of some constraints, if gaps are distances of these; None otherwise."""
        return None

    def thickness_of(self, numbers: Array) -> Array:
        """Return the thicknesses of some constraints, shape (k,) [m]."""
        return np.broadcast_to(self.thickness, (self.size,))[numbers]

    def nearest_of(self, t: float, q: Array, pairs: Array) -> tuple[Array, Array | None]:
        """Return gaps of some constraints in ascending order, shape (k,) [m]; normals, shape (k, 3), if with balls."""
        return np.asarray(self.gap(t, q)[pairs]), None

    # for sleeping bodies

    def memory(self) -> tuple[Array, ...]:
        """Return the arrays by which earlier queries may change the last digits of later ones; as `kept` may."""
        return ()

    def skip_resting(self, resting: Array | None) -> None:  # noqa: B027
        """Leave out pairs whose bodies are both at rest; `resting` has shape (bodies,), None leaves out no pair."""

    # for the report

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.count} constraint{'s' * (self.count != 1)} of {type(self).__name__}"
