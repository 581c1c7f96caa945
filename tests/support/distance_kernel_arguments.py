"""Random arguments of the kernels that refine distances: pairs of two shapes about as far apart as they are large."""

import numpy as np

from mbvi.geometry import kinks, refined_distance, separating_axis
from mbvi.geometry import normal_search as search
from mbvi.geometry.separating_axis import SeparatingAxes, place_shape
from mbvi.geometry.shape_table import ShapeTable
from mbvi.geometry.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere

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
    for side in (0, 1):
        place_shape(places, axes.frame, axes.shapes.fixed, side, world[side])
    return world


def separated(axes, places, pair, n):
    """The separation of a pair of shapes along a unit vector."""
    world, shapes = np.empty((2, 4, 3)), axes.shapes
    for side in (0, 1):
        place_shape(places, axes.frame, shapes.fixed, int(axes.sides[pair, side]), world[side])
    return separating_axis.pair_separation(world, *shapes[2:7], axes.sides, axes.start, pair, n)


def supports(rng):
    """Two shapes: where they are, and the arguments of `_describe` that follow, one list for each."""
    axes, places = axes_of(rng)
    shapes, edge, swell = axes.shapes, np.zeros((6, 3)), np.zeros((2, 3, 3))
    lists = []
    for s in (0, 1):
        vertices = np.arange(shapes.first_point[s], shapes.first_point[s + 1])
        lists.append((shapes.sizes[s].copy(), shapes.points, vertices, edge, swell, np.zeros((len(vertices), 3))))
    return world_of(axes, places), lists


def state(rng):
    """What the kernels of `kinks` share, at a normal that some of them are near."""
    world, (one, other) = supports(rng)
    refined_distance._describe(world, 0, *one)
    refined_distance._describe(world, 1, *other)
    sizes, points, _, edge, swell, first = one
    s = {"edge": edge, "swell": swell, "ball": sizes[3] + other[0][3], "first": first, "second": other[-1]}
    s["between"] = world[1, 3] - world[0, 3]
    n = s["between"] / np.linalg.norm(s["between"]) + 0.1 * rng.normal(size=3)
    edges = s["edge"][np.any(s["edge"] != 0.0, axis=1)]
    if len(edges) and rng.random() < 0.5:
        # on one kink
        a = edges[rng.integers(len(edges))]
        n -= (n @ a) / (a @ a) * a
    s["n"] = n / np.linalg.norm(n)
    s["sign"] = np.where(s["edge"] @ s["n"] >= 0.0, 1, -1)
    s["base"] = np.array([np.argmax(s["first"] @ s["n"]), np.argmax(s["second"] @ s["n"])])
    s["kinks"] = np.zeros((3, 3), np.int64)
    s["count"] = refined_distance._first_set(
        s["n"], s["kinks"], s["edge"], s["sign"], s["swell"], s["first"], s["second"], s["base"]
    )
    s["found"], s["basis"] = np.zeros((6, 3)), np.zeros((3, 3))
    names = ("kinks", "count", "edge", "swell", "first", "second", "base", "found")
    s["m"] = kinks.directions(*(s[name] for name in names))
    s["rank"] = search.span(s["found"], s["m"], s["basis"])
    s.update(place=world[0], sizes=sizes, points=points, kink=np.zeros(3, np.int64), scratch=np.zeros(3))
    s.update(t=1.5 * rng.normal(size=2), left=np.zeros(2, bool), at=np.zeros((2, 3)), slope=np.zeros(3))
    s.update(side=1.0, within=float(rng.choice([0.5, -1e-12])), disks=bool(rng.integers(2)), nearest=np.zeros(3))
    s.update(who=0, apart=0.1, pull=s["between"].copy(), tangents=np.zeros((2, 3)), first_base=int(s["base"][0]))
    s.update(vertex=s["first"][s["base"][0]].copy(), kind=int(rng.integers(3)), zero=0)
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
        shared = (s[k] for k in ("kinks", "count", "edge", "sign", "swell", "first", "second", "base"))
        if s["count"] < 3 and kinks.next_kink(s["n"], 2.0, False, s["kink"], *shared):
            return tuple(
                s[k] for k in ("n", "scratch", "kink", "kinks", "count", "between", "ball", "edge", "sign", "swell",
                               "first", "second", "base")
            )  # fmt: skip


def flat(rng):
    s = state(rng)
    return s["n"], 0, s["edge"], s["swell"], s["first"], int(s["base"][0]), np.zeros((3, 3))


def describe(rng):
    world, shapes = supports(rng)
    who = int(rng.integers(2))
    return world, who, *shapes[who]


def placed_shape(rng):
    axes, places = axes_of(rng)
    return places, axes.frame, axes.shapes.fixed, int(rng.integers(2)), np.zeros((4, 3))


def around(rng):
    axes, places = axes_of(rng)
    s = axes.shapes
    ends = int(s.first_point[0]), int(s.first_point[1])
    place, vertices = world_of(axes, places)[0], np.full(s.first_point[1], -1)
    return s.points, *ends, s.first, s.neighbour, place, unit(rng), 1.0, int(rng.integers(*ends)), vertices


def maximise(rng):
    world, (one, other) = supports(rng)
    apart = world[1, 3] - world[0, 3]
    return world, one[0], other[0], one[1], one[2], other[2], apart / np.linalg.norm(apart), np.zeros(3)


def refine_pair(rng):
    axes, places = axes_of(rng)
    world = world_of(axes, places)
    apart = world[1, 3] - world[0, 3]
    return world, *axes.shapes[2:7], axes.sides, axes.start, 0, apart / np.linalg.norm(apart), np.zeros(3)


def pair_separation(rng):
    return *refine_pair(rng)[:-2], unit(rng)


def axis_in_world(rng):
    axes, places = axes_of(rng)
    return places, int(axes.frame[0]), unit(rng)[None], 0, np.zeros(3)


def outermost(rng):
    axes, _ = axes_of(rng)
    s, side = axes.shapes, int(rng.integers(2))
    ends = int(s.first_point[side]), int(s.first_point[side + 1])
    return s.points, *ends, s.first, s.neighbour, *unit(rng).tolist(), int(rng.integers(*ends))


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


DISTANCE_ARGUMENTS = {
    "dot": lambda rng: tuple(rng.normal(size=(2, 3))),
    "cross": lambda rng: (*rng.normal(size=(2, 3)), np.zeros(3)),
    "normalise": lambda rng: (rng.normal(size=3),),
    "swell_along": lambda rng: (rng.normal(size=(3, 3)), unit(rng)),
    "farthest": lambda rng: (rng.normal(size=(5, 3)), unit(rng)),
    "separation_along": of_state("n", "between", "ball", "edge", "swell", "first", "second"),
    "span": vectors,
    "make_normal": make_normal,
    "gradient": of_state("n", "swell", "pull", "at", "slope"),
    "_tangents": tangents,
    "climb": climb,
    "has": of_state("kinks", "count", "kind", "who", "zero"),
    "is_disk": lambda rng: (state(rng)["swell"][0].copy(),),
    "_rise": lambda rng: (rng.normal(size=(4, 3)), int(rng.integers(4)), int(rng.integers(4)), unit(rng)),
    "directions": of_state("kinks", "count", "edge", "swell", "first", "second", "base", "found"),
    "next_kink": of_state(
        "n", "within", "disks", "kink", "kinks", "count", "edge", "sign", "swell", "first", "second", "base"
    ),
    "_flat_directions": flat,
    "common_directions": of_state("n", "edge", "swell", "first", "second", "base", "slope"),
    "clear_common": of_state("pull", "slope", "found", "kinks", "count", "t"),
    "turn_onto": of_state("n", "kinks", "count", "edge", "swell", "first", "second", "base", "found", "basis"),
    "add": added,
    "multipliers": of_state("pull", "found", "m", "t"),
    "release": of_state("n", "t", "found", "kinks", "count", "sign", "base", "left"),
    "_midpoint": of_state(
        "place", "sizes", "n", "apart", "kinks", "count", "t", "found", "edge", "sign", "at", "vertex", "nearest"
    ),
    "_describe": describe,
    "_outermost": lambda rng: (rng.normal(size=(5, 3)), unit(rng)),
    "_first_set": of_state("n", "kinks", "edge", "sign", "swell", "first", "second", "base"),
    "place_shape": placed_shape,
    "axis_in_world": axis_in_world,
    "outermost": outermost,
    "pair_separation": pair_separation,
    "_around": around,
    "_maximise": maximise,
    "refine_pair": refine_pair,
}
