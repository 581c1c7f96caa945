"""Packings on regular sites: a cubic lattice, and loose layers to be dropped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arguments import array, generator, integers, not_negative, positive, shown, vector
from ..errors import InputError
from .sizes import Array, Size, sizes

_ROUNDING = 1e-12
# limit of sites along an axis, so that integers can count them
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
        Number of spheres along x, y and z.
    radius : float, array_like of shape (n,), or a size distribution
        Radii [m].
    spacing : float, optional
        Distance of neighbouring sites [m]; by default the least that radii and jitter allow.
    corner : array_like, shape (3,)
        Site with the least coordinates [m].
    jitter : float
        Largest random displacement of a centre from its site along each axis [m].
    seed : int
        Seed of sizes and jitter.

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
    """Return spheres in loose layers on top of each other, to be dropped.

    Parameters
    ----------
    lower : array_like, shape (3,)
        Corner of the lowest layer's floor [m].
    upper : array_like, shape (2,) or (3,)
        Opposite corner in x and y [m]. A third number has no effect: there are as many layers as spheres need.
    radius : float, array_like of shape (n,), or a size distribution
        Radii [m].
    count : int, optional
        Number of spheres, unless radii are given one by one.
    clearance : float
        Free space around each sphere, in units of the largest radius; centres are random within it.
    seed : int
        Seed of sizes and positions.

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
    # sites spread over the whole floor
    width = np.append((far[:2] - corner[:2]) / sites, pitch)
    across, number = int(sites.prod()), np.arange(len(radii))
    layer, site = np.divmod(number, across)
    grid = np.stack([*np.divmod(site, sites[1]), layer], axis=1)
    off = rng.uniform(-1.0, 1.0, grid.shape) * (0.5 * width - largest)
    return Packing(corner + width * (grid + 0.5) + off, radii)
