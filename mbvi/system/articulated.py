"""One mechanism: a Pinocchio model of joints and links."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from ..errors import InputError
from ..projection import DenseMetric, Metric
from .system import Array

Control = Callable[[float, Array, Array], Array]

# a reach nobody can be sure of; finite, so that it is no NaN times a velocity of zero
_UNBOUNDED = 1e300

# a x b is the first three less the last three of a[left] b[right]
_CROSS_LEFT, _CROSS_RIGHT = np.array([1, 2, 0, 2, 0, 1]), np.array([2, 0, 1, 1, 2, 0])


class ArticulatedSystem:
    """A mechanism of joints, with gravity, joint damping and a control.

    Parameters
    ----------
    model : pinocchio.Model
        The mechanism; gravity, armature and damping are read from it. It is not written to.
    name : str
        Prefix of the body names.
    control : callable, optional
        control(t, q, v) -> tau, shape (nv,) [N, N m], of this mechanism's own q and v.

    Notes
    -----
    g(t, q, v) = tau - nle(q, v) - D v. Dry joint friction, effort and velocity limits are not modelled. Where D is
    not zero the step to the free velocity is implicit in D v, for explicit damping of light links is unstable at any
    common step; with D = 0 it is (11) to the letter.
    """

    def __init__(self, model: pin.Model, name: str = "robot", control: Control | None = None) -> None:
        self.model = model
        self.control = control
        self.nq, self.nv = int(model.nq), int(model.nv)
        self.bodies = ("world", *(f"{name}/{joint}" for joint in list(model.names)[1:]))
        self.damping = np.array(model.damping, dtype=float)
        self._damped = bool(self.damping.any())
        self._zero = np.zeros(self.nv)
        self._data = model.createData()
        self._energy_data = model.createData()
        self._key: bytes | None = None
        self._mass = np.zeros((self.nv, self.nv))
        self._metric: DenseMetric | None = None
        # arrays onto Pinocchio's own, through its getters: as long as the data and the poses live, they follow them
        self._poses = list(self._data.oMi)
        self._rotations = [pose.rotation for pose in self._poses]
        self._origins = [pose.translation for pose in self._poses]
        # one degree of freedom comes as a vector
        self._columns = self._data.J.reshape(6, self.nv)
        self._support = np.zeros((model.njoints, self.nv))
        for joint in range(1, model.njoints):
            for ancestor in list(model.supports[joint])[1:]:
                first = model.idx_vs[ancestor]
                self._support[joint, first : first + model.nvs[ancestor]] = 1.0

    def integrate(self, q: Array, dv: Array) -> Array:
        return pin.integrate(self.model, q, dv)

    def difference(self, q0: Array, q1: Array) -> Array:
        return pin.difference(self.model, q0, q1)

    def _refresh(self, q: Array) -> None:
        """Bring placements, Jacobian columns and mass matrix to q, once per q."""
        key = q.tobytes()
        if key != self._key:
            # in the world convention crba fills data.J and data.oMi on its way
            self._mass = pin.crba(self.model, self._data, q, pin.Convention.WORLD)
            self._metric = None
            self._key = key

    def metric(self, q: Array) -> DenseMetric:
        self._refresh(q)
        if self._metric is None:
            self._metric = DenseMetric(self._mass)
        return self._metric

    def _torque(self, t: float, q: Array, v: Array) -> Array:
        if self.control is None:
            return self._zero
        tau = np.asarray(self.control(t, q, v), dtype=float)
        if tau.shape != (self.nv,):
            raise InputError(f"control returned shape {tau.shape}; this robot asks for ({self.nv},)")
        return tau

    def force(self, t: float, q: Array, v: Array) -> Array:
        g = self._torque(t, q, v) - pin.nonLinearEffects(self.model, self._data, q, v)
        return g - self.damping * v if self._damped else g

    def free_velocity(self, t: float, q: Array, v: Array, h: float, metric: Metric | None = None) -> Array:
        if not self._damped and metric is None:
            if q.tobytes() != self._key:
                self._key = None
            return v + h * pin.aba(self.model, self._data, q, v, self._torque(t, q, v))
        if self._damped:
            self._refresh(q)
            mass = self._mass.copy()
            mass[np.diag_indices(self.nv)] += h * self.damping
            return v + lapack.dposv(mass, h * self.force(t, q, v), 0)[1]
        assert metric is not None
        return v + metric.unwhiten(metric.whiten(h * self.force(t, q, v)))

    def kinetic_energy(self, q: Array, v: Array) -> float:
        return float(pin.computeKineticEnergy(self.model, self._energy_data, q, v))

    def potential_energy(self, t: float, q: Array) -> float:
        return float(pin.computePotentialEnergy(self.model, self._energy_data, q))

    def placements(self, q: Array, bodies: Sequence[int]) -> tuple[Array, Array]:
        self._refresh(q)
        return np.array([self._rotations[b] for b in bodies]), np.array([self._origins[b] for b in bodies])

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array:
        self._refresh(q)
        wrench = np.empty((len(point), 6))
        wrench[:, :3] = normal
        # point x normal
        terms = point.take(_CROSS_LEFT, 1)
        terms *= normal.take(_CROSS_RIGHT, 1)
        np.subtract(terms[:, :3], terms[:, 3:], out=wrench[:, 3:])
        rows = wrench.dot(self._columns)
        moved = self._support.take(second, 0)
        if np.count_nonzero(first):
            moved -= self._support.take(first, 0)
        rows *= moved
        return rows

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        reach = np.zeros(self.nv)
        distance = radius + float(np.linalg.norm(centre))
        for joint in reversed(list(self.model.supports[body])[1:]):
            first, width = self.model.idx_vs[joint], self.model.nvs[joint]
            reach[first : first + width], travel = self._joint_reach(joint, distance)
            distance += travel + float(np.linalg.norm(self.model.jointPlacements[joint].translation))
        return np.minimum(reach, _UNBOUNDED)

    def _joint_reach(self, joint: int, distance: float) -> tuple[Array, float]:
        """Return the reach of one joint's velocities and how far its own travel moves its frame's origin."""
        kind = self.model.joints[joint].shortname()
        width = self.model.nvs[joint]
        if "FreeFlyer" in kind:
            return np.array([1.0] * 3 + [distance] * 3), 0.0
        if "JointModelR" in kind or "Spherical" in kind:
            return np.full(width, distance), 0.0
        if "JointModelP" in kind and width == 1:
            first = self.model.idx_qs[joint]
            limits = np.abs([self.model.lowerPositionLimit[first], self.model.upperPositionLimit[first]])
            # a tenth for what a step may penetrate the limit by
            return np.ones(1), 1.1 * float(limits.max()) if limits.max() < 1e10 else _UNBOUNDED
        return np.full(width, _UNBOUNDED), 0.0
