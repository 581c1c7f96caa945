"""The family of all pairs of spheres, which are found by a Verlet list."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import kernel, plain_array
from ...geometry.broad.sweep import may_pass
from ...geometry.broad.verlet_list import VerletList
from ...system import System, located_parts
from ...system.free.sparse_rows import dense
from ..family import ConstraintFamily
from ..rebuilt import Rebuilt
from ..relative_ways import PairBalls
from ..row_table import RowTable
from ..rows import Array, Rows

# most spheres of which the tunnelling guard lists all pairs
_FEW = 33


@kernel("i8(f8[:,::1], f8[::1], i8[::1], f8, i8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def pairs_within(
    centres: Array, radii: Array, pairs: Array, tolerance: float, number: Array, gap: Array, point: Array, normal: Array
) -> int:
    """Write those of the given pairs of spheres that are within the tolerance; return how many there are.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres [m].
    radii : ndarray, shape (n,)
        Radii [m].
    pairs : ndarray of int, shape (k,)
        Pairs i n + j, i < j.
    tolerance : float
        Gap at and below which a pair is written [m].
    number, gap, point, normal : ndarray, shapes (k,), (k,), (k, 3), (k, 3)
        Receive, in their first places, the pair, its signed distance, the point midway between the surfaces, and the
        unit normal from i to j.
    """
    n, count = len(radii), 0
    for k in range(len(pairs)):
        i = pairs[k] // n
        j = pairs[k] - i * n
        x, y, z = centres[j, 0] - centres[i, 0], centres[j, 1] - centres[i, 1], centres[j, 2] - centres[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        g = length - radii[i] - radii[j]
        if not g <= tolerance:
            continue
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
        else:
            x, y, z = 0.0, 0.0, 1.0
        far = radii[i] + 0.5 * g
        number[count], gap[count] = pairs[k], g
        normal[count, 0], normal[count, 1], normal[count, 2] = x, y, z
        point[count, 0] = centres[i, 0] + far * x
        point[count, 1] = centres[i, 1] + far * y
        point[count, 2] = centres[i, 2] + far * z
        count += 1
    return count


class SphereCentres(NamedTuple):
    """Where centres of spheres are in q: three numbers each, at equal distances.

    Attributes
    ----------
    start : int
        Place of the first.
    number : int
        How many spheres there are; they are the last in q.
    stride : int
        From one centre to the next: 3 where spheres have no rotation, 7 where they have.
    """

    start: int
    number: int
    stride: int

    def of(self, q: Array) -> Array:
        """Return the centres as a view of q, shape (n, 3)."""
        end = self.start + self.number * self.stride
        return q[self.start : end].reshape(self.number, self.stride)[:, :3]

    def moved_in(self, system: System) -> Array:
        """Return 1 for the velocities that move centres and 0 for others, shape (nv,)."""
        last = located_parts(system)[-1].system
        count = self.number * (last.nv // last.independent_bodies)
        moved = np.zeros(system.nv)
        # no turn of a sphere moves its centre
        moved[system.nv - count :] = last.are_lengths()[last.nv - count :]
        return moved


class SphereContacts(Rebuilt, ConstraintFamily):
    """Every pair of free spheres; only pairs of the Verlet list are measured.

    Parameters
    ----------
    system : System
        What moves the spheres.
    where : SphereCentres
        Where their centres are in q.
    first_body : int
        Body of the first sphere; the others follow.
    radii : ndarray, shape (n,)
        Radii [m].
    names : sequence of str
        Name of each sphere.
    group : ndarray of int, shape (n,)
        Number of the scene's item, such as a call of `add_spheres`, that each sphere belongs to.
    group_restitution : ndarray, shape (g, g)
        e between the items.
    group_friction : ndarray, shape (g, g), optional
        Coefficients of friction between them; none by default.

    Attributes
    ----------
    where, radii
        As given.

    Notes
    -----
    Constraint i n + j is the pair (i, j), i < j, of n spheres.
    """

    isotropic = True

    def __init__(
        self,
        system: System,
        where: SphereCentres,
        first_body: int,
        radii: Array,
        names: tuple[str, ...],
        group: Array,
        group_restitution: Array,
        group_friction: Array | None = None,
    ) -> None:
        self.system, self.where, self._first_body = system, where, first_body
        self.radii: Array = plain_array(radii)
        self._sphere_names = names
        self._group, self._e, self._mu = group, group_restitution, group_friction
        self.friction = 0.0 if group_friction is None else float(group_friction.max())
        self._neighbours = VerletList(radii)
        self.size = len(radii) ** 2
        # an item of a single sphere has no pair within itself
        several = np.bincount(group, minlength=len(group_restitution)) > 1
        self.restitution = np.asarray(group_restitution[~np.diag(~several)])

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        i, j = divmod(constraint, len(self.radii))
        return f"{self._sphere_names[i]} | {self._sphere_names[j]}"

    def friction_of(self, numbers: Array) -> Array:
        """Return the coefficients of friction of some pairs, shape (k,)."""
        i, j = np.divmod(numbers, len(self.radii))
        return np.zeros(len(numbers)) if self._mu is None else self._mu[self._group[i], self._group[j]]

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the bodies of both spheres of some pairs, shapes (k,)."""
        i, j = np.divmod(numbers, len(self.radii))
        return self._first_body + i, self._first_body + j

    @property
    def count(self) -> int:
        """How many pairs there are."""
        return len(self.radii) * (len(self.radii) - 1) // 2

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return "every pair of spheres, found when near"

    def row_table(self, t: float, q: Array) -> RowTable:
        """Return the table of all pairs i < j."""
        i, j = np.triu_indices(len(self.radii), 1)
        pairs, thickness = self.all_pairs(), self.radii[i] + self.radii[j]
        return RowTable(pairs, self.restitution_of(pairs), np.ones(len(i), bool), self.reach_of(pairs), thickness)

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return point and normal of some pairs i < j, shapes (k, 3)."""
        point, normal = self.nearest_points(q)
        return point[rows], normal[rows]

    def restitution_of(self, numbers: Array) -> Array:
        """Return e of some pairs, shape (k,); see the base class."""
        i, j = np.divmod(numbers, len(self.radii))
        return np.asarray(self._e[self._group[i], self._group[j]])

    def reach_of(self, numbers: Array) -> Array:
        """Return the reach of some pairs, shape (k, nv); see the base class."""
        i, j = np.divmod(numbers, len(self.radii))
        rows, here = np.zeros((len(i), self.system.nv)), np.arange(len(i))
        for body in np.unique(np.concatenate([i, j])).tolist():
            reach = self.system.reach(self._first_body + body, np.zeros(3), 0.0)
            rows[here[(i == body) | (j == body)]] += reach
        return rows

    def bending_envelope(self) -> Array:
        """Return how far each velocity carries a centre, shape (nv,)."""
        return self.where.moved_in(self.system)

    def least_displacement(self) -> float:
        """Return a bound: no sphere travels its radius if no entry of a displacement is larger."""
        return float(self.radii.min() / np.sqrt(3.0))

    def passed_share(self) -> Array | None:
        """Return the reach divided by the thickness, shape (nv, k), of the k pairs of few spheres; None of many."""
        if len(self.radii) > _FEW:
            return None
        pairs = self.all_pairs()
        return np.asarray(self.reach_of(pairs).T / self.thickness_of(pairs))

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the pairs that may pass through each other, their travel and their thickness; see the base class."""
        centres = self.where.of(q)
        moved = self.where.of(self.system.integrate(q, displacement)) - centres
        i, j = may_pass(centres, moved, np.linalg.norm(moved, axis=1), self.radii, self.radii)
        travel = np.linalg.norm(moved[j] - moved[i], axis=1)
        return i * len(self.radii) + j, travel, self.radii[i] + self.radii[j]

    def balls_of(self, numbers: Array) -> PairBalls:
        """Return the centres of some pairs, as balls without size: no turn of a sphere matters."""
        bodies = np.stack(self.bodies_of(numbers))
        return PairBalls(bodies, np.zeros((*bodies.shape, 3)), np.zeros(len(numbers)))

    def thickness_of(self, numbers: Array) -> Array:
        """Return the sums of the radii of some pairs, shape (k,) [m]."""
        i, j = np.divmod(numbers, len(self.radii))
        return np.asarray(self.radii[i] + self.radii[j])

    def nearest_of(self, t: float, q: Array, pairs: Array) -> tuple[Array, Array]:
        """Return gaps and normals of some pairs, shapes (k,) [m] and (k, 3)."""
        _, gap, _, normal = self._near(q, pairs, np.inf)
        return gap, normal

    def _near(self, q: Array, pairs: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
        """Return numbers, gaps, points and normals of those of the given pairs that are within the tolerance."""
        k = len(pairs)
        number, gap, point, normal = np.empty(k, np.int64), np.empty(k), np.empty((k, 3)), np.empty((k, 3))
        count = pairs_within(plain_array(self.where.of(q)), self.radii, pairs, tolerance, number, gap, point, normal)
        return number[:count], gap[:count], point[:count], normal[:count]

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        centres = plain_array(self.where.of(q))
        number, gap, point, normal = self._near(q, self._neighbours.within(centres, max(tolerance, 0.0)), tolerance)
        if not number.size:
            return None
        i, j = np.divmod(number, len(self.radii))
        rows = self.system.separation_rows(q, self._first_body + i, self._first_body + j, point, normal)
        return Rows(number, gap, rows, self.restitution_of(number), point, normal)

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return point and normal of every pair i < j, shapes (n (n - 1) / 2, 3)."""
        return self._near(q, self.all_pairs(), np.inf)[2:]

    def all_pairs(self) -> Array:
        """Return the numbers of all pairs i < j."""
        i, j = np.triu_indices(len(self.radii), 1)
        return i * len(self.radii) + j

    def gap(self, t: float, q: Array) -> Array:
        """Return the gap of every pair i < j, shape (n (n - 1) / 2,) [m]."""
        return self._near(q, self.all_pairs(), np.inf)[1]

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair i < j, shape (n (n - 1) / 2, nv)."""
        number, _, point, normal = self._near(q, self.all_pairs(), np.inf)
        i, j = np.divmod(number, len(self.radii))
        return dense(self.system.separation_rows(q, self._first_body + i, self._first_body + j, point, normal))
