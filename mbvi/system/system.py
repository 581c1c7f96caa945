"""The base class of mechanical systems: everything that schemes, constraints and runs use of one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ..projection import FreeMotion, Metric, TreeFreeMotion

if TYPE_CHECKING:
    import pinocchio as pin

Array = np.ndarray


class Part(NamedTuple):
    """One of the systems that a system consists of, and where its q, v and bodies begin."""

    system: System
    q: int
    v: int
    body: int


class Kinematics(NamedTuple):
    """Poses and Jacobian of a mechanism, in arrays that are overwritten at the next configuration.

    Attributes
    ----------
    poses : ndarray, shape (njoints, 4, 3)
        Columns of each body's rotation, then its origin [m].
    columns : ndarray, shape (nv, 6)
        Jacobian columns in the world, one in each row.
    support : ndarray, shape (njoints, nv)
        1 where a velocity moves a body, else 0.
    """

    poses: Array
    columns: Array
    support: Array


class System:
    """M(q) dv/dt = g(t, q, v) on a configuration manifold (equation 1).

    Bodies are numbered from 1; body 0 is the world. Velocities are in the tangent space at q.

    Attributes
    ----------
    nq, nv : int
        Sizes of q and v.
    bodies : tuple of str
        Names, the world first.
    velocity_dependent : bool
        Whether forces change with v and may be evaluated twice a step. Those of a step on free bodies do not: their
        gyroscopic torques are evaluated at the mean velocity of the step.
    controlled : bool
        Whether a control acts.
    loaded : bool
        Whether external forces or a control of the whole scene act.
    observe : callable or None
        observe(contacts) gives the controls a function that returns the contacts of the last accepted step; called
        after each step. None where no control looks at contacts.
    independent_bodies : int
        How many bodies move independently of each other, with equally many velocities each; 1 of a mechanism.
    free_bodies : bool
        Whether all bodies are free: forces on them change with neither q nor t.
    can_hold : bool
        Whether `hold` is implemented, so that bodies can sleep.
    pull : float
        Acceleration of free fall of bodies that can sleep [m/s^2].
    sparse : bool
        Whether `separation_rows` returns sparse rows.
    can_be_sparse : bool
        Whether `sparse` may be set from outside.
    applied : ndarray, shape (nv,), or None
        Generalised force from outside that the system adds to its own; None where it cannot.
    damping : ndarray, shape (nv,), or None
        Coefficients of joint damping that steps treat implicitly; None where there are none.
    has_joint_friction : bool
        Whether joints have dry friction.
    single_mechanism : bool
        Whether the system is one mechanism, which has `kinematics`.
    whole : System or None
        The mechanism that its parts are joined to, where equalities connect them.
    equalities : tuple
        The equalities c(q) = 0 that it has, beside those of its parts.
    model : pinocchio.Model or None
        The model of a mechanism.
    name : str
        Name of a mechanism.

    Notes
    -----
    A system of a user's own class need not derive from this class; see `GivenSystem`.
    """

    nq: int
    nv: int
    bodies: tuple[str, ...] = ("world",)
    velocity_dependent: bool = True
    controlled: bool = False
    loaded: bool = False
    observe: Callable[[Callable[[], tuple[Any, ...]]], None] | None = None
    independent_bodies: int = 1
    free_bodies: bool = False
    can_hold: bool = False
    pull: float = 0.0
    sparse: bool = False
    can_be_sparse: bool = False
    applied: Array | None = None
    damping: Array | None = None
    has_joint_friction: bool = False
    single_mechanism: bool = False
    whole: System | None = None
    equalities: tuple[Any, ...] = ()
    model: pin.Model | None = None
    name: str = ""

    def start(self) -> None:
        """Prepare for a run; called when one starts."""

    def share_closings(self, shared: bool) -> None:
        """Let the next call of `integrate` that closes equalities evaluate M and J_e for those after it, or each."""

    def gaps(self, q: Array) -> Array:
        """Return c(q) of the equalities, of the parts where it has none itself, shape (m,) [m, rad]."""
        parts = [part for part in self.located_parts() if part.system.equalities]
        each = [part.system.gaps(q[part.q : part.q + part.system.nq]) for part in parts]
        return np.concatenate([np.zeros(0), *each])

    def equality_gradients(self, q: Array) -> Array:
        """Return the gradients of the equalities of one mechanism, shape (m, nv)."""
        raise NotImplementedError

    def closed(self, q: Array) -> Array:
        """Return the nearest configuration where the equalities hold, shape (nq,); NaN where none is found."""
        new = q.copy()
        for part in self.located_parts():
            if part.system.equalities:
                here = slice(part.q, part.q + part.system.nq)
                new[here] = part.system.closed(q[here])
        return new

    def tangent(self, q: Array, v: Array) -> Array:
        """Return the velocity nearest to v that keeps the equalities, shape (nv,), at a q where they hold."""
        new = v.copy()
        for part in self.located_parts():
            if part.system.equalities:
                here = slice(part.v, part.v + part.system.nv)
                new[here] = part.system.tangent(q[part.q : part.q + part.system.nq], v[here])
        return new

    def keeping(self, q: Array, metric: Metric) -> Metric:
        """Return the metric M found elsewhere on the velocities that keep the equalities at q."""
        return metric

    def coupled(self) -> list[Array]:
        """Return of each equality between parts the velocities that it couples, shape (k,) of int."""
        return []

    def notes(self) -> list[str]:
        """Return what a run shall note about how the system is computed."""
        return []

    def check(self, t: float, q: Array, v: Array) -> None:
        """Raise `InputError` if functions of the user return something else than they should."""

    def functions(self) -> tuple[Callable[..., Any], ...]:
        """Return the functions of the user that define the system."""
        return ()

    def located_parts(self) -> list[Part]:
        """Return the systems that this one consists of, in the order of q and v; itself where it has no parts."""
        return [Part(self, 0, 0, 0)]

    def kinematics(self, q: Array) -> Kinematics:
        """Return poses and Jacobian of a single mechanism; they are valid until the next configuration."""
        raise NotImplementedError

    def hold(self, held: Array) -> None:
        """Take the weight off some bodies, shape (n,) of bool, and give it back to the others."""
        raise NotImplementedError

    def torque(self, t: float, q: Array, v: Array) -> Array:
        """Return the generalised force of controls and of forces from outside at (t, q, v), shape (nv,) [N, N m]."""
        return np.zeros(self.nv)

    def added_acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration of free bodies by loads from outside, shape (nv,)."""
        return np.zeros(self.nv)

    def are_lengths(self) -> Array:
        """Return which velocities are those of lengths and not of angles, shape (nv,) of bool; unknown ones count."""
        return np.ones(self.nv, bool)

    def go_straight(self) -> Array:
        """Return which velocities move bodies along the same direction of the world for ever, shape (nv,) of bool."""
        return np.zeros(self.nv, bool)

    def unit_groups(self) -> list[Array]:
        """Return the indices in q of unit quaternions and unit vectors, shapes (n, 4) and (n, 2)."""
        return []

    def damping_force(self, q: Array, v: Array) -> Array:
        """Return D v of the damping that steps treat implicitly, shape (nv,) [N, N m]."""
        parts = [part.system for part in self.located_parts()]
        return np.concatenate([np.zeros(part.nv) if part.damping is None else part.damping for part in parts]) * v

    def describe(self) -> str:
        """Return one line for a report."""
        return f"a system of {self.nv} degrees of freedom"

    def integrate(self, q: Array, dv: Array) -> Array:
        """Return q + dv along the retraction, shape (nq,)."""
        raise NotImplementedError

    def difference(self, q0: Array, q1: Array) -> Array:
        """Return the tangent vector, shape (nv,), from q0 to q1."""
        raise NotImplementedError

    def integrate_each(self, q: Array, dv: Array) -> Array:
        """Return `integrate` of several configurations, shape (m, nq)."""
        return np.array([self.integrate(*pair) for pair in zip(q, dv, strict=True)])

    def difference_each(self, q0: Array, q1: Array) -> Array:
        """Return `difference` of several pairs of configurations, shape (m, nv)."""
        return np.array([self.difference(*pair) for pair in zip(q0, q1, strict=True)])

    def metric(self, q: Array) -> Metric:
        """Return M(q), factorised."""
        raise NotImplementedError

    def force(self, t: float, q: Array, v: Array) -> Array:
        """Return g(t, q, v), shape (nv,) [N, N m]."""
        raise NotImplementedError

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        """Return v + h M^-1 g, shape (nv,)."""
        raise NotImplementedError

    def coast(self, v: Array, h: float) -> tuple[Array, Array]:
        """Return how `Centered` moves along v for a time: the tangent vector and the velocity then, shapes (nv,).

        Free bodies move as nothing acts on them, see `coast_spin`; of all others v stays.
        """
        return h * v, v

    def pushed_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        """Return v + h M^-1 g without the gyroscopic torques of free bodies, which `coast` has, shape (nv,)."""
        return self.free_velocity(t, q, v, h)

    def force_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        """Return the velocity after a time h at which forces at (t, q) are evaluated, shape (nv,); v with a control."""
        return self.pushed_velocity(t, q, v, h) if self.velocity_dependent else v

    def centered_motion(self, t: float, q: Array, v: Array, h: float, at: Array) -> FreeMotion | TreeFreeMotion:
        """Return the free motion of v under forces evaluated at the velocity `at`, that of `force_velocity` at h / 2.

        Joint damping acts on v itself, at order 2. Gyroscopic torques of free bodies do not act; see `coast`.
        """
        motion = self.free_motion(t, q, at, h)
        return FreeMotion(motion.free + (v - at), motion.metric)

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion | TreeFreeMotion:
        """Return v + h M^-1 g, shape (nv,), together with M(q); valid until a method is called with another q."""
        raise NotImplementedError

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return M^-1 g, with equalities the nearest one that keeps them, shape (nv,) [m/s^2, rad/s^2]."""
        raise NotImplementedError

    def unheld_acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return M^-1 g, shape (nv,): the acceleration before equalities hold it."""
        return self.acceleration(t, q, v)

    def held_acceleration(self, q: Array, v: Array, free: Array) -> Array:
        """Return the acceleration nearest to a free one that keeps the rates of the equalities zero, shape (nv,)."""
        new = free
        for part in self.located_parts():
            if part.system.equalities:
                here = slice(part.v, part.v + part.system.nv)
                new = new.copy() if new is free else new
                own = part.system.held_acceleration(q[part.q : part.q + part.system.nq], v[here], free[here])
                new[here] = own
        return new

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        """Return the rate of dv, shape (nv,), where `integrate(q, dv)` moves with the velocity v."""
        raise NotImplementedError

    def kinetic_energy(self, q: Array, v: Array) -> float:
        """Return v' M v / 2 [J]."""
        raise NotImplementedError

    def potential_energy(self, t: float, q: Array) -> float:
        """Return the potential energy [J]."""
        raise NotImplementedError

    def placements(self, q: Array, bodies: Array) -> Array:
        """Return the poses of bodies' frames, shape (n, 4, 3): the three columns of the rotation, then the origin [m].

        A point x of the body is at (x, 1) times this matrix.
        """
        raise NotImplementedError

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array | csr_array:
        """Return the gradient of the separation of two bodies at m contact points.

        Parameters
        ----------
        q : ndarray, shape (nq,)
            Configuration.
        first, second : ndarray of int, shape (m,)
            The bodies; 0 where the side belongs to the world or to another system.
        point, normal : ndarray, shape (m, 3)
            Contact points and unit normals from the first to the second body, in the world.

        Returns
        -------
        ndarray or csr_array, shape (m, nv)
            Rows r with r . v = normal . (velocity of second - velocity of first) at the point; sparse if the system's
            attribute `sparse` is true.
        """
        raise NotImplementedError

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        """Return the accelerations of points fixed to bodies at constant v, shape (k, 3), in the world.

        `points`, shape (k, 3), are in the bodies' own frames.
        """
        raise NotImplementedError

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        """Return the largest displacement of points of a ball fixed to a body per velocity, shape (nv,) [m per unit].

        No point of the ball moves by more than `reach @ |dv|` along the retraction by dv. Entries are positive exactly
        for the velocities that move the body.
        """
        raise NotImplementedError


def located_parts(system: System) -> list[Part]:
    """Return the mechanisms, bodies and spheres that a system consists of, with where each begins."""
    return system.located_parts()
