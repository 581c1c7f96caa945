"""A robot from a file, or by its name, above the floor z = 0."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer

from ..errors import InadmissibleStartError, InputError

if TYPE_CHECKING:
    from ..problem import Problem

Array = np.ndarray

# height at which no robot reaches the floor; the distance of its lowest point is measured there [m]
FAR_ABOVE = 1000.0
DROP_HEIGHT = 0.5


class Base(StrEnum):
    """Whether the root link floats or is welded to the world."""

    free = "free"
    fixed = "fixed"


RobotArgument = Annotated[
    Path,
    typer.Argument(
        metavar="ROBOT",
        help="A URDF, a MJCF, or robot:NAME of mbvi or robot_descriptions.",
        show_default=False,
    ),
]
BaseOption = Annotated[
    Base | None,
    typer.Option(
        help="Whether the root link floats or is welded to the world.", show_default="free; of a MJCF the file's own"
    ),
]
SrdfOption = Annotated[Path | None, typer.Option(metavar="FILE", help="Leave out the pairs that this SRDF disables.")]


class RobotOnFloor(NamedTuple):
    """A robot and how it starts.

    Attributes
    ----------
    robot : Path
        Its file or name.
    base : Base or None
        None is free, and of a MJCF the file's own.
    restitution, friction : float
        Of every contact.
    joints : mapping of str to float
        Initial positions.
    srdf : Path or None
        File of pairs to leave out.
    """

    robot: Path
    base: Base | None
    restitution: float = 0.5
    friction: float = 0.0
    joints: Mapping[str, float] = MappingProxyType({})
    srdf: Path | None = None

    def problem(self, height: float | None, far_above: bool = False, lowered: bool = True) -> Problem:
        """Return the problem; the lowest point of a free robot is at a height above the floor [m].

        A fixed base stands at that height instead, by default 0, and so does a MJCF with walls of its own, which
        brings its floor and gravity. `far_above` puts all at a height at which nothing touches the floor, and a free
        robot stays there unless it is `lowered`, for which it is built twice.
        """
        mjcf = self._mjcf
        if mjcf and (self.base is not None or self.srdf is not None):
            raise InputError("a MJCF has its own base and its own pairs: leave out --base and --srdf")
        gravity = self._gravity_of_mjcf() if mjcf else None
        own_floor, fixed = (False, self.base is Base.fixed) if gravity is None else self._of_mjcf(gravity)
        build = partial(self._problem_at, gravity, not own_floor)
        if far_above:
            return build(FAR_ABOVE)
        if fixed or own_floor:
            try:
                return build(height or 0.0)
            except InadmissibleStartError as error:
                raise InadmissibleStartError(f"{error}; --height raises the base, --joint bends a joint") from error
        if not lowered:
            return build(FAR_ABOVE)
        from ..arguments.bar import parts

        height = DROP_HEIGHT if height is None else height
        with parts(2, "robot") as bar:
            problem = build(FAR_ABOVE, ())
            floors = [family for family in problem.constraints.families if family.name(0).endswith(" | floor")]
            lowest = [FAR_ABOVE - float(family.gap(problem.t0, problem.q0).min()) for family in floors]
            bar.update()
            return build(height + min(lowest, default=0.0))

    @property
    def _mjcf(self) -> bool:
        from ..scene.urdf.checks import read_xml
        from ..scene.urdf.robot_names import format_of, is_robot_name

        if is_robot_name(self.robot):
            return format_of(self.robot) == "MJCF"
        return read_xml(self.robot)[1].tag == "mujoco"

    def _gravity_of_mjcf(self) -> Array:
        from ..scene.mjcf.file import compiled_model, gravity_of
        from ..scene.urdf.robot_names import description_file

        return gravity_of(compiled_model(description_file(self.robot, "MJCF"))[0])

    def _of_mjcf(self, gravity: Array) -> tuple[bool, bool]:
        """Return whether a MJCF has walls of its own, and whether its base is fixed."""
        model = self._problem_at(gravity, False, 0.0, ()).scene
        assert model is not None
        return bool(model.items.walls), model.items.robots[0].base == "fixed"

    def _problem_at(
        self, gravity: Array | None, floor: bool, z: float, reduce: Collection[str] | None = None
    ) -> Problem:
        """Return the problem with the robot raised by z; `gravity` is that of a MJCF, None for a URDF.

        Without `reduce` its default of `Scene.build` holds.
        """
        from ..scene import Scene

        scene = Scene(restitution=self.restitution, friction=self.friction)
        if gravity is not None:
            scene = Scene(gravity=gravity, restitution=self.restitution, friction=self.friction)
        if floor:
            scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
        if gravity is not None:
            scene.add_mjcf(self.robot, position=(0.0, 0.0, z), joints=self.joints)
        else:
            base, srdf = (self.base or Base.free).value, None if self.srdf is None else str(self.srdf)
            scene.add_urdf(self.robot, base=base, position=(0.0, 0.0, z), joints=self.joints, srdf=srdf)
        return scene.build() if reduce is None else scene.build(reduce)


def joint_positions(given: Sequence[str]) -> dict[str, float]:
    """Return the positions that texts NAME=VALUE give."""
    positions = {}
    for text in given:
        name, _, value = text.rpartition("=")
        try:
            positions[name] = float(value)
        except ValueError:
            name = ""
        if not name:
            raise InputError(f"--joint must be NAME=VALUE with a number; got {text!r}")
    return positions
