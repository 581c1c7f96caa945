"""Poses, Jacobian columns, mass matrix and nonlinear effects of a mechanism, computed once for each configuration."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from ...compiled import held, plain_array
from ...projection import TreeMetric
from ..system import Array, Kinematics
from .by_address.memory import read_results
from .coordinates import carriers, supports
from .equalities import Equality, equalities_of, write_gaps, write_rows
from .joint_tree import JointTree, joint_tree, place_joints, weigh_joints, write_effects
from .separation import write_bias

_WORLD = pin.Convention.WORLD


class Evaluation:
    """What a model has at a configuration; arrays are overwritten at the next one.

    Parameters
    ----------
    model : pinocchio.Model
        The mechanism.
    equalities : sequence of PointRows or CoupledJoints
        Its closed loops and coupled joints.

    Attributes
    ----------
    tree : JointTree
        Its joints; empty where one is of a kind that kernels do not know.
    known : bool
        Whether kernels know every joint, else Pinocchio computes.
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one.
    support : ndarray, shape (njoints, nv)
        1 where a velocity moves a body, else 0.
    mass : ndarray, shape (nv + m, nv)
        M in the lower triangle, then J_e: the gradients of the equalities.
    closed : Equalities
        The equalities, for kernels.
    latest : ndarray or None
        The last configuration that was returned read-only: what is computed for it stays valid.
    """

    def __init__(self, model: pin.Model, equalities: Sequence[Equality]) -> None:
        self._model, nv = model, int(model.nv)
        self.parent, self.support = carriers(model), supports(model)
        tree = self.tree = joint_tree(model, self.parent)
        self.known = len(tree.kind) > 0
        poses, columns, self.mass = (
            (tree.poses, tree.columns, tree.mass) if self.known else read_results(model, self.data)
        )
        self.closed = equalities_of(tuple(equalities), int(model.nq), nv)
        if equalities:
            self.mass = np.zeros(self.closed.L.shape)
            self.tree = tree._replace(mass=self.mass[:nv]) if self.known else tree
        self._any_equalities = bool(equalities)
        self._kinematics = Kinematics(poses, columns, self.support)
        # the configuration: its bytes and, if the array is read-only, the array itself
        self._key: bytes | None = None
        self._current: Array | None = None
        self.latest: Array | None = None
        self._metric: TreeMetric | None = None

    # made where Pinocchio computes: of many bodies this takes seconds
    @cached_property
    def data(self) -> pin.Data:
        """Pinocchio's results at the configuration."""
        return self._model.createData()

    @cached_property
    def other_data(self) -> pin.Data:
        """Pinocchio's results that do not belong to it."""
        return self._model.createData()

    @cached_property
    def _held(self) -> JointTree:
        return held(self.tree)

    def at(self, q: Array) -> Kinematics:
        """Compute what depends on q, once for each q, and return poses and Jacobian columns."""
        if q is self._current:
            return self._kinematics
        key = q.tobytes()
        if key != self._key:
            if self.known:
                place_joints(self._held, plain_array(q))
                weigh_joints(self._held)
            else:
                # in the world convention crba also fills data.J and data.oMi
                pin.crba(self._model, self.data, q, _WORLD)
                nv, read = self._model.nv, read_results(self._model, self.data)
                for array, found in zip((*self._kinematics[:2], self.mass[:nv]), read, strict=True):
                    array[:] = found
            if self._any_equalities:
                write_rows(self.closed, *self._kinematics, self.mass)
            self._metric, self._key = None, key
        self._current = q if q is self.latest or not q.flags.writeable else None
        return self._kinematics

    def effects(self, q: Array, v: Array) -> Array:
        """Return the nonlinear effects at q and v, shape (nv,)."""
        if not self.known:
            return pin.nonLinearEffects(self._model, self.data, q, v)
        self.at(q)
        write_effects(self._held, plain_array(v))
        return self.tree.effects.copy()

    def metric(self, q: Array) -> TreeMetric:
        """Return M(q) on the velocities that keep the equalities."""
        self.at(q)
        if self._metric is None:
            self._metric = TreeMetric(self.mass, self.parent)
        return self._metric

    def gaps(self, q: Array) -> Array:
        """Return c(q) of the equalities, shape (m,)."""
        write_gaps(self.closed, self.at(q).poses, plain_array(q))
        return self.closed.gap.copy()

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        """Return the accelerations of points of bodies at constant v; see `System.point_bias`."""
        data = self.other_data
        pin.forwardKinematics(self._model, data, q, v, np.zeros(self._model.nv))
        moving = bodies.tolist()
        twists = np.array([data.v[body].vector for body in moving])
        rates = np.array([data.a[body].vector for body in moving])
        bias = np.empty((len(points), 3))
        write_bias(self.at(q).poses, bodies, points, twists, rates, bias)
        return bias
