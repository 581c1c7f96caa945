"""Triangle meshes for granular scenes: funnels, an hourglass, a drum with vanes, a chute, terrain.

Each function returns vertices, shape (v, 3), and triangles, shape (t, 3), for `scene.add_surface(*mesh)`; lengths in
metres, the z axis up.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array, array, between, integer, not_negative, positive
from ..errors import InputError

# most strips around an axis, and most vanes: more are surely a mistake, and would fill the memory
_MOST_STRIPS = 100_000


def revolved(profile: Sequence[Sequence[float]] | Array, segments: int = 48) -> tuple[Array, Array]:
    """Return a surface of revolution about z; the free side of boxes is towards the axis where the profile goes up.

    Parameters
    ----------
    profile : array_like, shape (n, 2)
        Radius and height of each corner of the line that revolves about z; a radius of 0 closes the surface.
    segments : int
        Plane strips around the axis. Corners lie on the circle; faces lie inside it by up to 1 - cos(pi / segments) of
        the radius.

    Raises
    ------
    InputError
        On fewer than two corners, a negative radius, or fewer than three strips.
    """
    line, segments = array(profile, "profile", ("n", 2)), _segments(segments)
    if len(line) < 2 or (line[:, 0] < 0).any():
        raise InputError("profile must be two or more corners (radius, height), no radius negative")
    angle = 2.0 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.column_stack([r * ring, np.full(segments, z)]) for r, z in line])
    k = np.arange(segments)
    quads = [np.stack([k, k + segments, (k + 1) % segments + segments, (k + 1) % segments], axis=1) + row * segments
             for row in range(len(line) - 1)]  # fmt: skip
    return vertices, _halves(np.concatenate(quads))


def funnel(top: float, neck: float, height: float, pipe: float = 0.0, segments: int = 48) -> tuple[Array, Array]:
    """Return a cone that narrows downwards, with a pipe below it; its neck is at z = 0.

    Parameters
    ----------
    top, neck : float
        Radii at the top and at the neck [m].
    height, pipe : float
        Of the cone, and of the pipe below [m].
    segments : int
        See `revolved`.
    """
    top, neck, height = positive(top, "top"), positive(neck, "neck"), positive(height, "height")
    positive(top - neck, "top - neck")
    below = [(neck, -pipe)] if not_negative(pipe, "pipe") > 0.0 else []
    return revolved([*below, (neck, 0.0), (top, height)], segments)


def hourglass(radius: float, neck: float, height: float, segments: int = 48) -> tuple[Array, Array]:
    """Return two cones, closed at their far ends, that meet at a neck at z = 0.

    Parameters
    ----------
    radius, neck : float
        Radii at the ends and at the neck [m].
    height : float
        Of each cone [m].
    segments : int
        See `revolved`.
    """
    radius, neck, height = positive(radius, "radius"), positive(neck, "neck"), positive(height, "height")
    positive(radius - neck, "radius - neck")
    return revolved([(0, -height), (radius, -height), (neck, 0), (radius, height), (0, height)], segments)


def drum(radius: float, length: float, vanes: int = 0, depth: float = 0.0, segments: int = 48) -> tuple[Array, Array]:
    """Return a closed cylinder along y about the origin, with flat vanes inside that reach towards its axis.

    Without friction only the vanes move grains along with the drum.

    Parameters
    ----------
    radius, length : float
        Of the cylinder [m].
    vanes : int
        How many, evenly spread.
    depth : float
        How far each reaches inwards [m].
    segments : int
        See `revolved`.
    """
    radius, length, vanes = positive(radius, "radius"), positive(length, "length"), integer(vanes, "vanes")
    if vanes > _MOST_STRIPS:
        raise InputError(f"vanes must be {_MOST_STRIPS} at most; got {vanes}")
    depth = not_negative(depth, "depth")
    if vanes and not 0.0 < depth < radius:
        raise InputError(f"depth must lie between 0 and the radius {radius:g}; got {depth}")
    half = 0.5 * length
    vertices, triangles = revolved([(0, -half), (radius, -half), (radius, half), (0, half)], segments)
    # rotate the axis of revolution from z to y
    points, quads = [vertices[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])], []
    for k in range(vanes):
        angle = 2.0 * np.pi * k / vanes
        out = np.array([np.cos(angle), 0.0, np.sin(angle)])
        corners = [r * out + [0.0, y, 0.0] for r, y in ((radius, -half), (radius, half))]
        corners += [r * out + [0.0, y, 0.0] for r, y in ((radius - depth, half), (radius - depth, -half))]
        quads.append(len(vertices) + 4 * k + np.arange(4))
        points.append(np.array(corners))
    if quads:
        triangles = np.concatenate([triangles, _halves(np.array(quads))])
    return np.concatenate(points), triangles


def chute(length: float, width: float, angle: float, sides: float) -> tuple[Array, Array]:
    """Return a straight chute that falls along x, from z = length sin(angle) to the origin's height, with side walls.

    Parameters
    ----------
    length, width : float
        Of its floor, which lies from x = -length cos(angle) to 0 and about y = 0 [m].
    angle : float
        Slope [rad].
    sides : float
        Height of the walls, upright to the floor [m].
    """
    length, width, sides = positive(length, "length"), positive(width, "width"), positive(sides, "sides")
    angle = between(angle, "angle", -0.5 * np.pi, 0.5 * np.pi, ends=False)
    along, up = np.array([-np.cos(angle), 0.0, np.sin(angle)]), np.array([np.sin(angle), 0.0, np.cos(angle)])
    points = [s * length * along + [0.0, y * width, 0.0] + z * sides * up
              for y in (-0.5, 0.5) for s in (0.0, 1.0) for z in (0.0, 1.0)]  # fmt: skip
    quads = np.array([[0, 4, 6, 2], [0, 2, 3, 1], [4, 5, 7, 6]])
    return np.array(points), _halves(quads)


def terrain(x: Sequence[float] | Array, y: Sequence[float] | Array, heights: Array) -> tuple[Array, Array]:
    """Return a field of heights over a grid.

    Parameters
    ----------
    x, y : array_like, shapes (m,) and (n,)
        Grid lines in ascending order [m].
    heights : array_like, shape (m, n)
        Height at each crossing [m].

    Raises
    ------
    InputError
        If the shapes do not fit.
    """
    first, second, z = array(x, "x", ("m",)), array(y, "y", ("n",)), array(heights, "heights")
    if z.shape != (first.size, second.size) or min(z.shape) < 2:
        raise InputError(f"heights has shape {z.shape}; it must have ({first.size}, {second.size}), 2 at least")
    if (np.diff(first) <= 0.0).any() or (np.diff(second) <= 0.0).any():
        raise InputError("x and y must ascend")
    grid = np.stack([*np.meshgrid(first, second, indexing="ij"), z], axis=-1)
    number = np.arange(z.size).reshape(z.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    return grid.reshape(-1, 3), _halves(quads.reshape(-1, 4))


def _halves(quads: Array) -> Array:
    """Return two triangles for each quadrilateral, whose four corners are in one row."""
    return np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def _segments(segments: int) -> int:
    count = integer(segments, "segments", 3)
    if count > _MOST_STRIPS:
        raise InputError(f"segments must be {_MOST_STRIPS} at most; got {count}")
    return count
