"""The scene that users describe: robots, bodies, walls and restitution; `build` returns the Problem."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Unpack

import numpy as np

from ..arguments import (
    between,
    boolean,
    choice,
    file_path,
    function,
    label,
    not_negative,
    numbers_by_name,
    optional,
    positive,
    several_names,
    vector,
)  # fmt: skip
from ..errors import MbviWarning
from ..geometry.motion import Motion
from ..geometry.shapes.orientation import RotationLike, rotation_matrix
from ..geometry.shapes.shapes import Array, Box, Capsule, Cylinder, Ellipsoid, Sphere
from ..system.mechanisms.articulated import Control
from .assembly import assemble, start_picture
from .connected.connections import Connections
from .forces.actions import Actions
from .grains import Grains
from .inputs import BodyArguments
from .items import RobotItem, SceneItems, SphereItem
from .meshes.added import Meshes
from .mjcf.added import MjcfModels
from .overview import overview, overview_html
from .pairs.passing import passing_robots
from .pairs.rules import PairRules, friction_coefficients
from .plane import checked_plane
from .reductions import DEFAULT_REDUCTIONS, checked_reductions
from .urdf.checks import check_mass_matrix, check_masses
from .urdf.joint_friction import stated_friction, with_joint_friction
from .urdf.mimic import on_their_own, unfollowed
from .urdf.robot import load_robot, robot_name
from .urdf.robot_names import description_file
from .urdf.start import initial_state, set_base_velocity
from .urdf.still_joints import checked_locked

if TYPE_CHECKING:
    from ..problem import Problem

_ORIGIN, _STILL, _UPRIGHT = (0.0, 0.0, 0.0), (0.0,) * 6, np.eye(3)


class Scene(Meshes, Grains, MjcfModels, PairRules, Actions, Connections):
    """A scene to simulate; SI units, angles in radians, world frame unless said otherwise.

    Parameters
    ----------
    gravity : array_like, shape (3,)
        Acceleration of gravity [m/s^2].
    restitution : float
        Newton's e in [0, 1] of every contact and joint limit without one of its own.
    friction : float or tuple of three floats
        Coefficient of Coulomb friction mu >= 0 of every contact without one of its own; joint limits have none. Without
        friction contacts have no tangents, and spheres do not turn. Three numbers are mu and the lengths of torsional
        and of rolling friction [m]: a contact with the normal force N bears a torque of at most torsion N about its
        normal, and of rolling N about its tangents.
    energy_cap : bool
        With friction an impact with e > 0 can gain kinetic energy (Kane's paradox). With the cap it takes the largest
        e' <= e with which it gains none; see `Problem`.
    plane : "xy", "xz" or "yz", optional
        The plane that all moves in: spheres have two degrees of freedom, bodies and free bases of robots three, two
        along the plane's axes and a turn from the first axis to the second. Where the data are symmetric about the
        plane that is the motion in space; else things are held in it without friction.

    Notes
    -----
    Each `add_...` returns the name it goes by in impacts and in `set_restitution`. In q and v of the built problem come
    the robots in their order, then the rigid bodies, then the spheres.
    """

    def __init__(
        self,
        gravity: Sequence[float] | Array = (0.0, 0.0, -9.81),
        restitution: float = 0.0,
        plane: str | None = None,
        friction: float | tuple[float, float, float] = 0.0,
        energy_cap: bool = False,
    ) -> None:
        mu, torsion, rolling = friction_coefficients(friction, "friction")
        self._items = SceneItems(
            gravity=vector(gravity, "gravity"),
            restitution=between(restitution, "restitution e", 0.0, 1.0),
            friction=mu,
            resistance=(torsion, rolling),
            energy_cap=boolean(energy_cap, "energy_cap"),
            plane=checked_plane(plane),
        )

    def __repr__(self) -> str:
        return overview(self._items)

    def _repr_html_(self) -> str:
        """Return a picture of the start, and the things in the scene as a table, for a notebook."""
        return start_picture(self._items) + overview_html(self._items)

    def add_urdf(
        self,
        path: str | os.PathLike[str],
        base: str = "free",
        position: Sequence[float] | Array = _ORIGIN,
        rotation: RotationLike = _UPRIGHT,
        joints: Mapping[str, float] | None = None,
        velocity: Mapping[str, float] | None = None,
        control: Control | None = None,
        name: str | None = None,
        srdf: str | None = None,
        locked: Sequence[str] = (),
        tolerance: float | None = None,
        base_velocity: Sequence[float] | Array = _STILL,
        mimic: bool = True,
        joint_friction: bool | Mapping[str, float] = False,
    ) -> str:
        """Add a robot.

        Parameters
        ----------
        path : path
            URDF file, or "robot:" and the name of a robot that mbvi ships or that is in robot_descriptions' cache.
        base : "free" or "fixed"
            Whether its root link floats or is welded to the world.
        position, rotation : array_like
            Initial pose of the root link: shape (3,) [m], and a rotation as `BodyArguments` has it.
        joints, velocity : mapping of str to float, optional
            Initial positions and velocities by joint name; by default zero, or the middle of limits without zero.
        control : callable, optional
            control(t, q, v) -> tau, shape (nv,) [N, N m], of this robot's own q and v, locked joints not among them.
        name : str, optional
            The URDF's own by default.
        srdf : path, optional
            File whose `disable_collisions` pairs are left out.
        locked : sequence of str, optional
            Joints that stay at their initial positions.
        tolerance : float, optional
            As `add_mesh`, for the hull of each mesh [m]; by default 1e-4 of its size, the radius about its centre
            of mass. 0 is exact: only a primitive within 1e-9 of that size replaces a hull.
        base_velocity : array_like, shape (6,)
            Initial velocity of a free root link in the world frame: linear, of the origin of the link's frame, then
            angular [m/s, rad/s]; zero by default, and of a fixed one always.
        mimic : bool
            Whether mimic joints follow the joints that the file names, at the start and in motion, unless they are
            locked; without they move on their own.
        joint_friction : bool or mapping of str to float
            Whether joints have the dry friction that the file states, or the largest torque or force of it by joint
            name [N m, N]. By default they have none.

        Raises
        ------
        UrdfError
            If a file is missing, is no URDF, or describes no physical mechanism.
        InputError
            On an unknown joint, a negative friction, a locked joint that is to move, a wrong shape, a rotation that is
            none, a fixed base that is to move, an initial configuration at which the mass matrix is singular.
        """
        choice(base, "base", ("free", "fixed"))
        optional(function, control, "control", "control(t, q, v) -> tau")
        file, disabled, given = description_file(path, "URDF"), optional(file_path, srdf, "srdf"), optional(label, name)
        placed = {} if joints is None else numbers_by_name(joints, "joints")
        moving = {} if velocity is None else numbers_by_name(velocity, "velocity")
        still, within = several_names(locked, "locked"), optional(not_negative, tolerance, "tolerance")
        place, turn = vector(position, "position"), rotation_matrix(rotation)
        own = self._items.new_name(given, given or robot_name(file))
        robot = load_robot(file, base, turn, place, own, disabled)
        if not boolean(mimic, "mimic"):
            robot = replace(robot, omitted=(*robot.omitted, *on_their_own(robot.mimics)), mimics=())
        q0, v0 = initial_state(robot, base, place, turn, placed, moving, locked=still)
        set_base_velocity(q0, v0, base, vector(base_velocity, "base_velocity", 6))
        still = checked_locked(robot, base, q0, v0, still)
        check_masses(robot.model, {shape.body for shape in robot.shapes}, still, file)
        check_mass_matrix(robot.model, q0, still, file)
        robot, friction = with_joint_friction(robot, joint_friction, stated_friction(robot.model))
        self._items.robots.append(
            RobotItem(robot, base, place, turn, q0, v0, control, still, within, friction=friction)
        )
        self._couple_mimics(robot, still)
        left = unfollowed(robot.omitted, still)
        if left:
            warnings.warn(f"{file.name}: {left}", MbviWarning, stacklevel=2)
        return robot.name

    def add_sphere(
        self,
        radius: float,
        mass: float = 1.0,
        position: Sequence[float] | Array = _ORIGIN,
        velocity: Sequence[float] | Array = _ORIGIN,
        name: str | None = None,
        fixed: bool = False,
        motion: Motion | None = None,
    ) -> str:
        """Add one sphere: three degrees of freedom, its centre, and with friction three more, its rotation.

        Parameters
        ----------
        radius, mass : float
            Radius [m] and mass [kg].
        position, velocity : array_like, shape (3,)
            Of its centre [m, m/s].
        name : str, optional
            "sphere", then numbered, by default.
        fixed : bool
            Whether it is part of the world.
        motion : Motion, optional
            How it moves, whatever pushes on it; such a sphere is part of the world.

        Raises
        ------
        InputError
            On a radius or mass that is not positive, or a wrong shape.
        """
        radius = positive(radius, "radius")
        if boolean(fixed, "fixed") or motion is not None:
            vector(velocity, "velocity")
            body: BodyArguments = {"position": position, "name": name, "fixed": True, "motion": motion}
            return self._add_body(Sphere(radius), mass, "sphere", **body)
        name = self._items.new_name(name, "sphere")
        centre, speed = vector(position, "position"), vector(velocity, "velocity")
        self._items.spheres.append(
            SphereItem(name, centre[None], np.array([radius]), np.array([positive(mass, "mass")]), speed[None])
        )
        return name

    def add_box(
        self,
        size: Sequence[float] | Array,
        mass: float = 1.0,
        **body: Unpack[BodyArguments],
    ) -> str:
        """Add a homogeneous box.

        Parameters
        ----------
        size : array_like, shape (3,)
            Edge lengths [m].
        mass : float
            Mass [kg].
        **body
            `position`, `rotation`, `velocity`, `angular_velocity`, `name`, `fixed`, `motion`: see `BodyArguments`.

        Raises
        ------
        InputError
            On a length or mass that is not positive, a wrong shape, a rotation that is none.
        """
        edges = tuple(positive(x, "size") for x in vector(size, "size").tolist())
        shape = Box(edges)  # type: ignore[arg-type]
        return self._add_body(shape, mass, "box", **body)

    def add_ellipsoid(
        self,
        radii: Sequence[float] | Array,
        mass: float = 1.0,
        **body: Unpack[BodyArguments],
    ) -> str:
        """Add a homogeneous ellipsoid of three semi-axes, shape (3,) [m]; the rest as `add_box`."""
        axes = tuple(positive(x, "radii") for x in vector(radii, "radii").tolist())
        shape = Ellipsoid(axes)  # type: ignore[arg-type]
        return self._add_body(shape, mass, "ellipsoid", **body)

    def add_capsule(
        self,
        radius: float,
        length: float,
        mass: float = 1.0,
        **body: Unpack[BodyArguments],
    ) -> str:
        """Add a homogeneous capsule along its z axis, `length` between the ends' centres [m]; the rest as `add_box`."""
        shape = Capsule(positive(radius, "radius"), positive(length, "length"))
        return self._add_body(shape, mass, "capsule", **body)

    def add_cylinder(
        self,
        radius: float,
        length: float,
        mass: float = 1.0,
        **body: Unpack[BodyArguments],
    ) -> str:
        """Add a homogeneous cylinder along its z axis [m]; the rest as `add_box`."""
        shape = Cylinder(positive(radius, "radius"), positive(length, "length"))
        return self._add_body(shape, mass, "cylinder", **body)

    def build(self, reduce: Collection[str] = DEFAULT_REDUCTIONS, resolve: bool = False) -> Problem:
        """Return the Problem, with no degree of freedom, pair or constraint in it that the scene does not need.

        Parameters
        ----------
        reduce : collection of str
            Which of `mbvi.REDUCTIONS` to apply, all but "pairs" by default; the motion is the same with each of them or
            without, but for the tolerance of "shapes". "joints": those whose limits leave them no range. "pairs": those
            that the limits of joints keep apart; the search takes some 0.1 s a robot and pays in runs of minutes.
            "shapes": hulls that a simpler shape does for, see `add_urdf` and `add_mesh`. "plane": without, a planar
            scene is built in space.
            "rest": free bodies at rest sleep until something touches them, and contacts of shapes that stand still
            are not measured again.
        resolve : bool
            Whether a start that overlaps is moved out of penetration: by the least displacement of bodies and joints in
            the kinetic metric. Report and runs say by how much.

        Raises
        ------
        InputError
            If nothing moves, a reduction is unknown, or something leaves the scene's plane.
        InadmissibleStartError
            If two things overlap at the start and `resolve` is off, or finds no way out.
        """
        problem = assemble(self._items, checked_reductions(reduce), boolean(resolve, "resolve"))
        for one in passing_robots(self._items):
            warnings.warn(str(one), MbviWarning, stacklevel=2)
        return problem
