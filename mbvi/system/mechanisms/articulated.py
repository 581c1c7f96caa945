"""The system of one mechanism: a Pinocchio model of joints and links with damping and a control."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from ...arguments import all_finite, returned
from ...compiled import held, plain_array
from ...errors import InputError, ProjectionError
from ...projection import Metric, TreeFreeMotion, TreeMetric, in_flight
from ...projection.tree import damp_slowed
from ...projection.tree_factor import least_change
from ..actuators import Actuators, DrivenActuators
from ..controls import LoopControl
from ..free.coasting import coast
from ..free.spinning import free_links, remove_spin_effects, spin_effects
from ..given import not_finite
from ..joint_forces import JointForce, add_row_forces, force_rows, spring_energy
from ..system import Array, Kinematics, System
from .by_address.pinocchio_check import reason_for_bindings
from .coordinates import lengths, reach, straight_velocities, uncounted_armature, unit_groups
from .equalities import EACH_ITS_OWN, FIRST_FINDS, Equality, PointRows
from .evaluation import Evaluation
from .mechanism import Mechanism, close, dry_friction, mechanism
from .separation import separation

Control = Callable[[float, Array, Array], Array]


@cache
def _no_data() -> pin.Data:
    return pin.Model().createData()


class ArticulatedSystem(System):
    """A mechanism of joints, with gravity, joint damping and a control.

    Parameters
    ----------
    model : pinocchio.Model
        The mechanism with its gravity, armature and damping. It is not changed.
    name : str
        Prefix of the body names.
    control : callable, optional
        control(t, q, v) -> tau, shape (nv,) [N, N m], of this mechanism's own q and v.
    equalities : sequence of PointRows or CoupledJoints
        c(q) = 0: closed loops and coupled joints. `metric` is then M on the velocities with J_e v = 0, free motions
        keep them, and the retraction returns to c(q) = 0 by least displacements.
    springs : sequence of JointForce
        Springs of the mechanism, which act beside the control.

    Notes
    -----
    g(t, q, v) = tau - nle(q, v) - D v; the springs are in tau. Dry friction of joints, `upperDryFrictionLimit` of the
    model, is part of the impact law: see `in_flight`. Effort and velocity limits are not modelled. Where D is not zero
    the step to the free velocity is implicit in D v, because explicit damping of light links is unstable at any usual
    step; with D = 0 it is (11) exactly. `Centered` takes D at order 2; see `advance_by`.
    """

    single_mechanism = True

    def __init__(
        self, model: pin.Model, name: str = "robot", control: Control | None = None,
        equalities: Sequence[Equality] = (), springs: Sequence[JointForce] = (),
    ) -> None:  # fmt: skip
        self.model: pin.Model = model
        self.equalities, self.springs = tuple(equalities), tuple(springs)
        self.spring_rows = force_rows(self.springs, model)
        self.name = name
        self.nq, self.nv = int(model.nq), int(model.nv)
        # free bodies among the links
        self._free = free_links(model)
        self._spins = len(self._free.first) > 0
        self.set_control(control)
        self.bodies = ("world", *(f"{name}/{joint}" for joint in list(model.names)[1:]))
        self.damping: Array = np.array(model.damping, dtype=float)
        self._damped = bool(self.damping.any())
        self.friction: Array = dry_friction(model)
        self.has_joint_friction = bool(self.friction.any())
        self._uncounted = uncounted_armature(model)
        self._zero = np.zeros(self.nv)
        # generalised force from outside the mechanism, added to the torque of the control
        self.applied: Array = self._zero
        # whether the retraction is q + dv, up to multiples of 2 pi
        self._flat = all(joint.nv == 1 for joint in list(model.joints)[1:])
        # number of leading velocities for which it is not; joints are independent of each other
        self._curved = max((j.idx_v + j.nv for j in list(model.joints)[1:] if j.nv > 1), default=0)
        self.evaluation = Evaluation(model, self.equalities)

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        # a copy makes its own Data, because the arrays kept here lie in the memory of this one
        return type(self), (self.model, self.name, self.control, self.equalities, self.springs)

    def integrate(self, q: Array, dv: Array) -> Array:
        new = pin.integrate(self.model, q, dv)
        if self.equalities:
            close(self._closing, new)
            if not all_finite(new):
                raise ProjectionError(
                    f"{self.widest_open(pin.integrate(self.model, q, dv))} cannot be closed after this step: it is too "
                    "long, or a loop passes a dead centre",
                    {},
                )
        # read-only, so that results computed for this array remain valid
        new.setflags(False)
        self.evaluation.latest = new
        return new

    def share_closings(self, shared: bool) -> None:
        if self.equalities:
            self._closing.equalities.shared[0] = FIRST_FINDS if shared else EACH_ITS_OWN

    def difference(self, q0: Array, q1: Array) -> Array:
        return pin.difference(self.model, q0, q1)

    def set_control(self, control: Control | None) -> None:
        """Replace the control."""
        if isinstance(control, LoopControl | DrivenActuators):
            control = control.fitted(self.model, self.name)
        self.control, self.controlled = control, control is not None
        # a control is called once in each step; torques of free bodies do not change with v
        self.velocity_dependent = control is None and 6 * len(self._free.first) < self.nv

    def notes(self) -> list[str]:
        reason = reason_for_bindings()
        return [] if reason is None else [f"Pinocchio was called through its Python bindings: {reason}"]

    def mechanism(self) -> Mechanism | None:
        """Return a record with results of its own, or None where Pinocchio cannot be called by address."""
        if reason_for_bindings() is not None:
            return None
        # kernels that know every joint ask Pinocchio for nothing that it computes into its data
        at = self.evaluation
        data = _no_data() if at.known else self.model.createData()
        return mechanism(self.model, data, at.support, at.tree, self._free, self.equalities)

    @cached_property
    def _closing(self) -> Mechanism:
        """What closes the equalities."""
        made = self.mechanism()
        if made is None:
            raise InputError(f"loops and coupled joints need Pinocchio called by address: {reason_for_bindings()}")
        return held(made)

    def gaps(self, q: Array) -> Array:
        return self.evaluation.gaps(q)

    def equality_names(self) -> list[str]:
        """Return the connection or coupling of each equality: points first, as in `Equalities`."""
        points = [one for one in self.equalities if isinstance(one, PointRows)]
        joints = [one.name for one in self.equalities if not isinstance(one, PointRows)]
        return [one.name for one in points for _ in one.normals] + joints

    def widest_open(self, q: Array) -> str:
        """Return the connection or coupling whose equality is farthest from zero at q."""
        # written so that a NaN is the farthest
        return self.equality_names()[int(np.nan_to_num(np.abs(self.gaps(q)), nan=np.inf).argmax())]

    def equality_gradients(self, q: Array) -> Array:
        self.evaluation.at(q)
        return self.evaluation.mass[self.nv :].copy()

    def closed(self, q: Array) -> Array:
        new = np.array(q, dtype=float)
        if self.equalities:
            close(self._closing, new)
        return new

    def tangent(self, q: Array, v: Array) -> Array:
        return self.metric(q).tangent(v) if self.equalities else v.copy()

    def keeping(self, q: Array, metric: Metric) -> Metric:
        if not (self.equalities and isinstance(metric, TreeMetric)):
            return metric
        return metric.keeping(self.equality_gradients(q))

    def metric(self, q: Array) -> TreeMetric:
        return self.evaluation.metric(q)

    def torque(self, t: float, q: Array, v: Array) -> Array:
        tau = self._zero if self.control is None else self._checked(t, q, v)
        if self.springs:
            tau = tau.copy()
            add_row_forces(self.spring_rows, 0, plain_array(q), plain_array(v), tau)
        return tau if self.applied is self._zero else tau + self.applied

    def _checked(self, t: float, q: Array, v: Array) -> Array:
        """Return the torque of the control."""
        assert self.control is not None
        tau = self.control(t, q, v)
        if type(tau) is not np.ndarray or not tau.flags.carray or tau.dtype != np.float64:
            tau = plain_array(returned(tau, f"the control of {self.name}"))
        if tau.shape != (self.nv,):
            raise InputError(f"the control returned shape {tau.shape} at t = {t:.6g} s; {self.name} has ({self.nv},)")
        if not all_finite(tau):
            raise not_finite(f"the control of {self.name}", tau, t, q, v)
        return tau

    def force(self, t: float, q: Array, v: Array) -> Array:
        torque = self.torque(t, q, v)
        g = torque - self.evaluation.effects(q, v)
        return g - self.damping * v if self._damped else g

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return in_flight(self.free_motion(t, q, v, h))

    def coast(self, v: Array, h: float) -> tuple[Array, Array]:
        if not self._spins:
            return h * v, v
        displacement, after = np.empty(self.nv), np.empty(self.nv)
        coast(self._free, h, plain_array(v), displacement, after)
        return displacement, after

    def pushed_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return in_flight(self.pushed_motion(t, q, v, h))

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> TreeFreeMotion:
        return self._free_motion(t, q, v, h, v, False, True)

    def pushed_motion(self, t: float, q: Array, v: Array, h: float) -> TreeFreeMotion:
        """Return the free motion without the gyroscopic torques of free bodies, which `coast` has."""
        return self._free_motion(t, q, v, h, v, False, False)

    def centered_motion(self, t: float, q: Array, v: Array, h: float, at: Array) -> TreeFreeMotion:
        damping = None
        if self._damped and self.has_joint_friction and self.velocity_dependent:
            damping = np.empty(self.nv)
            damp_slowed(self.damping, self.pushed_motion(t, q, v, 0.5 * h).free, plain_array(at), damping)
        return self._free_motion(t, q, v, h, at, True, False, damping)

    def _free_motion(
        self, t: float, q: Array, v: Array, h: float, at: Array, twice: bool, spins: bool,
        damping: Array | None = None,
    ) -> TreeFreeMotion:  # fmt: skip
        """Return the free motion of v under forces at a velocity.

        `twice` is that of `advance_by`, and `spins` is whether gyroscopic torques of free bodies act. `damping` is that
        of the joints unless given.
        """
        torque = self.torque(t, q, at)
        effects = self.evaluation.effects(q, at)
        if not v.flags.carray:
            v = plain_array(v)
        if self._spins and spins:
            spin_effects(self._free, v, plain_array(at), h, plain_array(torque), effects)
        elif self._spins:
            remove_spin_effects(self._free, plain_array(at), effects)
        # the control may have evaluated the mechanism at another q
        self.evaluation.at(q)
        return TreeFreeMotion(
            self.evaluation.mass.copy(), self.damping if damping is None else damping, self.evaluation.parent, v, h,
            torque, effects, twice, self.friction if self.has_joint_friction else None,
        )  # fmt: skip

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        free = self.unheld_acceleration(t, q, v)
        return self.held_acceleration(q, v, free) if self.equalities else free

    def unheld_acceleration(self, t: float, q: Array, v: Array) -> Array:
        torque = self.torque(t, q, v)
        if self._damped:
            torque = torque - self.damping * v
        return pin.aba(self.model, self.evaluation.data, q, v, torque)

    def held_acceleration(self, q: Array, v: Array, free: Array) -> Array:
        if not self.equalities:
            return free
        metric, change = self.metric(q), np.empty(self.nv)
        e, rate = self.evaluation.closed, self.evaluation.mass[self.nv :] @ free
        m = len(e.normals)
        if m:
            # n . (acceleration of the second point less that of the first) at constant v
            points = plain_array(e.points[:, :3]), plain_array(e.points[:, 3:])
            sides = [self.point_bias(q, v, e.bodies[:, k].copy(), points[k]) for k in (0, 1)]
            turned = np.einsum("icr,ic->ir", self.kinematics(q).poses[e.bodies[:, 0], :3], e.normals)
            rate[:m] += ((sides[1] - sides[0]) * turned).sum(axis=1)
        least_change(metric.lower, self.evaluation.parent, metric.triangle, rate, change)
        return free + change

    def supported(self, bodies: Sequence[int]) -> Array:
        """Return which velocities move some of the bodies, shape (nv,) of bool."""
        moved: Array = self.evaluation.support[list(bodies)].max(axis=0) > 0.0
        return moved

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        if self._flat:
            return v
        derivative, n = pin.dIntegrate(self.model, q, dv, pin.ARG1), self._curved
        rate = v.copy()
        rate[:n] = lapack.dgesv(derivative[:n, :n], v[:n])[2]
        return rate

    def kinetic_energy(self, q: Array, v: Array) -> float:
        counted = float(pin.computeKineticEnergy(self.model, self.evaluation.other_data, q, v))
        return counted + 0.5 * float(self._uncounted @ (v * v))

    def potential_energy(self, t: float, q: Array) -> float:
        weight = float(pin.computePotentialEnergy(self.model, self.evaluation.other_data, q))
        return weight + spring_energy(self.spring_rows, q) if self.springs else weight

    def placements(self, q: Array, bodies: Array) -> Array:
        return self.evaluation.at(q).poses.take(bodies, 0)

    def kinematics(self, q: Array) -> Kinematics:
        return self.evaluation.at(q)

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array:
        _, columns, support = self.evaluation.at(q)
        rows = np.empty((len(point), self.nv))
        separation(columns, support, first, second, point, normal, rows)
        return rows

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        return self.evaluation.point_bias(q, v, bodies, points)

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        return reach(self.model, body, centre, radius)

    def are_lengths(self) -> Array:
        return self._lengths.copy()

    @cached_property
    def _lengths(self) -> Array:
        return lengths(self.model)

    def go_straight(self) -> Array:
        return self._straight.copy()

    @cached_property
    def _straight(self) -> Array:
        return straight_velocities(self.model)

    def unit_groups(self) -> list[Array]:
        return unit_groups(self.model)

    def describe(self) -> str:
        model = self.model
        base = {6: "free", 3: "planar"}.get(model.nvs[1], "fixed")
        joints = model.njoints - 1 - (base != "fixed")
        mass = sum(i.mass for i in list(model.inertias)[1:])
        acting = f", {len(self.springs)} springs" if self.springs else ""
        if isinstance(self.control, Actuators | DrivenActuators):
            acting += f", actuators {', '.join(self.control.names)}"
        return f"{self.name}: {base} base, {joints} joints, {self.nv} degrees of freedom, {mass:.4g} kg moving{acting}"
