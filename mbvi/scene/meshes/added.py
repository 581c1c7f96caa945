"""The part of a scene that adds mesh files: as convex hulls, as convex parts, or as they are."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ...arguments import boolean, file_path, optional, positive, vector
from ...errors import InputError
from ...geometry.meshes.triangles import Surface
from ...geometry.motion import checked_motion
from ...geometry.shapes.orientation import rotation_matrix
from ...geometry.shapes.shapes import Convex, Hull
from ..inputs import BodyArguments, check_known, mesh_of, scaled
from ..items import BodyItem
from ..walls import Walls
from .convex_parts import convex_parts, mass_properties
from .visual import triangles_of

# CoACD's own default, and the bounds that it keeps
CONCAVITY, _LEAST, _MOST = 0.05, 0.01, 1.0
_ORIGIN, _UPRIGHT = (0.0, 0.0, 0.0), np.eye(3)


class Meshes(Walls):
    """What adds mesh files, and single bodies of other shapes."""

    def add_mesh(
        self,
        path: str | os.PathLike[str],
        mass: float = 1.0,
        scale: float = 1.0,
        tolerance: float | None = None,
        convex: bool = True,
        decompose: bool | float = False,
        **body: Unpack[BodyArguments],
    ) -> str:
        """Add the convex hull of a mesh file (STL, OBJ, DAE) as a homogeneous body; the rest as `add_box`.

        With `convex=False` it is the mesh as it is, hollows and all, a part of the world: solid behind its triangles if
        it is closed, a sheet as of `add_surface` if it has a rim. Such a mesh has no mass, and moves by `motion` only.
        With `decompose=True` it is a body of convex parts "name[0]", "name[1]", ... that CoACD cuts the mesh into, for
        meshes with hollows that move; a number from 0.01 to 1 in place of True is CoACD's bound on how far parts lie
        outside of the mesh, relative to its size (0.05).

        `position` and `rotation` are those of the file's frame; q holds the centre of mass. `scale` multiplies the
        file's coordinates [m per unit], of a DAE file after the unit that it names. A hull that is a ball, box, capsule
        or cylinder within `tolerance` [m] touches as that, or else as a hull of some of its vertices, if nine tenths of
        them suffice. By default only the first, within 1e-9 of its size. Mass and inertia stay those of the hull, or of
        the parts.
        """
        file, cut = file_path(path), _concavity(decompose)
        if not boolean(convex, "convex"):
            if cut is not None:
                raise InputError("decompose is for a mesh of convex parts, and convex=False for one as it is: choose")
            return self._add_as_it_is(file, scale, {"mass": mass, "tolerance": tolerance, **body})
        hull = Hull(scaled(mesh_of(file)[0], scale))
        within = optional(positive, tolerance, "tolerance")
        if cut is None:
            return self._add_body(hull, mass, file.stem, within, **body)
        points, corners, _ = triangles_of(file)
        cuts = convex_parts(Surface(scaled(points, scale), corners, None), cut)
        return self._add_body(hull, mass, file.stem, within, *cuts, **body)

    def _add_body(
        self, shape: Convex, mass: float, default: str, tolerance: float | None = None,
        parts: tuple[Hull, ...] = (), larger: float | None = None, **body: Unpack[BodyArguments],
    ) -> str:  # fmt: skip
        check_known(body)
        mass = positive(mass, "mass")
        place = vector(body.get("position", _ORIGIN), "position")
        turn = rotation_matrix(body.get("rotation", _UPRIGHT))
        speed = vector(body.get("velocity", _ORIGIN), "velocity")
        spin = vector(body.get("angular_velocity", _ORIGIN), "angular_velocity")
        motion = checked_motion(body.get("motion"))
        name = self._items.new_name(body.get("name"), default)
        centre, inertia = np.zeros(3), shape.inertia(mass)
        if isinstance(shape, Hull):
            centre, inertia = mass_properties(parts, mass) if parts else shape.mass_properties(mass)
        fixed = boolean(body.get("fixed", False), "fixed") or motion is not None
        self._items.bodies.append(
            BodyItem(
                name, shape, mass, inertia, centre, place, turn, speed, spin, fixed, motion, tolerance, parts, larger
            )
        )
        return name

    def _add_as_it_is(self, file: Path, scale: float, given: dict[str, Any]) -> str:
        """Add a mesh as it is; raise `InputError` on what is given for a body only."""
        check_known(given, ("mass", "tolerance"))
        if not boolean(given.pop("fixed", True), "fixed"):
            raise InputError(
                f"{file.name} as it is cannot move freely: of two meshes that both move, mbvi finds contacts of convex "
                f"parts only. Take decompose=True in place of convex=False, or leave out fixed=False"
            )
        defaults: dict[str, Any] = {"mass": 1.0, "tolerance": None, "velocity": _ORIGIN, "angular_velocity": _ORIGIN}
        for argument, default in defaults.items():
            if not np.array_equal(given.pop(argument, default), default):
                raise InputError(f"{argument} is not for a mesh as it is, convex=False: it is a part of the world")
        points, corners, _ = triangles_of(file)
        place = vector(given.get("position", _ORIGIN), "position")
        turn = rotation_matrix(given.get("rotation", _UPRIGHT))
        surface, motion = Surface(scaled(points, scale), corners, None), checked_motion(given.get("motion"))
        return self._add_sheet(given.get("name"), file.stem, surface, place, turn, motion)


def _concavity(decompose: bool | float) -> float | None:
    """Return CoACD's threshold, None where a mesh is not cut."""
    if isinstance(decompose, bool | np.bool_):
        return CONCAVITY if decompose else None
    found = positive(decompose, "decompose")
    if not _LEAST <= found <= _MOST:
        raise InputError(f"decompose is True, False or a number from {_LEAST:g} to {_MOST:g}, not {found:g}")
    return found
