"""Names and units of the entries of q and v, for tables and other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from .run_data import RunData

if TYPE_CHECKING:
    from ..system import System

_QUATERNION = ("qx", "qy", "qz", "qw")
# number of q and v of a body or of a joint that is named by axes
_FREE, _BODY_IN_PLANE, _CENTRE, _CENTRE_IN_PLANE = (7, 6), (7, 3), (3, 3), (3, 2)
_PLANAR_JOINT, _TURNS_WITHOUT_LIMITS = (4, 3), (2, 1)


class Coordinate(NamedTuple):
    """One entry of q or v: its name "robot/joint" or "body/x", and its unit."""

    name: str
    unit: str


def coordinates(run: RunData) -> tuple[list[Coordinate], list[Coordinate]]:
    """Return the coordinates of q and those of v, in their order.

    A joint with one coordinate goes by its own name. Free bodies and bases have x, y, z and the quaternion qx, qy, qz,
    qw, and the velocities vx to wz; a sphere that does not turn x, y, z. Entries without names have numbers.
    """
    if run.problem is None:
        return _numbered("", run.q.shape[1]), _numbered("", run.v.shape[1])
    problem, q, v = run.problem, list[Coordinate](), list[Coordinate]()
    plane = (problem.scene.items.plane if problem.scene is not None else None) or "xy"
    for part in problem.system.located_parts():
        of_q, of_v = _of_mechanism(part.system, plane) if part.system.model is not None else _of(part.system, plane)
        q += of_q
        v += of_v
    return q, v


def _of_mechanism(system: System, plane: str) -> tuple[list[Coordinate], list[Coordinate]]:
    """Return the coordinates of the joints of a mechanism."""
    model, q, v = system.model, list[Coordinate](), list[Coordinate]()
    assert model is not None
    lengths = system.are_lengths()
    for name, joint in zip(system.bodies[1:], list(model.joints)[1:], strict=True):
        size = (joint.nq, joint.nv)
        if size == (1, 1):
            unit = "m" if lengths[joint.idx_v] else "rad"
            q.append(Coordinate(name, unit))
            v.append(Coordinate(name, f"{unit}/s"))
        else:
            of_q, of_v = _named(name, size, plane)
            q += of_q
            v += of_v
    return q, v


def _of(system: System, plane: str) -> tuple[list[Coordinate], list[Coordinate]]:
    """Return the coordinates of free bodies or spheres, or of a system given by functions."""
    q, v = list[Coordinate](), list[Coordinate]()
    names = system.bodies[1:]
    if not names:
        return _numbered("", system.nq), _numbered("", system.nv)
    for name in names:
        of_q, of_v = _named(name, (system.nq // len(names), system.nv // len(names)), plane)
        q += of_q
        v += of_v
    return q, v


def _named(name: str, size: tuple[int, int], plane: str) -> tuple[list[Coordinate], list[Coordinate]]:
    """Return the coordinates of a joint or body of several degrees of freedom."""
    centre, speeds = [(axis, "m") for axis in "xyz"], [(f"v{axis}", "m/s") for axis in "xyz"]
    in_plane = [(f"v{axis}", "m/s") for axis in plane]
    spin = [("w", "rad/s")]
    known = {
        _FREE: (centre + [(part, "1") for part in _QUATERNION], speeds + [(f"w{axis}", "rad/s") for axis in "xyz"]),
        _BODY_IN_PLANE: (centre + [(part, "1") for part in _QUATERNION], in_plane + spin),
        _CENTRE: (centre, speeds),
        _CENTRE_IN_PLANE: (centre, in_plane),
        _PLANAR_JOINT: ([(axis, "m") for axis in plane] + [("cos", "1"), ("sin", "1")], in_plane + spin),
        _TURNS_WITHOUT_LIMITS: ([("cos", "1"), ("sin", "1")], [("w", "rad/s")]),
    }.get(size)
    if known is None:
        return _numbered(name, size[0]), _numbered(name, size[1])
    q, v = ([Coordinate(f"{name}/{part}", unit) for part, unit in entries] for entries in known)
    return q, v


def _numbered(name: str, count: int) -> list[Coordinate]:
    return [Coordinate(f"{name}[{k}]" if name else str(k), "") for k in range(count)]
