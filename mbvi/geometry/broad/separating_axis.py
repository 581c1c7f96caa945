"""Lower bounds on the distance of convex shapes by the last separating axis of each pair.

The distance of two shapes is at least the distance of their projections onto any unit vector n. The normal of the last
measured distance is kept in the frame of the first body. It separates the shapes for many steps, so that most pairs are
seldom measured again.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..shapes.shape_table import Shapes, ShapeTable, outermost_of_shape
from ..vectors import dot, normalise


@kernel("void(f8[:,:,::1], i8[::1], f8[:,:,::1], i8, f8[:,::1])")
def place_shape(places: Array, frame: Array, fixed: Array, shape: int, world: Array) -> None:
    """Write where a shape is, shape (4, 3): columns of its rotation, then its origin. See `Shapes`."""
    for k in range(4):
        for c in range(3):
            world[k, c] = fixed[shape, k, c]
            if frame[shape] >= 0:
                P, f = places[frame[shape]], fixed[shape, k]
                world[k, c] = f[0] * P[0, c] + f[1] * P[1, c] + f[2] * P[2, c]
                world[k, c] += P[3, c] if k == 3 else 0.0


@kernel("void(f8[:,:,::1], Shapes, i8, f8[:,:,::1])")
def place_pair(places: Array, shapes: Shapes, pair: int, world: Array) -> None:
    """Write where the shapes of a pair are, shape (2, 4, 3); see `place_shape`."""
    for side in range(2):
        place_shape(places, shapes.frame, shapes.fixed, shapes.sides[pair, side], world[side])


@kernel("f8(f8[:,::1], f8[::1], Shapes, i8, i8)")
def reach(place: Array, n: Array, shapes: Shapes, pair: int, side: int) -> float:
    """Return how far a shape of a pair reaches from the world's origin towards the other shape [m].

    Parameters
    ----------
    place : ndarray, shape (4, 3)
        Placement of the shape: columns of its rotation, then its origin.
    n : ndarray, shape (3,)
        The unit vector from the first shape to the second.
    shapes : Shapes
        The search begins at `start[pair, side]`, which receives the outermost point.
    pair, side : int
        Which shape of which pair it is.
    """
    # slices of arrays would cost as much as the rest
    s, points, sizes = shapes.sides[pair, side], shapes.points, shapes.sizes
    u, v, w = (n[0], n[1], n[2]) if side == 0 else (-n[0], -n[1], -n[2])
    x = place[0, 0] * u + place[0, 1] * v + place[0, 2] * w
    y = place[1, 0] * u + place[1, 1] * v + place[1, 2] * w
    z = place[2, 0] * u + place[2, 1] * v + place[2, 2] * w
    k = outermost_of_shape(shapes, s, x, y, z, shapes.start[pair, side])
    shapes.start[pair, side] = k
    far = points[k, 0] * x + points[k, 1] * y + points[k, 2] * z
    far += place[3, 0] * u + place[3, 1] * v + place[3, 2] * w
    far += abs(x) * sizes[s, 0] + abs(y) * sizes[s, 1] + abs(z) * sizes[s, 2] + sizes[s, 3]
    if sizes[s, 4] > 0.0:
        far += sizes[s, 4] * np.sqrt(x * x + y * y)
    if sizes[s, 5] > 0.0:
        far += np.sqrt((sizes[s, 5] * x) ** 2 + (sizes[s, 6] * y) ** 2 + (sizes[s, 7] * z) ** 2)
    return far


@kernel("void(f8[:,:,::1], i8[::1], f8[:,:,::1], i8, i8, f8[:,:,::1])")
def place_side(places: Array, frame: Array, fixed: Array, shape: int, side: int, world: Array) -> None:
    """Write where a shape is into `world[side]`; as `place_shape`, but without views, which cost more than the sums."""
    b = frame[shape]
    for k in range(4):
        x, y, z = fixed[shape, k, 0], fixed[shape, k, 1], fixed[shape, k, 2]
        for c in range(3):
            if b < 0:
                world[side, k, c] = fixed[shape, k, c]
            else:
                world[side, k, c] = x * places[b, 0, c] + y * places[b, 1, c] + z * places[b, 2, c]
                if k == 3:
                    world[side, k, c] += places[b, 3, c]


@kernel("f8(f8[:,:,::1], i8, f8, f8[::1], f8[:,::1], i8)")
def core_reach(world: Array, side: int, sign: float, n: Array, sizes: Array, shape: int) -> float:
    """Return what `reach` returns for a sphere, capsule or box at `world[side]` and the unit vector sign n [m]."""
    u, v, w = sign * n[0], sign * n[1], sign * n[2]
    x = world[side, 0, 0] * u + world[side, 0, 1] * v + world[side, 0, 2] * w
    y = world[side, 1, 0] * u + world[side, 1, 1] * v + world[side, 1, 2] * w
    z = world[side, 2, 0] * u + world[side, 2, 1] * v + world[side, 2, 2] * w
    far = world[side, 3, 0] * u + world[side, 3, 1] * v + world[side, 3, 2] * w
    return far + (abs(x) * sizes[shape, 0] + abs(y) * sizes[shape, 1] + abs(z) * sizes[shape, 2] + sizes[shape, 3])


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1])")
def pair_separation(world: Array, shapes: Shapes, pair: int, n: Array) -> float:
    """Return the separation of the two shapes of a pair along a unit vector from the first to the second [m].

    `world`, shape (2, 4, 3), says where they are. The climbs begin at `start`, which receives the outermost points.
    """
    return -(reach(world[1], n, shapes, pair, 1) + reach(world[0], n, shapes, pair, 0))


@kernel("void(f8[:,:,::1], i8, f8[:,::1], i8, f8[::1])")
def axis_in_world(places: Array, body: int, axis: Array, pair: int, n: Array) -> None:
    """Write the axis of a pair, which is given in the frame of its first body; -1 stands for the world."""
    for c in range(3):
        n[c] = axis[pair, c]
        if body >= 0:
            P = places[body]
            n[c] = axis[pair, 0] * P[0, c] + axis[pair, 1] * P[1, c] + axis[pair, 2] * P[2, c]


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1])")
def between_centres(world: Array, shapes: Shapes, pair: int, between: Array) -> float:
    """Write the vector from the centre of the first shape of a pair to that of the second; return the radii's sum.

    The centres are those of the balls inside the shapes, the radii theirs; `world`, shape (2, 4, 3), says where
    they are.
    """
    radius = 0.0
    for side in range(2):
        ball, place = shapes.inside[shapes.sides[pair, side]], world[side]
        radius += ball[3]
        for c in range(3):
            centre = place[3, c] + ball[0] * place[0, c] + ball[1] * place[1, c] + ball[2] * place[2, c]
            between[c] = centre if side == 0 else centre - between[c]
    return radius


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1])")
def first_axis(world: Array, shapes: Shapes, pair: int, n: Array) -> float:
    """Write the best of seven axes of a pair: between the centres, and along the axes of both frames.

    The frames' axes are the normals of boxes and the ends of cylinders. Returns the separation along it; -inf if the
    centres are the same point.
    """
    most, between, tried = -np.inf, np.empty(3), np.empty(3)
    between_centres(world, shapes, pair, between)
    if dot(between, between) == 0.0:
        return most
    normalise(between)
    for k in range(7):
        for c in range(3):
            tried[c] = between[c] if k == 6 else world[k // 3, k % 3, c]
        if dot(tried, between) < 0.0:
            for c in range(3):
                tried[c] = -tried[c]
        apart = pair_separation(world, shapes, pair, tried)
        if apart > most:
            most = apart
            for c in range(3):
                n[c] = tried[c]
    return most


@kernel("void(f8[:,:,::1], i8, f8[::1], f8[:,::1], i8)")
def keep_axis(places: Array, body: int, n: Array, axis: Array, pair: int) -> None:
    """Write a unit vector as the axis of a pair, in the frame of its first body; see `axis_in_world`."""
    for c in range(3):
        axis[pair, c] = n[c]
        if body >= 0:
            P = places[body]
            axis[pair, c] = P[c, 0] * n[0] + P[c, 1] * n[1] + P[c, 2] * n[2]


@kernel("void(f8[:,:,::1], Tuple(Shapes), f8[:,::1], i8[::1], f8)")
def guess_axes(places: Array, tables: tuple[Array, ...], axis: Array, candidates: Array, tolerance: float) -> None:
    """Write `first_axis` as the axis of those pairs without one that it separates by more than the tolerance.

    Most pairs are far apart at first, and need not be measured then. The arguments are those of `separated`.
    """
    shapes, n, world = Shapes(*tables), np.empty(3), np.empty((2, 4, 3))
    for i in range(len(candidates)):
        pair = candidates[i]
        if axis[pair, 0] != axis[pair, 0]:
            place_pair(places, shapes, pair, world)
            if first_axis(world, shapes, pair, n) > tolerance:
                keep_axis(places, shapes.frame[shapes.sides[pair, 0]], n, axis, pair)


@kernel("i8(f8[:,:,::1], Tuple(Shapes), f8[:,::1], i8[::1], f8, f8[::1], i8[::1])")
def separated(
    places: Array, tables: tuple[Array, ...], axis: Array, candidates: Array, tolerance: float, bound: Array,
    unresolved: Array,
) -> int:  # fmt: skip
    """Write lower bounds of the distances of pairs whose axes separate them; list the other pairs.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    tables : tuple
        The fields of `Shapes`.
    axis : ndarray, shape (n, 3)
        Unit vectors from the first shape to the second, in the first's body; NaN where none is known.
    candidates : ndarray of int, shape (d,)
        The pairs.
    tolerance : float
        Gap at and below which a pair is active [m].
    bound : ndarray, shape (n,)
        Receives the bounds of the pairs that are separated by more than the tolerance [m].
    unresolved : ndarray of int, shape (d,)
        Receives the other pairs, in its first places.

    Returns
    -------
    int
        How many other pairs there are.
    """
    shapes, count, n, world = Shapes(*tables), 0, np.empty(3), np.empty((2, 4, 3))
    for i in range(len(candidates)):
        pair, gap = candidates[i], -np.inf
        if axis[pair, 0] == axis[pair, 0]:
            a, b, sizes, starts = shapes.sides[pair, 0], shapes.sides[pair, 1], shapes.sizes, shapes.first_point
            place_side(places, shapes.frame, shapes.fixed, a, 0, world)
            place_side(places, shapes.frame, shapes.fixed, b, 1, world)
            axis_in_world(places, shapes.frame[a], axis, pair, n)
            points_each = max(starts[a + 1] - starts[a], starts[b + 1] - starts[b])
            if points_each == 1 and sizes[a, 4] + sizes[b, 4] + sizes[a, 5] + sizes[b, 5] == 0.0:
                # most pairs of many bodies, at a tenth of the cost
                gap = -(core_reach(world, 1, -1.0, n, sizes, b) + core_reach(world, 0, 1.0, n, sizes, a))
            else:
                gap = pair_separation(world, shapes, pair, n)
        if gap > tolerance:
            bound[pair] = gap
        else:
            unresolved[count] = pair
            count += 1
    return count


@kernel("void(f8[:,:,::1], i8[::1], i8[:,::1], f8[:,::1], i8[::1], f8[:,::1])")
def keep_normals(places: Array, frame: Array, sides: Array, axis: Array, pairs: Array, normals: Array) -> None:
    """Write normals, shape (k, 3), as the axes of some pairs; the other arguments are those of `separated`."""
    for i in range(len(pairs)):
        keep_axis(places, frame[sides[pairs[i], 0]], normals[i], axis, pairs[i])


@kernel("void(i8[::1], f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], i8[:,::1])")
def carry_axes(
    number: Array, axis: Array, start: Array, new_number: Array, new_axis: Array, new_start: Array
) -> None:  # fmt: skip
    """Copy axes and outermost points, as of `SeparatingAxes`, to those pairs of a new list that are in the old one.

    `number` and `new_number`, shapes (n,) and (m,), are the numbers of the pairs of both lists, ascending.
    """
    k = 0
    for i in range(len(new_number)):
        while k < len(number) and number[k] < new_number[i]:
            k += 1
        if k < len(number) and number[k] == new_number[i]:
            for c in range(3):
                new_axis[i, c] = axis[k, c]
            for j in range(start.shape[1]):
                new_start[i, j] = start[k, j]


class SeparatingAxes:
    """One axis for each pair: the normal of its last measured distance.

    Parameters
    ----------
    table : ShapeTable
        The shapes.
    sides : ndarray of int, shape (n, 2)
        The two shapes of each pair.
    guesses : bool
        Whether axes are guessed at first; see `guess_axes`.

    Attributes
    ----------
    bodies : ndarray of int
        The bodies other than the world, ascending: methods expect their placements in this order.
    frame : ndarray of int
        The place of each shape's body in `bodies`; -1 for the world.
    shapes : Shapes
        Their arrays.
    tables : tuple
        The same as a plain tuple, which kernels take faster.
    axis : ndarray, shape (n, 3)
        The axes in the frames of the first bodies; NaN where none is known.
    """

    def __init__(self, table: ShapeTable, sides: Array, guesses: bool = True) -> None:
        self.bodies, self.frame, self.shapes = table.bodies, table.frame, table.pairs(sides)
        self.tables = tuple(self.shapes)
        self.axis = np.full((len(sides), 3), np.nan)
        self._guesses = guesses

    def clear(self, places: Array, candidates: Array, tolerance: float, bound: Array) -> Array:
        """Return the candidates that their axes do not separate; write lower bounds of the distances of the others.

        At the first call missing axes may be guessed.
        `places`, shape (b, 4, 3), are the placements of `bodies`.
        """
        if self._guesses:
            self._guesses = False
            guess_axes(places, self.tables, self.axis, candidates, tolerance)
        unresolved = np.empty(len(candidates), np.int64)
        count = separated(places, self.tables, self.axis, candidates, tolerance, bound, unresolved)
        return unresolved[:count]

    def keep(self, places: Array, pairs: Array, normals: Array) -> None:
        """Keep measured normals, shape (k, 3), as the axes of some pairs."""
        keep_normals(places, self.frame, self.shapes.sides, self.axis, pairs, normals)
