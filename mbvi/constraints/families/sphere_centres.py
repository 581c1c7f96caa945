"""Where the centres of free spheres are in q."""

from __future__ import annotations

from typing import NamedTuple

from ..rows import Array


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
