"""Frictionless spheres against each other, in bulk."""

from __future__ import annotations

import numpy as np

from ..system import System
from .active import Array, Rows


class SphereContacts:
    """Every pair of the free spheres; neighbours are found by a tree, so that no list of pairs is kept.

    Parameters
    ----------
    system : System
        What moves the spheres.
    where : slice
        The part of q that holds their centres.
    first_body : int
        Body of the first sphere; the others follow.
    radii : ndarray, shape (n,)
        Radii [m].
    names : sequence of str
        One a sphere.
    group : ndarray of int, shape (n,)
        Which entity each sphere belongs to.
    group_restitution : ndarray, shape (g, g)
        e between the entities.

    Notes
    -----
    Constraint i n + j is the pair (i, j), i < j.
    """

    def __init__(
        self,
        system: System,
        where: slice,
        first_body: int,
        radii: Array,
        names: tuple[str, ...],
        group: Array,
        group_restitution: Array,
    ) -> None:
        self.system, self._where, self._first_body = system, where, first_body
        self._radii, self._sphere_names = radii, names
        self._group, self._e = group, group_restitution
        self._largest = 2.0 * float(radii.max())

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        i, j = divmod(constraint, len(self._radii))
        return f"{self._sphere_names[i]} | {self._sphere_names[j]}"

    @property
    def size(self) -> int:
        """How many numbers the pairs take up."""
        return len(self._radii) ** 2

    @property
    def count(self) -> int:
        """How many spheres there are."""
        return len(self._radii)

    def restitution_of(self, i: Array, j: Array) -> Array:
        """Return e of pairs of spheres."""
        return np.asarray(self._e[self._group[i], self._group[j]])

    def reach_of(self, i: Array, j: Array) -> Array:
        """Return how fast each velocity can bring pairs of spheres nearer, shape (k, nv)."""
        rows, here = np.zeros((len(i), self.system.nv)), np.arange(len(i))
        for body in np.unique(np.concatenate([i, j])).tolist():
            reach = self.system.reach(self._first_body + body, np.zeros(3), 0.0)
            rows[here[(i == body) | (j == body)]] += reach
        return rows

    def thickness_of(self, i: Array, j: Array) -> Array:
        """Return what pairs of spheres travel at least in passing through each other [m]."""
        return np.asarray(self._radii[i] + self._radii[j])

    def _near(self, q: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
        # imported here for its weight: only scenes of spheres need it
        from scipy.spatial import cKDTree

        centres = q[self._where].reshape(-1, 3)
        pairs = cKDTree(centres).query_pairs(self._largest + max(tolerance, 0.0), output_type="ndarray")
        i, j = pairs[:, 0], pairs[:, 1]
        apart = centres[j] - centres[i]
        length = np.sqrt(np.einsum("ij,ij->i", apart, apart))
        near = np.flatnonzero(length - self._radii[i] - self._radii[j] <= tolerance)
        near = near[np.lexsort((j[near], i[near]))]
        i, j, length = i[near], j[near], length[near]
        # coinciding centres have no direction; any will do to push them apart
        normal = np.where(
            length[:, None] > 0.0, apart[near] / np.where(length > 0.0, length, 1.0)[:, None], [0, 0, 1.0]
        )
        return i, j, length - self._radii[i] - self._radii[j], normal

    def active(self, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        i, j, gap, normal = self._near(q, tolerance)
        if not i.size:
            return None
        point = q[self._where].reshape(-1, 3)[i] + (self._radii[i] + 0.5 * gap)[:, None] * normal
        rows = self.system.separation_rows(q, self._first_body + i, self._first_body + j, point, normal)
        return Rows(i * len(self._radii) + j, gap, rows, self._e[self._group[i], self._group[j]], point, normal)

    def gap(self, t: float, q: Array) -> Array:
        """Return the gap of every pair i < j, shape (n (n - 1) / 2,) [m]."""
        return self._near(q, np.inf)[2]

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair i < j, shape (n (n - 1) / 2, nv)."""
        rows = self.active(t, q, np.inf, None)
        return np.zeros((0, self.system.nv)) if rows is None else rows.jacobian
