"""The contact patch of two flat faces: the polygon that they share, from Coal."""

from __future__ import annotations

import coal
import numpy as np

from ..arguments import Array


class PatchFinder:
    """Finds the polygon that two flat faces share.

    Coal starts from a contact. Its point, normal and distance are given by the caller, because the normal of Coal's own
    search is dominated by rounding where faces just touch. Coal returns one depth for the whole patch; callers compute
    the gap of each corner themselves.

    Parameters
    ----------
    geometry : list
        Coal geometries; `find` names two by their places.
    """

    def __init__(self, geometry: list) -> None:
        self._geometry = geometry
        self._functors: dict[tuple[int, ...], tuple] = {}
        self._contacts, self._patch = coal.CollisionResult(), coal.ContactPatchResult()

    def find(
        self, sides: tuple[int, ...], poses: tuple, tolerance: float, point: Array, normal: Array, distance: float
    ) -> Array | None:
        """Return the corners of the patch, shape (k, 3), k >= 2, in the units of the geometry, or None."""
        a, b = sides
        geometry = self._geometry[a], self._geometry[b]
        if sides not in self._functors:
            request = coal.ContactPatchRequest()
            request.setPatchTolerance(tolerance)
            self._functors[sides] = coal.ComputeContactPatch(*geometry), request
        patch_of, request = self._functors[sides]
        self._contacts.clear()
        self._patch.clear()
        self._contacts.addContact(coal.Contact(*geometry, -1, -1, point, normal, distance))
        patch_of(*poses, self._contacts, request, self._patch)
        if not self._patch.numContactPatches():
            return None
        patch = self._patch.getContactPatch(0)
        if patch.size() < 2:
            return None
        return np.array([patch.getPoint(i) for i in range(patch.size())])
