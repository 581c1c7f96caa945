"""Spheres on sites: a lattice, and layers to be dropped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arguments import array, generator, integers, not_negative, positive, shown, vector
from ..errors import InputError
from .sizes import Array, Size, sizes

_ROUNDING = 1e-12
# sites along an axis that an integer can count
_MOST_SITES = 1e9


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
    sites = integers(shape, "shape", (3,)).tolist()
    if min(sites) < 1:
        raise InputError(f"shape must be three positive integers; got {shown(shape)}")
    rng, jitter, corner = generator(seed), not_negative(jitter, "jitter"), vector(corner, "corner")
    radii = sizes(radius, math.prod(sites), rng)
    least = 2.0 * (float(radii.max()) + jitter)
    spacing = least if spacing is None else positive(spacing, "spacing")
    if spacing < least * (1.0 - _ROUNDING):
        raise InputError(f"spheres on sites {spacing:g} m apart could overlap: radii and jitter need {least:g} m")
    grid = np.stack(np.meshgrid(*map(np.arange, sites), indexing="ij"), axis=-1).reshape(-1, 3)
    off = rng.uniform(-jitter, jitter, grid.shape)
    return Packing(corner + spacing * grid + off, radii)


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
    rng, clearance = generator(seed), not_negative(clearance, "clearance")
    radii = sizes(radius, count, rng)
    corner, far = vector(lower, "lower"), array(upper, "upper")
    if far.shape not in ((2,), (3,)):
        raise InputError(f"upper has shape {far.shape}; it must have (2,) or (3,)")
    largest = float(radii.max())
    pitch = 2.0 * largest * (1.0 + clearance)
    room = np.floor((far[:2] - corner[:2]) / pitch + _ROUNDING)
    if (room > _MOST_SITES).any():
        raise InputError(f"a layer of {(far[:2] - corner[:2]).tolist()} m is too wide for spheres {pitch:g} m apart")
    if not (room >= 1.0).all():
        raise InputError(f"a layer of {(far[:2] - corner[:2]).tolist()} m has no room for spheres {pitch:g} m apart")
    sites = room.astype(int)
    # spread over the whole floor
    width = np.append((far[:2] - corner[:2]) / sites, pitch)
    across, number = int(sites.prod()), np.arange(len(radii))
    layer, site = np.divmod(number, across)
    grid = np.stack([*np.divmod(site, sites[1]), layer], axis=1)
    off = rng.uniform(-1.0, 1.0, grid.shape) * (0.5 * width - largest)
    return Packing(corner + width * (grid + 0.5) + off, radii)
