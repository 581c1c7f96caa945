"""The family of many spheres against half-spaces, boxes and capsules, in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...compiled import kernel, plain_array
from ...geometry.shapes.seams import seams_of, uncovered
from ...geometry.shapes.shapes import Box, Capsule, HalfSpace, PlacedShape
from ...system import System
from ...system.free.sparse_rows import dense
from ..family import ConstraintFamily
from ..rebuilt import Rebuilt
from ..relative_ways import PairBalls, relative_ways, ways_of
from ..rows import Array, Rows
from .spheres import SphereCentres

# values of `kind` of `wall_contacts`
_PLANE, _BOX, _CAPSULE = range(3)


@kernel("f8(f8[:,::1], i8, f8[:,::1], i8, f8, f8[::1])")
def distance_from_box(walls: Array, a: int, centres: Array, i: int, most: float, normal: Array) -> float:
    """Return the distance of a point from a box [m], negative inside; write the normal towards the point, shape (3,).

    From inside, the normal is that of the nearest face.

    Parameters
    ----------
    walls, a, centres, i
        Arrays of `wall_contacts`, each followed by the row to use. Slices would cost more than the distance.
    most : float
        Distance beyond which the normal need not be written [m].
    """
    square, deepest, face, side = 0.0, np.inf, 0, 1.0
    u = v = t = 0.0
    for c in range(3):
        local = (
            walls[a, 3 * c] * (centres[i, 0] - walls[a, 9])
            + walls[a, 3 * c + 1] * (centres[i, 1] - walls[a, 10])
            + walls[a, 3 * c + 2] * (centres[i, 2] - walls[a, 11])
        )
        half = walls[a, 12 + c]
        if half - abs(local) < deepest:
            deepest, face, side = half - abs(local), c, 1.0 if local >= 0.0 else -1.0
        away = local - min(max(local, -half), half)
        square += away * away
        u += away * walls[a, 3 * c]
        v += away * walls[a, 3 * c + 1]
        t += away * walls[a, 3 * c + 2]
    far = np.sqrt(square)
    if far > most:
        return far
    if far > 0.0:
        normal[0], normal[1], normal[2] = u / far, v / far, t / far
        return far
    at = 3 * face
    normal[0], normal[1], normal[2] = side * walls[a, at], side * walls[a, at + 1], side * walls[a, at + 2]
    return -deepest


@kernel("f8(f8[:,::1], i8, f8[:,::1], i8, f8, f8[::1])")
def distance_from_capsule(walls: Array, a: int, centres: Array, i: int, most: float, normal: Array) -> float:
    """Return the distance of a point from a capsule [m], negative inside; see `distance_from_box`."""
    p, q, r = walls[a, 3] - walls[a, 0], walls[a, 4] - walls[a, 1], walls[a, 5] - walls[a, 2]
    u, v, t = centres[i, 0] - walls[a, 0], centres[i, 1] - walls[a, 1], centres[i, 2] - walls[a, 2]
    square = p * p + q * q + r * r
    along = (u * p + v * q + t * r) / square if square > 0.0 else 0.0
    along = min(max(along, 0.0), 1.0)
    u, v, t = u - along * p, v - along * q, t - along * r
    far = np.sqrt(u * u + v * v + t * t)
    if far - walls[a, 6] > most:
        return far - walls[a, 6]
    if far > 0.0:
        normal[0], normal[1], normal[2] = u / far, v / far, t / far
    else:
        # on the axis the normal is not unique
        normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
    return far - walls[a, 6]


@kernel("i8(f8[:,::1], f8[::1], i8[::1], f8[:,::1], f8, i8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def wall_contacts(
    centres: Array, radii: Array, kind: Array, walls: Array, tolerance: float, number: Array, gap: Array, point: Array,
    normal: Array,
) -> int:  # fmt: skip
    """Write the contacts of spheres with walls that are within the tolerance; return how many there are.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres [m].
    radii : ndarray, shape (n,)
        Radii [m].
    kind : ndarray of int, shape (w,)
        0 a half-space, 1 a box, 2 a capsule.
    walls : ndarray, shape (w, 15)
        Of a half-space, normal and offset; of a box, its axes one after the other, its centre and half its edges; of a
        capsule, the ends of its axis and its radius.
    tolerance : float
        Gap at and below which a contact is written [m].
    number, gap, point, normal : ndarray, shapes (k,), (k,), (k, 3), (k, 3)
        Receive, in their first places, the constraint (sphere times w plus wall), the signed distance, the point
        midway between the surfaces, and the unit normal from the wall to the sphere. They have room for all pairs.
    """
    w, count, out = len(kind), 0, np.empty(3)
    for i in range(len(radii)):
        # no contact beyond this distance of the centre, with a margin for rounding
        most = (tolerance + radii[i]) + 1e-9 * (abs(tolerance) + radii[i])
        for a in range(w):
            if kind[a] == _PLANE:
                far = (
                    centres[i, 0] * walls[a, 0]
                    + centres[i, 1] * walls[a, 1]
                    + centres[i, 2] * walls[a, 2]
                    - walls[a, 3]
                )
                if far > most:
                    continue
                out[0], out[1], out[2] = walls[a, 0], walls[a, 1], walls[a, 2]
            elif kind[a] == _BOX:
                far = distance_from_box(walls, a, centres, i, most, out)
            else:
                far = distance_from_capsule(walls, a, centres, i, most, out)
            g = far - radii[i]
            if not g <= tolerance:
                continue
            back = radii[i] + 0.5 * g
            number[count], gap[count] = i * w + a, g
            for c in range(3):
                normal[count, c] = out[c]
                point[count, c] = centres[i, c] - back * out[c]
            count += 1
    return count


class SphereWalls(Rebuilt, ConstraintFamily):
    """Half-spaces of the world and boxes or capsules on any body, the walls, against many free spheres.

    Parameters
    ----------
    system : System
        What moves the spheres and the walls.
    where : SphereCentres
        Where the spheres' centres are in q.
    first_body : int
        Body of the first sphere; the others follow.
    radii : ndarray, shape (n,)
        Radii [m].
    walls : sequence of HalfSpace or PlacedShape
        Half-spaces, and boxes or capsules on their bodies.
    names : sequence of str
        Name of each sphere.
    wall_names : sequence of str
        Name of each wall.
    group : ndarray of int, shape (n,)
        Number of the scene's item, such as a call of `add_spheres`, that each sphere belongs to.
    group_restitution : ndarray, shape (g, w)
        e between the items and the walls.
    group_friction : ndarray, shape (g, w), optional
        Coefficients of friction between them; none by default.

    Notes
    -----
    Constraint i w + a is the pair of sphere i and wall a of w walls. The wall is its first body.
    """

    isotropic = True

    def __init__(
        self,
        system: System,
        where: SphereCentres,
        first_body: int,
        radii: Array,
        walls: Sequence[HalfSpace | PlacedShape],
        names: Sequence[str],
        wall_names: Sequence[str],
        group: Array,
        group_restitution: Array,
        group_friction: Array | None = None,
    ) -> None:
        self.system, self._where, self._first_body = system, where, first_body
        self._radii, self._sphere_names, self._wall_names = plain_array(radii), names, wall_names
        self._group, self._e, self._mu = group, group_restitution, group_friction
        self.friction = 0.0 if group_friction is None else float(group_friction.max())
        self._bodies = np.array([0 if isinstance(w, HalfSpace) else w.body for w in walls], dtype=np.int64)
        self._kind = np.array([_kind_of(w) for w in walls], dtype=np.int64)
        self._local = np.array([_wall_numbers(w) for w in walls])
        self._middles = np.array([w.position if isinstance(w, PlacedShape) else np.zeros(3) for w in walls])
        # walls on bodies, and which of their vectors are points: the centre of a box, the ends of a capsule
        self._carried = [
            (here, points)
            for kind, points in ((_BOX, slice(3, 4)), (_CAPSULE, slice(2)))
            if (here := np.flatnonzero((self._bodies > 0) & (self._kind == kind))).size
        ]
        # a half-space has no far side: no sphere passes through it
        self._inner = np.array([np.inf if isinstance(w, HalfSpace) else w.shape.inner for w in walls])
        # the most that each velocity moves a point of the walls that are not fixed
        self._reach = [
            (a, system.reach(w.body, w.position, w.shape.bound))
            for a, w in enumerate(walls)
            if isinstance(w, PlacedShape) and w.body
        ]
        seams = seams_of([w for w in walls if isinstance(w, PlacedShape)])
        self._seams = seams if len(seams.neighbour) else None
        # of each wall its number among those that the world holds, -1 for others
        solid = np.array([isinstance(w, PlacedShape) for w in walls])
        self._fixed = np.where(solid & (self._bodies == 0), np.cumsum(solid) - 1, -1)
        self.size = len(self._radii) * len(self._kind)
        self.restitution = np.asarray(group_restitution[group].ravel())

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        i, a = divmod(constraint, len(self._kind))
        sphere, wall = self._sphere_names[i], self._wall_names[a]
        return f"{sphere} | {wall}" if self._kind[a] == _PLANE else f"{wall} | {sphere}"

    def friction_of(self, numbers: Array) -> Array:
        """Return the coefficients of friction of some pairs, shape (k,)."""
        i, a = np.divmod(numbers, len(self._kind))
        return np.zeros(len(numbers)) if self._mu is None else self._mu[self._group[i], a]

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the bodies of wall and sphere of some pairs, shapes (k,)."""
        i, a = np.divmod(numbers, len(self._kind))
        return self._bodies[a], self._first_body + i

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} pairs of a sphere and a wall, in bulk"

    def _walls_at(self, q: Array) -> Array:
        """Return the argument `walls` of `wall_contacts`, in the world."""
        walls = self._local.copy() if self._carried else self._local
        for here, points in self._carried:
            places, width = self.system.placements(q, self._bodies[here]), 3 * points.stop
            vectors = self._local[here, :width].reshape(-1, points.stop, 3) @ places[:, :3]
            vectors[:, points] += places[:, 3:]
            walls[here, :width] = vectors.reshape(len(here), width)
        return walls

    def _near(self, q: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
        """Return numbers, gaps, points and normals of the pairs within the tolerance."""
        k, walls = self.size, self._walls_at(q)
        number, gap, point, normal = np.empty(k, np.int64), np.empty(k), np.empty((k, 3)), np.empty((k, 3))
        centres = plain_array(self._where.of(q))
        count = wall_contacts(centres, self._radii, self._kind, walls, tolerance, number, gap, point, normal)
        return number[:count], gap[:count], point[:count], normal[:count]

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        number, gap, point, normal = self._near(q, tolerance)
        if self._seams is not None and number.size:
            kept, fixed = np.empty(len(number), np.int64), self._fixed[number % len(self._kind)]
            kept = kept[: uncovered(self._seams, fixed, np.full_like(fixed, -1), gap, point, normal, kept)]
            number, gap, point, normal = number[kept], gap[kept], point[kept], normal[kept]
        if not number.size:
            return None
        i, a = np.divmod(number, len(self._kind))
        rows = self.system.separation_rows(q, self._bodies[a], self._first_body + i, point, normal)
        return Rows(number, gap, rows, self._e[self._group[i], a], point, normal)

    def gap(self, t: float, q: Array) -> Array:
        """Return the gap of every pair, shape (n w,) [m]."""
        return self._near(q, np.inf)[1]

    def nearest_of(self, t: float, q: Array, pairs: Array) -> tuple[Array, Array]:
        """Return gaps and normals of some pairs, shapes (k,) [m] and (k, 3)."""
        _, gap, _, normal = (part[pairs] for part in self._near(q, np.inf))
        return gap, normal

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return point and normal of every pair, shapes (n w, 3)."""
        return self._near(q, np.inf)[2:]

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return point and normal of some pairs, shapes (k, 3)."""
        point, normal = self.nearest_points(q)
        return point[rows], normal[rows]

    def bending_envelope(self) -> Array:
        """Return how far each velocity carries a centre or a wall, shape (nv,)."""
        return np.max([self._where.moved_in(self.system), *(reach for _, reach in self._reach)], axis=0)

    def least_displacement(self) -> float:
        """Return a bound: no sphere passes through a wall if no entry of a displacement is larger."""
        # sphere and wall together travel no more than this times the largest entry
        travel = np.full(len(self._kind), np.sqrt(3.0))
        for a, reach in self._reach:
            travel[a] += reach.sum()
        return float(((self._radii.min() + self._inner) / travel).min(initial=np.inf))

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the pairs that may pass through each other, their travel and their thickness; see the base class."""
        moved = self._where.of(self.system.integrate(q, displacement)) - self._where.of(q)
        own, (of_walls, *turns) = np.linalg.norm(moved, axis=1), np.zeros((3, len(self._kind)))
        for a, reach in self._reach:
            of_walls[a], turns[0][a], turns[1][a] = ways_of(self.system, displacement, reach)
        if not (own.max() + of_walls > self._radii.min() + self._inner).any():
            return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
        travel, thick = (np.add.outer(*one).ravel() for one in ((own, of_walls), (self._radii, self._inner)))
        pairs = np.flatnonzero((travel > thick) & (self.gap(0.0, q) < travel))
        travel, thick, wall = travel[pairs], thick[pairs], pairs % len(self._kind)
        carried = self._bodies[wall] > 0
        if carried.any():
            # centres go straight, and no turn of a sphere matters
            ways = travel[carried], turns[0][wall[carried]], turns[1][wall[carried]]
            travel[carried] = relative_ways(self.system, q, displacement, ways, self.balls_of(pairs[carried]))
        passing = travel > thick
        return pairs[passing], travel[passing], thick[passing]

    def reach_of(self, numbers: Array) -> Array:
        """Return the reach of some pairs, shape (k, nv): of spheres that of their centres."""
        own = [self.system.reach(body, np.zeros(3), 0.0) for body in self.bodies_of(numbers)[1].tolist()]
        of_walls, still = dict(self._reach), np.zeros(self.system.nv)
        return np.array(own) + np.array([of_walls.get(a, still) for a in (numbers % len(self._kind)).tolist()])

    def balls_of(self, numbers: Array) -> PairBalls:
        """Return middles of walls and the centres of spheres, as balls without size."""
        middles = self._middles[numbers % len(self._kind)]
        return PairBalls(np.stack(self.bodies_of(numbers)), np.stack([middles, 0.0 * middles]), np.zeros(len(numbers)))

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair, shape (n w, nv)."""
        rows = self.contacts(t, q, np.inf)
        return np.zeros((0, self.system.nv)) if rows is None else dense(rows.jacobian)


def _kind_of(wall: HalfSpace | PlacedShape) -> int:
    return _PLANE if isinstance(wall, HalfSpace) else _BOX if isinstance(wall.shape, Box) else _CAPSULE


def _wall_numbers(wall: HalfSpace | PlacedShape) -> Array:
    """Return the row of `walls` of `wall_contacts` for a wall in the frame of its body, shape (15,)."""
    numbers = np.zeros(15)
    if isinstance(wall, HalfSpace):
        numbers[:3], numbers[3] = wall.normal, wall.offset
        return numbers
    R, p = wall.rotation, wall.position
    if isinstance(wall.shape, Box):
        numbers[:9], numbers[9:12], numbers[12:] = R.T.ravel(), p, 0.5 * np.array(wall.shape.size)
        return numbers
    assert isinstance(wall.shape, Capsule)
    half = 0.5 * wall.shape.length * R[:, 2]
    numbers[:3], numbers[3:6], numbers[6] = p - half, p + half, wall.shape.radius
    return numbers
