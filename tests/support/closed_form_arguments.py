"""Random arguments of the kernels of closed forms: pairs of spheres, capsules, boxes and cylinders near each other."""

import numpy as np

from mbvi.geometry.closed_form import box_box, box_patch
from mbvi.geometry.closed_form.primitive_pairs import BOXES, FIRST_BALL, NONE, SECOND_BALL, PrimitivePairs
from mbvi.geometry.shapes import shape_cores
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, PlacedShape, Sphere
from support.distance_kernel_arguments import rotation, unit

BOXES_AND_CAPSULES = [Box((0.3, 0.4, 0.2)), Box((0.2, 0.2, 0.5)), Capsule(0.1, 0.4), Capsule(0.15, 0.3)]
ALL = [*BOXES_AND_CAPSULES, Sphere(0.2), Cylinder(0.15, 0.3)]


def pairs_of(rng, shapes):
    """All pairs of some shapes that have a closed form, on the world and on bodies, and where the bodies are."""
    turn = rotation(rng)
    placed = [
        # every other time faces are parallel
        PlacedShape(f"{k}", shape, k % 3, turn if rng.random() < 0.5 else rotation(rng), 0.3 * unit(rng))
        for k, shape in enumerate(shapes)
    ]
    sides = np.array([(a, b) for a in range(len(placed)) for b in range(len(placed)) if a != b])
    table = ShapeTable(placed)
    places = np.array([np.vstack([np.eye(3), 0.05 * rng.normal(size=3)]) for _ in table.bodies])
    pairs = PrimitivePairs(table, sides)
    return (places, *table.arrays[:3], sides), pairs, np.flatnonzero(pairs.form != NONE)


def cores(rng, shapes=BOXES_AND_CAPSULES, normal=True):
    """Two shapes, each in the frame of the other, and an approximate normal."""
    arguments, pairs, known = pairs_of(rng, shapes)
    table = np.zeros((2, 12, 3))
    shape_cores.place_cores(*arguments, int(rng.choice(known[pairs.form[known] == BOXES])), table)
    shape_cores.relate(table)
    if normal:
        box_box.core_distance(table, 1e-12, np.zeros((2, 32, 3)))
    return table


def ball_and_other(rng):
    """A sphere and another shape; sometimes the centre is inside the other."""
    arguments, pairs, known = pairs_of(rng, ALL)
    number = int(rng.choice(known[pairs.form[known] != BOXES]))
    table = np.zeros((2, 12, 3))
    shape_cores.place_cores(*arguments, number, table)
    side = int(pairs.form[number]) - 1
    table[1 - side, shape_cores.NEAREST] = rng.choice([0.05, 0.3]) * rng.normal(size=3)
    return table, side


def point_beside(rng, disk):
    while True:
        table, side = ball_and_other(rng)
        if (table[1 - side, shape_cores.BALL, 1] > 0.0) == disk:
            return table, 1 - side


def polygon(rng):
    """The corners of a face over another, after clipping."""
    table, corners = cores(rng, [BOXES_AND_CAPSULES[0], BOXES_AND_CAPSULES[1]]), np.zeros((2, 32, 3))
    box_patch.project_face(table, 0, corners)
    return corners, 4


def clipped(rng):
    return *polygon(rng), 0.15, 0.1


def low(rng):
    corners, count = polygon(rng)
    return corners, count, float(np.median(corners[0, :count, 2])), float(rng.choice([1e-7, 0.2]))


def corner(rng):
    table, corners = cores(rng), np.zeros((2, 32, 3))
    box_patch.project_face(table, 1, corners)
    return table, 1, corners, int(rng.integers(4)), np.zeros((5, 7)), int(rng.integers(5))


def contacts(rng):
    arguments, pairs, known = pairs_of(rng, ALL)
    room, tolerance = int(rng.choice([3, 9 * len(known)])), float(rng.choice([-np.inf, 0.01, np.inf]))
    rows = np.full(room, -1), np.full(room, np.nan), np.full((room, 3), np.nan), np.full((room, 3), np.nan)
    return *arguments, pairs.form, known, tolerance, *rows


def balls(rng):
    arguments, pairs, known = pairs_of(rng, ALL)
    known = known[np.isin(pairs.form[known], (FIRST_BALL, SECOND_BALL))]
    k = len(known)
    return (
        *arguments,
        pairs.form,
        known,
        np.full(k, -1),
        np.full(k, np.nan),
        np.full((k, 3), np.nan),
        np.full((k, 3), np.nan),
    )


def placing(rng):
    arguments, _, known = pairs_of(rng, ALL)
    return *arguments, int(rng.choice(known)), np.zeros((2, 12, 3))


def of_side(rng):
    return cores(rng), int(rng.integers(2))


CLOSED_FORM_ARGUMENTS = {
    "place_cores": placing,
    "relate": lambda rng: (cores(rng, normal=False),),
    "complete_normal": of_side,
    "face_normal": lambda rng: (*of_side(rng), int(rng.integers(3)), float(rng.choice([-1.0, 1.0]))),
    "facing_axis": of_side,
    "bounding_radius": of_side,
    "write_normal": lambda rng: (*of_side(rng), np.zeros((5, 7)), int(rng.integers(5))),
    "face_separation": lambda rng: (*of_side(rng), int(rng.integers(3)), float(rng.choice([-1.0, 1.0]))),
    "separation_across": lambda rng: (cores(rng, BOXES_AND_CAPSULES[2:]), 1e-12, float(rng.choice([-np.inf, np.inf]))),
    "largest_separation": lambda rng: (cores(rng, normal=False), 1e-12),
    "nearest_on_edges": lambda rng: (cores(rng), 2, 2),
    "nearest_to_corners": lambda rng: (cores(rng), float(rng.choice([0.01, np.inf]))),
    "project_face": lambda rng: (cores(rng), int(rng.integers(2)), np.zeros((2, 32, 3))),
    "clip": clipped,
    "keep_low": low,
    "lowest_corner": polygon,
    "clip_faces": lambda rng: (*of_side(rng), 1e-12, np.zeros((2, 32, 3))),
    "write_corner": corner,
    "core_distance": lambda rng: (cores(rng, normal=False), 1e-12, np.zeros((2, 32, 3))),
    "preferred_face": lambda rng: (cores(rng), -1.0, 0.2),
    "reference_side": lambda rng: (cores(rng),),
    "write_middle": lambda rng: (cores(rng), np.zeros((5, 7)), int(rng.integers(5))),
    "box_contacts": lambda rng: (
        cores(rng, normal=False), float(rng.choice([-np.inf, np.inf])), np.zeros((2, 32, 3)),
        np.zeros((33, 7)),
    ),
    "out_of_core": lambda rng: point_beside(rng, False),
    "out_of_cylinder_core": lambda rng: point_beside(rng, True),
    "ball_contact": lambda rng: (*ball_and_other(rng), np.zeros((1, 7))),
    "primitive_contacts": contacts,
    "ball_contacts": balls,
}  # fmt: skip
