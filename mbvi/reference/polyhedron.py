"""Force-free motions between plane walls, with a constant mass matrix: straight lines with exact impacts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from ..arguments import array, between, boolean, shown
from ..constraints import GapFunction
from ..errors import InputError
from ..problem import Problem
from ..system import LagrangianSystem
from .law import law
from .solution import Array, Pieces, Reference, State, Times, checked, column

_MOST_IMPACTS = 1000
# gaps below the first, and speeds relative to the largest below the second, count as zero
_TOUCHING, _STILL = 1e-13, 1e-14
# impacts closer than this travel count as an accumulation, whose limit is not computed [m]
_LEAST_TRAVEL = 1e-10

_STRAIGHT = "straight lines between impacts at the roots of linear functions, the law (8) by enumeration; "


def corner(
    e: float,
    angle: float = np.pi / 2,
    mass: Sequence[Sequence[float]] | Array = ((2.0, 0.5), (0.5, 1.0)),
    aim: bool = False,
    duration: float = 2.5,
) -> Reference:
    """Return a force-free point in the corner between two walls of any kinetic angle.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    angle : float
        Angle between the walls measured in the kinetic metric, inside K, in (0, pi) [rad].
    mass : array_like, shape (2, 2)
        Mass matrix, constant.
    aim : bool
        Whether the point aims exactly at the corner. Otherwise it strikes one wall after the other.
    duration : float
        [s].

    Raises
    ------
    InputError
        If an argument is out of its range, or impacts accumulate before the end.

    Notes
    -----
    With M = L L' the map y = L' q makes kinetic angles those of the plane; K is {0 <= arg y <= angle} there. Condition
    (12) holds for e = 0 up to a right angle, for e > 0 at a right angle only: at other angles the motion through the
    corner itself does not depend continuously on the data.
    """
    e, duration = checked(e, duration)
    M, aim = array(mass, "mass", (2, 2)), boolean(aim, "aim")
    if not np.allclose(M, M.T) or not np.linalg.eigvalsh(M)[0] > 0:
        raise InputError(f"mass must be symmetric positive definite, shape (2, 2); got {shown(mass)}")
    # beyond pi, K is not an intersection of two half-planes
    angle = between(angle, "angle", 0.0, np.pi, ends=False)
    L = np.linalg.cholesky(M)
    N = np.array([[0.0, 1.0], [np.sin(angle), -np.cos(angle)]]) @ L.T
    middle = np.array([np.cos(angle / 2), np.sin(angle / 2)])
    if aim:
        y0, speed = middle, -middle
    else:
        # towards the lower wall, at the middle between the foot of the perpendicular and the corner
        y0 = middle
        speed = np.array([0.5 * middle[0], 0.0]) - y0
    q0, v0 = np.linalg.solve(L.T, y0), np.linalg.solve(L.T, speed)
    name = f"corner of {np.degrees(angle):.4g} degrees" + (", aimed at" if aim else "")
    return _reference(name, M, N, np.zeros(2), q0, v0, e, duration, ("lower wall", "upper wall"))


def chain(
    e: float,
    masses: Sequence[float] = (1.0, 1.0, 1.0),
    gaps: Sequence[float] = (0.5, 0.0),
    duration: float = 2.0,
) -> Reference:
    """Return balls in a row; the first arrives at speed one and strikes the others, which are at rest.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    masses : sequence of float, n of them
        [kg].
    gaps : sequence of float, n - 1 of them
        Distances between neighbours, zero where they touch [m]; the first is the travel of the first ball.
    duration : float
        [s].

    Raises
    ------
    InputError
        If an argument is out of its range, or impacts accumulate before the end.

    Notes
    -----
    Condition (12) fails at e > 0 if balls touch: the outcome of the law differs from that of balls that almost touch.
    Rounding decides which one a scheme finds, unless it treats touching balls as active.
    """
    e, duration = checked(e, duration)
    m, d = array(masses, "masses", ("n",)), array(gaps, "gaps")
    if len(m) < 2 or not (m > 0).all():
        raise InputError(f"masses must be two positive numbers or more; got {shown(masses)}")
    if d.shape != (len(m) - 1,) or not (d >= 0).all() or d[0] == 0:
        raise InputError(
            f"gaps must be {len(m) - 1} numbers >= 0, one between each two balls, the first positive; got {shown(gaps)}"
        )
    n = len(m)
    N = np.eye(n)[1:] - np.eye(n)[:-1]
    # coordinates in which touching balls are at equal values to the last bit
    q0, v0 = np.concatenate([[0.0], np.cumsum(d)]), np.eye(n)[0]
    kind = "touching" if (d[1:] == 0).any() else "apart"
    equal = "" if (m == m[0]).all() else ", unequal masses"
    name = f"chain of {n}, {kind}{equal}"
    labels = tuple(f"ball {k} | ball {k + 1}" for k in range(1, n))
    return _reference(name, np.diag(m), N, np.zeros(n - 1), q0, v0, e, duration, labels)


def _reference(
    name: str, M: Array, N: Array, c: Array, q0: Array, v0: Array, e: float, duration: float, labels: tuple[str, ...]
) -> Reference:
    """Return the force-free motion in {N q >= c}."""
    d = len(q0)
    at, impacts = _fly(M, N, c, q0, v0, e, duration)
    gaps = [
        GapFunction(lambda q, n=n, b=b: n @ q - b, lambda q, n=n: n, name=label)  # type: ignore[misc]
        for n, b, label in zip(N, c, labels, strict=True)
    ]
    system = LagrangianSystem(lambda q: M, lambda t, q, v: np.zeros(d), d, lambda q: 0.0)
    problem = Problem(system, gaps, q0, v0, restitution=e)
    return Reference(name, problem, duration, at, impacts, f"{_STRAIGHT}exact to rounding")


def _fly(M: Array, N: Array, c: Array, q: Array, v: Array, e: float, duration: float) -> tuple[Pieces, Array]:
    """Return the motion and its impact times."""
    t, gap, speed = 0.0, N @ q - c, np.abs(v).max()
    starts, states = [t], [partial(_straight, t, q, v)]
    impacts: list[float] = []
    while True:
        gap[np.abs(gap) < _TOUCHING] = 0.0
        rate = N @ v
        closing = rate < -_STILL * speed
        wait = np.divide(gap, -rate, out=np.full(len(gap), np.inf), where=closing)
        if t + wait.min() > duration:
            return Pieces(starts, states, duration), np.array(impacts)
        if len(impacts) == _MOST_IMPACTS:
            raise InputError(f"more than {_MOST_IMPACTS} impacts before {t:g} s: choose a shorter duration")
        dt = float(wait.min())
        if impacts and 0.0 < dt * np.abs(v).max() < _LEAST_TRAVEL:
            raise InputError(f"impacts accumulate near {t:g} s: choose a shorter duration, or another angle or e")
        t, q, gap = t + dt, q + dt * v, gap + dt * rate
        touching = gap < _TOUCHING
        # the law acts on closing and touching walls together
        v = law(M, N[touching], v, e)
        starts.append(t)
        states.append(partial(_straight, t, q, v))
        impacts.append(t)


def _straight(start: float, q: Array, v: Array, t: Times) -> State:
    s = column(t - start)
    return q + s * v, v + 0.0 * s
