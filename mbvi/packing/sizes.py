"""Size distributions of spheres."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arguments import Array, all_positive, array, between, function, integer, positive, returned
from ..errors import InputError

# largest sigma whose radii are finite; least share of drawn radii that are kept; largest number of spheres
_LARGEST_SIGMA, _LEAST_SHARE, _MOST_SPHERES = 10.0, 1e-3, 100_000_000
Size = float | Sequence[float] | Array | Callable[[np.random.Generator, int], Array]


def uniform(low: float, high: float) -> Callable[[np.random.Generator, int], Array]:
    """Return a size distribution: radii are uniform between two limits [m].

    Raises
    ------
    InputError
        If not 0 < low <= high.
    """
    low, high = _range(low, high)
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
        Radii outside are drawn again [m]; by default those beyond three standard deviations.

    Raises
    ------
    InputError
        If median or sigma is not positive, or the median is not between low and high.
    """
    median, sigma = positive(median, "median"), positive(sigma, "sigma")
    between(sigma, "sigma", 0.0, _LARGEST_SIGMA)
    least = median * np.exp(-3.0 * sigma) if low is None else low
    most = median * np.exp(3.0 * sigma) if high is None else high
    least, most = _range(least, most)
    if not least < median < most:
        raise InputError(f"the median {median} must lie between low and high, {least:g} and {most:g}")
    below, above = (0.5 * (1.0 + math.erf(math.log(x / median) / (math.sqrt(2.0) * sigma))) for x in (least, most))
    if above - below < _LEAST_SHARE:
        raise InputError(f"low and high keep a share of {above - below:.1g} of the radii: widen them, or reduce sigma")

    def draw(rng: np.random.Generator, count: int) -> Array:
        radii = np.zeros(count)
        while (outside := np.flatnonzero((radii < least) | (radii > most))).size:
            radii[outside] = median * np.exp(sigma * rng.standard_normal(outside.size))
        return radii

    return draw


def sizes(radius: Size, count: int | None, rng: np.random.Generator) -> Array:
    """Return the radii, drawn from a distribution or as given."""
    number = None if count is None else integer(count, "count", 1)
    if number is not None and number > _MOST_SPHERES:
        raise InputError(f"count must be {_MOST_SPHERES} at most; got {number}")
    given: Any = radius
    if callable(radius):
        function(radius, "radius", "radius(rng, count) -> radii")
        if number is not None:
            given = returned(radius(rng, number), "radius(rng, count)")
    elif np.ndim(array(radius, "radius")):
        return all_positive(radius, "radius", len(array(radius, "radius", ("n",))) if number is None else number)
    if number is None:
        raise InputError("the number of spheres is missing: count must be a positive integer; got None")
    return all_positive(given, "radius", number)


def _range(low: float, high: float) -> tuple[float, float]:
    least, most = positive(low, "low"), positive(high, "high")
    if least > most:
        raise InputError(f"radii must lie between two positive numbers; got low = {least:g} above high = {most:g}")
    return least, most
