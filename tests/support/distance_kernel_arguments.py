"""Random arguments of the kernels that refine distances: pairs of two shapes about as far apart as they are large."""

import numpy as np

from mbvi.geometry.broad import separating_axis
from mbvi.geometry.broad.separating_axis import SeparatingAxes, place_pair
from mbvi.geometry.narrow import core_points, kinks, refined_distance
from mbvi.geometry.narrow import normal_search as search
from mbvi.geometry.narrow.contact_patch import MOST_GATHERED
from mbvi.geometry.narrow.core_search import search_cores
from mbvi.geometry.narrow.proved_depth import MOST_POINTS
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere

CORNERS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0.9, 0.8, -0.7]])
SHAPES = [
    Sphere(0.2), Box((0.3, 0.4, 0.2)), Ellipsoid((0.3, 0.2, 0.1)), Capsule(0.1, 0.4), Cylinder(0.15, 0.3),
    Hull(0.2 * CORNERS), Hull(np.random.default_rng(3).normal(size=(60, 3)) @ np.diag([0.1, 0.08, 0.05])),
]  # fmt: skip


def rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def unit(rng):
    n = rng.normal(size=3)
    return n / np.linalg.norm(n)


def axes_of(rng):
    """Two shapes on bodies of their own or of the world, their axes, and where the bodies are."""
    shapes = [SHAPES[k] for k in rng.integers(len(SHAPES), size=2)]
    bodies = [(1, 2), (0, 1), (1, 0)][rng.integers(3)]
    at = np.zeros(3), 0.45 * unit(rng)
    placed = [
        PlacedShape(f"{k}", shape, body, rotation(rng), where)
        for k, (shape, body, where) in enumerate(zip(shapes, bodies, at, strict=True))
    ]
    axes = SeparatingAxes(ShapeTable(placed), np.array([[0, 1]]))
    places = np.array([[*rotation(rng), 0.05 * rng.normal(size=3)] for _ in axes.bodies])
    return axes, places


def world_of(axes, places):
    world = np.empty((2, 4, 3))
    place_pair.loops(places, axes.shapes, 0, world)
    return world


def separated(axes, places, pair, n):
    """The separation of a pair of shapes along a unit vector."""
    world = np.empty((2, 4, 3))
    place_pair(places, axes.shapes, pair, world)
    return separating_axis.pair_separation(world, axes.shapes, pair, n)


def refined(axes, places, pair, normal):
    """Refine the signed distance of a pair of shapes, starting from an approximate normal.

    Parameters
    ----------
    axes : SeparatingAxes
        The shapes and pairs.
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies `axes.bodies`.
    pair : int
        The pair.
    normal : ndarray, shape (3,)
        The approximate unit normal from the first to the second; receives the refined one.

    Returns
    -------
    result : int
        `UNIQUE`; `FLAT`, then the point is meaningless; `FAILED`, then distance, point and normal are.
    distance : float
        Signed distance [m].
    point : ndarray, shape (3,)
        The point midway between the surfaces [m].
    """
    nearest, world = np.empty(3), np.empty((2, 4, 3))
    place_pair(places, axes.shapes, pair, world)
    result, distance = refined_distance.refine_pair(world, axes.shapes, pair, normal, nearest)
    return result, distance, nearest


def state(rng):
    """What the kernels of `kinks` share, at a normal that some of them are near."""
    axes, places = axes_of(rng)
    world = world_of(axes, places)
    between = world[1, 3] - world[0, 3]
    n = between / np.linalg.norm(between) + 0.1 * rng.normal(size=3)
    d = refined_distance.separation_of(world, axes.shapes, 0, n / np.linalg.norm(n))
    edges = d.edge[np.any(d.edge != 0.0, axis=1)]
    if len(edges) and rng.random() < 0.5:
        # on one kink
        a = edges[rng.integers(len(edges))]
        n -= (n @ a) / (a @ a) * a
    n /= np.linalg.norm(n)
    d.sign[:] = np.where(d.edge @ n >= 0.0, 1, -1)
    d.base[:] = np.argmax(d.first @ n), np.argmax(d.second @ n)
    s = {"n": n, "d": d, "kinks": np.zeros((3, 3), np.int64), "found": np.zeros((6, 3)), "basis": np.zeros((3, 3))}
    s["count"] = refined_distance._first_set(n, s["kinks"], d)
    s["m"] = kinks.directions(s["kinks"], s["count"], d, s["found"])
    s["rank"] = search.span(s["found"], s["m"], s["basis"])
    s.update(origin=world[0, 3], radius=0.1, kink=np.zeros(3, np.int64), scratch=np.zeros(3), swell=d.swell.copy())
    s.update(t=1.5 * rng.normal(size=2), left=np.zeros(2, bool), at=np.zeros((2, 3)), slope=np.zeros(3))
    s.update(within=float(rng.choice([0.5, -1e-12])), disks=bool(rng.integers(2)), nearest=np.zeros(3))
    s.update(who=int(rng.integers(2)), apart=0.1, pull=between.copy(), kind=int(rng.integers(3)), zero=0)
    return s


def of_state(*names):
    def make(rng):
        s = state(rng)
        return tuple(s[name] for name in names)

    return make


def added(rng):
    """A state and a kink that n is not kept on yet."""
    while True:
        s = state(rng)
        if s["count"] < 3 and kinks.next_kink(s["n"], 2.0, False, s["kink"], s["kinks"], s["count"], s["d"]):
            return tuple(s[k] for k in ("n", "scratch", "kink", "kinks", "count", "d"))


def placed_shape(rng):
    axes, places = axes_of(rng)
    return places, axes.frame, axes.shapes.fixed, int(rng.integers(2)), np.zeros((4, 3))


def pair_of(rng):
    """A pair of shapes, and the direction from one to the other."""
    axes, places = axes_of(rng)
    world = world_of(axes, places)
    apart = world[1, 3] - world[0, 3]
    return world, axes.shapes, 0, apart / np.linalg.norm(apart)


def points_about(rng):
    world, shapes, pair, n = pair_of(rng)
    return world, shapes, pair, int(rng.integers(2)), n


def maximise(rng):
    world, shapes, pair, n = pair_of(rng)
    radius = float(shapes.sizes[0, 3])
    return world[0, 3].copy(), radius, refined_distance.separation_of(world, shapes, pair, n), n, np.zeros(3)


def place_pair_(rng):
    axes, places = axes_of(rng)
    return places, axes.shapes, 0, np.zeros((2, 4, 3))


def axis_in_world(rng):
    axes, places = axes_of(rng)
    return places, int(axes.frame[0]), unit(rng)[None], 0, np.zeros(3)


def keep_axis(rng):
    places, body, axis, pair, n = axis_in_world(rng)
    return places, body, axis[0], n[None], pair


def outermost(rng):
    axes, _ = axes_of(rng)
    s, side = axes.shapes, int(rng.integers(2))
    ends = int(s.first_point[side]), int(s.first_point[side + 1])
    return s.points, *ends, s.first, s.neighbour, *unit(rng).tolist(), int(rng.integers(*ends))


def outermost_of_shape(rng):
    shapes, side = axes_of(rng)[0].shapes, int(rng.integers(2))
    return shapes, side, *unit(rng).tolist(), int(rng.integers(*shapes.first_point[side : side + 2]))


def cell_of(rng):
    return tuple(rng.choice([-1.0, -0.3, 0.0, 0.7], size=3).tolist())


def connected(rng):
    points, begin, end, first, neighbour, *n, start = outermost(rng)
    heights = points[begin:end] @ np.array(n)
    if rng.random() < 0.7:
        start = begin + int(np.argmax(heights))
    least, most = float(rng.choice([-np.inf, np.median(heights)])), int(rng.choice([3, 40, 1000]))
    found = np.full(int(rng.choice([5, end - begin])), -1)
    return points, begin, end, first, neighbour, *n, start, least, most, found, np.zeros(len(points), bool)


def climb(rng):
    axes = [np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.1, 0.3, (3, 1)) for _ in range(2)]
    rank = int(rng.integers(2))
    n, along = unit(rng), unit(rng)
    if rank:
        n -= (n @ along) * along
        n /= np.linalg.norm(n)
    return n, n + 0.1 * rng.normal(size=3), np.array(axes), np.array([along, *np.zeros((2, 3))]), rank


def vectors(rng):
    found = rng.normal(size=(4, 3))
    found[2] = found[0] - 2.0 * found[1]
    return found, int(rng.integers(5)), np.zeros((3, 3))


def tangents(rng):
    n, _, _, basis, rank = climb(rng)
    return n, basis, rank, np.zeros((2, 3))


def make_normal(rng):
    basis, rank = np.linalg.qr(rng.normal(size=(3, 3)))[0], int(rng.integers(3))
    return unit(rng), np.ascontiguousarray(basis), rank


def hulls_of(rng):
    """Two hulls whose centres are near each other, a direction between them, and their extents along it."""
    placed = [PlacedShape(f"{k}", Hull(rng.normal(size=(12, 3))), k + 1, np.eye(3), np.zeros(3)) for k in range(2)]
    axes = SeparatingAxes(ShapeTable(placed), np.array([[0, 1]]))
    places = np.array([[*rotation(rng), k * rng.uniform(0.5, 3.0) * unit(rng)] for k in range(2)])
    n = places[1, 3] / np.linalg.norm(places[1, 3])
    return world_of(axes, places), axes.shapes, 0, n, 0.1 * rng.random(), 1.0


def polygons(rng):
    """Points of two polygons in a plane, in the first places of arrays."""
    k, m = rng.integers(1, 6, size=2)
    return rng.normal(size=(8, 2)), 0.5 * rng.normal(size=(8, 2)), int(k), int(m)


def triangle(rng):
    """A triangle of directions about one, and a point for each."""
    middle = unit(rng)
    corners = middle + 0.3 * rng.normal(size=(3, 3))
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    return (np.array([corners, middle + 0.5 * rng.normal(size=(3, 3))]),)


def better_direction(rng):
    """Two shapes that overlap, and the depth along a direction that may not be the least."""
    axes, _ = axes_of(rng)
    places = np.array([[*rotation(rng), 0.05 * rng.normal(size=3)] for _ in axes.bodies])
    world, n = world_of(axes, places), unit(rng)
    return world, axes.shapes, 0, n, 0.5 * rng.random(), 0.3 * float(rng.integers(2)), 1e-3


def turn_to(rng):
    world, shapes, pair, n = pair_of(rng)
    active = np.zeros((4, 8))
    core_points.lowest_difference(world, shapes, pair, *n.tolist(), core_points.CORNERS, active, 0)
    return world, shapes, pair, n, unit(rng), active, 1


def corners(rng):
    """A pair and its axis, with the corners of three points of its difference, which may be those of a result."""
    world, shapes, pair, n = pair_of(rng)
    if rng.random() < 0.5:
        search_cores(world, shapes, pair, n, False, np.zeros(3))
    count = int((shapes.start[pair, 2::2] >= 0).sum())
    for side in range(2):
        s = shapes.sides[pair, side]
        begin, end = shapes.first_point[s], shapes.first_point[s + 1]
        # others for those that are not known
        others = rng.integers(*((begin, end) if end - begin > 1 else (0, 8)), size=3)
        shapes.start[pair, 2 + side + 2 * count :: 2] = others[count:]
    return world, shapes, pair, n


def active_points(rng):
    """The same with the points."""
    world, shapes, pair, n = corners(rng)
    active = np.zeros((4, 8))
    for i in range(3):
        core_points.difference_of(world, shapes, pair, *shapes.start[pair, 2 + 2 * i : 4 + 2 * i].tolist(), active, i)
    return world, shapes, pair, n, active


def difference(rng):
    world, shapes, pair, _ = corners(rng)
    return world, shapes, pair, *shapes.start[pair, 2:4].tolist(), np.zeros((4, 8)), int(rng.integers(4))


def ended_search(rng):
    return *active_points(rng), rng.random(3), int(rng.integers(1, 4)), np.zeros(3)


def maximum(rng):
    gaps = 4 * MOST_GATHERED
    room = np.zeros(3), np.zeros(gaps), np.zeros((gaps, 3)), np.zeros((2, MOST_POINTS, 2)), np.zeros(2, np.int64)
    return *pair_of(rng), bool(rng.integers(2)), 0.2, *room


DISTANCE_ARGUMENTS = {
    "dot": lambda rng: tuple(rng.normal(size=(2, 3))),
    "cross": lambda rng: (*rng.normal(size=(2, 3)), np.zeros(3)),
    "normalise": lambda rng: (rng.normal(size=3),),
    "swell_along": lambda rng: (rng.normal(size=(3, 3)), unit(rng)),
    "farthest": lambda rng: (rng.normal(size=(5, 3)), unit(rng)),
    "separation_along": of_state("n", "d"),
    "span": vectors,
    "make_normal": make_normal,
    "gradient": of_state("n", "swell", "pull", "at", "slope"),
    "_tangents": tangents,
    "climb": climb,
    "has": of_state("kinks", "count", "kind", "who", "zero"),
    "is_disk": lambda rng: (state(rng)["swell"][0].copy(),),
    "_rise": lambda rng: (rng.normal(size=(4, 3)), int(rng.integers(4)), int(rng.integers(4)), unit(rng)),
    "directions": of_state("kinks", "count", "d", "found"),
    "next_kink": of_state("n", "within", "disks", "kink", "kinks", "count", "d"),
    "_flat_directions": of_state("n", "who", "d", "basis"),
    "common_directions": of_state("n", "d", "slope"),
    "clear_common": of_state("pull", "slope", "found", "kinks", "count", "t"),
    "turn_onto": of_state("n", "kinks", "count", "d", "found", "basis"),
    "add": added,
    "multipliers": of_state("pull", "found", "m", "t"),
    "release": of_state("n", "t", "found", "kinks", "count", "d", "left"),
    "_released": of_state("n", "pull", "found", "m", "kinks", "count", "d", "left", "t"),
    "_smooth_part": of_state("d", "kinks", "count", "swell", "slope"),
    "_onto_disk": of_state("d", "kinks", "left", "n"),
    "_turn_segments": of_state("d", "n"),
    "_midpoint": of_state("origin", "radius", "n", "apart", "kinks", "count", "t", "found", "d", "at", "nearest"),
    "_first_set": of_state("n", "kinks", "d"),
    "place_shape": placed_shape,
    "place_pair": place_pair_,
    "axis_in_world": axis_in_world,
    "keep_axis": keep_axis,
    "outermost": outermost,
    "outermost_of_shape": outermost_of_shape,
    "cell_of": cell_of,
    "connected": connected,
    "pair_separation": pair_of,
    "first_axis": pair_of,
    "between_centres": lambda rng: (*hulls_of(rng)[:3], np.zeros(3)),
    "widest_angle": lambda rng: hulls_of(rng)[:5],
    "disc_radius": polygons,
    "level_points": lambda rng: (*hulls_of(rng)[:4], 1.0, np.zeros((2, MOST_POINTS, 2)), np.zeros(2, np.int64)),
    "share_a_line": lambda rng: (np.round(rng.normal(size=(2, MOST_POINTS, 2))), rng.integers(1, 4, size=2)),
    "least_within": triangle,
    "one_norm": lambda rng: (unit(rng),),
    "longest_side": triangle,
    "farthest_point": lambda rng: (*pair_of(rng)[:3], *triangle(rng), int(rng.integers(3)), np.zeros((1, 8))),
    "better_direction": better_direction,
    "is_curved": lambda rng: (axes_of(rng)[0].shapes, 0),
    "on_circle": lambda rng: (*rng.normal(size=2).tolist(), int(rng.choice([0, 16]))),
    "lowest_difference": lambda rng: (
        *pair_of(rng)[:3],
        *unit(rng).tolist(),
        int(rng.choice([0, 16])),
        np.zeros((4, 8)),
        int(rng.integers(4)),
    ),
    "move_point": lambda rng: (rng.normal(size=(4, 8)), *rng.integers(4, size=2).tolist()),
    "on_face": lambda rng: (np.round(2.0 * rng.normal(size=(4, 8))), unit(rng), np.zeros(3)),
    "on_edge": lambda rng: (rng.normal(size=(4, 8)), int(rng.integers(1, 3)), unit(rng), np.zeros(3), np.zeros(3)),
    "steepest": lambda rng: (
        unit(rng),
        unit(rng),
        float(rng.integers(2)) * unit(rng),
        float(rng.normal()),
        np.zeros(3),
    ),
    "turn_to": turn_to,
    "approach": lambda rng: (*pair_of(rng), np.zeros((4, 8)), float(rng.choice([0.0, 0.1])), int(rng.choice([0, 4]))),
    "ascend": lambda rng: (*pair_of(rng), np.zeros((4, 8)), np.zeros(3)),
    "write_midpoint": lambda rng: (
        *pair_of(rng),
        rng.normal(size=(4, 8)),
        rng.random(3),
        int(rng.integers(1, 4)),
        np.zeros(3),
    ),
    "take_corner": lambda rng: (
        active_points(rng)[0],
        int(rng.integers(2)),
        int(rng.integers(8)),
        *rng.normal(size=3).tolist(),
        rng.normal(size=(4, 8)),
        int(rng.integers(4)),
    ),
    "difference_of": difference,
    "are_edges": lambda rng: (rng.integers(2, size=(4, 8)).astype(float),),
    "on_foot": lambda rng: (rng.normal(size=(4, 8)), int(rng.integers(1, 3)), unit(rng), np.zeros(3)),
    "order_corners": lambda rng: (*active_points(rng), int(rng.integers(1, 4)), np.zeros(3)),
    "corners_of": lambda rng: (*corners(rng), np.zeros((4, 8)), np.zeros(3)),
    "separation_and_midpoint": ended_search,
    "search_from_corners": lambda rng: (*corners(rng), np.zeros((4, 8)), np.zeros(3)),
    "_known_maximum": lambda rng: (
        *pair_of(rng),
        float(rng.normal()),
        int(rng.integers(1, 3)),
        bool(rng.integers(2)),
        0.2,
        np.zeros((2, MOST_POINTS, 2)),
        np.zeros(2, np.int64),
    ),
    "search_cores": lambda rng: (*pair_of(rng), bool(rng.integers(2)), np.zeros(3)),
    "_curved_maximum": lambda rng: (*pair_of(rng), *maximum(rng)[5:-2]),
    "_nearly_apart": lambda rng: (
        *pair_of(rng),
        bool(rng.integers(2)),
        float(rng.choice([0.0, 0.1])),
        np.zeros((4, 8)),
    ),
    "_maximum": maximum,
    "_points_about": points_about,
    "separation_of": pair_of,
    "_maximise": maximise,
    "refine_pair": lambda rng: (*pair_of(rng), np.zeros(3)),
}
