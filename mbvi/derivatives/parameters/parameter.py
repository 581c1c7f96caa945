"""What each parameter of a problem knows, and systems with other masses, torques and gravity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from ...system.free.bodies import FreeBodies, Spheres
from ...system.free.planar import PlanarBodies, PlanarSpheres
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.system import Array, System

# what the size of a torque and of gravity accelerates by [lengths of the scene, or radians, per s^2]
ACCELERATION = 10.0


class Parameter:
    """A parameter p of a problem, of one column or more.

    Attributes
    ----------
    sizes : ndarray, shape (k,)
        A variation of each column that is neither large nor small; positive.
    gaps : ndarray, shape (m, k), or float
        The derivatives of the gaps of all constraints by p; their gradients do not depend on p.
    frictions : ndarray, shape (m, k), or float
        The derivatives of the coefficients of friction of all constraints by p.
    hides_control : bool
        Whether `vary` puts another control in front of that of a robot, so that it must be varied last.
    """

    sizes: Array
    gaps: Array | float = 0.0
    frictions: Array | float = 0.0
    hides_control = False

    def add_force(self, t: float, q: Array, v: Array, a: Array, out: Array) -> None:
        """Add the derivatives of M a - g at constant (t, q, v, a) by p to `out`, shape (nv, k)."""

    def add_percussion(self, q: Array, w: Array, out: Array) -> None:
        """Add the derivatives of M w at constant (q, w) by p to `out`, shape (nv, k)."""

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        """Put the objects that have another p, by the identity of those in whose place they are."""
        raise NotImplementedError


def replaced_mechanism(system: ArticulatedSystem, model: pin.Model, control: Any) -> ArticulatedSystem:
    """Return a mechanism like a given one, with another model and control."""
    return type(system)(model, system.name, control, system.equalities, system.springs)


def replaced_bodies(system: System, masses: Array, inertias: Array | None, gravity: Array) -> System:
    """Return free bodies or spheres like the given ones, with other numbers."""
    names, new = system.bodies[1:], System()
    if isinstance(system, PlanarBodies):
        assert inertias is not None
        new = PlanarBodies(masses, inertias, gravity, names, system.axes, system.normals)
    elif isinstance(system, FreeBodies):
        assert inertias is not None
        new = FreeBodies(masses, inertias, gravity, names)
    elif isinstance(system, PlanarSpheres):
        new = PlanarSpheres(masses, gravity, names, system.axes)
    else:
        new = Spheres(masses, gravity, names)
    new.sparse = system.sparse
    return new


def with_gravity(system: Any, change: Array) -> System:
    """Return a mechanism, bodies or spheres with another gravity."""
    if isinstance(system, ArticulatedSystem):
        model = system.model.copy()
        model.gravity = pin.Motion(model.gravity.linear + change, np.zeros(3))
        return replaced_mechanism(system, model, system.control)
    return replaced_bodies(system, system.masses, getattr(system, "inertias", None), system.gravity + change)


def gravitation(system: Any) -> Callable[[Array], Array]:
    """Return a function of q that returns the generalised weights in a unit gravity along x, y, z, shape (nv, 3)."""
    if isinstance(system, ArticulatedSystem):
        models, data = [], system.model.createData()
        for axis in np.eye(3):
            model = system.model.copy()
            model.gravity = pin.Motion(axis, np.zeros(3))
            models.append(model)
        return lambda q: -np.stack([pin.computeGeneralizedGravity(m, data, q) for m in models], axis=1)
    still, unmoved = np.zeros(system.nq), np.zeros(system.nv)
    # linear in gravity, so that any difference is exact
    both = [with_gravity(system, axis - system.gravity).force(0.0, still, unmoved) for axis in np.eye(3)]
    weights = np.stack(both, axis=1)
    return lambda q: weights
