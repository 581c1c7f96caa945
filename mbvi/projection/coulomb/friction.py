"""Impacts with Coulomb friction: the law for dense rows, each answer with its cases and its residual."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import plain_array
from ...errors import ProjectionError
from ..metric import Array, Metric
from ..tree import TreeFreeMotion, TreeMetric, solve
from .existence import existence_margin
from .few_contacts import MOST_CONTACTS
from .frictional_step import frictional_tree_law
from .law import COMPLIANT, NOTHING, UNIQUE
from .separate_laws import coulomb_law

# friction above this counts as this: nothing that bears slips then, and the rounding of mu |u_t| stays small
LARGEST_FRICTION = 100.0
# the residual that is aimed at; and the share of the one asked up to which an answer needs no check of each row
AIM, EXACT = 1e-12, 1e-3


class FrictionalProjection(NamedTuple):
    """The velocity of Coulomb's law, the percussions that lead to it, and what each contact does.

    Attributes
    ----------
    velocity : ndarray, shape (nv,)
        w with M (w - x) = J' p.
    percussion, free, after : ndarray, shape (3 m,)
        p [N s], J x and J w.
    residual : float
        The natural map of the law, in rows scaled to unit normal entries of J M^-1 J', relative to the largest scaled
        speed of x, or of `lower`.
    case : ndarray of int, shape (m,)
        `OPEN`, `STICK` or `SLIP` of each contact; closed contacts without friction slip.
    unique : bool
        Whether percussions and velocity are known to be unique: rows are independent, and friction acts little on
        normals.
    start : ndarray, shape (3 m,)
        What the next projection of the same contacts can start from.
    """

    velocity: Array
    percussion: Array
    free: Array
    after: Array
    residual: float
    case: Array
    unique: bool
    start: Array


class FrictionalStart(NamedTuple):
    """What a projection can start from: fields of a `FrictionalProjection`."""

    start: Array
    unique: bool

    @property
    def known(self) -> int:
        """Which percussions these are, as `coulomb_law` counts them."""
        return UNIQUE if self.unique else COMPLIANT


# there is no start yet
NO_START = FrictionalStart(np.zeros(0), True)


def law_of_contacts(
    motion: TreeFreeMotion, J: Array, T: Array, e: Array, drift: Array, opened: Array, friction: Array,
    last: FrictionalStart, residual: float,
) -> tuple[Array, Array, float, Array, FrictionalStart] | None:  # fmt: skip
    """Return Coulomb's law for at most 64 contacts of one mechanism, in one kernel; None if the residual is too large.

    Parameters
    ----------
    motion : TreeFreeMotion
        The free motion.
    J, T, e, drift, opened, friction
        See `frictional_tree_law`, where friction is mu.
    last : FrictionalStart
        Ignored if it is of another number of contacts.
    residual : float
        The relative residual that is allowed.

    Returns
    -------
    velocity : ndarray, shape (nv,)
        The velocity after.
    rates : ndarray, shape (4, m)
        Percussions, and rates of normals under forces alone, after and before.
    residual : float
        See `FrictionalProjection`.
    slip : ndarray, shape (4, m, 2)
        The same as `rates` of tangents.
    start : FrictionalStart
        What the next law of the same contacts can start from.
    """
    m, nv = J.shape
    w, rates, slip = np.empty(nv), np.empty((4, m)), np.empty((4, m, 2))
    matches = len(last.start) == 3 * m
    known, start = (last.known, last.start.copy()) if matches else (NOTHING, np.zeros(3 * m))
    found, unique = frictional_tree_law(
        *motion.kernel_arguments, J, T, e, drift, opened, friction, known, AIM, start, w, rates, slip
    )
    # written so that a NaN is refused too
    if not 0.0 <= found <= residual:
        return None
    return w, rates, found, slip, FrictionalStart(start, unique)


def project_frictional(
    x: Array,
    metric: Metric,
    J: Array,
    lower: Array,
    friction: Array,
    residual: float = 1e-6,
    start: FrictionalProjection | FrictionalStart | None = None,
    bound: Array | None = None,
) -> FrictionalProjection:
    """Return the velocity w that Coulomb's law gives, with M (w - x) = J' p.

    For each contact, K_mu ∋ p ⊥ (u_n + mu |u_t|, u_t) ∈ K_mu* with u = J w - lower (Moreau; De Saxcé).

    Parameters
    ----------
    x : ndarray, shape (nv,)
        Velocity under the forces alone.
    metric : Metric
        M.
    J : ndarray, shape (3 m, nv)
        Of each contact the normal and two tangents, all of unit length and orthogonal to each other in space. Tangents
        of contacts without friction may be zero.
    lower : ndarray, shape (m,) or (3 m,)
        Least normal rates [m/s], or of each contact that and the rates of its tangents at which it sticks: the velocity
        of a belt.
    friction : ndarray, shape (m,)
        Coefficients of friction.
    residual : float
        The relative residual above which this raises.
    start : FrictionalProjection, optional
        That of the same contacts in a problem like this, such as one time step before. It saves time and does not
        change the answer. Ignored if the number of contacts differs.
    bound : ndarray of int, shape (m,), optional
        See `coulomb_law`; no contact is bounded by another by default.

    Raises
    ------
    ProjectionError
        If the residual is not reached; the message states the margin of existence.
    """
    J, n = plain_array(J), len(J)
    w, table, case = np.empty(len(x)), np.empty((3, n)), np.empty(len(friction), np.int64)
    known, first = NOTHING, np.zeros(n)
    if start is not None and len(start.start) == n:
        known, first = UNIQUE if start.unique else COMPLIANT, start.start.copy()
    limit = AIM if len(friction) <= MOST_CONTACTS else 1e-2 * residual
    A, lower, mu = _solved(metric, J), _wide(lower, n), plain_array(friction)
    bound = np.full(len(mu), -1, np.int64) if bound is None else bound
    found, unique = coulomb_law(J, A, plain_array(x), lower, mu, bound, known, limit, first, w, table, case)
    # written so that a NaN is refused too
    if not found <= residual:
        raise _failure(found, residual, metric, {"x": x, "J": J, "lower": lower, "friction": friction})
    return FrictionalProjection(w, table[0], table[1], table[2], found, case, unique, first)


def _wide(lower: Array, n: int) -> Array:
    """Return the bounds of all n rows, given those, or those of normals."""
    if len(lower) == n:
        return plain_array(lower)
    wide = np.zeros(n)
    wide[::3] = lower
    return wide


def _solved(metric: Metric, J: Array) -> Array:
    """Return M^-1 times each row of J."""
    if type(metric) is TreeMetric:
        A = np.empty(J.shape)
        solve(metric.lower, metric.parent, J, np.empty(J.shape), A)
        return A
    return plain_array(metric.solve_rows(J))


def _failure(found: float, residual: float, metric: Metric, problem: dict[str, Array]) -> ProjectionError:
    """Return the error of a problem that was not solved, with the margin of existence."""
    J, m = problem["J"], len(problem["friction"])
    problem = {**problem, "M": metric.dense()}
    still = ~J[::3].any(axis=1)
    if (problem["lower"][::3][still] > 0.0).any():
        message = "a contact whose normal row vanishes demands a positive rate: no velocity gives it"
        return ProjectionError(message, problem, found)
    moving = np.repeat(~still, 3)
    # dry friction of joints alone always has a solution
    margin = existence_margin(metric, J[moving], problem["friction"][~still]) if moving.any() else np.inf
    if margin > 0.0:
        existence = f"a solution exists (margin {margin:.1e})"
    else:
        existence = "no velocity opens all contacts at once (margin 0), so that there may be no solution"
    message = f"Coulomb's law for {m} contacts stopped at the relative residual {found:.1e}, above {residual:.1e}"
    return ProjectionError(f"{message}; {existence}; the problem is in `.problem`", problem, found)
