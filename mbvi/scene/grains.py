"""The part of a scene that adds many bodies at once, for granular media."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from ..arguments import all_positive, array, file_path, optional, positive, vectors
from ..geometry.shapes.orientation import RotationLike, rotation_matrices
from ..geometry.shapes.shapes import Array, Box, Hull
from .inputs import many_masses, mesh_of, scaled
from .items import BodyItem, SceneItems, SphereItem

Numbers = float | Sequence[float] | Array


class Grains:
    """Methods of `Scene` that add many bodies under one name."""

    _items: SceneItems

    def add_spheres(
        self,
        positions: Array,
        radius: Numbers,
        mass: Numbers | None = None,
        velocities: Array | None = None,
        name: str | None = None,
        density: Numbers | None = None,
    ) -> str:
        """Add many spheres; `add_spheres(*packing, density=2500.0)` accepts the result of `mbvi.packing`.

        Parameters
        ----------
        positions : array_like, shape (n, 3)
            Centres [m].
        radius, mass : float or array_like, shape (n,)
            Radii [m] and masses [kg].
        velocities : array_like, shape (n, 3), optional
            Velocities of the centres [m/s]; at rest by default.
        name : str, optional
            "spheres" by default; the k-th is "spheres[k]".
        density : float or array_like, shape (n,)
            In place of the mass [kg/m^3].

        Raises
        ------
        InputError
            On wrong shapes, a radius, mass or density that is not positive, or both mass and density, or neither.
        """
        centres = vectors(positions, "positions")
        radii = all_positive(radius, "radius", len(centres))
        masses = many_masses(mass, density, 4.0 / 3.0 * np.pi * radii**3)
        speeds = np.zeros_like(centres) if velocities is None else vectors(velocities, "velocities", len(centres))
        name = self._items.new_name(name, "spheres")
        self._items.spheres.append(SphereItem(name, centres, radii, masses, speeds))
        return name

    def add_boxes(
        self,
        positions: Array,
        size: Sequence[float] | Array,
        mass: Numbers | None = None,
        *,
        density: Numbers | None = None,
        rotations: RotationLike | None = None,
        velocities: Array | None = None,
        angular_velocities: Array | None = None,
        name: str | None = None,
    ) -> str:
        """Add many homogeneous boxes.

        Parameters
        ----------
        positions : array_like, shape (n, 3)
            Centres [m].
        size : array_like, shape (3,) or (n, 3)
            Edge lengths [m].
        mass, density : float or array_like, shape (n,)
            One of them [kg, kg/m^3].
        rotations : array_like, shape (n, 3, 3) or (n, 4), or one rotation for all, optional
            Matrices or unit quaternions (x, y, z, w), as an array or as scipy's `Rotation`; one for all may be
            roll-pitch-yaw angles too. Upright by default.
        velocities, angular_velocities : array_like, shape (n, 3), optional
            Both in the world [m/s, rad/s]; at rest by default.
        name : str, optional
            "boxes" by default; the k-th is "boxes[k]".

        Raises
        ------
        InputError
            On wrong shapes, a length, mass or density that is not positive, a rotation that is none.
        """
        centres = vectors(positions, "positions")
        edges = np.atleast_2d(array(size, "size"))
        edges = vectors(edges, "size", None if len(edges) == 1 else len(centres))
        all_positive(edges.ravel(), "size", edges.size)
        shapes = [Box(tuple(edge)) for edge in edges.tolist()]
        if len(shapes) < len(centres):
            shapes *= len(centres)
        masses = many_masses(mass, density, np.broadcast_to(edges.prod(axis=1), len(centres)))
        name = self._items.new_name(name, "boxes")
        moves = _motions(len(centres), rotations, velocities, angular_velocities)
        for k, (place, turn, speed, spin) in enumerate(zip(centres, *moves, strict=True)):
            m = float(masses[k])
            inertia = shapes[k].inertia(m)
            item = BodyItem(f"{name}[{k}]", shapes[k], m, inertia, np.zeros(3), place, turn, speed, spin, False)
            self._items.bodies.append(item)
        return name

    def add_convex(
        self,
        shape: Array | str | os.PathLike[str],
        positions: Array,
        mass: Numbers | None = None,
        *,
        density: Numbers | None = None,
        scale: float = 1.0,
        rotations: RotationLike | None = None,
        velocities: Array | None = None,
        angular_velocities: Array | None = None,
        name: str | None = None,
        tolerance: float | None = None,
    ) -> str:
        """Add many homogeneous bodies of one shape, the convex hull of points or of a mesh file.

        Parameters
        ----------
        shape : array_like of shape (p, 3), or path
            Points in the shape's frame, or a mesh file (STL, OBJ, DAE).
        positions : array_like, shape (n, 3)
            Where that frame stands [m]; q holds the centres of mass.
        mass, density : float or array_like, shape (n,)
            One of them [kg, kg/m^3].
        scale : float
            Metres per unit of the points or the file.
        rotations, velocities, angular_velocities, name
            As `add_boxes`; velocities are those of the centres of mass. "grains" by default.
        tolerance : float, optional
            As `add_mesh` [m].

        Raises
        ------
        InputError
            As `add_boxes`; also if the points span no volume or the file cannot be read.
        """
        centres = vectors(positions, "positions")
        if isinstance(shape, str | os.PathLike):
            points = mesh_of(file_path(shape, "shape"))[0]
        else:
            points = vectors(shape, "shape")
        hull, within = Hull(scaled(points, scale)), optional(positive, tolerance, "tolerance")
        masses = many_masses(mass, density, np.full(len(centres), hull.volume))
        name = self._items.new_name(name, "grains")
        centre, inertia = hull.mass_properties(1.0)
        moves = _motions(len(centres), rotations, velocities, angular_velocities)
        for k, (place, turn, speed, spin) in enumerate(zip(centres, *moves, strict=True)):
            m = float(masses[k])
            at = place, turn, speed, spin
            item = BodyItem(f"{name}[{k}]", hull, m, m * inertia, centre, *at, False, tolerance=within)
            self._items.bodies.append(item)
        return name


def _motions(
    count: int, rotations: RotationLike | None, velocities: Array | None, angular_velocities: Array | None
) -> tuple[Array, Array, Array]:
    still = np.zeros((count, 3))
    return (
        rotation_matrices(np.eye(3) if rotations is None else rotations, "rotations", count),
        still if velocities is None else vectors(velocities, "velocities", count),
        still if angular_velocities is None else vectors(angular_velocities, "angular_velocities", count),
    )
