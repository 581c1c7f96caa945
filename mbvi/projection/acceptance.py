"""Which answers of solvers a run accepts: by their residual, and by how deep each row sinks, in its own units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.sparse import csr_array

from ..errors import ProjectionError
from .dense.scaled_qp import ScaledQP
from .metric import Array

Answer = TypeVar("Answer")
# error of a rate, in accepted depths per step: an accepted depth also holds what earlier steps left
_SHARE = 0.25
# the largest residual that follows from a depth
_MOST_RESIDUAL = 1e-2
# the largest relative residual of Coulomb's law for contacts of mechanisms
OF_MECHANISMS = 1e-6
# where a row sinks too deep, so often a residual is made so much smaller that half of the stated depth is expected
_MOST_FINER = 3
# the second bound of a residual, relative to the first, and its largest value
_SECOND, _MOST_SECOND = 1e3, 1e-2


class AcceptedDepth(NamedTuple):
    """The penetration that a run of many bodies accepts, from which its residual follows.

    Attributes
    ----------
    relative : float
        Relative to a size of the bodies.
    depth : float
        The same as a length [m].
    levers : callable
        Returns the factors that turn gaps of constraints, given by their numbers, into lengths.
    """

    relative: float
    depth: float
    levers: Callable[[Array], Array | float]

    def residual(self, qp: ScaledQP, contacts: Array | None, h: float) -> float:
        """Return the relative residual with which the gaps of a step h [s] are off by a quarter of the depth at most.

        A scaled row whose residual is r times the largest scaled speed s has the rate error r s l, where l is the
        length of its gradient in the metric. The residual is never larger than the relative depth or 1e-2: slow bodies
        would otherwise move at the speeds that it leaves.
        """
        lengths = qp.lengths if contacts is None else qp.lengths * self.levers(contacts)
        found = self.rate(h) / (qp.scale * qp.largest * float(lengths.max()))
        return min(found, self.largest_residual)

    def rate(self, h: float) -> float:
        """Return the error of a rate with which the gaps of a step h [s] are off by a quarter of the depth [m/s]."""
        return _SHARE * self.depth / h

    @property
    def largest_residual(self) -> float:
        """The residual of slow bodies, which does not follow from the depth."""
        return min(self.relative, _MOST_RESIDUAL)


class StatedDepth(NamedTuple):
    """How deep an error of a projection may let any row sink in one step, whatever else the scene holds.

    A residual is relative to the largest speed of a scene. It says little of a light finger beside a falling trunk.

    Attributes
    ----------
    depth, tolerance : float
        The depth above which an answer is refused, and the activation tolerance, which is aimed at: a contact that
        moves by less within a step counts as closed [m].
    h : float
        Length of a step [s].
    levers : callable
        See `AcceptedDepth`.
    jointed : ndarray of bool, shape (nv,)
        The velocities of mechanisms; the others are those of free bodies.
    """

    depth: float
    tolerance: float
    h: float
    levers: Callable[[Array], Array | float]
    jointed: Array

    def of_mechanisms(self, J: Array | csr_array) -> Array:
        """Return which rows act on a mechanism, shape (k,)."""
        if isinstance(J, np.ndarray):
            return np.asarray(J[:, self.jointed].any(axis=1))
        entry = self.jointed[J.indices] & (J.data != 0.0)
        return np.bincount(np.repeat(np.arange(J.shape[0]), np.diff(J.indptr)), entry, J.shape[0]) > 0.0

    def aims(self, numbers: Array) -> Array:
        """Return the errors of rates that are aimed at for rows of constraints, shape (k,) [m/s, rad/s]."""
        return np.asarray(np.ones(len(numbers)) * self.tolerance / (self.h * self.levers(numbers)))

    def worst(self, numbers: Array, closing: Array) -> tuple[int, float]:
        """Return the row that sinks deepest within a step, and its depth relative to the stated one.

        `closing`, shape (k,), says how much faster rows close than they may [m/s, rad/s].
        """
        depth = np.asarray(closing * self.levers(numbers)) * self.h / self.depth
        row = int(depth.argmax())
        return row, float(depth[row])


class Acceptance:
    """The bounds of residuals and depths of a run.

    Parameters
    ----------
    stated : StatedDepth, optional
        How deep an error may let a row sink; without it only residuals count.

    Attributes
    ----------
    second : bool
        Whether residuals have their second bound, a thousand times the first and at most 1e-2.
    beyond : list of (float, int or None)
        Residuals between both bounds that were accepted, each with the constraint of a row of that projection.
    """

    def __init__(self, stated: StatedDepth | None = None) -> None:
        self.stated, self.second = stated, False
        self.beyond: list[tuple[float, int | None]] = []

    @contextmanager
    def second_bound(self) -> Iterator[None]:
        """Accept residuals up to their second bound within a block."""
        self.second = True
        try:
            yield
        finally:
            self.second = False

    def bound(self, residual: float) -> float:
        """Return the residual above which an answer is refused, where `residual` is the first bound."""
        return max(residual, min(_SECOND * residual, _MOST_SECOND)) if self.second else residual

    def excess(self, numbers: Array | None, closing: Array) -> float:
        """Return the depth by which a row sinks, relative to the stated one; 0 where nothing is stated.

        The arguments are those of `check`.
        """
        if numbers is None or self.stated is None or not len(closing):
            return 0.0
        return self.stated.worst(numbers, closing)[1]

    def refined(
        self, numbers: Array | None, found: tuple[Answer, Array],
        again: Callable[[float, Answer], tuple[Answer, Array] | None],
    ) -> tuple[Answer, Array]:  # fmt: skip
        """Return an answer of a smaller residual where a row of the given one sinks too deep, as far as there is one.

        Parameters
        ----------
        numbers : ndarray of int, shape (k,), or None
            See `check`.
        found : tuple
            An answer of the residual that is asked, and how much faster its rows close than they may, shape (k,)
            [m/s, rad/s].
        again : callable
            Returns a better answer with the same, given a factor of the residual and an answer to start from; None if
            there is none.
        """
        factor = 1.0
        for _ in range(_MOST_FINER):
            excess = self.excess(numbers, found[1])
            if not excess > 1.0:
                break
            factor *= min(0.5, 0.5 / excess)
            better = again(factor, found[0])
            if better is None:
                break
            found = better
        return found

    def check(
        self, found: float, residual: float, numbers: Array | None, closing: Array,
        about: Callable[[], dict[str, Any]],
    ) -> None:  # fmt: skip
        """Raise `ProjectionError` if a row sinks too deep; note an answer that only the second bound accepts.

        Parameters
        ----------
        found, residual : float
            The residual of an answer, and its first bound.
        numbers : ndarray of int, shape (k,), or None
            The constraints of its rows; None if they are no rates of gaps.
        closing : ndarray, shape (k,)
            How much faster they close than they may [m/s, rad/s].
        about : callable
            Returns the problem, for the error.
        """
        depth = self.excess(numbers, closing)
        # written so that a NaN is refused too
        if not depth <= 1.0 and numbers is not None and self.stated is not None:
            raise ProjectionError(
                f"the answer of relative residual {found:.1e} would let a row sink by {depth:.1e} times the stated "
                "depth in one step; the problem is in `.problem`",
                about(),
                found,
                int(numbers[self.stated.worst(numbers, closing)[0]]),
            )
        if found > residual:
            self.beyond.append((found, None if numbers is None or not len(numbers) else int(numbers[closing.argmax()])))
