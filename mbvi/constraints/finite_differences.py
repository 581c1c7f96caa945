"""Directional derivatives by central differences, with error bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..errors import MbviError
from ..system import System

Array = np.ndarray

# lengths of differences, relative to the scale of q: of a full check, and of a quick one
_ALL, _FEW = 10.0 ** -np.arange(2.0, 10.0), 10.0 ** -np.arange(4.0, 8.0)
# relative rounding error of one value of f
_EPS = 2.3e-16
# the shortest difference is taken whose error is at most so many times the least error, or this part of the slope
_NEARLY, _PRECISE = 10.0, 1e-5
# two lengths have the same slope if their slopes differ by less than this part of the steepest
_ALIKE = 1e-4


class Slopes(NamedTuple):
    """Derivatives of m functions along k directions, each of shape (k, m).

    Attributes
    ----------
    middle : ndarray
        By central differences; NaN where these are not finite.
    low, high : ndarray
        Bounds of the derivative: they include the slopes on both sides, so that a gradient at a kink is accepted, and
        the estimated error.
    """

    middle: Array
    low: Array
    high: Array


def slopes(f: Callable[[Array], Any], here: Array, along: Array, scale: float, full: bool) -> Slopes:
    """Return the derivatives at w = 0 of functions of a displacement w.

    Parameters
    ----------
    f : callable
        f(w) -> values, shape (m,), of the displacement w, shape (nv,). Where it raises, values count as unknown.
    here : ndarray, shape (m,)
        f(0).
    along : ndarray, shape (k, nv)
        Unit directions.
    scale : float
        The size of q, by which the lengths of differences are multiplied.
    full : bool
        Whether to try differences of eight lengths, or of four.
    """
    lengths = scale * (_ALL if full else _FEW)
    found = np.array([[[_value(f, s * h * u, len(here)) for s in (1.0, -1.0)] for h in lengths] for u in along])
    plus, minus = found[:, :, 0], found[:, :, 1]
    h = lengths[None, :, None]
    with np.errstate(all="ignore"):
        central = (plus - minus) / (2.0 * h)
        rounding = _EPS * np.maximum(np.abs(plus), np.abs(minus)) / h + _EPS * np.abs(here) / h
        error = np.abs(np.diff(central, axis=1)) + rounding[:, 1:]
        error[~np.isfinite(error)] = np.inf
        least = error.min(axis=1, keepdims=True)
        enough = error <= np.maximum(_NEARLY * least, _PRECISE * np.abs(central[:, 1:]))
        # the shortest of these lengths, as the last of them
        best = (error.shape[1] - 1 - enough[:, ::-1].argmax(axis=1))[:, None]
        middle = np.take_along_axis(central[:, 1:], best, 1)[:, 0]
        off = 2.0 * np.take_along_axis(error, best, 1)[:, 0]
        forward = np.take_along_axis(((plus - here) / h)[:, 1:], best, 1)[:, 0]
        backward = np.take_along_axis(((here - minus) / h)[:, 1:], best, 1)[:, 0]
        # a function with small jumps or noise has one slope at short lengths and another at long ones: allow both
        flat = error <= _ALIKE * np.abs(central).max(axis=1, keepdims=True, initial=0.0) + rounding[:, 1:]
        least_flat = np.where(flat, central[:, 1:], np.inf).min(axis=1)
        most_flat = np.where(flat, central[:, 1:], -np.inf).max(axis=1)
        low = np.minimum(np.minimum(np.minimum(forward, backward), middle), least_flat) - off
        high = np.maximum(np.maximum(np.maximum(forward, backward), middle), most_flat) + off
    unknown = ~np.isfinite(np.take_along_axis(error, best, 1)[:, 0])
    middle[unknown], low[unknown], high[unknown] = np.nan, -np.inf, np.inf
    return Slopes(middle, low, high)


def _value(f: Callable[[Array], Any], w: Array, count: int) -> Array:
    """Return f(w); NaN where it fails: a user's function need not be defined where the motion never comes."""
    try:
        value = np.asarray(f(w), dtype=float).reshape(-1)
    except Exception:
        return np.full(count, np.nan)
    return value if len(value) == count else np.full(count, np.nan)


def directions_along(system: System, q: Array, gradient: Array, full: bool) -> Array:
    """Return unit vectors along the gradients and, if `full`, along M^-1 times them, shape (k, nv)."""
    along = gradient
    if full:
        try:
            along = np.concatenate([along, system.metric(q).solve_rows(gradient)])
        except MbviError:
            # the error is raised where M is needed
            pass
    lengths = np.linalg.norm(along, axis=1)
    usable = np.isfinite(lengths) & (lengths > 0.0)
    return np.asarray(along[usable] / lengths[usable, None])


def random_directions(nv: int) -> Array:
    """Return some unit vectors, shape (8, nv), the same each time."""
    directions = np.random.default_rng(0).normal(size=(8, nv))
    return np.asarray(directions / np.linalg.norm(directions, axis=1)[:, None])
