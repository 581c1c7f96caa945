"""The patch of two cores: the corners of the polygon that two faces share, seen along the normal.

polygon : ndarray, shape (2, 32, 3)
    Receives the corners in its first half: two coordinates within the plane of the reference face, then the height of
    the other face above it along the normal [m]. The second half is scratch.
"""

from __future__ import annotations

from ...arguments import Array
from ...compiled import kernel
from ..shapes.shape_cores import BALL, HALF, NORMAL, PLACE, SHIFT, facing_axis

# capsules are parallel if their ends are beside each other by less than this part of the sum of their radii
PARALLEL = 1e-4


@kernel("void(f8[:,:,::1], i8, f8[:,:,::1])")
def project_face(cores: Array, side: int, polygon: Array) -> None:
    """Write the face of the other core that looks towards one core, projected along the normal onto the face of that.

    Four corners are written; some coincide if the other core is a segment or a point.
    """
    other = 1 - side
    k, j = facing_axis(cores, side), facing_axis(cores, other)
    k1, k2, j1, j2 = (k + 1) % 3, (k + 2) % 3, (j + 1) % 3, (j + 2) % 3
    depth = cores[other, HALF, j] if cores[other, NORMAL, j] >= 0.0 else -cores[other, HALF, j]
    slope = cores[side, NORMAL, k]
    top = cores[side, HALF, k] if slope >= 0.0 else -cores[side, HALF, k]
    for corner in range(4):
        a = cores[other, HALF, j1] if corner in (0, 3) else -cores[other, HALF, j1]
        b = cores[other, HALF, j2] if corner < 2 else -cores[other, HALF, j2]
        x = cores[side, SHIFT, k] + cores[side, k, j] * depth + cores[side, k, j1] * a + cores[side, k, j2] * b
        height = (x - top) / slope
        x = cores[side, SHIFT, k1] + cores[side, k1, j] * depth + cores[side, k1, j1] * a + cores[side, k1, j2] * b
        polygon[0, corner, 0] = x - height * cores[side, NORMAL, k1]
        x = cores[side, SHIFT, k2] + cores[side, k2, j] * depth + cores[side, k2, j1] * a + cores[side, k2, j2] * b
        polygon[0, corner, 1] = x - height * cores[side, NORMAL, k2]
        polygon[0, corner, 2] = height


@kernel("i8(f8[:,:,::1], i8, f8, f8)")
def clip(polygon: Array, count: int, first: float, second: float) -> int:
    """Clip a polygon of `count` corners to |x| <= first and |y| <= second; return how many corners are left.

    Notes
    -----
    I. E. Sutherland, G. W. Hodgman, Reentrant polygon clipping (1974).
    """
    source = 0
    for line in range(4):
        axis, sign = line // 2, 1.0 if line % 2 == 0 else -1.0
        bound, target, kept, outside = first if axis == 0 else second, 1 - source, 0, False
        for corner in range(count):
            outside = outside or sign * polygon[source, corner, axis] > bound
        if not outside:
            continue
        for corner in range(count):
            following = corner + 1 if corner + 1 < count else 0
            room = bound - sign * polygon[source, corner, axis]
            beyond = bound - sign * polygon[source, following, axis]
            if room >= 0.0 and kept < 32:
                for c in range(3):
                    polygon[target, kept, c] = polygon[source, corner, c]
                kept += 1
            if ((room > 0.0 and beyond < 0.0) or (room < 0.0 and beyond > 0.0)) and kept < 32:
                share = room / (room - beyond)
                for c in range(3):
                    x = polygon[source, corner, c]
                    polygon[target, kept, c] = x + share * (polygon[source, following, c] - x)
                kept += 1
        count, source = kept, target
    for corner in range(count if source == 1 else 0):
        for c in range(3):
            polygon[0, corner, c] = polygon[1, corner, c]
    return count


@kernel("i8(f8[:,:,::1], i8, f8, f8)")
def keep_low(polygon: Array, count: int, highest: float, apart: float) -> int:
    """Keep the corners up to a height, of those nearer to each other than `apart` only one; return how many."""
    kept = 0
    for corner in range(count):
        x, y, height = polygon[0, corner, 0], polygon[0, corner, 1], polygon[0, corner, 2]
        wanted = height <= highest
        for other in range(kept):
            beside = max(abs(polygon[0, other, 0] - x), abs(polygon[0, other, 1] - y)) <= apart
            if wanted and beside:
                # the lower one stays
                wanted = False
                if height < polygon[0, other, 2]:
                    polygon[0, other, 0], polygon[0, other, 1], polygon[0, other, 2] = x, y, height
        if wanted:
            polygon[0, kept, 0], polygon[0, kept, 1], polygon[0, kept, 2] = x, y, height
            kept += 1
    return kept


@kernel("i8(f8[:,:,::1], i8)")
def lowest_corner(polygon: Array, count: int) -> int:
    """Return the index of the lowest of `count` corners; -1 if there is none."""
    lowest = -1
    for corner in range(count):
        if lowest < 0 or polygon[0, corner, 2] < polygon[0, lowest, 2]:
            lowest = corner
    return lowest


@kernel("i8(f8[:,:,::1], i8, f8, f8[:,:,::1])")
def clip_faces(cores: Array, side: int, slack: float, polygon: Array) -> int:
    """Write the polygon that the faces of two cores share, on that of one side; return how many corners it has."""
    k = facing_axis(cores, side)
    first, second = cores[side, HALF, (k + 1) % 3], cores[side, HALF, (k + 2) % 3]
    # an edge that vanishes is that of a capsule, which is as wide as it is round
    beside = max(slack, PARALLEL * (cores[0, BALL, 0] + cores[1, BALL, 0]))
    project_face(cores, side, polygon)
    first += beside if first == 0.0 else slack
    second += beside if second == 0.0 else slack
    count = clip(polygon, 4, first, second)
    for axis in range(2):
        c = (k + 1 + axis) % 3
        for corner in range(count):
            # back into the face itself
            x = polygon[0, corner, axis]
            beyond = x - min(max(x, -cores[side, HALF, c]), cores[side, HALF, c])
            polygon[0, corner, axis] = x - beyond
            polygon[0, corner, 2] += beyond * cores[side, NORMAL, c]
    return count


@kernel("void(f8[:,:,::1], i8, f8[:,:,::1], i8, f8[:,::1], i8)")
def write_corner(cores: Array, side: int, polygon: Array, corner: int, found: Array, row: int) -> None:
    """Write the point midway between the surfaces at a corner of the polygon on a face of one side."""
    k = facing_axis(cores, side)
    top = cores[side, HALF, k] if cores[side, NORMAL, k] >= 0.0 else -cores[side, HALF, k]
    # from the face of one core to the middle between the surfaces
    along = 0.5 * (polygon[0, corner, 2] + cores[side, BALL, 0] - cores[1 - side, BALL, 0])
    for c in range(3):
        x = cores[side, PLACE + 3, c] + cores[side, PLACE + k, c] * top
        x += cores[side, PLACE + (k + 1) % 3, c] * polygon[0, corner, 0]
        x += cores[side, PLACE + (k + 2) % 3, c] * polygon[0, corner, 1]
        for i in range(3):
            x += along * cores[side, NORMAL, i] * cores[side, PLACE + i, c]
        found[row, 1 + c] = x
