"""Velocities at the end of a step of `Centered`: with closed loops they are tangent to what the loops allow.

The law of the step acts in its middle, where the mean of both velocities keeps the equalities. A jump of the velocity
then leaves a part at the end that no motion has, and that the next steps reverse again and again. It is taken away from
parts that lose energy in the step. Where nothing does, the step is symmetric and creates no such part.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel, plain_array
from ..projection import FreeMotion, TreeFreeMotion
from ..projection.tree import factor
from ..projection.tree_factor import keep_equalities
from ..system import System, independent_parts, located_parts
from ..system.free.sparse_rows import dense
from ..system.mechanisms.mechanism import weigh
from ..system.system import Array
from .kernels.records import MechanismStep
from .step import Step


@kernel("b1(i8[::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], b1[::1])")
def mark_dissipating(
    part: Array, damping: Array, friction: Array, J: Array, e: Array, mu: Array, percussion: Array, marked: Array
) -> bool:
    """Mark the velocities of parts that lose energy in a step, shape (nv,); return whether there are any.

    Parameters
    ----------
    part : ndarray of int, shape (nv,)
        See `independent_parts`.
    damping, friction : ndarray, shape (nv,)
        Damping of joints, and their dry friction.
    J : ndarray, shape (k, nv)
        Gradients of gaps.
    e, mu, percussion : ndarray, shape (k,)
        Restitution, friction and percussions.
    marked : ndarray of bool, shape (nv,)
        Receives which velocities they are.
    """
    n, some = len(part), False
    for k in range(n):
        marked[k] = damping[k] > 0.0 or friction[k] > 0.0
        some = some or marked[k]
    for a in range(len(e)):
        if percussion[a] > 0.0 and (e[a] < 1.0 or mu[a] > 0.0):
            for k in range(n):
                if J[a, k] != 0.0:
                    marked[k] = some = True
    for k in range(n if some else 0):
        for i in range(n):
            marked[k] = marked[k] or (marked[i] and part[i] == part[k])
    return some


@kernel("b1(MechanismStep, i8)")
def make_tangent(s: MechanismStep, count: int) -> bool:
    """Take away from `s.v` the part that no motion at `s.q` has; False where M has no factor. `count` rows acted."""
    m, n = s.mechanism, len(s.v)
    if len(m.equalities.gap) == 0:
        return True
    marked, kept = np.empty(n, np.bool_), np.empty(n)
    acted = s.scales.part, m.damping, m.friction, s.rows.J[:count], s.rows.e[:count], s.rows.mu[:count]
    if not mark_dissipating(*acted, s.rates[:count], marked):
        return True
    weigh(m, s.q)
    if factor(m.mass, 0.0, m.damping, m.parent, s.room.L):
        return False
    for k in range(n):
        kept[k] = s.v[k]
    keep_equalities(s.room.L, m.parent, kept)
    for k in range(n):
        if marked[k]:
            s.v[k] = kept[k]
    return True


def with_tangent_velocity(system: System, step: Step, motion: FreeMotion | TreeFreeMotion) -> Step:
    """Return the step without the part of its velocity that no motion at its end has.

    `motion` is its free motion, for the dry friction of joints.
    """
    parts = located_parts(system)
    if not system.equalities and not any(part.system.equalities for part in parts):
        return step
    nv, rows = system.nv, step.active
    nothing, k = np.zeros(nv), len(rows.gap)
    damping = [np.zeros(one.nv) if one.damping is None else one.damping for one in (part.system for part in parts)]
    friction = nothing if motion.friction is None else motion.friction
    mu = np.zeros(k) if rows.tangents is None else rows.tangents.friction
    acted = plain_array(dense(rows.jacobian)), plain_array(rows.restitution), plain_array(mu)
    marked = np.empty(nv, bool)
    percussion = plain_array(step.percussion) if k else np.zeros(0)
    part = independent_parts(system)
    if not mark_dissipating(part, np.concatenate(damping), plain_array(friction), *acted, percussion, marked):
        return step
    return step._replace(v=np.where(marked, system.tangent(step.q, step.v), step.v))
