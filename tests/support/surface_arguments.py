"""Random arguments of the kernels for contacts of convex shapes with meshes: polyhedra and capsules over terrain."""

import numpy as np

from mbvi.geometry.closed_form.surface_rows import all_rows, place_core, triangles_in_box
from mbvi.geometry.meshes.creases import creases_of
from mbvi.geometry.meshes.triangles import Surface
from mbvi.geometry.shapes.convex_cores import cores_of
from mbvi.geometry.shapes.shapes import Box, Capsule, Hull, PlacedShape
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

    def scratch(self):
        return np.zeros(self.triangles + 300, np.int64), np.zeros((8, 3)), np.zeros((6, 4))


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
    return scene.mesh, peak_of(scene), *(unit(rng) if rng.random() < 0.5 else [0.0, 0.0, 1.0])


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


def row_arguments(scene, *box):
    given = scene.mesh, scene.cores, scene.s, scene.triangle(), scene.points, scene.faces, scene.middle, *box
    return *given, 0.2, EPS, np.zeros((300, 7)), int(scene.rng.integers(3)), np.zeros(12)


def sharp_rows(rng):
    scene = sharp(rng)
    return row_arguments(scene, scene.points.min(axis=0), scene.points.max(axis=0))


def round_rows(rng):
    return row_arguments(Scene(rng, 2))


def edge_near(rng):
    scene = Scene(rng)
    low = rng.uniform(-1.0, 0.5, 3) * [1, 1, 0]
    return scene.mesh, *(int(c) for c in scene.mesh.triangles[3, :2]), low, low + 0.4, 0.1


def every_row(rng):
    scene = Scene(rng)
    tolerance = float(rng.choice([0.0, 0.1]))
    rest = np.zeros((300, 7)), np.zeros(12)
    return scene.places, scene.mesh, scene.cores, scene.s, tolerance, EPS, *scene.scratch(), *rest


def few(rng):
    *given, rows, out = every_row(rng)
    if rng.random() < 0.5:
        # a flat face of many points, some of them twice
        rows[:14, 1:3] = rng.uniform(-0.3, 0.3, (14, 2))
        rows[14:20], rows[:20, 6] = rows[3:9], 1.0
        rows[:20, 0] = rng.choice([0.0, 0.01]) * rng.random(20)
        return rows, 20, 0.4, np.zeros(300, np.int64)
    _, count = all_rows(*given, rows, out)
    return rows, count, 0.4, np.zeros(300, np.int64)


def contacts(rng):
    scene, room = Scene(rng), int(rng.choice([2, 300]))
    found = np.zeros(room, np.int64), np.zeros(room), np.zeros((room, 3)), np.zeros((room, 3))
    scratch = *scene.scratch(), np.zeros((300, 7)), np.zeros(12)
    return scene.places, tuple(scene.mesh), tuple(scene.cores), np.array([0, 2]), 0.1, EPS, *scratch, *found


def box_apart(rng):
    boxes = Scene(rng).mesh.boxes
    return boxes, int(rng.integers(1, len(boxes))), rng.normal(size=3) - 1.0, rng.normal(size=3) + 1.0


def over_face(rng):
    scene = sharp(rng)
    f, x = int(rng.integers(4)), scene.points[:3].mean(axis=0) + 0.1 * unit(rng)
    return scene.cores, *scene.core[2:], f, *x


def nearer(rng):
    scene = Scene(rng)
    given = scene.mesh, scene.cores, scene.s, scene.triangle(), scene.points, scene.faces
    return *given, float(rng.choice([0.1, np.inf])), np.zeros(6), np.zeros(12)


def far(rng):
    scene = Scene(rng)
    best = float(rng.choice([0.01, 0.1, np.inf]))
    return scene.points, 0, 1, scene.mesh.vertices, scene.mesh.triangles, scene.triangle(), best


def distances(rng):
    scene = Scene(rng)
    found = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    given = scene.places, tuple(scene.mesh), tuple(scene.cores), np.arange(3)
    return *given, np.zeros((8, 3)), np.zeros((6, 4)), np.zeros(12), *found


SURFACE_ARGUMENTS = {
    "above": above,
    "looks_at": looks_at,
    "in_cone": in_cone,
    "in_arc": in_arc,
    "shared_side": shared_side,
    "_outdone": outdone,
    "on_triangle": on_triangle,
    "on_core_face": on_core_face,
    "crossing": crossing,
    "across_ridge": across_ridge,
    "above_triangle": above_triangle,
    "from_segment": from_segment,
    "triangles_in_box": in_box,
    "place_core": placed,
    "edge_near": edge_near,
    "_add": add,
    "sharp_rows": sharp_rows,
    "round_rows": round_rows,
    "all_rows": every_row,
    "few_of_each_normal": few,
    "surface_contacts": contacts,
    "_box_apart": box_apart,
    "height_over_face": over_face,
    "is_far": far,
    "nearer": nearer,
    "surface_distances": distances,
}
