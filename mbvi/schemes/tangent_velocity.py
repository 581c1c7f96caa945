"""Velocities at the end of a step of `Centered` that keep the equalities there.

The law of the step acts in its middle, where the mean of both velocities keeps the equalities. A jump of the velocity
then leaves a component normal to the manifold of the equalities, and each later step reverses its sign. Mechanisms that
lose energy in a step have their velocity projected at its end. For others the step stays symmetric, and keeps energy.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel, plain_array
from ..projection import FreeMotion, TreeFreeMotion
from ..projection.tree import factor, tangent
from ..projection.tree_factor import keep_equalities
from ..system import HingedSystem, System, independent_parts, located_parts
from ..system.free.sparse_rows import dense
from ..system.mechanisms.loop_margin import with_equalities
from ..system.mechanisms.mechanism import weigh
from ..system.system import Array
from .kernels.records import MechanismStep
from .step import Step


def along_equalities(motion: FreeMotion | TreeFreeMotion, v: Array) -> tuple[FreeMotion, Array, Array]:
    """Return the parts of a free motion and of v that keep the equalities, and what the free motion has beside it.

    The law is one on velocities that keep the equalities. In the middle of a step of `Centered` only the mean of both
    velocities keeps them; where a contact and the equalities hold a body against each other, the rest of each, of
    order h, would decide its percussions.
    """
    metric, free = motion.metric, motion.free
    kept = tangent(metric, free)
    return FreeMotion(kept, metric), tangent(metric, v), free - kept


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
    loses, some = np.zeros(len(part), np.bool_), False
    for k in range(len(part)):
        if damping[k] > 0.0 or friction[k] > 0.0:
            loses[part[k]] = True
    for a in range(len(e)):
        if percussion[a] > 0.0 and (e[a] < 1.0 or mu[a] > 0.0):
            for k in range(len(part)):
                if J[a, k] != 0.0:
                    loses[part[k]] = True
    for k in range(len(part)):
        marked[k] = loses[part[k]]
        some = some or marked[k]
    return some


@kernel("b1(MechanismStep, i8)")
def make_tangent(s: MechanismStep, count: int) -> bool:
    """Project `s.v` onto the velocities that keep the equalities at `s.q`; False where M has no factor.

    Only mechanisms that lose energy are projected. `count` is how many rows the law had.
    """
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
    for k in range(len(s.scales.part)):
        if marked[k]:
            s.v[k] = kept[k]
    return True


def with_tangent_velocity(system: System, step: Step, motion: FreeMotion | TreeFreeMotion) -> Step:
    """Return the step with the velocities of mechanisms that lose energy projected, as `make_tangent` does.

    `motion` is its free motion, for the dry friction of joints.
    """
    if not with_equalities(system):
        return step
    parts = [part.system for part in located_parts(system)]
    rows, nothing, marked = step.active, np.zeros(system.nv), np.empty(system.nv, bool)
    damping = np.concatenate([np.zeros(part.nv) if part.damping is None else part.damping for part in parts])
    friction = nothing if motion.friction is None else motion.friction[: system.nv]
    if isinstance(system, HingedSystem):
        damping += system.losing
    mu = np.zeros(len(rows.gap)) if rows.tangents is None else rows.tangents.friction
    lost = plain_array(damping), plain_array(friction)
    acted = plain_array(dense(rows.jacobian)), plain_array(rows.restitution), plain_array(mu)
    if not mark_dissipating(independent_parts(system), *lost, *acted, plain_array(step.percussion), marked):
        return step
    return step._replace(v=np.where(marked, system.tangent(step.q, step.v), step.v))
