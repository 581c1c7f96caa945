"""Where the grains of a scene start: lattices, random packings, layers to be dropped, and what has been poured.

Each function returns a `Packing`, positions and radii, that no two spheres of overlap, and
`scene.add_spheres(*packing, density=2500.0)` takes. The same seed gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .errors import InputError

Array = np.ndarray
Size = float | Sequence[float] | Array | Callable[[np.random.Generator, int], Array]

# spheres proposed at once, and how many rounds of that may in a row place none
_PROPOSED, _MOST_VAIN = 4096, 100
# radii within such a factor share a tree of neighbours
_CLASS = 2.0
_ROUNDING = 1e-12


class Packing(NamedTuple):
    """Spheres that do not overlap.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        Centres [m].
    radii : ndarray, shape (n,)
        Radii [m].
    """

    positions: Array
    radii: Array


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


def lattice(
    shape: Sequence[int],
    radius: Size,
    spacing: float | None = None,
    corner: Sequence[float] | Array = (0.0, 0.0, 0.0),
    jitter: float = 0.0,
    seed: int = 0,
) -> Packing:
    """Return spheres on a cubic lattice.

    Parameters
    ----------
    shape : sequence of int, shape (3,)
        How many along x, y and z.
    radius : float, array_like of shape (n,), or a size distribution
        Radii [m].
    spacing : float, optional
        Distance of neighbouring sites [m]; by default as near as radii and jitter allow.
    corner : array_like, shape (3,)
        Site of the lowest corner [m].
    jitter : float
        Each centre is off its site by up to this along each axis [m].
    seed : int
        Of sizes and jitter.

    Raises
    ------
    InputError
        If spheres of these sizes could overlap, or on numbers that are not positive.
    """
    sites = np.array(shape)
    if sites.shape != (3,) or sites.dtype.kind != "i" or not (sites > 0).all():
        raise InputError(f"shape must be three positive integers; got {shape!r}")
    rng = np.random.default_rng(seed)
    radii = _sizes(radius, int(sites.prod()), rng)
    least = 2.0 * (float(radii.max()) + jitter)
    spacing = least if spacing is None else float(spacing)
    if not (jitter >= 0.0 and spacing >= least * (1.0 - _ROUNDING)):
        raise InputError(f"spheres on sites {spacing:g} m apart could overlap: radii and jitter ask for {least:g} m")
    grid = np.stack(np.meshgrid(*map(np.arange, sites), indexing="ij"), axis=-1).reshape(-1, 3)
    off = rng.uniform(-jitter, jitter, grid.shape)
    return Packing(np.asarray(corner, dtype=float) + spacing * grid + off, radii)


def random_loose(
    lower: Sequence[float] | Array,
    upper: Sequence[float] | Array,
    radius: Size,
    count: int | None = None,
    fraction: float | None = None,
    seed: int = 0,
) -> Packing:
    """Return spheres placed at random in a box, the larger ones first, each where none is yet.

    Parameters
    ----------
    lower, upper : array_like, shape (3,)
        Corners of the box, which holds the spheres whole [m].
    radius : float, array_like of shape (n,), or a size distribution
        Radii [m].
    count : int, optional
        How many; that or `fraction`, unless radii are given one by one.
    fraction : float, optional
        Part of the box's volume that spheres fill, to within the last of them.
    seed : int
        Of sizes and places.

    Raises
    ------
    InputError
        If the box gets no more of them in: equal spheres jam at a fraction of 0.38, and above 0.33 it takes long.

    Notes
    -----
    Random sequential addition.
    """
    rng = np.random.default_rng(seed)
    low, high = _box(lower, upper)
    radii = _sizes(radius, count if fraction is None else _enough(radius, fraction, high - low, rng), rng)
    if fraction is not None:
        filled = np.cumsum(4.0 / 3.0 * np.pi * radii**3)
        radii = radii[filled <= fraction * float((high - low).prod())]
        if not radii.size:
            raise InputError(f"one sphere is more than the fraction {fraction:g} of the box")
    if 2.0 * radii.max() > (high - low).min():
        raise InputError(f"a sphere of radius {radii.max():g} does not fit into a box of {(high - low).tolist()}")
    positions = np.empty((len(radii), 3))
    # of each class of sizes that is placed already, the spheres and their tree
    placed: list[tuple[Array, Array]] = []
    sizes = np.floor(np.log(radii / radii.max()) / np.log(_CLASS))
    for size in np.unique(sizes)[::-1]:
        index = np.flatnonzero(sizes == size)
        index = index[np.argsort(-radii[index], kind="stable")]
        positions[index] = _placed_among(placed, radii[index], low, high, rng)
        placed.append((positions[index], radii[index]))
    return Packing(positions, radii)


def layers(
    lower: Sequence[float] | Array,
    upper: Sequence[float] | Array,
    radius: Size,
    count: int | None = None,
    clearance: float = 0.1,
    seed: int = 0,
) -> Packing:
    """Return spheres in loose layers on top of each other, to be dropped into what is below.

    Parameters
    ----------
    lower : array_like, shape (3,)
        Corner of the lowest layer's floor [m].
    upper : array_like, shape (2,) or (3,)
        Its opposite corner in x and y [m]; there are as many layers as it takes, so that a height is no bound.
    radius : float, array_like of shape (n,), or a size distribution
        Radii [m].
    count : int, optional
        How many, unless radii are given one by one.
    clearance : float
        Room around each, in largest radii, over which centres are spread at random.
    seed : int
        Of sizes and places.

    Raises
    ------
    InputError
        If the floor is too small for one sphere, or on numbers that are not positive.
    """
    rng = np.random.default_rng(seed)
    radii = _sizes(radius, count, rng)
    if not (clearance >= 0.0 and np.isfinite(clearance)):
        raise InputError(f"clearance must not be negative; got {clearance}")
    corner, far = np.array(lower, dtype=float), np.array(upper, dtype=float)
    if corner.shape != (3,) or far.shape not in ((2,), (3,)):
        raise InputError(f"lower has shape {corner.shape} and upper {far.shape}; (3,) and (2,) or (3,) are asked for")
    largest = float(radii.max())
    pitch = 2.0 * largest * (1.0 + clearance)
    sites = np.floor((far[:2] - corner[:2]) / pitch + _ROUNDING).astype(int)
    if not (sites > 0).all():
        raise InputError(f"a layer of {(far[:2] - corner[:2]).tolist()} m has no room for spheres {pitch:g} m apart")
    # spread over the whole floor
    width = np.append((far[:2] - corner[:2]) / sites, pitch)
    across, number = int(sites.prod()), np.arange(len(radii))
    layer, site = np.divmod(number, across)
    grid = np.stack([*np.divmod(site, sites[1]), layer], axis=1)
    off = rng.uniform(-1.0, 1.0, grid.shape) * (0.5 * width - largest)
    return Packing(corner + width * (grid + 0.5) + off, radii)


def _placed_among(
    placed: list[tuple[Array, Array]], radii: Array, low: Array, high: Array, rng: np.random.Generator
) -> Array:
    """Return centres, shape (n, 3), of spheres of similar radii, free of each other and of what is placed."""
    # imported here for its weight
    from scipy.spatial import cKDTree

    largest = float(radii.max())
    trees = [(cKDTree(centres), sizes) for centres, sizes in placed]
    positions, left, vain = np.empty((len(radii), 3)), np.arange(len(radii)), 0
    done = np.zeros(len(radii), bool)
    while left.size:
        owner = np.resize(left, max(_PROPOSED, left.size))
        size = radii[owner][:, None]
        points = low + size + rng.random((len(owner), 3)) * (high - low - 2.0 * size)
        free = np.ones(len(owner), bool)
        among = [*trees, (cKDTree(positions[done]), radii[done])] if done.any() else trees
        proposed = cKDTree(points)
        for tree, sizes in among:
            near = proposed.sparse_distance_matrix(tree, largest + float(sizes.max()), output_type="ndarray")
            free[near["i"][near["v"] < radii[owner[near["i"]]] + sizes[near["j"]]]] = False
        # the first free place of each, and of two that overlap the one that comes first
        chosen = np.flatnonzero(free)
        chosen = chosen[np.unique(owner[chosen], return_index=True)[1]]
        pairs = cKDTree(points[chosen]).query_pairs(2.0 * largest, output_type="ndarray") if chosen.size else None
        if pairs is not None and pairs.size:
            i, j = chosen[pairs.min(axis=1)], chosen[pairs.max(axis=1)]
            apart = np.linalg.norm(points[i] - points[j], axis=1)
            chosen = np.setdiff1d(chosen, j[apart < radii[owner[i]] + radii[owner[j]]])
        positions[owner[chosen]], done[owner[chosen]] = points[chosen], True
        left = np.flatnonzero(~done)
        vain = 0 if chosen.size else vain + 1
        if vain > _MOST_VAIN:
            raise InputError(
                f"{left.size} of {len(radii)} spheres find no place at random: take fewer, a larger box, or `layers`"
            )
    return positions


def _sizes(radius: Size, count: int | None, rng: np.random.Generator) -> Array:
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


def _enough(radius: Size, fraction: float, size: Array, rng: np.random.Generator) -> int | None:
    """Return how many spheres surely fill a fraction of a box."""
    if not 0.0 < fraction < 1.0:
        raise InputError(f"fraction must lie between 0 and 1; got {fraction}")
    if not callable(radius) and np.ndim(radius):
        return None
    sample = _sizes(radius, 1000, rng)
    return int(1.5 * fraction * size.prod() / (4.0 / 3.0 * np.pi * float((sample**3).mean()))) + 10


def _box(lower: Sequence[float] | Array, upper: Sequence[float] | Array) -> tuple[Array, Array]:
    low, high = np.array(lower, dtype=float), np.array(upper, dtype=float)
    if low.shape != (3,) or high.shape != (3,) or not (np.isfinite(low) & (low < high) & np.isfinite(high)).all():
        raise InputError(f"lower and upper must be the corners of a box; got {low.tolist()} and {high.tolist()}")
    return low, high


def _check_range(low: float, high: float) -> None:
    # written so that a NaN is refused too
    if not 0.0 < low <= high < np.inf:
        raise InputError(f"radii must lie between two positive numbers; got {low} and {high}")
