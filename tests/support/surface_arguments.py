"""Random arguments of the kernels for contacts of convex shapes with meshes: polyhedra and capsules over terrain."""

import numpy as np
import pinocchio as pin

from mbvi.geometry.at_meshes.cores_at_mesh import CoresAtMesh, place_core
from mbvi.geometry.at_meshes.mesh_tree import narrow_cone, triangles_in_box
from mbvi.geometry.at_meshes.near_features import list_features
from mbvi.geometry.at_meshes.surface_rows import all_rows, lowest_of_rims
from mbvi.geometry.meshes.creases import creases_of
from mbvi.geometry.meshes.triangles import Surface
from mbvi.geometry.shapes.convex_cores import cores_of
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Hull, PlacedShape
from support.robot_arguments import rotation, unit

TETRAHEDRON = Hull(0.3 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float))
SHAPES = [Box((0.5, 0.4, 0.3)), TETRAHEDRON, Capsule(0.1, 0.4)]
# rounding of lengths [m]
EPS = 1e-12


def terrain(rng, n=6, rough=0.1):
    """A graph over a grid of n x n points in [-1, 1]^2, with normals upwards."""
    line = np.linspace(-1.0, 1.0, n)
    x, y = np.meshgrid(line, line)
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    corner = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    # heights of a few levels: some triangles are level, and some edges flat
    return np.column_stack([x.ravel(), y.ravel(), rough * rng.integers(-1, 2, n * n)]), corner


class Scene:
    """Three cores over terrain, one of them chosen: a sharp one, or the capsule."""

    def __init__(self, rng, s=None):
        self.mesh = creases_of(Surface(*terrain(rng)))
        shapes = [PlacedShape(f"s{k}", shape, 1 + k, rotation(rng), 0.1 * unit(rng)) for k, shape in enumerate(SHAPES)]
        self.cores = cores_of(shapes, np.arange(3))
        self.places = np.array([[*rotation(rng), [*rng.uniform(-0.5, 0.5, 2), rng.uniform(0.1, 0.4)]] for _ in SHAPES])
        self.s = int(rng.integers(3)) if s is None else s
        self.points, self.faces, self.middle = np.zeros((8, 3)), np.zeros((6, 4)), np.zeros(3)
        place_core(self.places, self.cores, self.s, self.points, self.faces, self.middle)
        self.first, self.face = int(self.cores.first_point[self.s]), int(self.cores.first_face[self.s])
        self.rng, self.triangles = rng, len(self.mesh.triangles)

    @property
    def core(self):
        return self.mesh, self.cores, self.first, self.face, self.points, self.faces

    def triangle(self):
        """A triangle below the core."""
        low, high = self.points.min(axis=0) - 0.2, self.points.max(axis=0) + 0.2
        found = np.zeros(self.triangles, np.int64)
        count = triangles_in_box(self.mesh, low, high, found)
        return int(self.rng.choice(found[:count])) if count else 0

    def at(self, features=400, triangles=None, rows=300, contacts=300):
        """The mesh and the cores with no lists yet."""
        n, k, cores = len(SHAPES), self.triangles if triangles is None else triangles, self.cores
        return CoresAtMesh(
            self.mesh, cores, EPS, *np.full((2, n), 0.02), np.zeros(n), np.full(n, -1.0), np.zeros((n, 4, 3)),
            np.zeros((n, features, 3), np.int64), np.zeros(n, np.int64), np.zeros((n, 4, 3)), np.zeros(n),
            np.zeros((n, features)), np.zeros(k, np.int64), np.zeros((8, 3)), np.zeros((6, 4)),
            np.zeros((2, 12), np.int64), np.zeros((12, 6)), np.zeros((rows, 7)), np.zeros(rows, np.int64), np.zeros(12),
            np.zeros(contacts, np.int64), np.zeros(contacts), np.zeros((contacts, 3)), np.zeros((contacts, 3)),
        )  # fmt: skip

    def listed(self):
        """The same with a list of the chosen core, which stays where it was placed, and its near triangles."""
        at = self.at()
        triangles, _ = list_features(at, self.places, self.s, 0.05, 0.001)
        at.points[:], at.faces[:] = self.points, self.faces
        return at, triangles

    def cone(self, at, triangles):
        axis = np.zeros(3)
        return axis, narrow_cone(at, triangles, axis)

    def moved(self, size):
        """Placements a little farther on."""
        places = self.places + 0.0
        places[:, :3] = places[:, :3] @ pin.exp3(size * self.rng.normal(size=3))
        places[:, 3] += size * self.rng.normal(size=(len(places), 3))
        return places


def sharp(rng):
    return Scene(rng, int(rng.integers(2)))


def above(rng):
    return Scene(rng).mesh.planes, 3, int(rng.integers(4)), *rng.normal(size=3)


def looks_at(rng):
    scene = Scene(rng)
    return scene.mesh.planes, scene.triangle(), scene.middle, float(rng.normal())


def peak_of(scene):
    return int(scene.rng.integers(len(scene.mesh.first) - 1))


def in_cone(rng):
    scene = Scene(rng)
    return scene.mesh, peak_of(scene), *(unit(rng) if rng.random() < 0.5 else [0.0, 0.0, 1.0]), 0.1 * rng.random()


def ridge_of(scene):
    t, k = np.argwhere(scene.mesh.ridge >= 0)[scene.rng.integers(len(scene.mesh.ends))]
    return int(t), int(k)


def in_arc(rng):
    scene = Scene(rng)
    return scene.mesh, *ridge_of(scene), *unit(rng)


def shared_side(rng):
    mesh = Scene(rng).mesh
    t, k = np.argwhere(mesh.beyond >= 0)[7]
    return mesh, int(mesh.beyond[t, k]), int(t)


def outdone(rng):
    return (*(float(x) for x in rng.choice([-0.1, -0.01, 0.0, 0.2], 2)), float(rng.choice([0.2, 0.97])), 0.05)


def on_triangle(rng):
    scene = sharp(rng)
    t, i = scene.triangle(), int(rng.integers(4))
    height = scene.mesh.planes[t, 0, :3] @ scene.points[i] - scene.mesh.planes[t, 0, 3]
    return scene.mesh, scene.middle, t, scene.points, i, height, 0.2, 0.01, EPS


def on_core_face(rng):
    scene = sharp(rng)
    p, f = int(np.flatnonzero(scene.mesh.peak >= 0)[peak_of(scene)]), int(rng.integers(4))
    gap = scene.faces[f, :3] @ scene.mesh.vertices[p] - scene.faces[f, 3]
    return *scene.core, f, p, gap, 0.01, EPS


def edge_of(scene):
    return int(scene.rng.integers(scene.cores.first_edge[scene.s], scene.cores.first_edge[scene.s + 1]))


def crossing(rng):
    scene = Scene(rng)
    t = scene.triangle()
    return scene.points, 0, 1, scene.mesh.vertices, *(int(c) for c in scene.mesh.triangles[t, :2]), EPS, np.zeros(12)


def crossing_beyond(rng):
    points, a, b, vertices, c, d, eps, out = crossing(rng)
    return vertices, points, a, b, c, d, eps, out


def across_ridge(rng):
    scene = Scene(rng)
    t, k = ridge_of(scene)
    return *scene.core, scene.middle, t, k, edge_of(scene), 0.01, EPS, np.zeros(12)


def above_triangle(rng):
    scene = Scene(rng)
    return scene.mesh, scene.triangle(), scene.points, 0, EPS


def from_segment(rng):
    ends = rng.normal(size=(4, 3))
    return rng.normal(size=(5, 3)), 2, ends, 1, int(rng.integers(1, 4)), np.zeros(12)


def in_box(rng):
    scene, room = Scene(rng), int(rng.choice([3, 100]))
    return scene.mesh, scene.points[0] - 0.3, scene.points[0] + 0.3, np.zeros(room, np.int64)


def placed(rng):
    scene = Scene(rng)
    return scene.places, scene.cores, scene.s, np.zeros((8, 3)), np.zeros((6, 4)), np.zeros(3)


def add(rng):
    return np.zeros((3, 7)), int(rng.integers(5)), *rng.normal(size=4), rng.normal(size=12)


def feature_of(scene, kinds):
    """A core with a list, and one of its listed features of some kinds; a feature that is not listed without any."""
    at, _ = scene.listed()
    some = at.features[scene.s, : at.counts[scene.s]]
    some = some[np.isin(some[:, 1], kinds)]
    if not len(some):
        edge = int(scene.cores.first_edge[scene.s])
        some = np.array([[scene.triangle(), kinds[0], edge if kinds[0] < 3 else 0]])
        if kinds[0] < 3:
            some[0, :2] = ridge_of(scene)
    return at, *(int(k) for k in some[scene.rng.integers(len(some))])


def vertex_row(rng):
    scene = Scene(rng)
    at, t, _, i = feature_of(scene, [6])
    return at, scene.s, t, i, scene.middle, 0.2, int(rng.integers(3))


def crossed(rng):
    """A segment over the terrain or through it, and now and then no room."""
    scene = Scene(rng)
    start, end = rng.uniform(-1.0, 1.0, (2, 3)) * (1.0, 1.0, 0.3)
    found = np.zeros(int(rng.choice([2, scene.triangles])), np.int64)
    return scene.mesh, start, end, bool(rng.integers(2)), EPS, found


def overhang(rng):
    scene = Scene(rng)
    at, t, i = scene.listed()[0], scene.triangle(), int(rng.integers(2))
    return at, t, i, -0.5 * rng.random(), scene.middle


def rims(rng):
    """A cylinder, which stands upright in some cases."""
    scene = Scene(rng)
    wheel = PlacedShape("wheel", Cylinder(0.2, 0.3), 1, rotation(rng), 0.1 * unit(rng))
    if rng.random() < 0.4:
        scene.places[0, :3] = wheel.rotation
    cores, t = cores_of([wheel], np.zeros(1, np.int64)), scene.triangle()
    return scene.places, scene.mesh, cores, 0, t, np.zeros((len(cores.points) + 2, 3)), scene.middle


def rim_is_beyond(rng):
    """A cylinder whose lowest points are known."""
    places, mesh, cores, s, t, points, middle = rims(rng)
    place_core(places, cores, s, points, np.zeros((len(cores.faces), 4)), middle)
    lowest_of_rims(places, mesh, cores, s, t, points, middle)
    return Scene(rng).at()._replace(mesh=mesh, cores=cores, points=points), s, t, int(rng.integers(96)), middle


def rim_clearance(rng):
    places, _, cores, s, t, _, middle = rims(rng)
    return Scene(rng).at()._replace(cores=cores), places, s, t, middle


def sharp_row(rng):
    scene = sharp(rng)
    at, t, k, e = feature_of(scene, [[0, 1, 2], [3, 4, 5]][int(rng.integers(2))])
    if k >= 3:
        t, corner = (int(x) for x in np.argwhere(scene.mesh.owned >= 0)[peak_of(scene)])
        k = 3 + corner
    return at, scene.s, t, k, e, scene.middle, 0.2, int(rng.integers(3))


def round_rows(rng):
    scene = Scene(rng, 2)
    t, k = ridge_of(scene)
    if rng.random() < 0.5:
        t, k = (int(x) for x in np.argwhere(scene.mesh.owned >= 0)[peak_of(scene)])
        k += 3
    return scene.listed()[0], 2, t, k, scene.middle, 0.2, int(rng.integers(3))


def every_row(rng):
    scene = Scene(rng)
    return scene.at(), scene.places, scene.s, float(rng.choice([0.0, 0.1]))


def few(rng):
    given = every_row(rng)
    rows = given[0].rows
    if rng.random() < 0.5:
        # a flat face of many points, some of them twice
        rows[:14, 1:3] = rng.uniform(-0.3, 0.3, (14, 2))
        rows[14:20], rows[:20, 6] = rows[3:9], 1.0
        rows[:20, 0] = rng.choice([0.0, 0.01]) * rng.random(20)
        return rows, 20, 0.4, np.zeros(300, np.int64)
    _, _, count = all_rows(*given)
    return rows, count, 0.4, np.zeros(300, np.int64)


def touching(rng):
    return rng.normal(size=(20, 2)), 0.01 * rng.normal(size=20), np.zeros(8, np.int64)


def contacts(rng):
    scene = Scene(rng)
    return scene.at(contacts=int(rng.choice([2, 300]))), scene.places, np.array([0, 2]), 0.1


def box_apart(rng):
    boxes = Scene(rng).mesh.boxes
    return boxes, int(rng.integers(1, len(boxes))), rng.normal(size=3) - 1.0, rng.normal(size=3) + 1.0


def tree_apart(rng):
    low = 2.0 * rng.normal(size=3)
    return Scene(rng).mesh.boxes, low, low + 0.3


def of_core(rng):
    # a capsule has no faces
    scene = sharp(rng)
    return scene.places, scene.cores, scene.s


def list_of(rng):
    scene = Scene(rng)
    at = scene.at(features=int(rng.choice([3, 400])), triangles=int(rng.choice([3, 50])))
    if rng.random() < 0.2:
        scene.places[:, 3, 2] += 3.0
    return at, scene.places, scene.s, float(rng.choice([0.0, 0.1])), 1e-3


def with_cone(rng):
    scene = Scene(rng)
    at, triangles = scene.listed()
    return scene, at, triangles, *scene.cone(at, triangles)


def list_vertices(rng):
    scene, at, triangles, axis, least = with_cone(rng)
    return at, scene.s, triangles, 1e-3, scene.middle, axis, least, rng.uniform(-0.2, 0.1, 8)


def choose_edges(rng):
    scene, at, _, axis, least = with_cone(rng)
    return at, scene.places, scene.s, axis, least, 0.01, 0.1, rng.uniform(-0.2, 0.1, 8), nothing_placed()


def choose_faces(rng):
    *given, _, _, placed = choose_edges(rng)
    return *given, placed


def dropped(rng):
    """With a core above all triangles in some cases."""
    scene = Scene(rng)
    at, triangles = scene.listed()
    if rng.random() < 0.5:
        at.points[:, 2] += 0.5
    return at, scene.s, triangles


def write_excess(rng):
    scene, at, triangles, axis, least = with_cone(rng)
    count = int(np.diff(scene.cores.first_point)[scene.s])
    return at, scene.s, triangles, 1e-3, axis, least, np.zeros(count)


def nothing_placed():
    """No vertex and no face is placed."""
    return np.zeros((2, 8), bool)


def once(rng):
    scene = sharp(rng)
    placed = nothing_placed()
    placed[:] = rng.random() < 0.5
    return scene.at(), scene.places, scene.s, 1, placed


def list_at_triangle(rng):
    scene = Scene(rng)
    at, triangles = scene.listed()
    t = int(at.near[rng.integers(triangles)]) if triangles else scene.triangle()
    # a capsule has no faces
    return at, scene.s, t, 1, int(scene.s < 2), 0.02, int(rng.integers(3))


def placed_feature(rng):
    scene = Scene(rng)
    at, _, k, e = feature_of(scene, [[0, 1, 2], [3, 4, 5], [6]][int(rng.integers(3))])
    if scene.s == 2 and 3 <= k < 6:
        e = 0
    return at, scene.places, scene.s, k, e, nothing_placed()


def placed_features(kinds):
    """A listed feature of some kinds of a sharp core."""

    def arguments(rng):
        scene = sharp(rng)
        at, t, k, e = feature_of(scene, kinds)
        return at, scene.s, t, k, e, scene.middle

    return arguments


def missed_normals(rng):
    at, s, t, k, e, _ = placed_features([0, 1, 2])(rng)
    return at, s, t, k, e, np.concatenate([unit(rng), unit(rng), unit(rng), np.zeros(3)])


def vertex_clearance(rng):
    scene = Scene(rng)
    return scene.listed()[0], scene.s, scene.triangle(), 1, scene.middle


def face_clearance(rng):
    return *may_hold(rng)[:2], *may_hold(rng)[3:1:-1], 0.1 * unit(rng)


def ends_beside(rng):
    cosine = float(rng.uniform(-0.9, 0.9))
    a, b, side = rng.normal(size=3)
    return rng.random(), cosine, np.sqrt(1.0 - cosine**2), a, b, 2.0 * (a * a + b * b + side * side), 1.2, 3.0


def may_hold(rng):
    scene = sharp(rng)
    p = int(np.flatnonzero(scene.mesh.peak >= 0)[peak_of(scene)])
    return scene.listed()[0], scene.s, int(rng.integers(4)), p, 0.02


def may_cross(rng):
    scene = sharp(rng)
    return scene.listed()[0], scene.s, *ridge_of(scene), edge_of(scene), 0.02


def travel_from(rng):
    scene = Scene(rng)
    at, _ = scene.listed()
    return at, at.place[scene.s].copy(), scene.moved(0.01), scene.s


def free_way(rng):
    scene = Scene(rng)
    scene.places[:, 3, 2] += rng.choice([0.0, 2.0])
    at, _ = scene.listed()
    at.last[:], at.clear_to[:] = at.place, 0.1 * rng.random(at.clear_to.shape)
    return at, scene.moved(1e-3), scene.s


def beyond_middle(rng):
    scene, _, _, axis, least = with_cone(rng)
    return scene.points, int(rng.integers(4)), scene.middle, axis, max(least, 0.3), 0.01


def meets_box(rng):
    low = rng.normal(size=3)
    boxes = np.concatenate([rng.normal(size=(3, 3)) - 1.0, rng.normal(size=(3, 3)) + 1.0], axis=1)
    return low, low + rng.random(3), boxes, 1


def over_face(rng):
    scene = sharp(rng)
    f, x = int(rng.integers(4)), scene.points[:3].mean(axis=0) + 0.1 * unit(rng)
    return scene.cores, *scene.core[2:], f, *x, float(rng.choice([0.05, np.inf]))


def nearer(rng):
    scene = Scene(rng)
    given = scene.mesh, scene.cores, scene.s, scene.triangle(), scene.points, scene.faces
    return *given, float(rng.choice([0.1, np.inf])), np.zeros(6), np.zeros(12), np.zeros(8)


def far(rng):
    scene = Scene(rng)
    best = float(rng.choice([0.01, 0.1, np.inf]))
    return scene.points, 0, 1, scene.mesh.vertices, scene.mesh.triangles, scene.triangle(), best


def distances(rng):
    scene = Scene(rng)
    found = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    return scene.at(), scene.places, np.arange(3), *found


def bent(rng):
    """A mesh over terrain: its creases, the numbers of edges, and the first side of each."""
    surface = Surface(*terrain(rng))
    number = surface.features[:, 3:6] - len(surface.vertices)
    first = np.unique(number, return_index=True)[1]
    return creases_of(surface), np.ascontiguousarray(number), first


def planes_of(rng):
    mesh, _, _ = bent(rng)
    return mesh.vertices, mesh.triangles, np.zeros(mesh.planes.shape)


def angles_of(rng):
    mesh, number, first = bent(rng)
    return mesh.vertices, mesh.triangles, mesh.planes, number, 0 * first, 0 * number, np.zeros(len(first))


def peaks_of(rng):
    mesh, _, first = bent(rng)
    return mesh.triangles, mesh.ends, first, 0 * mesh.peak, 0 * mesh.owned, 0 * mesh.peak


def peak_edges(rng):
    mesh, _, first = bent(rng)
    begin, edges = mesh.first[:-1].copy(), np.zeros(mesh.edges.shape)
    return mesh.vertices, mesh.triangles, mesh.planes, mesh.ends, first, mesh.peak, begin, edges


SURFACE_ARGUMENTS = {
    "write_planes": planes_of,
    "write_angles": angles_of,
    "count_peaks": peaks_of,
    "write_peak_edges": peak_edges,
    "above": above,
    "looks_at": looks_at,
    "in_cone": in_cone,
    "in_arc": in_arc,
    "shared_side": shared_side,
    "_outdone": outdone,
    "on_triangle": on_triangle,
    "on_core_face": on_core_face,
    "crossing": crossing,
    "crossing_beyond": crossing_beyond,
    "across_ridge": across_ridge,
    "above_triangle": above_triangle,
    "from_segment": from_segment,
    "triangles_in_box": in_box,
    "is_crossed": crossed,
    "is_under_overhang": overhang,
    "place_core": placed,
    "_add": add,
    "vertex_row": vertex_row,
    "lowest_of_rims": rims,
    "rim_is_beyond": rim_is_beyond,
    "sharp_row": sharp_row,
    "round_rows": round_rows,
    "all_rows": every_row,
    "without_equals": lambda rng: few(rng)[:3],
    "first_to_touch": touching,
    "few_of_each_patch": few,
    "surface_contacts": contacts,
    "lowest_gap": every_row,
    "box_apart": box_apart,
    "tree_apart": tree_apart,
    "middle_of": lambda rng: (*of_core(rng), 1),
    "place_point": lambda rng: (*of_core(rng), 1, np.zeros((8, 3))),
    "place_face": lambda rng: (*of_core(rng), 1, np.zeros((6, 4))),
    "lever_of": lambda rng: (Scene(rng).listed()[0], 1),
    "travel_from": travel_from,
    "write_place": lambda rng: (Scene(rng).at(), Scene(rng).places, 1, np.zeros((4, 3))),
    "free_way": free_way,
    "may_cross": may_cross,
    "meets_box": meets_box,
    "narrow_cone": lambda rng: (*Scene(rng).listed(), np.zeros(3)),
    "append": lambda rng: (Scene(rng).at(features=2), 1, int(rng.integers(4)), 3, 4, 5),
    "is_beyond_middle": beyond_middle,
    "list_vertices": list_vertices,
    "choose_edges": choose_edges,
    "choose_faces": choose_faces,
    "drop_below": dropped,
    "write_excess": write_excess,
    "place_point_once": once,
    "place_face_once": once,
    "rim_clearance": rim_clearance,
    "may_hold": may_hold,
    "list_at_triangle": list_at_triangle,
    "place_feature": placed_feature,
    "missed_normals": missed_normals,
    "vertex_clearance": vertex_clearance,
    "face_clearance": face_clearance,
    "edge_clearance": placed_features([0, 1, 2]),
    "ends_beside": ends_beside,
    "clearance_of_feature": lambda rng: placed_features([[0, 1, 2], [6]][int(rng.integers(2))])(rng),
    "list_features": list_of,
    "height_over_face": over_face,
    "is_far": far,
    "nearer": nearer,
    "surface_distances": distances,
}
