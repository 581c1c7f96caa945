"""Implicit steps where the directions of slow slips turn so fast that explicit steps would have to be tiny.

A slip s turns at the rate mu N w / |s|, w the response of its contact. Where a slip begins or ends gently, that rate is
far above those of all else, and the direction follows at once what drives it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....system.system import Array
from ..runge_kutta import DEGREE, MARGIN, Flow, RungeKuttaStep
from .modes import ContactModes, aside

# turns of directions in a step, as rate times length, above which steps are implicit
_STIFF = 2.0
# most sweeps of Newton's method; its last change, relative to the error that is allowed and to the speeds
_MOST_SWEEPS, _EXACT, _ROUNDING = 15, 1e-4, 1e-14
# sweeps after which changes must fall, and the largest turn of a direction in one [rad]
_MOST_RISING, _MOST_TURN = 3, 0.7
_STAGES = DEGREE
# where the equations are checked, and the largest error of states over a step for a unit error of rates at its start
_CHECKED, _REACHED = 0.43, 0.0175
# weight of the rates in the filter of errors: the real eigenvalue of the weights
_FILTER = 0.112


def _radau(stages: int) -> tuple[Array, Array]:
    """Return the nodes of Radau's quadrature on (0, 1], and the integrals of their Lagrange polynomials.

    These are the coefficients of x, x^2, ... of each, shape (stages, stages). The nodes are the roots of
    d^(s-1)/dx^(s-1) (x^(s-1) (x - 1)^s) (Hairer, Wanner 1996, IV.5).
    """
    x = np.polynomial.Polynomial([0.0, 1.0])
    nodes = np.sort((x ** (stages - 1) * (x - 1.0) ** stages).deriv(stages - 1).roots().real)
    nodes[-1] = 1.0
    return nodes, np.linalg.inv(np.vander(nodes, increasing=True)).T / np.arange(1, stages + 1)


_NODES, _INTEGRALS = _radau(_STAGES)
_POWERS = np.arange(1, _STAGES + 1)
# weights of the rates at the nodes in the states at these, and in the rates at the start of a step
_WEIGHTS, _AT_START = _NODES[:, None] ** _POWERS @ _INTEGRALS.T, _INTEGRALS[:, 0]


class _Nodes(NamedTuple):
    """What holds at n nodes, where k contacts slip.

    Attributes
    ----------
    rates : ndarray, shape (n, ...)
        The rows of `RungeKuttaStep.rates`.
    turned : ndarray, shape (n, k, nv)
        What unit turns of the directions of slip change accelerations by.
    across : ndarray, shape (n, k, nv)
        Gradients of the slips across these directions.
    along, beside : ndarray, shape (n, k)
        Slips along the directions and across them [m/s].
    """

    rates: Array
    turned: Array
    across: Array
    along: Array
    beside: Array


class ImplicitSteps:
    """Steps by collocation at Radau's seven nodes, of order 13 (Hairer, Wanner 1996, IV.5 and IV.8).

    The directions of slip at the nodes are unknowns of their own: each slip must have no part across its direction.
    Newton's method takes the derivatives by directions, which are known; all else varies slowly in a step, and sweeps
    find it. At a stop the direction is continued, and the slip becomes negative.

    Parameters
    ----------
    flow : Flow
        The smooth motion.
    modes : ContactModes
        Which contacts slip.
    units : ndarray, shape (nv,)
        See `velocity_units`.
    allowed : float
        Error that one step may have, in units.
    """

    def __init__(self, flow: Flow, modes: ContactModes, units: Array, allowed: float) -> None:
        self._flow, self._modes, self._units, self._allowed = flow, modes, units, allowed

    def needed(self, h: float) -> bool:
        """Return whether directions of slip turn often in a step of length h, which `ContactModes.begin` has begun."""
        modes = self._modes
        if modes.start is None or modes.sticks.all():
            return False
        equations, found = modes.start
        way = modes.directions(equations)
        rate = np.abs(np.vecdot(np.vecmat(aside(way), equations.T), equations.turned(modes.sticks, way, found)))
        change = np.vecdot(np.matvec(equations.T, found.acceleration) - equations.along, way)
        size = np.linalg.norm(equations.slip, axis=1) + h * np.abs(change)
        return bool((h * rate > _STIFF * size).any())

    def _slips(self) -> Array:
        """Return which closed contacts slip with friction."""
        modes = self._modes
        assert modes.start is not None
        return np.asarray(~modes.sticks & (modes.start[0].mu > 0.0))

    def step(self, t: float, q: Array, v: Array, a: Array, h: float, closed: Array) -> RungeKuttaStep | None:
        """Take one step of length h with its dense output, see `Flow.step`; None where Newton's method fails."""
        at, nv = (t, q, v, h, closed), len(v)
        K = np.tile(np.concatenate([v, a]), (_STAGES, 1))
        angle, units = np.zeros((_STAGES, self._slips().sum())), np.resize(self._units, K.shape[1])
        before = np.inf
        for sweep in range(_MOST_SWEEPS):
            nodes = self._evaluate(at, _NODES, _WEIGHTS @ K, angle)
            if not np.isfinite(nodes.rates).all():
                return None
            change, turn = _newton(nodes, K, h)
            angle, K = angle + turn, K + change
            size = float(np.abs(h * change / units).max())
            speed = float(np.abs((v + h * _WEIGHTS @ K[:, nv : 2 * nv]) / self._units).max())
            if size <= max(_EXACT * self._allowed, _ROUNDING) * max(1.0, speed):
                break
            if sweep >= _MOST_RISING and size >= before:
                return None
            before = size
        else:
            return None
        if (nodes.along[0] < 0.0).any():
            return None
        dense = np.array([K[:, :nv].T, K[:, nv : 2 * nv].T]) @ _INTEGRALS
        dq, dv = h * dense.sum(axis=2)
        place = self._flow.system.integrate(q, dq)
        # read-only, so that results computed for this array remain valid
        place.setflags(write=False)
        travel = MARGIN * h * np.abs(K[:, :nv]).max(axis=0)
        error = self._error(at, a, K, nodes, angle)
        return RungeKuttaStep(t, h, q, v, place, v + dv, K[-1, nv:], travel, K, error, dense)

    def _evaluate(
        self, at: tuple[float, Array, Array, float, Array], shares: Array, change: Array, angles: Array
    ) -> _Nodes:
        """Return what holds at shares of a step, with the directions at its start turned by angles, shape (n, k).

        `change` holds the changes of the chart's coordinates and of the velocities, over h.
        """
        system, modes, (t, q, v, h, closed) = self._flow.system, self._modes, at
        found, nv, slips = [], len(v), self._slips()
        for share, (dq, dv), angle in zip(
            shares.tolist(), h * change[:, : 2 * nv].reshape(-1, 2, nv), angles, strict=True
        ):
            place, speed = system.integrate(q, dq), v + dv
            if self._flow.has_loops:
                speed = system.tangent(place, speed)
            equations = modes.equations(t + share * h, place, speed, closed)
            way = modes.kept_way(equations)
            way[slips] = np.cos(angle)[:, None] * way[slips] + np.sin(angle)[:, None] * aside(way[slips])
            forces = equations.forces(modes.sticks, way)
            rates = np.concatenate([system.chart_rate(q, dq, speed), forces.acceleration, equations.normals.free])
            side = aside(way)
            found.append((
                rates, equations.turned(modes.sticks, way, forces)[slips], np.vecmat(side, equations.T)[slips],
                np.vecdot(way, equations.slip)[slips], np.vecdot(side, equations.slip)[slips],
            ))  # fmt: skip
        return _Nodes(*(np.array(column) for column in zip(*found, strict=True)))

    def _error(
        self, at: tuple[float, Array, Array, float, Array], a: Array, K: Array, nodes: _Nodes, angle: Array
    ) -> Array:
        """Return the errors of the dense output: what it misses of the rates, less what directions damp of that."""
        (_, _, v, h, _), nv = at, self._flow.system.nv
        states, rates = _INTEGRALS @ _CHECKED**_POWERS, _INTEGRALS @ (_POWERS * _CHECKED ** (_POWERS - 1))
        middle = self._evaluate(at, np.array([_CHECKED]), (states @ K)[None], (rates @ angle)[None])
        missed = np.array([np.concatenate([v, a]) - _AT_START @ K, middle.rates[0] - rates @ K])
        # where slips are faster, directions damp less
        along = np.maximum(nodes.along[-1], middle.along[0])
        U, W = middle.turned[0], middle.across[0] / np.where(along > 0.0, along, np.inf)[:, None]
        part = np.linalg.solve(np.eye(len(U)) - _FILTER * h * W @ U.T, _FILTER * h * W @ missed[:, nv : 2 * nv].T)
        missed[:, nv : 2 * nv] += part.T @ U
        return np.asarray(_REACHED * h * np.abs(missed).max(axis=0))


def _newton(nodes: _Nodes, K: Array, h: float) -> tuple[Array, Array]:
    """Return the changes of the rates K at s nodes and of the directions of slip by a step of Newton's method."""
    residual = nodes.rates - K
    s, k, nv = nodes.turned.shape
    missing = nodes.beside + h * np.einsum("ij,ikv,jv->ik", _WEIGHTS, nodes.across, residual[:, nv : 2 * nv])
    matrix = h * np.einsum("ij,ikv,jlv->ikjl", _WEIGHTS, nodes.across, nodes.turned).reshape(s * k, s * k)
    # least squares, because in a plane directions cannot turn
    turn = np.linalg.lstsq(np.diag(nodes.along.ravel()) - matrix, missing.ravel())[0].reshape(s, k)
    turn *= _MOST_TURN / max(_MOST_TURN, float(np.abs(turn).max()))
    residual[:, nv : 2 * nv] += np.einsum("ik,ikv->iv", turn, nodes.turned)
    residual[:, :nv] += h * _WEIGHTS @ residual[:, nv : 2 * nv]
    return residual, turn
