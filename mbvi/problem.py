"""The problem that schemes solve: system, admissible set, initial state, restitution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.sparse import csr_array

from .arguments import LARGEST, Array, boolean, finite, positive, shown, vector
from .arguments import friction as checked_friction
from .arguments import restitution as checked_restitution
from .constraints import AdmissibleSet, Constraint, ConstraintFamily
from .errors import DivergedError, InadmissibleStartError, InputError
from .system import ArticulatedSystem, System, checked_system, parts_of
from .system.actuators import Actuators, DrivenActuators, Inputs
from .system.free.free_body_table import FreeBodyTable, free_body_table, velocities_in_space
from .system.mechanisms.loop_margin import widest_open, with_equalities

if TYPE_CHECKING:
    from .built_scene import BuiltScene

# gap at and below which a constraint is active, in lengths of the scene
ACTIVATION = 1e-8


class Problem:
    """The Cauchy problem (P): find q in K and v of bounded variation from (q0, v0).

    Parameters
    ----------
    system : System
        M(q), g(t, q, v) and the retraction.
    constraints : sequence of Constraint or ConstraintFamily
        f_a and their gradients.
    q0 : array_like, shape (nq,)
        Initial configuration, in K.
    v0 : array_like, shape (nv,)
        Initial velocity; outside T_K(q0) the law (8) is applied to it once.
    restitution : float or array_like, shape (len(constraints),)
        e in [0, 1], one for all or one each; constraints built by a `Scene` carry their own.
    friction : float or array_like, shape (len(constraints),)
        Coefficient of Coulomb friction mu >= 0, one for all or one each; constraints built by a `Scene` carry their
        own. Others need tangents; see `GapFunction`.
    energy_cap : bool
        Whether an impact with friction that would gain kinetic energy takes the largest restitution e' <= e with which
        it gains none, up to 64 contacts at once. e' is recorded as `Impact.e_used`.
    t0 : float
        Initial time [s].
    length : float
        Length of the scene [m]: a constraint is active at a gap below 1e-8 of it, the limit of a joint that turns at
        1e-8 rad.
    scene : BuiltScene, optional
        The scene that the problem was built from; given by `Scene.build()` only.

    Raises
    ------
    InputError
        On wrong shapes, infinite numbers, e outside [0, 1], mu < 0, friction without tangents, quaternions not unit.
    InadmissibleStartError
        If q0 is not in K.
    """

    def __init__(
        self,
        system: System,
        constraints: Sequence[Constraint | ConstraintFamily],
        q0: Array | Sequence[float],
        v0: Array | Sequence[float],
        *,
        restitution: float | Sequence[float] | Array = 0.0,
        friction: float | Sequence[float] | Array = 0.0,
        energy_cap: bool = False,
        t0: float = 0.0,
        length: float = 1.0,
        scene: BuiltScene | None = None,
    ) -> None:
        self.system = checked_system(system)
        self.q0 = _state(q0, system.nq, "q0")
        self.v0 = _state(v0, system.nv, "v0")
        self.t0, self.length, self.scene = finite(t0, "t0"), positive(length, "length"), scene
        # in a problem loaded from a file: the functions that the file could not hold; runs need them given again
        self.not_kept: tuple[str, ...] = ()
        constraints = _checked_constraints(constraints)
        if scene is not None and not (hasattr(scene, "items") and hasattr(scene, "report")):
            raise InputError(f"scene is given by Scene.build() only; got {shown(scene)}")
        self.restitution = checked_restitution(restitution, len(constraints))
        self.energy_cap = boolean(energy_cap, "energy_cap")
        self.friction = checked_friction(friction, len(constraints))
        self.constraints = AdmissibleSet(self.system, constraints, self.restitution, self.friction)
        # gap at and below which a constraint is active [m]; gaps of angles are multiplied by their levers
        self.tolerance = ACTIVATION * self.length
        # entries of q of unit quaternions and unit vectors, and where each starts among them; None without them
        entries = [one for group in self.system.unit_groups() for one in group]
        self._rotations: tuple[Array, Array] | None = None
        if entries:
            self._rotations = np.concatenate(entries), np.cumsum([0, *map(len, entries[:-1])])
        self._check()
        self.constraints.renew()

    def _check_rotations(self) -> None:
        if self._rotations is None:
            return
        entries, starts = self._rotations
        turns = self.q0[entries]
        off = np.add.reduceat(turns * turns, starts) - 1.0
        # the sum of squares is faster and decides nearly all cases; NaN decides none
        if not (off.dot(off) <= 4e-12 or np.abs(off).max() <= 2e-6):
            raise InputError(
                "q0 holds a quaternion, or cosine and sine of an angle, that is not of unit length: divide it by its "
                "norm; the quaternion (0, 0, 0, 1) turns nothing"
            )

    def _check(self) -> None:
        self._check_rotations()
        try:
            self._check_system()
        except DivergedError as error:
            raise InputError(f"at the start {error}") from error
        self.constraints.check(self.t0, self.q0)
        open_by = float(np.abs(self.system.gaps(self.q0)).max(initial=0.0))
        # written so that a NaN is refused too
        if not open_by <= self.tolerance:
            widest = f": {widest_open(self.system, self.q0)}" if with_equalities(self.system) else ""
            raise InadmissibleStartError(
                f"the initial configuration opens loops or couplings, by {open_by:.3g}{widest}; start where they close"
            )
        if self.scene is not None and self.scene.underway:
            return
        active = self.constraints.active(self.t0, self.q0, self.tolerance)
        gaps = active.gap * self.constraints.levers(active.constraint)
        if gaps.size and gaps.min() < -self.tolerance:
            worst = int(np.argmin(gaps))
            others = len(set(active.constraint[gaps < -self.tolerance])) - 1
            more = f" ({others} more constraint{'s' if others > 1 else ''} with it)" if others else ""
            depth = f"{-active.gap[worst]:.6g}"
            # a joint limit has no normal; its unit depends on the joint
            resolve = "" if self.scene is None else ", or build the scene by build(resolve=True), which moves it out"
            found = f"penetrates by {depth} m{more}; move the bodies apart or leave that pair out{resolve}"
            if np.isnan(active.normal[worst]).any():
                found = f"is violated by {depth}{more}; start where its gap is not negative{resolve}"
            name = self.constraints.name(int(active.constraint[worst]))
            raise InadmissibleStartError(f"the initial configuration is not admissible: {name} {found}")

    def __repr__(self) -> str:
        return f"Problem(nq={self.system.nq}, nv={self.system.nv}, constraints={len(self.constraints)}, t0={self.t0:g})"

    def _repr_html_(self) -> str:
        """Return the report for a notebook."""
        return f"<div><b>{escape(repr(self))}</b><pre>{escape(self.report())}</pre></div>"

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        # the arrays of a copy are writeable
        for start in (self.q0, self.v0):
            start.setflags(write=False)

    def at(
        self, q: Array | Sequence[float], v: Array | Sequence[float], t: float = 0.0, *, check: bool = False
    ) -> Problem:
        """Return the same problem from another state, for resets and rollouts.

        System and constraints are shared, so that this costs microseconds. Steps of the copies may alternate, but the
        copies must not run on several threads at once.

        Parameters
        ----------
        q : array_like, shape (nq,)
            Initial configuration, in the order of this problem's `q0`: robots, then rigid bodies, then spheres, each in
            the order they were added. A robot has the position of its free base [m] and its quaternion (x, y, z, w),
            then its joints in the order of its `pinocchio.Model`; a rigid body its centre of mass and its quaternion; a
            sphere its centre. A turning joint without limits has the cosine and the sine of its angle; a free base in a
            planar scene has two positions, then cosine and sine.
        v : array_like, shape (nv,)
            Initial velocity, in the order of `v0`: of a free base linear and angular in its own frame; of a rigid body
            that of the centre of mass in the world and angular in its own frame.
        t : float
            Initial time [s].
        check : bool
            Whether to check all that building the problem checks: that q is in K, that mass and forces are finite, and
            that q lies in the plane of a planar scene.

        Raises
        ------
        InputError
            On wrong shapes, numbers that are not finite, an unnormalised quaternion.
        InadmissibleStartError
            If `check` finds that q is not in K.
        """
        # copy() is avoided, because a subclass may redefine it
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__)
        new.q0, new.v0, new.t0 = _state(q, self.system.nq, "q"), _state(v, self.system.nv, "v"), finite(t, "t")
        if boolean(check, "check"):
            new._check()
            if self.scene is not None:
                self.scene.check_in_plane(self, new.q0)
        else:
            new._check_rotations()
        return new

    def state(self, q: Mapping[str, Any] | None = None, v: Mapping[str, Any] | None = None) -> tuple[Array, Array]:
        """Return the start of a scene with other values by name, as `at`, `rollout` and `Simulator` take them.

        Parameters
        ----------
        q, v : mapping of str to mapping or array_like, optional
            For a robot values by joint, {"quadruped": {"FL_hip_joint": 0.1}}: an angle [rad] or a length [m], several
            numbers for a joint with several; or all of its numbers, shapes (nq,) and (nv,). For a rigid body its centre
            of mass and quaternion (x, y, z, w), shape (7,) [m]; its velocities in space are that of the centre of mass
            in the world and the angular velocity in its own axes, shape (6,) [m/s, rad/s]. For a sphere its centre and
            velocity, shape (3,); for a body the first three alone will do, and the others stay. A group has one row for
            each member. What is not named keeps its value at the start; joints that follow a named one go with it.

        Returns
        -------
        q, v : ndarray, shapes (nq,) and (nv,)
            New arrays.

        Raises
        ------
        InputError
            If the problem is of no scene, a name is unknown, a shape or number is wrong, or a joint is given another
            value than that of the joint it follows.
        """
        if self.scene is None:
            raise InputError("this problem is of no scene: nothing in it has a name; give q and v as arrays")
        return self.scene.state(self, q, v)

    @property
    def ctrl(self) -> Inputs:
        """The inputs of the actuators of MJCFs by name, in the order of the robots and of their files.

        `problem.ctrl["hip"] = 0.3` sets one, `problem.ctrl[:] = array` all, for runs that begin later and for the next
        step of a `Simulator`; `names` and `ranges`, shape (nu, 2), list them. Names are "robot/actuator" where several
        robots have actuators.
        """
        found = [(part.name, part.control) for part in parts_of(self.system) if isinstance(part, ArticulatedSystem)]
        return Inputs([(name, one) for name, one in found if isinstance(one, Actuators | DrivenActuators)])

    def model(self, name: str | None = None) -> pin.Model:
        """Return a copy of the Pinocchio model of a robot, as it is simulated.

        Its q and v are the arguments of the robot's `control(t, q, v)`. Locked joints are left out. Joints whose limits
        coincide are left out too, unless a control or a force refers to them. The links behind such joints are part of
        the link before. In a planar scene a free base is a planar joint. Gravity is that of the scene.

        Parameters
        ----------
        name : str, optional
            The robot; may be left out where there is one.

        Raises
        ------
        InputError
            If there is no robot of that name, or several and none is named.
        """
        robots = {part.name: part.model for part in parts_of(self.system) if part.model is not None}
        known = ", ".join(robots) or "none"
        if name is None and len(robots) == 1:
            return next(iter(robots.values())).copy()
        if name is None:
            raise InputError(f"name the robot whose model is meant; those of this problem are {known}")
        if not isinstance(name, str) or name not in robots:
            raise InputError(f"this problem has no robot {shown(name)}; known are {known}")
        return robots[name].copy()

    @cached_property
    def free_bodies(self) -> FreeBodyTable:
        """The free bodies of the system."""
        return free_body_table(self.system)

    @cached_property
    def in_space(self) -> csr_array | None:
        """The matrix that maps v to velocities of bodies in space; None if no body moves in a plane."""
        return velocities_in_space(self.system)

    def _check_system(self) -> None:
        self.system.check(self.t0, self.q0, self.v0)
        self.system.metric(self.q0)
        if not np.isfinite(self.system.force(self.t0, self.q0, self.v0)).all():
            raise InputError("the force at the initial state is not finite")

    def report(self) -> str:
        """Return a text that lists the parts of the model, its reductions and their reasons."""
        if self.scene is not None:
            return self.scene.report(self)
        e = np.unique(self.restitution)
        return (
            f"{self.system.nv} degrees of freedom, {len(self.constraints)} constraints given as functions, "
            f"restitution {', '.join(f'{x:g}' for x in e) or 'none'}; nothing was left out"
        )


def _checked_constraints(constraints: Any) -> list[Constraint]:
    """Return a user's constraints as a list.

    Raises
    ------
    InputError
        If they are no list or tuple, or one of them has no gap or no gradient.
    """
    if not isinstance(constraints, list | tuple):
        raise InputError(f"constraints must be a list of constraints; got {shown(constraints)}")
    each = list(constraints)
    for one in each:
        if isinstance(one, type) or not (hasattr(one, "gap") and hasattr(one, "gradient")):
            raise InputError(
                f"constraints must be objects with gap(t, q) and gradient(t, q), such as mbvi.GapFunction(f, grad_f); "
                f"got {shown(one)} among them"
            )
    return each


def check_kept(problem: Problem) -> None:
    """Raise `InputError` if a problem came from a file that could not keep all its functions."""
    if problem.not_kept:
        raise InputError(
            f"this problem came from a file, which could not keep: {', '.join(problem.not_kept)}; give controls and "
            'forces back by mbvi.load(path, control={"robot": f}, force={"body": f}), and build the scene again for '
            "anything else"
        )


def _state(values: Array | Sequence[float], size: int, name: str) -> Array:
    """Return a read-only vector, faster than `vector` for the usual kinds of arguments."""
    if type(values) is list and set(map(type, values)) == {float}:
        values = np.array(values)
    fits = False
    if type(values) is np.ndarray and values.dtype == np.float64 and values.shape == (size,):
        with np.errstate(over="ignore"):
            fits = values.dot(values) <= LARGEST**2
    numbers = np.array(values) if fits else vector(values, name, size)
    numbers.setflags(write=False)
    return numbers
