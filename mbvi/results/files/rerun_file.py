"""Writes a run to a file for the Rerun viewer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...errors import InputError, TrajectoryFileError
from ...geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, PlacedShape, Sphere
from ..diagnosis.energies import energies_of_run
from ..replay.motion import bounds, motion, scene_of, shapes_of
from ..tables import table
from .columns import STATES

if TYPE_CHECKING:
    from ...geometry.motion import Motion
    from ...scene.model import SceneModel
    from ..run_data import Array, RunData

_WALL, _SHEET, _PERCUSSION, _CONTACT = (190, 198, 204, 50), (90, 125, 154, 90), (216, 27, 74), (21, 101, 192)
# how long the arrow of an impact is shown [s], and its length of the greatest percussion, in sizes of the motion
_FADE, _LENGTH = 0.1, 0.3


def write_rerun(run: RunData, path: Path) -> None:
    """Write the file; see `Trajectory.to_rerun`."""
    scene = scene_of(run)
    try:
        import rerun as rr
        import rerun.blueprint as rrb
    except ImportError as error:
        raise InputError("run.to_rerun() needs the Rerun SDK: pip install 'mbvi[rerun]'") from error
    shown = shapes_of(run)["visual"]
    moves = motion(run, shown=shown)
    lower, upper = bounds(scene, moves, shown)
    views = [rrb.TimeSeriesView(origin=name, name=name) for name in ("energy", "penetration", "limit_violation")]
    layout = rrb.Blueprint(
        rrb.Horizontal(rrb.Spatial3DView(origin="world"), rrb.Vertical(*views), column_shares=[2, 1])
    )
    try:
        # the recorder itself only warns of a path that cannot be written
        path.write_bytes(b"")
    except OSError as error:
        raise TrajectoryFileError(f"{path} cannot be written: {error.strerror or error}") from error
    file = rr.RecordingStream("mbvi")
    file.save(path, default_blueprint=layout)
    frames = rr.TimeColumn("time", duration=moves.times)
    file.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    entities = _Entities(rr, run, scene)
    carriers = [*(entities.driven[id(drive)] for drive in scene.motions), *map(entities.body, moves.bodies)]
    for k, entity in enumerate(carriers):
        poses = rr.Transform3D.columns(translation=moves.position[:, k], quaternion=moves.quaternion[:, k])
        file.send_columns(entity, [frames], poses)
    for placed in shown:
        entity = entities.of(placed.name, placed.motion, placed.body)
        file.log(entity, rr.Transform3D(translation=placed.position, mat3x3=placed.rotation), static=True)
        file.log(entity, _shape(rr, placed), static=True)
    for name, wall in scene.walls.items():
        file.log(entities.of(name, wall.motion), _plate(rr, wall, lower, upper), static=True)
    for item in scene.surfaces:
        mesh = item.placed()
        sheet = rr.Mesh3D(vertex_positions=mesh.vertices, triangle_indices=mesh.triangles, albedo_factor=_SHEET)
        file.log(entities.of(item.name, item.motion), sheet, static=True)
    _arrows(rr, file, run, _LENGTH * float(np.linalg.norm(upper - lower)))
    _scalars(rr, file, run)
    file.flush()
    file.disconnect()


class _Entities:
    """Entities of bodies, and of parts of the world with the same prescribed motion or none."""

    def __init__(self, rr: Any, run: RunData, scene: SceneModel) -> None:
        assert run.problem is not None
        self._escaped, self._bodies = rr.escape_entity_path_part, run.problem.system.bodies
        self.driven = {id(drive): f"world/driven/{k}" for k, drive in enumerate(scene.motions)}
        self.driven[id(None)] = "world/fixed"

    def body(self, number: int) -> str:
        """Return the entity of a body."""
        robot, slash, joint = self._bodies[number].partition("/")
        return f"world/bodies/{self._escaped(robot)}" + slash + self._escaped(joint)

    def of(self, name: str, motion: Motion | None, body: int = 0) -> str:
        """Return the entity of a shape, a wall or a mesh; body 0 is the world."""
        return f"{self.body(body) if body else self.driven[id(motion)]}/{self._escaped(name)}"


def _shape(rr: Any, placed: PlacedShape) -> Any:
    """Return a shape in its color."""
    shape, color = placed.shape, [placed.color]
    look = {"colors": color, "fill_mode": "solid"}
    if isinstance(shape, Sphere):
        return rr.Ellipsoids3D(half_sizes=[[shape.radius] * 3], **look)
    if isinstance(shape, Ellipsoid):
        return rr.Ellipsoids3D(half_sizes=[shape.radii], **look)
    if isinstance(shape, Box):
        return rr.Boxes3D(sizes=[shape.size], **look)
    if isinstance(shape, Cylinder):
        return rr.Cylinders3D(lengths=[shape.length], radii=[shape.radius], **look)
    if isinstance(shape, Capsule):
        # there it begins at the origin
        middle = [[0.0, 0.0, -0.5 * shape.length]]
        return rr.Capsules3D(lengths=[shape.length], radii=[shape.radius], translations=middle, **look)
    colors = getattr(shape, "colors", None)
    return rr.Mesh3D(
        vertex_positions=shape.vertices,
        triangle_indices=shape.triangles,
        vertex_colors=None if colors is None else np.where(np.isnan(colors), placed.color[:3], colors),
        albedo_factor=placed.color if colors is None else None,
    )


def _plate(rr: Any, wall: HalfSpace, lower: Array, upper: Array) -> Any:
    """Return a square in the plane of a wall, near the motion."""
    normal, middle, size = np.array(wall.normal), 0.5 * (lower + upper), 0.6 * float(np.linalg.norm(upper - lower))
    turn = Rotation.align_vectors([normal], [[0.0, 0.0, 1.0]])[0]
    square = turn.apply([[-size, -size, 0.0], [size, -size, 0.0], [size, size, 0.0], [-size, size, 0.0]])
    corners = middle + (wall.offset - normal @ middle) * normal + square
    return rr.Mesh3D(vertex_positions=corners, triangle_indices=[[0, 1, 2], [0, 2, 3]], albedo_factor=_WALL)


def _arrows(rr: Any, file: Any, run: RunData, length: float) -> None:
    """Draw percussions of impacts for a moment, and those of recorded contacts while they last."""
    sets = {"world/impacts": ("impacts", _PERCUSSION)}
    if run.record.contacts is not None:
        sets["world/contacts"] = ("contacts", _CONTACT)
    for entity, (name, color) in sets.items():
        columns = table(run, name)
        point, normal = (
            np.stack([columns[f"{key}/{axis}"].values for axis in "xyz"], axis=1) for key in ("point", "normal")
        )
        p, t = np.asarray(columns["percussion"].values), np.asarray(columns["time"].values)
        vector = p[:, None] * normal
        if "tangential/x" in columns:
            vector = vector + np.stack([columns[f"tangential/{axis}"].values for axis in "xyz"], axis=1)
        seen = np.isfinite(normal[:, 0]) & (p > 0.0)
        if not seen.any():
            continue
        times, counts = np.unique(t[seen], return_counts=True)
        # an arrow stays until the next ones: nothing is drawn from then on
        ends = times + _FADE if name == "impacts" else run.t
        ends = np.setdiff1d(ends, times)
        order = np.argsort(np.concatenate([times, ends]), kind="stable")
        column = rr.TimeColumn("time", duration=np.concatenate([times, ends])[order])
        partition = np.concatenate([counts, np.zeros(len(ends), np.int64)])[order]
        drawn = rr.Arrows3D.columns(
            vectors=length / np.sqrt(p[seen].max()) * vector[seen] / np.sqrt(p[seen])[:, None], origins=point[seen]
        )
        file.log(entity, rr.Arrows3D.from_fields(colors=[color]), static=True)
        file.send_columns(entity, [column], drawn.partition(partition))


def _scalars(rr: Any, file: Any, run: RunData) -> None:
    """Write energies, penetration and violation of joint limits over time."""
    kinetic, potential = energies_of_run(run).T
    series = {
        "energy/kinetic": kinetic,
        "energy/potential": potential,
        "energy/total": kinetic + potential,
        "penetration": run.record.penetration,
        "limit_violation": run.record.limit_violation,
    }
    times = rr.TimeColumn("time", duration=run.t)
    for entity, values in series.items():
        unit = STATES[entity.partition("/")[0]].unit
        file.log(entity, rr.SeriesLines(names=f"{entity.rpartition('/')[2]} [{unit}]"), static=True)
        file.send_columns(entity, [times], rr.Scalars.columns(scalars=values))
