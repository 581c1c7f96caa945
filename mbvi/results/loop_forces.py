"""Forces of connections and couplings, from the balance of percussions of each step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..arguments import printable, shown
from ..errors import InputError
from ..schemes import Centered
from ..schemes.step import Step
from ..system import ArticulatedSystem, ConnectedSystem, HingedSystem, System, with_parts
from ..system.mechanisms.equalities import Equality, PointRows
from .diagnosis.diagnose import State, states
from .run_data import Array, RunData, legs


class Place(NamedTuple):
    """An equality: what it belongs to, where that begins in q and v, and where its rows begin there."""

    system: System
    q: int
    v: int
    begin: int
    equality: Equality


def loop_forces(run: RunData, name: str) -> Array:
    """Return the forces of a connection or a coupling; see `Trajectory.loop_forces`."""
    if run.problem is None:
        raise InputError("this file holds no problem, whose loops could be asked")
    if run.step <= 0.0:
        raise InputError(
            f"{run.scheme} takes no steps of one length, whose percussions could be balanced: take Centered"
        )
    scene = run.problem.scene
    # those that are switched off have no place
    widths = dict[str, int]()
    if scene is not None:
        widths = {one.name: 6 for one in scene.items.connections}
        widths |= {one.name: 1 for one in scene.items.couplings if not one.active}
    parts = [(start, leg, placed_equalities(leg.problem.system)) for start, leg in legs(run) if leg.problem is not None]
    for _, _, places in parts:
        widths |= {known: 6 if isinstance(place.equality, PointRows) else 1 for known, place in places.items()}
    if printable(name, "name") not in widths:
        raise InputError(
            f"{shown(name)} is no connection or coupling of this run; known are {', '.join(widths) or 'none'}"
        )
    found = np.zeros((len(run.t), widths[name]))
    for start, leg, places in parts:
        if name in places:
            found[start + 1 : start + len(leg.t)] = _forces(leg, places[name])[1:]
    return found if widths[name] == 6 else found[:, 0]


def _forces(run: RunData, place: Place) -> Array:
    """Return the forces of an equality in each step of a run without switches, shape (n + 1, 6) or (n + 1, 1)."""
    assert run.problem is not None
    bare, several = without_equalities(run.problem.system), isinstance(place.equality, PointRows)
    found = np.zeros((len(run.t), 6 if several else 1))
    i, since = 0, float(run.t[0])
    for state in states(run):
        if state.h > 0.0:
            found[i + 1] += _percussions(run, bare, state, place)
            if state.t >= run.t[i + 1] - 1e-9 * run.step:
                found[i + 1] /= state.t - since
                i, since = i + 1, state.t
    return found


def placed_equalities(system: System) -> dict[str, Place]:
    """Return all equalities of a system by name, in the order of their rows."""
    return {place.equality.name: place for place in _places(system)}


def _places(system: System) -> Iterator[Place]:
    parts = (
        [(system.whole, 0, 0)] if system.whole is not None else [(p.system, p.q, p.v) for p in system.located_parts()]
    )
    for part, q, v in parts:
        begin = 0
        for points in (True, False):
            for one in part.equalities:
                if isinstance(one, PointRows) == points:
                    yield Place(part, q, v, begin, one)
                    begin += len(one.normals) if isinstance(one, PointRows) else 1


def without_equalities(system: System) -> System:
    """Return the same system without its equalities."""

    def replaced(part: System) -> System:
        if not isinstance(part, ArticulatedSystem):
            return part
        return ArticulatedSystem(part.model, part.name, part.control, (), part.springs)

    return with_parts(system.inner if isinstance(system, ConnectedSystem) else system, replaced)


def _percussions(run: RunData, bare: System, state: State, place: Place) -> Array:
    """Return the percussions of an equality in one step: of points force and moment on the second body in the world."""
    assert run.problem is not None
    system, q, h = run.problem.system, state.q, state.h
    t = state.t - (1.0 - run.record.timing.jump) * h
    step = state.step if state.step is not None or state.again is None else state.again()
    if step is None:
        return np.full(6 if isinstance(place.equality, PointRows) else 1, np.nan)
    if isinstance(run.record.scheme, Centered):
        # the velocities in the middle, where the law acts: what bodies turn on the way is no reaction
        before, after = system.coast(state.before, 0.5 * h)[1], system.coast(step.v, -0.5 * h)[1]
        at = system.force_velocity(t, q, before, 0.5 * h)
        motion, held = (one.centered_motion(t, q, before, h, at) for one in (bare, system))
        share = 0.5
    else:
        motion, held = (one.free_motion(t, q, state.before, h) for one in (bare, system))
        after, share = step.v, 1.0
    # damping acts on the velocities that keep the equalities; with `Centered` to order 2
    damped = share * h * system.damping_force(q, held.free - motion.free)
    reaction = damped + bare.metric(q).apply(after - motion.free) - _of_contacts(step)
    part = place.system
    nq, nv = part.nq, part.nv
    own = q[place.q : place.q + nq]
    rows = part.equality_gradients(own)
    if isinstance(part, ArticulatedSystem) and part.has_joint_friction:
        # percussions of dry friction are not known: the least of all that balance
        rough = np.eye(nv)[np.flatnonzero(part.friction)]
        rows = np.concatenate([rows, rough])
    if isinstance(system, HingedSystem):
        # nor are those of the torques about hinges
        rows = np.concatenate([rows, system.hinge_gradients(own)])
    percussions = np.linalg.lstsq(rows.T, reaction[place.v : place.v + nv])[0]
    one, end = place.equality, place.begin
    if not isinstance(one, PointRows):
        return percussions[end : end + 1]
    points, normals = rows_in_world(place, own)
    pushes = percussions[end : end + len(normals), None] * normals
    return np.concatenate([pushes.sum(axis=0), np.cross(points - points[0], pushes).sum(axis=0)])


def rows_in_world(place: Place, q: Array) -> tuple[Array, Array]:
    """Return the points of a connection's rows on its second body and their directions in the world, shapes (m, 3).

    q, shape (nq,), is that of the system that it belongs to.
    """
    one, poses = place.equality, place.system.kinematics(q).poses
    assert isinstance(one, PointRows)
    return one.points[:, 3:] @ poses[one.second, :3] + poses[one.second, 3], one.normals @ poses[one.first, :3]


def _of_contacts(step: Step) -> Array:
    """Return the percussions of contacts and limits in a step, shape (nv,)."""
    total = step.active.jacobian.T @ step.percussion
    if step.slip is not None and step.active.tangents is not None:
        total = total + step.active.tangents.jacobian.T @ step.slip[0].ravel()
    return np.asarray(total)
