"""Random arguments of the kernels that find contact points: pairs of shapes that touch, overlap, or are apart."""

import numpy as np

from mbvi.geometry.closed_form.convex_polygon import convex_hull
from mbvi.geometry.narrow.contact_patch import MOST_GATHERED
from mbvi.geometry.narrow.refined_distance import FAILED, UNIQUE
from mbvi.geometry.shapes.shapes import HalfSpace, Hull
from support.distance_kernel_arguments import axes_of, refined, rotation, unit, world_of

# a disk of many vertices, all of which can lie in one plane
ANGLES = np.sort(np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, 30))
WHEEL = Hull(
    0.2 * np.concatenate([np.column_stack([np.cos(ANGLES), np.sin(ANGLES), z + 0 * ANGLES]) for z in (0, 0.3)])
)


def points(rng):
    """Points of a plane, now and then on one line, or some of them twice."""
    place = rng.normal(size=(int(rng.integers(1, 12)), 2))
    if rng.random() < 0.3:
        place[:, 1] = 2.0 * place[:, 0]
    return np.concatenate([place, place[:2]])


def turns_right(rng):
    """Two corners, which may coincide, and a point, which may lie on their line."""
    place, part = rng.normal(size=(2, 2)), rng.normal()
    place[1] = place[int(rng.integers(2))]
    x, y = place[0] + part * (place[1] - place[0]) + rng.choice([0.0, 3e-10, 1.0]) * rng.normal(size=2)
    return place, 0, 1, float(x), float(y), 1.0


def list_outer(rng):
    """Few or many points, the latter of a disk or of a line."""
    place = rng.normal(size=(int(rng.choice([5, 40])), 2))
    if rng.random() < 0.3:
        place[:, 1] = 2.0 * place[:, 0]
    return place, len(place), 1.0, np.zeros(len(place), np.int64)


def polygon(rng):
    place = points(rng)
    corners = np.zeros((2 * len(place), 2))
    return corners, int(convex_hull(place, len(place), 1.0, corners))


def hull(rng):
    place = points(rng)
    return place, len(place), 1.0, np.zeros((2 * len(place), 2))


def segments(rng):
    one, other = rng.normal(size=(2, 2)), rng.normal(size=(2, 2))
    if rng.random() < 0.6:
        other = one + rng.uniform(-0.5, 0.5) * (one[1] - one[0])
    return one, int(rng.integers(1, 3)), other.copy(), int(rng.integers(1, 3)), 1.0, np.zeros((8, 2))


def polygons(rng):
    one, other = polygon(rng), polygon(rng)
    room = 2 * (len(one[0]) + len(other[0]))
    return *one, *other, 1.0, np.zeros((room, 2)), np.zeros((room, 2))


def spread_out(rng):
    place = points(rng) if rng.random() < 0.5 else np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    return place, rng.normal(size=len(place)), float(rng.choice([0.0, 0.01, 0.1])), np.zeros(len(place) + 1, np.int64)


def face(rng):
    """Places and gaps of points of a face, and the gap up to which some of them count as touching."""
    place = points(rng) if rng.random() < 0.5 else np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    gap = rng.choice([0.0, 1.0]) * place @ rng.normal(size=2) + rng.choice([0.0, 1e-3]) * rng.normal(size=len(place))
    return place, gap, float(np.quantile(gap, rng.choice([0.0, 0.3, 1.0])))


def grow(rng):
    place, gap, low = face(rng)
    corner = np.zeros(8, np.int64)
    corner[0] = gap.argmin()
    return place, gap, low, float(rng.choice([1e-9, 0.1])), corner, 1, int(rng.choice([3, 8]))


def side_of_pair(rng):
    """Where one shape of a pair is, the tables of both, the pair, the side, and the points of that shape."""
    axes, places = axes_of(rng)
    side, shapes = int(rng.integers(2)), axes.shapes
    points = np.arange(shapes.first_point[side], shapes.first_point[side + 1])
    shapes.start[0, side] = rng.choice(points)
    return world_of(axes, places), shapes, 0, side, points


def near_vertices(rng):
    world, shapes, pair, side, _ = side_of_pair(rng)
    rest = float(rng.choice([0.0, 0.1, 1.0])), np.zeros((MOST_GATHERED, 3)), np.full(MOST_GATHERED, -1)
    return world[side], shapes, pair, side, unit(rng), *rest


def near_corners(rng):
    world, shapes, _, side, _ = side_of_pair(rng)
    n = unit(rng) if rng.random() < 0.6 else world[side, int(rng.integers(3))].copy()
    depth, found = float(rng.choice([1e-9, 0.1, 1.0])), np.zeros((MOST_GATHERED, 3))
    return world[side], shapes.sizes[side].copy(), n, depth, found


def leave(rng):
    world, shapes, _, side, _ = side_of_pair(rng)
    return world[side], shapes, side, world[side, 3] + 0.02 * rng.normal(size=3), unit(rng)


def lines_out(rng):
    while True:
        world, shapes, pair, side, points = side_of_pair(rng)
        if shapes.first_face[points[0] + 1] > shapes.first_face[points[0]]:
            shape = int(shapes.sides[pair, side])
            return world[side], shapes, shape, points, len(points), rotation(rng), float(rng.normal())


def facing(rng):
    world, *pair, _ = side_of_pair(rng)
    return world[pair[-1]], *pair, unit(rng), np.zeros(3)


def known_pair(rng):
    """A pair of shapes with its distance and normal."""
    while True:
        axes, places = axes_of(rng)
        world = world_of(axes, places)
        normal = world[1, 3] - world[0, 3]
        normal /= np.linalg.norm(normal)
        result, distance, middle = refined(axes, places, 0, normal)
        if result != FAILED:
            return axes, places, world, distance, normal, middle if result == UNIQUE else np.zeros(3), result


def outline(rng):
    world, *pair, _ = side_of_pair(rng)
    found, vertices = np.zeros((MOST_GATHERED, 3)), np.full(MOST_GATHERED, -1)
    depth, corners = float(rng.choice([1e-9, 0.1])), np.zeros((2 * MOST_GATHERED, 2))
    return world, *pair, rotation(rng), depth, 0.2, found, vertices, corners


def few(rng):
    place = points(rng)
    k = len(place)
    return place, rng.normal(size=k), rng.normal(size=(k, 3)), k, float(rng.choice([-9.0, 0.0, 9.0])), 1.0


def choose_normal(rng):
    axes, _, world, distance, normal, *_ = known_pair(rng)
    return world, axes.shapes, 0, distance, 0.2, normal


def region(rng):
    axes, _, world, distance, normal, *_ = known_pair(rng)
    depth, room = float(rng.choice([1e-6, 0.05, 0.5])), 4 * MOST_GATHERED
    return world, axes.shapes, 0, distance, depth, 0.2, normal, np.zeros(room), np.zeros((room, 3))


def from_axes(rng):
    axes, places, _, _, normal, *_ = known_pair(rng)
    axes.keep(places, np.array([0]), normal[None])
    if rng.random() < 0.2:
        axes.axis[0] = np.nan
    written = np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1, np.int64)
    near = float(rng.choice([0.0, np.inf]))
    return places, axes.tables, np.array([0.2]), np.zeros(1, np.int64), axes.axis, near, *written


def contacts(rng):
    axes, places, _, distance, normal, middle, result = known_pair(rng)
    tolerance, room = float(rng.choice([distance - 1.0, distance + 1e-9, distance + 0.1])), int(rng.choice([0, 60]))
    found = np.array([distance]), normal[None].copy(), middle[None].copy(), np.array([result])
    return (
        places, axes.tables, np.array([0.2]), np.array([True]), np.zeros(1, np.int64), tolerance,
        *found, np.zeros(room, np.int64), np.zeros(room), np.zeros((room, 3)), np.zeros((room, 3)),
    )  # fmt: skip


def walls_of(rng, shapes):
    """A half-space for each shape; of the wheel its face is level."""
    walls = [HalfSpace(tuple(unit(rng)), 0.1 * rng.normal()) for _ in shapes]
    return [
        HalfSpace(tuple(s.rotation[:, 2]), 0.0) if s.shape is WHEEL else w for s, w in zip(shapes, walls, strict=True)
    ]


def lines_of_pairs(rng):
    point = rng.normal(size=(6, 3))
    point[3:] = point[:3] + np.array([0.0, 1.0, 0.0])
    return np.sort(rng.integers(0, 3, size=6)), point, np.array([0.0, 1.0, 0.0]), np.full(6, -1)


PATCH_ARGUMENTS = {
    "_beyond": lambda rng: (rng.normal(size=(4, 2)), 0, int(rng.integers(4)), *rng.normal(size=2).tolist()),
    "_turns_right": turns_right,
    "_list_outer": list_outer,
    "convex_hull": hull,
    "_common_segment": segments,
    "common_polygon": polygons,
    "spread_out": spread_out,
    "_farthest": lambda rng: (*face(rng), 0),
    "_outside": lambda rng: (*face(rng), 0, 1),
    "_grow": grow,
    "make_ascending": lambda rng: (rng.permutation(9), int(rng.integers(10))),
    "few_corners": lambda rng: (*face(rng), np.zeros(8, np.int64)),
    "one_face": lambda rng: (*face(rng)[:2], 1.0),
    "within_plane": lambda rng: (unit(rng), np.zeros(3), np.zeros(3)),
    "_gather": lambda rng: (
        rng.normal(size=(4, 3)), unit(rng), 0.0, *rng.normal(size=3).tolist(), np.zeros((2, 3)), int(rng.integers(3)),
    ),
    "near_vertices": near_vertices,
    "near_corners": near_corners,
    "_leave_ball": lambda rng: (0.1 * rng.normal(size=3), unit(rng), 0.5),
    "leave": leave,
    "lines_out": lines_out,
    "least_line": lambda rng: (rng.normal(size=(int(rng.integers(4)), 3)), *rng.normal(size=2).tolist()),
    "facing": facing,
    "_choose_normal": choose_normal,
    "shared_region": region,
    "_outline": outline,
    "_few": few,
    "mean_of_shared": lambda rng: (rng.normal(size=4), rng.normal(size=(4, 3)), int(rng.integers(5)), 0.3, np.zeros(3)),
    "keep_one_of_each_line": lines_of_pairs,
    "distances_from_axes": from_axes,
    "write_contacts": contacts,
}  # fmt: skip
