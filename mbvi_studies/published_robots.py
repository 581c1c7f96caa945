"""Robots as their makers publish them, from the package example-robot-data, dropped onto a floor."""

from __future__ import annotations

import sysconfig
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mbvi.errors import InputError
from mbvi.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mbvi.problem import Problem
    from mbvi.system.mechanisms.articulated import Control

_FOLDER = Path(sysconfig.get_path("purelib")) / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
# height of the base while the robot's lowest point is sought [m]
_LIFTED = 5.0


class Published(NamedTuple):
    """A published robot: its name in tables, its file, and whether its base is free."""

    title: str
    file: str
    free: bool = True


PUBLISHED = {
    "go2": Published("Go2", "go2_description/urdf/go2.urdf"),
    "g1": Published("G1, 29 joints", "g1_description/urdf/g1_29dof_rev_1_0.urdf"),
    "talos": Published("Talos, reduced", "talos_data/robots/talos_reduced.urdf"),
    "panda": Published("Panda", "panda_description/urdf/panda.urdf", False),
    "solo12": Published("Solo12", "solo_description/robots/solo12.urdf"),
    "anymal": Published("ANYmal B", "anymal_b_simple_description/robots/anymal.urdf"),
}


def robot_file(name: str) -> Path:
    """Return the URDF of a key of `PUBLISHED`; raise `InputError` if example-robot-data is not installed."""
    file = _FOLDER / PUBLISHED[name].file
    if not file.is_file():
        title = PUBLISHED[name].title
        raise InputError(f"{title} comes with example-robot-data, which is not installed: pip install mbvi[test]")
    return file


def published_robot(
    name: str,
    height: float,
    restitution: float = 0.0,
    joints: Mapping[str, float] | None = None,
    control: Control | None = None,
    friction: float = 0.0,
) -> Problem:
    """Return a published robot at rest over a floor; its mimic joints move on their own.

    Parameters
    ----------
    name : str
        A key of `PUBLISHED`.
    height : float
        Height of its lowest point [m]; a fixed base stands at height 0, where its links do not meet the floor.
    restitution : float
        Newton's e.
    joints, control
        See `Scene.add_urdf`.
    friction : float
        Coefficient of friction of all contacts.

    Raises
    ------
    InputError
        If example-robot-data is not installed.
    """
    robot, file = PUBLISHED[name], robot_file(name)
    scene = Scene(restitution=restitution, friction=friction)
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    place, base = (0.0, 0.0, _LIFTED if robot.free else 0.0), "free" if robot.free else "fixed"
    scene.add_urdf(file, base, place, joints=joints, control=control, name=name, mimic=False)
    problem = scene.build()
    if not robot.free:
        return problem
    q, rows = problem.q0.copy(), problem.constraints
    floor = [k for k in range(len(rows)) if rows.name(k).endswith(" | floor")]
    q[2] += height - float(rows.gap(problem.t0, q)[floor].min())
    return problem.at(q, problem.v0, check=True)
