"""Contacts of shapes with a triangle mesh of the world in the compiled loop, as `SurfaceContacts` finds them."""

from __future__ import annotations

from typing import NamedTuple

from ...compiled import kernel, record
from ...geometry.at_meshes.cores_at_mesh import CoresAtMesh, free_way
from ...geometry.at_meshes.mesh_contacts import mesh_contacts
from ...geometry.at_meshes.surface_rows import surface_contacts
from ...system.mechanisms.mechanism import Mechanism, place
from ..rows import Array
from .pairs import append_contact
from .tables import FOUND, MOST_ROWS, TOO_MANY, UNRESOLVED, PairFamily, RowBuffer


@record("CoresAtMesh, PairFamily, i8[::1], f8[:,:,::1]")
class ShapesAtMesh(NamedTuple):
    """Boxes, hulls, capsules and cylinders at a mesh.

    Attributes
    ----------
    at : CoresAtMesh
        The mesh and the cores of the shapes, shared with the family.
    family : PairFamily
        The numbers, bodies and coefficients of the shapes.
    bodies : ndarray of int, shape (b,)
        The bodies whose placements the cores need.
    places : ndarray, shape (b, 4, 3)
        Room for these.
    """

    at: CoresAtMesh
    family: PairFamily
    bodies: Array
    places: Array


@record(
    "f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], i8[:,::1], i8[::1], b1[::1], f8, f8, f8[:,::1], f8[::1], f8[:,::1],"
    " f8[::1], i8[:,::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1],"
    " f8[:,::1]"
)
class BallsAtMesh(NamedTuple):
    """Spheres at a mesh, which all but `local` to `reach` describe as arguments of `mesh_contacts`.

    Attributes
    ----------
    rounding : float
        How far beyond its reach a sphere looks [m].
    local, radii : ndarray, shapes (n, 3) and (n,)
        Centres in the frames of their bodies, and radii [m].
    centres, reach : ndarray, shapes (n, 3) and (n,)
        Room for centres in the world, and for how far from each triangles are looked at [m].
    """

    vertices: Array
    triangles: Array
    order: Array
    boxes: Array
    features: Array
    sharers: Array
    sheet: Array
    deepest: float
    rounding: float
    local: Array
    radii: Array
    centres: Array
    reach: Array
    listed: Array
    about: Array
    triangle: Array
    number: Array
    distance: Array
    foot: Array
    rank: Array
    sphere: Array
    gap: Array
    point: Array
    normal: Array


@record("BallsAtMesh, PairFamily")
class SpheresAtMesh(NamedTuple):
    """Spheres at a mesh, and their numbers, bodies and coefficients.

    Attributes
    ----------
    at : BallsAtMesh
        The spheres and the mesh.
    family : PairFamily
        The rest.
    """

    at: BallsAtMesh
    family: PairFamily


@kernel("void(Mechanism, ShapesAtMesh)")
def place_at_mesh(mechanism: Mechanism, shapes: ShapesAtMesh) -> None:
    """Write where the bodies of the shapes are."""
    for b in range(len(shapes.bodies)):
        for r in range(4):
            for c in range(3):
                shapes.places[b, r, c] = mechanism.poses[shapes.bodies[b], r, c]


@kernel("i8(Mechanism, ShapesAtMesh, f8[::1], f8, RowBuffer)")
def touching_shapes(mechanism: Mechanism, shapes: ShapesAtMesh, q: Array, tolerance: float, rows: RowBuffer) -> int:
    """Append the contacts of shapes with a mesh at q within a tolerance [m]; return a code."""
    at = shapes.at
    place(mechanism, q)
    place_at_mesh(mechanism, shapes)
    count, triangles, features, most = surface_contacts(at, shapes.places, shapes.family.listed, tolerance)
    if triangles > len(at.near) or features > at.features.shape[1] or max(most, count) > min(len(at.rows), len(at.gap)):
        return UNRESOLVED
    if rows.size[0] + count > MOST_ROWS:
        return TOO_MANY
    for a in range(count):
        append_contact(mechanism, shapes.family, at.shape[a], at.gap[a], at.point[a], at.normal[a], rows)
    return FOUND


@kernel("i8(Mechanism, SpheresAtMesh, f8[::1], f8, RowBuffer)")
def touching_spheres(mechanism: Mechanism, spheres: SpheresAtMesh, q: Array, tolerance: float, rows: RowBuffer) -> int:
    """Append the contacts of spheres with a mesh at q within a tolerance [m]; return a code."""
    balls, family = spheres.at, spheres.family
    place(mechanism, q)
    for i in range(len(balls.radii)):
        pose = mechanism.poses[family.bodies[1, i]]
        balls.reach[i] = balls.radii[i] + tolerance + balls.rounding
        for c in range(3):
            balls.centres[i, c] = pose[3, c]
            for k in range(3):
                balls.centres[i, c] += balls.local[i, k] * pose[k, c]
    count, most = mesh_contacts(
        balls.vertices, balls.triangles, balls.order, balls.boxes, balls.features, balls.sharers, balls.sheet,
        balls.centres, balls.radii, balls.reach, tolerance, balls.deepest, balls.listed, balls.about, balls.triangle,
        balls.number, balls.distance, balls.foot, balls.rank, balls.sphere, balls.gap, balls.point, balls.normal,
    )  # fmt: skip
    if max(count, most) > len(balls.gap):
        return UNRESOLVED
    if rows.size[0] + count > MOST_ROWS:
        return TOO_MANY
    for a in range(count):
        append_contact(mechanism, family, balls.sphere[a], balls.gap[a], balls.point[a], balls.normal[a], rows)
    return FOUND


@kernel("b1(Mechanism, ShapesAtMesh, f8[::1], i8, f8)")
def is_clear_of_mesh(mechanism: Mechanism, shapes: ShapesAtMesh, q: Array, s: int, distance: float) -> bool:
    """Return whether it is known that shape s at q is farther than a distance from a mesh [m]."""
    place(mechanism, q)
    place_at_mesh(mechanism, shapes)
    return free_way(shapes.at, shapes.places, s) > distance
