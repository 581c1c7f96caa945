"""Contacts of boxes and capsules in closed form: signed distance, normal, and the patch of faces that touch.

The signed distance of two shapes is that of their cores less the radii of their balls; see `shape_cores`.
"""

from __future__ import annotations

from math import cos

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..shapes.shape_cores import (
    BALL,
    HALF,
    NEAREST,
    NORMAL,
    PLACE,
    SHIFT,
    bounding_radius,
    complete_normal,
    face_normal,
    facing_axis,
    relate,
    write_normal,
)
from .box_axes import EDGES, NO_AXIS, face_separation, largest_separation, nearest_on_edges, nearest_to_corners
from .box_patch import PARALLEL, clip_faces, keep_low, lowest_corner, project_face, write_corner

# lengths that differ by less than this part of the sum of all half edges are equal: the difference is rounding
_ROUNDING = 1e-12
# lengths below are relative to the bounding radius of the smaller shape
# a face normal replaces the normal within the angle of this cosine, if the separation along it is less by no more than
# the second
_SAME_FACE, _EQUAL = cos(1e-3), 1e-8
# how far a corner of the patch may be above the deepest point, and how near two corners may be to count as one
_PATCH_DEPTH, _SAME_CORNER = 0.02, 1e-7
# a patch whose corners are all less deep than the signed distance by more than this lacks the deepest point
_DEEPEST = 1e-7


@kernel("Tuple((f8, i8, i8))(f8[:,:,::1], f8, f8[:,:,::1])")
def core_distance(cores: Array, slack: float, polygon: Array) -> tuple[float, int, int]:
    """Write the normal of two cores, and their nearest points.

    Returns
    -------
    distance : float
        The signed distance [m].
    code : int
        If it is that of a face, the normal is that of the face, and the lowest corner of the polygon stands for the
        nearest points. Otherwise their nearest points are written.
    corners : int
        How many corners that polygon has.
    """
    best, code = largest_separation(cores, slack)
    corners, known = 0, np.inf
    if code >= EDGES:
        known = nearest_on_edges(cores, (code - EDGES) // 3, (code - EDGES) % 3)
    elif code != NO_AXIS:
        corners = clip_faces(cores, code // 3, slack, polygon)
        if corners == 0 and best <= 0.0:
            # the faces meet but for rounding: the deepest corner
            project_face(cores, code // 3, polygon)
            lowest, corners = lowest_corner(polygon, 4), 1
            for c in range(3):
                polygon[0, 0, c] = polygon[0, lowest, c]
        if corners > 0:
            known = polygon[0, lowest_corner(polygon, corners), 2]
    # of two segments, which have no volume, the axes separate none in one plane
    overlap = best <= 0.0 and (cores[0, HALF, 0] > 0.0 or cores[1, HALF, 0] > 0.0)
    if code != NO_AXIS and (overlap or known <= best + 4.0 * slack):
        return best, code, corners
    # apart: an axis separates by less than the distance if a corner is nearest to a corner or to an edge
    distance = nearest_to_corners(cores, known)
    if distance <= best + 4.0 * slack:
        return best, EDGES, 0
    if 0 <= code < EDGES and distance == known:
        return distance, code, corners
    if distance > slack:
        for c in range(3):
            cores[0, NORMAL, c] = (cores[1, NEAREST, c] - cores[0, NEAREST, c]) / distance
        complete_normal(cores, 0)
    elif code == NO_AXIS:
        # segments on one line: any direction across them
        face_normal(cores, 0, 0, 1.0)
    return distance, NO_AXIS, 0


@kernel("i8(f8[:,:,::1], f8, f8)")
def preferred_face(cores: Array, distance: float, bound: float) -> int:
    """Return the code of a face whose normal replaces the normal, or `NO_AXIS`.

    Where faces touch, rounding decides which of their normals separates most. The face of the first shape goes first,
    by a margin far above rounding: rows are steady, and do not depend on earlier calls.
    """
    for side in range(2):
        if cores[side, HALF, 0] > 0.0:
            k = facing_axis(cores, side)
            sign = 1.0 if cores[side, NORMAL, k] >= 0.0 else -1.0
            least = distance - _EQUAL * bound
            if sign * cores[side, NORMAL, k] > _SAME_FACE and face_separation(cores, side, k, sign) >= least:
                return 3 * side + k
    return NO_AXIS


@kernel("i8(f8[:,:,::1])")
def reference_side(cores: Array) -> int:
    """Return the core on whose face a patch is clipped where the normal is that of no face; -1 if there is no patch."""
    box, other_box = cores[0, HALF, 0] > 0.0, cores[1, HALF, 0] > 0.0
    if box and other_box:
        facing = abs(cores[0, NORMAL, facing_axis(cores, 0)])
        return 0 if facing >= abs(cores[1, NORMAL, facing_axis(cores, 1)]) else 1
    if box or other_box:
        return 0 if box else 1
    # of two capsules only parallel ones touch along a line
    beside = np.sqrt(cores[0, 0, 2] ** 2 + cores[0, 1, 2] ** 2) * min(cores[0, HALF, 2], cores[1, HALF, 2])
    return 0 if beside <= PARALLEL * (cores[0, BALL, 0] + cores[1, BALL, 0]) else -1


@kernel("void(f8[:,:,::1], f8[:,::1], i8)")
def write_middle(cores: Array, found: Array, row: int) -> None:
    """Write the point midway between the surfaces, given nearest points of the cores."""
    wider = cores[0, BALL, 0] - cores[1, BALL, 0]
    for c in range(3):
        found[row, 1 + c] = cores[0, PLACE + 3, c]
        for i in range(3):
            x = cores[0, NEAREST, i] + cores[1, NEAREST, i] + wider * cores[0, NORMAL, i]
            found[row, 1 + c] += 0.5 * x * cores[0, PLACE + i, c]


@kernel("i8(f8[:,:,::1], f8, f8[:,:,::1], f8[:,::1])")
def box_contacts(cores: Array, tolerance: float, polygon: Array, found: Array) -> int:
    """Write the contacts of two shapes, each a box or a capsule.

    Parameters
    ----------
    cores : ndarray, shape (2, 12, 3)
        The shapes: rows HALF, BALL and PLACE are given.
    tolerance : float
        Gap at and below which the patch is wanted [m].
    polygon : ndarray, shape (2, 32, 3)
        Scratch.
    found : ndarray, shape (33, 7)
        Receives a contact in each row: gap, point, normal.

    Returns
    -------
    int
        How many contacts there are.
    """
    relate(cores)
    extent = 0.0
    for c in range(3):
        extent += cores[0, HALF, c] + cores[1, HALF, c] + abs(cores[0, SHIFT, c])
    slack, radii = _ROUNDING * extent, cores[0, BALL, 0] + cores[1, BALL, 0]
    distance, code, corners = core_distance(cores, slack, polygon)
    side = code // 3 if 0 <= code < EDGES else 0
    # the deepest point goes into the first row
    if 0 <= code < EDGES:
        write_corner(cores, side, polygon, lowest_corner(polygon, corners), found, 0)
    else:
        write_middle(cores, found, 0)
    found[0, 0] = distance - radii
    if distance - radii > tolerance:
        write_normal(cores, side, found, 0)
        return 1
    bound = min(bounding_radius(cores, 0), bounding_radius(cores, 1))
    face = preferred_face(cores, distance, bound)
    reference = face // 3 if face != NO_AXIS else reference_side(cores)
    if face != NO_AXIS and face != code:
        face_normal(cores, reference, face % 3, 1.0 if cores[reference, NORMAL, face % 3] >= 0.0 else -1.0)
    write_normal(cores, max(reference, 0), found, 0)
    if reference < 0:
        return 1
    if face == NO_AXIS or face != code:
        corners = clip_faces(cores, reference, slack, polygon)
    corners = keep_low(polygon, corners, distance + _PATCH_DEPTH * bound, _SAME_CORNER * bound)
    lowest = lowest_corner(polygon, corners)
    first = 1
    if lowest >= 0 and polygon[0, lowest, 2] <= distance + _DEEPEST * bound:
        # it is the deepest point
        polygon[0, lowest, 2], first = distance, 0
    for corner in range(corners):
        # what exceeds the penetration depth is rounding
        polygon[0, corner, 2] = max(polygon[0, corner, 2], distance)
        write_corner(cores, reference, polygon, corner, found, first + corner)
        found[first + corner, 0] = polygon[0, corner, 2] - radii
        for c in range(3):
            found[first + corner, 4 + c] = found[0, 4 + c]
    return first + corners
