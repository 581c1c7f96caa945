"""Random arguments of the kernels that find contact points: pairs of shapes that touch, overlap, or are apart."""

import numpy as np

from mbvi.geometry.contact_patch import MOST_GATHERED
from mbvi.geometry.convex_polygon import convex_hull
from mbvi.geometry.refined_distance import COAL, FAILED, UNIQUE, refined
from mbvi.geometry.shapes import HalfSpace, Hull
from support.distance_kernel_arguments import axes_of, rotation, unit, world_of

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


def one_of_lines(rng):
    point = rng.normal(size=(6, 3))
    point[3:] = point[:3] + np.array([0.0, 1.0, 0.0])
    return rng.normal(size=6), point, 6, np.array([0.0, 1.0, 0.0])


def shape(rng):
    """The tables of two shapes, one of them with its place in the world, and the first and last of its points."""
    axes, places = axes_of(rng)
    side = int(rng.integers(2))
    ends = int(axes.shapes.first_point[side]), int(axes.shapes.first_point[side + 1])
    return axes.shapes, side, world_of(axes, places)[side], ends


def near_vertices(rng):
    tables, _, place, ends = shape(rng)
    rest = (
        unit(rng),
        float(rng.choice([0.0, 0.1, 1.0])),
        np.zeros((MOST_GATHERED, 3)),
        np.zeros(MOST_GATHERED, np.int64),
    )
    return place, tables.points, *ends, tables.first, tables.neighbour, int(rng.integers(*ends)), *rest


def near_corners(rng):
    tables, side, place, _ = shape(rng)
    n = unit(rng) if rng.random() < 0.6 else place[int(rng.integers(3))].copy()
    return place, tables.sizes[side].copy(), n, float(rng.choice([1e-9, 0.1, 1.0])), np.zeros((MOST_GATHERED, 3))


def of_hull(tables, begin):
    return tables.first_face[begin + 1] > tables.first_face[begin]


def leave(rng):
    tables, side, place, ends = shape(rng)
    vertices = np.arange(*ends)
    count = len(vertices) if of_hull(tables, ends[0]) else 0
    faces = tables.first_face, tables.face, tables.planes
    return place, tables.sizes[side].copy(), vertices, count, *faces, place[3] + 0.02 * rng.normal(size=3), unit(rng)


def facing(rng):
    tables, side, place, ends = shape(rng)
    vertex = int(rng.integers(*ends)) if of_hull(tables, ends[0]) else -1
    faces = tables.first_face, tables.face, tables.planes
    return place, tables.sizes[side].copy(), vertex, *faces, unit(rng), np.zeros(3)


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
    tables, side, place, ends = shape(rng)
    axes, start = rotation(rng), int(rng.integers(*ends))
    depth, found = float(rng.choice([1e-9, 0.1])), np.zeros((MOST_GATHERED, 3))
    return (
        place, tables.sizes[side].copy(), tables.points, *ends, tables.first, tables.neighbour, start, *axes.copy(),
        depth, 0.2, found, np.full(MOST_GATHERED, -1), np.zeros((2 * MOST_GATHERED, 2)),
    )  # fmt: skip


def few(rng):
    place = points(rng)
    k = len(place)
    return place, rng.normal(size=k), rng.normal(size=(k, 3)), k, float(rng.choice([-9.0, 0.0, 9.0])), 1.0


def choose_normal(rng):
    axes, _, world, distance, normal, _, result = known_pair(rng)
    state = int(rng.choice([result, COAL]))
    rest = axes.sides, axes.start, 0, distance, 0.2, 0.25, state, normal
    return world, *axes.shapes[2:], *rest


def patch(rng):
    axes, _, world, distance, normal, *_ = known_pair(rng)
    room = 4 * MOST_GATHERED
    sizes = distance, float(rng.choice([1e-6, 0.05, 0.5])), 0.2
    return world, *axes.shapes[2:], axes.sides, axes.start, 0, *sizes, normal, np.zeros(room), np.zeros((room, 3))


def from_axes(rng):
    axes, places, _, _, normal, *_ = known_pair(rng)
    axes.keep(places, np.array([0]), normal[None])
    if rng.random() < 0.2:
        axes.axis[0] = np.nan
    written = np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1, np.int64)
    pairs, bound = np.zeros(1, np.int64), np.array([0.2])
    return places, *axes.shapes, axes.sides, axes.start, bound, axes.axis, pairs, *written, np.full(1, -1)


def from_normals(rng):
    axes, places, _, distance, normal, *_ = known_pair(rng)
    pairs, enough = np.zeros(1, np.int64), float(rng.choice([-1.0, np.inf]))
    known = np.array([distance]), normal[None].copy(), np.zeros((1, 3)), np.full(1, FAILED)
    return places, *axes.shapes[:7], axes.sides, axes.start, np.array([0.2]), pairs, pairs, enough, *known


def contacts(rng):
    axes, places, _, distance, normal, middle, result = known_pair(rng)
    flat, line = np.array([True]), np.zeros(3) if rng.random() < 0.7 else unit(rng)
    room = int(rng.choice([0, 60]))
    found = np.array([distance]), normal[None].copy(), middle[None].copy(), np.array([result])
    return (
        places, *axes.shapes, axes.sides, axes.start, np.array([0.2]), np.array([0.25]), flat, line,
        np.zeros(1, np.int64), float(rng.choice([distance - 1.0, distance + 1e-9, distance + 0.1])), *found,
        np.zeros(room, np.int64), np.zeros(room), np.zeros((room, 3)), np.zeros((room, 3)),
    )  # fmt: skip


def walls_of(rng, shapes):
    """A half-space for each shape; of the wheel its face is level."""
    walls = [HalfSpace(tuple(unit(rng)), 0.1 * rng.normal()) for _ in shapes]
    return [
        HalfSpace(tuple(s.rotation[:, 2]), 0.0) if s.shape is WHEEL else w for s, w in zip(shapes, walls, strict=True)
    ]


def lines_of_pairs(rng):
    _, point, count, line = one_of_lines(rng)
    return np.sort(rng.integers(0, 3, size=count)), point, line, np.full(count, -1)


PATCH_ARGUMENTS = {
    "_beyond": lambda rng: (rng.normal(size=(4, 2)), 0, int(rng.integers(4)), *rng.normal(size=2).tolist()),
    "convex_hull": hull,
    "_common_segment": segments,
    "common_polygon": polygons,
    "spread_out": spread_out,
    "within_plane": lambda rng: (unit(rng), np.zeros(3), np.zeros(3)),
    "_gather": lambda rng: (
        rng.normal(size=(4, 3)), unit(rng), 0.0, *rng.normal(size=3).tolist(), np.zeros((2, 3)), int(rng.integers(3)),
    ),
    "near_vertices": near_vertices,
    "near_corners": near_corners,
    "_leave_ball": lambda rng: (0.1 * rng.normal(size=3), unit(rng), 0.5),
    "leave": leave,
    "facing": facing,
    "_choose_normal": choose_normal,
    "_patch": patch,
    "_outline": outline,
    "_few": few,
    "_middle_of": lambda rng: (rng.normal(size=4), rng.normal(size=(4, 3)), int(rng.integers(5)), 0.3, np.zeros(3)),
    "_one_of_each_line": one_of_lines,
    "keep_one_of_each_line": lines_of_pairs,
    "distances_from_axes": from_axes,
    "distances_from_normals": from_normals,
    "write_contacts": contacts,
}  # fmt: skip
