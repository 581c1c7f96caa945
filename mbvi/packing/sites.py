"""Spheres on sites: a lattice, and layers to be dropped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from .sizes import Array, Size, sizes

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
    radii = sizes(radius, int(sites.prod()), rng)
    least = 2.0 * (float(radii.max()) + jitter)
    spacing = least if spacing is None else float(spacing)
    if not (jitter >= 0.0 and spacing >= least * (1.0 - _ROUNDING)):
        raise InputError(f"spheres on sites {spacing:g} m apart could overlap: radii and jitter ask for {least:g} m")
    grid = np.stack(np.meshgrid(*map(np.arange, sites), indexing="ij"), axis=-1).reshape(-1, 3)
    off = rng.uniform(-jitter, jitter, grid.shape)
    return Packing(np.asarray(corner, dtype=float) + spacing * grid + off, radii)


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
    radii = sizes(radius, count, rng)
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
