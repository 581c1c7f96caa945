"""The part of a scene that adds fixed or prescribed walls: half-spaces, open boxes, meshes, height fields."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arguments import (
    SMALLEST,
    all_positive,
    array,
    boolean,
    file_path,
    finite,
    integers,
    optional,
    positive,
    vector,
)
from ..errors import InputError
from ..geometry.meshes.height_field import height_field
from ..geometry.meshes.triangles import Surface
from ..geometry.motion import Motion, checked_motion
from ..geometry.shapes.orientation import RotationLike, rotation_matrix
from ..geometry.shapes.shapes import Array, HalfSpace
from .inputs import scaled
from .items import SceneItems, SurfaceItem
from .meshes.grey import grey_values
from .meshes.visual import triangles_of

_ZERO = (0.0, 0.0, 0.0)
_SIDES = {
    "floor": (0, 0, 1),
    "left": (1, 0, 0),
    "right": (-1, 0, 0),
    "front": (0, 1, 0),
    "back": (0, -1, 0),
}


class Walls:
    """What adds walls."""

    _items: SceneItems

    def add_halfspace(
        self,
        normal: Sequence[float] | Array,
        offset: float = 0.0,
        name: str | None = None,
        motion: Motion | None = None,
    ) -> str:
        """Add a wall or floor: free where normal . x >= offset.

        Parameters
        ----------
        normal : array_like, shape (3,)
            Direction into the free side; its length does not matter to the wall, but divides the offset with it.
        offset : float
            Signed distance of the wall from the origin along a unit normal [m].
        name : str, optional
            "floor" for the first by default.
        motion : Motion, optional
            How it moves, one of `mbvi.motion`; it stands still by default.

        Raises
        ------
        InputError
            If the normal is zero, the name is taken, or the motion is none.
        """
        n = vector(normal, "normal")
        length = float(np.linalg.norm(n))
        if length < SMALLEST:
            raise InputError("the normal of a half-space must not be zero")
        shift, moved = finite(offset, "offset") / length, checked_motion(motion)
        finite(shift, "offset divided by the length of the normal")
        name = self._items.new_name(name, "floor")
        self._items.walls[name] = HalfSpace(tuple(n / length), shift, moved)
        return name

    def add_container(
        self,
        lower: Sequence[float] | Array,
        upper: Sequence[float] | Array,
        name: str | None = None,
        motion: Motion | None = None,
    ) -> str:
        """Add an open box: a floor and four walls that go up without end, each a half-space.

        Parameters
        ----------
        lower : array_like, shape (3,)
            Its lowest corner [m].
        upper : array_like, shape (2,) or (3,)
            The opposite corner in x and y [m]; a height does not matter.
        name : str, optional
            "container" by default; its parts are "container/floor", "/left", "/right", "/front" and "/back".
        motion : Motion, optional
            As `add_halfspace`.

        Raises
        ------
        InputError
            If the corners are none of a box, the name is taken, or the motion is none.
        """
        low, far = vector(lower, "lower"), array(upper, "upper")
        if far.shape not in ((2,), (3,)):
            raise InputError(f"upper has shape {far.shape}; it must have (2,) or (3,)")
        high = np.array([*far[:2], 0.0])
        if not (low[:2] < high[:2]).all():
            raise InputError(f"lower must lie below upper in x and y; got {low.tolist()} and {high[:2].tolist()}")
        moved = checked_motion(motion)
        name = self._items.new_name(name, "container")
        for side, normal in _SIDES.items():
            corner = high if min(normal) < 0 else low
            n = np.array(normal, dtype=float)
            self._items.walls[f"{name}/{side}"] = HalfSpace(tuple(n), float(n @ corner), moved)
        return name

    def add_surface(
        self,
        mesh: str | os.PathLike[str] | Array,
        triangles: Array | None = None,
        scale: float = 1.0,
        position: Sequence[float] | Array = (0.0, 0.0, 0.0),
        rotation: RotationLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        name: str | None = None,
        motion: Motion | None = None,
        one_sided: bool = False,
    ) -> str:
        """Add a triangle mesh of the world as it is, hollows and all: a funnel, a drum, terrain.

        Spheres, boxes, hulls and capsules meet it, those of robots included: spheres from both sides, unless it is
        `one_sided`, the others where the corners of its triangles run anticlockwise, as solid behind them.
        `mbvi.surfaces` makes meshes; `add_mesh(path, convex=False)` reads one that may be solid.

        Parameters
        ----------
        mesh : path, or array_like of shape (v, 3)
            A file (STL, OBJ, DAE), or vertices.
        triangles : array_like of int, shape (t, 3), optional
            Which vertices each triangle has; not for a file.
        scale : float
            Metres per unit of the file or the vertices.
        position, rotation : array_like
            Pose of the mesh's frame: shape (3,) [m], and a rotation as `BodyArguments` has it.
        name : str, optional
            The file's, or "surface", by default.
        motion : Motion, optional
            As `add_halfspace`.
        one_sided : bool
            Whether it is solid behind its triangles, whose corners run anticlockwise seen from the free side. A sphere
            whose centre is behind it is pushed back, if the mesh has a rim up to a depth of half a radius.

        Raises
        ------
        InputError
            If the file cannot be read, the mesh has no area, the name is taken, or the motion is none.
        """
        place, turn = vector(position, "position"), rotation_matrix(rotation)
        if isinstance(mesh, str | os.PathLike):
            file = file_path(mesh, "mesh")
            if triangles is not None:
                raise InputError("a mesh file brings its triangles itself")
            default, (points, corners, _) = file.stem, triangles_of(file)
        elif triangles is None:
            raise InputError("give triangles with the vertices: add_surface(vertices, triangles)")
        else:
            default, points, corners = (
                "surface",
                array(mesh, "mesh", ("v", 3)),
                integers(triangles, "triangles", ("t", 3)),
            )
        moved, side = checked_motion(motion), boolean(one_sided, "one_sided")
        return self._add_sheet(name, default, Surface(scaled(points, scale), corners, side), place, turn, moved)

    def add_heightfield(
        self,
        heights: str | os.PathLike[str] | Array,
        size: Sequence[float] | Array,
        position: Sequence[float] | Array = (0.0, 0.0, 0.0),
        rotation: RotationLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        name: str | None = None,
        motion: Motion | None = None,
        height: float | None = None,
    ) -> str:
        """Add terrain: heights over a rectangle, solid below, in triangles.

        The middle of the rectangle is at `position`; heights are above it. What rolls over the rim falls off. Each cell
        is two triangles; the edge between them leads from its corner of least x and y to the opposite one.

        Parameters
        ----------
        heights : array_like of shape (rows, columns), or path
            Heights [m]; rows ascend along y, columns along x. Or a PNG of grey values, as a map: its upper rows are
            those of larger y.
        size : array_like, shape (2,)
            Lengths of the rectangle along x and y [m].
        position, rotation : array_like
            Pose of the field: shape (3,) [m], and a rotation as `BodyArguments` has it.
        name : str, optional
            "field", or the name of the file, by default.
        motion : Motion, optional
            As `add_halfspace`.
        height : float, optional
            Of a PNG, and only of it: the height of white above black [m].

        Raises
        ------
        InputError
            If there are fewer than two rows or columns, the file is no grey PNG, or as `add_surface`.
        """
        place, turn = vector(position, "position"), rotation_matrix(rotation)
        along_x, along_y = all_positive(vector(size, "size", 2), "size", 2).tolist()
        white, default = optional(positive, height, "height"), "field"
        if isinstance(heights, str | os.PathLike):
            file = file_path(heights, "heights")
            if white is None:
                raise InputError("give the height of white above black with a PNG: height=")
            default, z = file.stem, white * grey_values(file)
        elif white is not None:
            raise InputError("height is for a PNG; an array holds heights in metres")
        else:
            z = array(heights, "heights", ("rows", "columns")).copy()
        if min(z.shape) < 2:
            raise InputError(f"heights has shape {z.shape}; it must have two rows and columns at least")
        surface, moved = height_field(z, (along_x, along_y)), checked_motion(motion)
        return self._add_sheet(name, default, surface, place, turn, moved, z, (along_x, along_y))

    def _add_sheet(
        self, name: str | None, default: str, surface: Surface, place: Array, turn: Array, *more: Any
    ) -> str:
        """Add a mesh of the world as it is; `more` are its motion, and of a height field its heights and size."""
        name = self._items.new_name(name, default)
        self._items.surfaces.append(SurfaceItem(name, surface, place, turn, *more))
        return name
