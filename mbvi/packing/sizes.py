"""Size distributions of spheres."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..errors import InputError

Array = np.ndarray
Size = float | Sequence[float] | Array | Callable[[np.random.Generator, int], Array]


def uniform(low: float, high: float) -> Callable[[np.random.Generator, int], Array]:
    """Return a size distribution: radii spread evenly between two [m].

    Raises
    ------
    InputError
        If not 0 < low <= high.
    """
    _check_range(low, high)
    return lambda rng, count: rng.uniform(low, high, count)


def lognormal(
    median: float, sigma: float, low: float | None = None, high: float | None = None
) -> Callable[[np.random.Generator, int], Array]:
    """Return a size distribution: the logarithm of the radius is normal.

    Parameters
    ----------
    median : float
        Median radius [m].
    sigma : float
        Standard deviation of the logarithm.
    low, high : float, optional
        Radii beyond these are drawn again [m]; three standard deviations by default.

    Raises
    ------
    InputError
        If median or sigma is not positive, or the median is not between low and high.
    """
    if not (median > 0.0 and sigma > 0.0 and np.isfinite(median) and np.isfinite(sigma)):
        raise InputError(f"median and sigma must be positive and finite; got {median} and {sigma}")
    least = median * np.exp(-3.0 * sigma) if low is None else low
    most = median * np.exp(3.0 * sigma) if high is None else high
    _check_range(least, most)
    if not least < median < most:
        raise InputError(f"the median {median} must lie between low and high, {least:g} and {most:g}")

    def draw(rng: np.random.Generator, count: int) -> Array:
        radii = np.zeros(count)
        while (outside := np.flatnonzero((radii < least) | (radii > most))).size:
            radii[outside] = median * np.exp(sigma * rng.standard_normal(outside.size))
        return radii

    return draw


def sizes(radius: Size, count: int | None, rng: np.random.Generator) -> Array:
    """Return the radii, drawn from a distribution or as given."""
    if callable(radius) or np.ndim(radius) == 0:
        if count is None or int(count) != count or count < 1:
            raise InputError(f"say how many spheres: count must be a positive integer; got {count!r}")
        count = int(count)
        radii = np.array(radius(rng, count) if callable(radius) else np.full(count, radius), dtype=float)
    else:
        radii = np.array(radius, dtype=float)
        if count is not None and radii.shape != (count,):
            raise InputError(f"radius has shape {radii.shape}; ({count},) is asked for")
    # written so that a NaN is refused too
    if radii.ndim != 1 or not radii.size or not ((radii > 0.0) & np.isfinite(radii)).all():
        raise InputError("every radius must be positive and finite, one a sphere")
    return radii


def _check_range(low: float, high: float) -> None:
    # written so that a NaN is refused too
    if not 0.0 < low <= high < np.inf:
        raise InputError(f"radii must lie between two positive numbers; got {low} and {high}")
