"""Random packings: spheres are placed one after the other, each where there is room."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import array, between, generator, optional, vector
from ..errors import InputError
from .sites import Packing
from .sizes import Array, Size, sizes

# spheres proposed in a round; rounds in a row that may place none before the box counts as full
_PROPOSED, _MOST_FAILED_ROUNDS = 4096, 100
# radii within this factor share a tree of neighbours
_CLASS = 2.0


def random_loose(
    lower: Sequence[float] | Array,
    upper: Sequence[float] | Array,
    radius: Size,
    count: int | None = None,
    fraction: float | None = None,
    seed: int = 0,
) -> Packing:
    """Return spheres placed at random in a box, the larger ones first, each where there is room.

    Parameters
    ----------
    lower, upper : array_like, shape (3,)
        Corners of the box; spheres lie inside entirely [m].
    radius : float, array_like of shape (n,), or a size distribution
        Radii [m].
    count : int, optional
        Number of spheres. Give it or `fraction`, unless radii are given one by one.
    fraction : float, optional
        Part of the box's volume that spheres fill, to within the volume of one.
    seed : int
        Seed of sizes and positions.

    Raises
    ------
    InputError
        If the spheres do not fit. Equal spheres jam at a fraction of 0.38; above 0.33 the search is slow.

    Notes
    -----
    Random sequential addition.
    """
    rng, (low, high) = generator(seed), _box(lower, upper)
    fraction = optional(between, fraction, "fraction", 0.0, 1.0)
    radii = sizes(radius, count if fraction is None else _sufficient_count(radius, fraction, high - low, rng), rng)
    if fraction is not None:
        filled = np.cumsum(4.0 / 3.0 * np.pi * radii**3)
        radii = radii[filled <= fraction * float((high - low).prod())]
        if not radii.size:
            raise InputError(f"one sphere is larger than the fraction {fraction:g} of the box")
    if 2.0 * radii.max() > (high - low).min():
        raise InputError(f"a sphere of radius {radii.max():g} does not fit into a box of {(high - low).tolist()}")
    positions = np.empty((len(radii), 3))
    # for each class of sizes already placed: centres and radii
    placed: list[tuple[Array, Array]] = []
    classes = np.floor(np.log(radii / radii.max()) / np.log(_CLASS))
    for size in np.unique(classes)[::-1]:
        index = np.flatnonzero(classes == size)
        index = index[np.argsort(-radii[index], kind="stable")]
        positions[index] = _placed_among(placed, radii[index], low, high, rng)
        placed.append((positions[index], radii[index]))
    return Packing(positions, radii)


def _placed_among(
    placed: list[tuple[Array, Array]], radii: Array, low: Array, high: Array, rng: np.random.Generator
) -> Array:
    """Return centres, shape (n, 3), of spheres of similar radii that overlap neither each other nor those placed."""
    # imported here because it is slow to import
    from scipy.spatial import cKDTree

    largest = float(radii.max())
    trees = [(cKDTree(centres), theirs) for centres, theirs in placed]
    positions, left, failed_rounds = np.empty((len(radii), 3)), np.arange(len(radii)), 0
    done = np.zeros(len(radii), bool)
    while left.size:
        owner = np.resize(left, max(_PROPOSED, left.size))
        size = radii[owner][:, None]
        points = low + size + rng.random((len(owner), 3)) * (high - low - 2.0 * size)
        free = np.ones(len(owner), bool)
        among = [*trees, (cKDTree(positions[done]), radii[done])] if done.any() else trees
        proposed = cKDTree(points)
        for tree, theirs in among:
            near = proposed.sparse_distance_matrix(tree, largest + float(theirs.max()), output_type="ndarray")
            free[near["i"][near["v"] < radii[owner[near["i"]]] + theirs[near["j"]]]] = False
        # for each sphere the first free point; of two spheres that overlap the first one
        chosen = np.flatnonzero(free)
        chosen = chosen[np.unique(owner[chosen], return_index=True)[1]]
        pairs = cKDTree(points[chosen]).query_pairs(2.0 * largest, output_type="ndarray") if chosen.size else None
        if pairs is not None and pairs.size:
            i, j = chosen[pairs.min(axis=1)], chosen[pairs.max(axis=1)]
            apart = np.linalg.norm(points[i] - points[j], axis=1)
            chosen = np.setdiff1d(chosen, j[apart < radii[owner[i]] + radii[owner[j]]])
        positions[owner[chosen]], done[owner[chosen]] = points[chosen], True
        left = np.flatnonzero(~done)
        failed_rounds = 0 if chosen.size else failed_rounds + 1
        if failed_rounds > _MOST_FAILED_ROUNDS:
            raise InputError(
                f"{left.size} of {len(radii)} spheres do not fit at random: use fewer, a larger box, or `layers`"
            )
    return positions


def _sufficient_count(radius: Size, fraction: float, size: Array, rng: np.random.Generator) -> int | None:
    """Return a number of spheres that is certainly enough to fill a fraction of a box."""
    if not 0.0 < fraction < 1.0:
        raise InputError(f"fraction must lie between 0 and 1; got {fraction:g}")
    if not callable(radius) and np.ndim(array(radius, "radius")):
        return None
    sample = sizes(radius, 1000, rng)
    return int(1.5 * fraction * size.prod() / (4.0 / 3.0 * np.pi * float((sample**3).mean()))) + 10


def _box(lower: Sequence[float] | Array, upper: Sequence[float] | Array) -> tuple[Array, Array]:
    low, high = vector(lower, "lower"), vector(upper, "upper")
    if not (low < high).all():
        raise InputError(f"lower and upper must be the corners of a box; got {low.tolist()} and {high.tolist()}")
    return low, high
