"""Masses, centres of mass and inertias as parameters: M a - g is linear in those of each body about its joint."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.system import Array, Part
from .parameter import Parameter, replaced_bodies, replaced_mechanism

# what names of these parameters begin with
OF_MASS, OF_CENTRE, OF_INERTIA = "mass of ", "centre of mass of ", "inertia of "
# entries of a symmetric matrix in the order of the columns of an inertia, and in that of Pinocchio's parameters
_ENTRIES = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
_PACKED = (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)


class Regressor:
    """Y(q, v, a) of a mechanism, with M a + b(q, v) = Y pi and the ten parameters pi of each link.

    Parameters
    ----------
    system : ArticulatedSystem
        The mechanism.
    """

    def __init__(self, system: ArticulatedSystem) -> None:
        self._model, self._weightless, self._data = system.model, system.model.copy(), system.model.createData()
        self._weightless.gravity = pin.Motion.Zero()
        self._still = np.zeros(system.nv)
        # the last arguments and what was returned, because several links are evaluated one after another
        self._last: tuple[bytes, Array] = b"", np.zeros((0, 0))

    def forces(self, q: Array, v: Array, a: Array) -> Array:
        """Return Y, shape (nv, 10 n)."""
        key = q.tobytes() + v.tobytes() + a.tobytes()
        if self._last[0] != key:
            self._last = key, self._computed(self._model, q, v, a)
        return self._last[1]

    def percussions(self, q: Array, w: Array) -> Array:
        """Return the Y of M w, shape (nv, 10 n)."""
        return self._computed(self._weightless, q, self._still, w)

    def _computed(self, model: pin.Model, q: Array, v: Array, a: Array) -> Array:
        # of one velocity Pinocchio returns a vector
        return np.array(pin.computeJointTorqueRegressor(model, self._data, q, v, a)).reshape(len(v), -1)


class LinkInertia(Parameter):
    """What moves with a joint of a mechanism: its mass, its centre of mass or its inertia about that.

    Parameters
    ----------
    part : Part
        The mechanism.
    joint : int
        The joint.
    kind : str
        `OF_MASS`, `OF_CENTRE` or `OF_INERTIA`.
    length : float
        That of the scene [m].
    regressor : Regressor
        That of the mechanism.
    """

    def __init__(self, part: Part, joint: int, kind: str, length: float, regressor: Regressor) -> None:
        self._part, self._joint, self._kind, self._regressor = part, joint, kind, regressor
        assert part.system.model is not None
        inertia: pin.Inertia = part.system.model.inertias[joint]
        mass, centre = inertia.mass, np.array(inertia.lever)
        if kind == OF_MASS:
            columns, sizes = [_packed(1.0, centre, _about_origin(centre, centre))], [mass]
        elif kind == OF_INERTIA:
            columns = [_packed(0.0, np.zeros(3), _symmetric(*entry)) for entry in _ENTRIES]
            sizes = [mass * length**2] * 6
        else:
            columns = [_packed(0.0, mass * axis, 2.0 * mass * _about_origin(centre, axis)) for axis in np.eye(3)]
            sizes = [length] * 3
        # links without mass have no size of their own
        self._by, self.sizes = np.array(columns).T, np.where(np.array(sizes) > 0.0, sizes, 1.0)
        self._own = slice(10 * joint - 10, 10 * joint)
        self._q, self._v = slice(part.q, part.q + part.system.nq), slice(part.v, part.v + part.system.nv)

    def add_force(self, t: float, q: Array, v: Array, a: Array, out: Array) -> None:
        Y = self._regressor.forces(q[self._q], v[self._v], a[self._v])
        out[self._v] += Y[:, self._own] @ self._by

    def add_percussion(self, q: Array, w: Array, out: Array) -> None:
        out[self._v] += self._regressor.percussions(q[self._q], w[self._v])[:, self._own] @ self._by

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        now = replaced.get(id(self._part.system), self._part.system)
        model = now.model.copy()
        old = model.inertias[self._joint]
        mass, centre, inertia = old.mass, np.array(old.lever), np.array(old.inertia)
        if self._kind == OF_MASS:
            mass += float(change[0])
        elif self._kind == OF_INERTIA:
            inertia += _changes(change)
        else:
            centre += change
        model.inertias[self._joint] = pin.Inertia(mass, centre, inertia)
        replaced[id(self._part.system)] = replaced_mechanism(now, model, now.control)


class BodyInertia(Parameter):
    """The mass of a free body or a sphere, or the inertia of a free body about its centre of mass.

    Parameters
    ----------
    part : Part
        The bodies.
    body : int
        Which of them.
    kind : str
        `OF_MASS` or `OF_INERTIA`.
    """

    def __init__(self, part: Part, body: int, kind: str) -> None:
        self._part, self._body, self._of_mass = part, body, kind == OF_MASS
        own: Any = part.system
        if self._of_mass:
            self.sizes = np.array([float(own.masses[body])])
        else:
            self.sizes = np.full(6, 0.25 * float(np.linalg.eigvalsh(own.inertias[body])[0]))
        # M a - g is linear in each of them, so that differences of this length are exact
        self._varied = [self._with(own, step) for step in np.diag(self.sizes)]
        self._v = slice(part.v, part.v + own.nv)

    def _with(self, now: Any, change: Array) -> Any:
        """Return the bodies with another mass or inertia."""
        masses, inertias = now.masses.copy(), getattr(now, "inertias", None)
        if self._of_mass:
            masses[self._body] += float(change[0])
        else:
            inertias = now.inertias.copy()
            inertias[self._body] += _changes(change)
        return replaced_bodies(now, masses, inertias, now.gravity)

    def add_force(self, t: float, q: Array, v: Array, a: Array, out: Array) -> None:
        # neither M nor g of bodies depends on q
        self._add(out, lambda system: system.metric(q).apply(a[self._v]) - system.force(0.0, q, v[self._v]))

    def add_percussion(self, q: Array, w: Array, out: Array) -> None:
        self._add(out, lambda system: system.metric(q).apply(w[self._v]))

    def _add(self, out: Array, of: Any) -> None:
        here = of(self._part.system)
        for k, (system, size) in enumerate(zip(self._varied, self.sizes, strict=True)):
            out[self._v, k] += (of(system) - here) / size

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        system = self._part.system
        replaced[id(system)] = self._with(replaced.get(id(system), system), change)


def _packed(mass: float, moment: Array, inertia: Array) -> Array:
    """Return ten parameters in Pinocchio's order, from the inertia about the joint."""
    return np.array([mass, *moment, *(inertia[entry] for entry in _PACKED)])


def _about_origin(a: Array, b: Array) -> Array:
    """Return (a . b) 1 - (a b' + b a') / 2."""
    return float(a @ b) * np.eye(3) - 0.5 * (np.outer(a, b) + np.outer(b, a))


def _symmetric(i: int, j: int) -> Array:
    matrix = np.zeros((3, 3))
    matrix[i, j] = matrix[j, i] = 1.0
    return matrix


def _changes(change: Array) -> Array:
    """Return the symmetric matrix of the six columns of an inertia."""
    return sum((x * _symmetric(*entry) for x, entry in zip(change, _ENTRIES, strict=True)), np.zeros((3, 3)))
