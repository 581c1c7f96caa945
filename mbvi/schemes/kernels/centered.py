"""A step of `Centered` for a mechanism in one kernel; see `phases`."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows, write_gradients
from ...constraints.mechanism.tables import FOUND, copy_row
from ...constraints.rows import mutual_nearest, nearest_going_on
from ...projection.positions.travel import write_largest_of_parts, write_largest_of_rows
from ...projection.row_speeds import row_speeds
from ...projection.tree import advance_by, damp_slowed, is_damped
from ...system.free.spinning import remove_spin_effects
from ...system.mechanisms.equalities import EACH_ITS_OWN, FIRST_FINDS
from ...system.mechanisms.mechanism import evaluate_nonlinear_effects, glide, place, weigh
from ...system.system import Array
from ..positions.carried_kernel import carry_along
from ..positions.displacement_kernel import independent_groups
from ..positions.nearby_kernel import search_nearby
from ..positions.settle_kernel import glide_to_end, project_positions, take_velocity_of_end
from ..step import joins, write_closing_speeds, write_margins
from ..tangent_velocity import make_tangent
from .joint_friction import apply_joint_friction, joints_with_friction
from .phases import act, apply_law, move_freely
from .records import DONE, UNSOLVED, MechanismStep
from .walls import is_moved_by_walls, widen_margins


@kernel("i8(MechanismStep, f8[::1], f8[::1], b1[::1])")
def take_near(s: MechanismStep, drift: Array, still: Array, near: Array) -> int:
    """Copy the rows ahead that join the law to its rows; write which and return how many; see `joining`.

    `drift`, shape (nv,), leads to where the rows are. `still`, shape (parts,), is as of `Margins`, and the room's
    margins are the largest.
    """
    rows, near_rows, tolerance, k = s.ahead, s.rows, s.scales.tolerance, s.ahead.size[0]
    near_rows.size[0], own, largest = 0, np.empty(k), np.empty(k if len(s.prescribed.motion) > 0 else 0)
    write_largest_of_parts(rows.J, s.scales.part, still, own)
    write_largest_of_parts(rows.J, s.scales.part, s.room.margins, largest)
    for a in range(k):
        farther = 0.0
        if len(largest) > 0 and is_moved_by_walls(s, rows, a):
            farther = largest[a] - own[a]
        margin = own[a] + farther
        near[a] = rows.lever[a] * rows.gap[a] <= tolerance + margin
        if near[a] and margin > 0.0:
            change = 0.0
            for i in range(len(drift)):
                change += rows.J[a, i] * drift[i]
            near[a] = joins(rows.gap[a], change, rows.e[a], rows.lever[a], tolerance, farther)
        if near[a]:
            copy_row(rows, a, near_rows)
    return near_rows.size[0]


@kernel("i8(MechanismStep, f8[::1], f8[::1])")
def rows_in_the_middle(s: MechanismStep, middle: Array, change: Array) -> int:
    """Replace the rows of the end of a step by the same in its middle, in the same order; return a code.

    `middle`, shape (nq,), is the configuration there, and `change`, shape (k,), that of the gaps from there to the end.
    """
    rows, here, most, m = s.rows, s.middle, 0.0, s.rows.size[0]
    for a in range(m):
        most = max(most, rows.lever[a] * (abs(rows.gap[a]) + abs(change[a])))
    # twice the linear estimate, because the gradients change within the step
    reach = s.scales.tolerance + 2.0 * most
    code = active_rows(s.mechanism, s.constraints, middle[:0], s.room.moved, middle, reach, here)
    if code != FOUND:
        return code
    # the same is nearest for each observer in uniform motion
    carry_along(s, rows, np.ones(m, np.bool_), s.room.end, middle)
    n, owner, order = here.size[0], s.room.owner[:m], s.room.order[: here.size[0]]
    for b in range(n):
        # rows are found in the order of their numbers
        order[b] = b
    mutual_nearest(rows.number[:m], rows.point[:m], here.number[:n], here.point[:n], order, owner)
    for a in range(m):
        if owner[a] >= 0:
            rows.size[0] = a
            copy_row(here, owner[a], rows)
        else:
            # a contact without a counterpart in the middle is taken at the place where it is at the end, or where one
            # that goes on from it is, as before the joint of two tiles
            b = nearest_going_on(
                rows.number[a], rows.point[a], rows.normal[a], rows.J[a], here.number[:n], here.point[:n],
                here.normal[:n], here.J[:n], owner, reach,
            )  # fmt: skip
            for k in range(3 if b >= 0 else 0):
                rows.point[a, k] = here.point[b, k]
            rows.gap[a] -= change[a]
            place(s.mechanism, middle)
            write_gradients(s.mechanism, s.constraints, rows, a)
    rows.size[0] = m
    return FOUND


@kernel("void(MechanismStep, f8[::1], b1[::1])")
def mark_bouncing(s: MechanismStep, change: Array, bounces: Array) -> None:
    """Write `parts_that_bounce` (`room.bouncing`), and which rows act on them: those keep the gaps of the middle.

    `change` and `bounces` have the shape (k,).
    """
    rows, k, some = s.rows, s.rows.size[0], False
    for a in range(k):
        rebound = -2.0 * rows.e[a] * change[a] * rows.lever[a]
        bounces[a] = rows.e[a] > 0.0 and (rebound > s.scales.tolerance or rows.e[a] >= 1.0)
        some = some or bounces[a]
    s.room.bouncing[:] = 0.0
    if not some:
        return
    group, connected = np.empty(k, np.int64), np.zeros(k)
    independent_groups(rows.J[:k], s.scales.part, group)
    for a in range(k):
        if bounces[a]:
            connected[group[a]] = 1.0
    for a in range(k):
        connected[a] = connected[group[a]]
        bounces[a] = connected[a] > 0.0
    write_largest_of_rows(rows.J, s.scales.part, connected, s.room.bouncing)


@kernel("void(MechanismStep, f8[::1], f8[::1])")
def evaluate_pushing_effects(s: MechanismStep, q: Array, v: Array) -> None:
    """Compute the nonlinear effects without gyroscopic ones of free bodies."""
    evaluate_nonlinear_effects(s.mechanism, q, v)
    remove_spin_effects(s.mechanism.free, v, s.mechanism.effects)


@kernel("void(MechanismStep, f8, f8[::1], f8[::1], f8)")
def centered_forces(s: MechanismStep, t: float, q: Array, v: Array, half: float) -> None:
    """Compute all that the free motion takes at (t, q), with the effects of velocities half a step later.

    Gyroscopic torques of free bodies do not act; see `coast`. With equalities the factor of M + half D
    stays in the room.
    """
    m, room, late, w = s.mechanism, s.room, s.scales.late, s.room.force_velocity
    rough = joints_with_friction(m.friction) > 0
    room.known[0] = 0
    for k in range(len(v)):
        room.damping[k] = m.damping[k]
    act(s, t, q, v)
    weigh(s.mechanism, q)
    evaluate_pushing_effects(s, q, v)
    if len(late):
        # where M has no factor the step itself says so
        if len(room.damped) > len(v) and is_damped(m.damping):
            torque, effects, none = room.torque, m.effects, room.L[:0]
            bad = advance_by(
                m.mass, m.damping, m.parent, v, half, torque, effects, False, none, room.damped, room.changes, w
            )
            room.known[0] = 0 if bad else len(room.damped)
        else:
            move_freely(s, v, half, False, w)
        if rough:
            for k in range(len(v)):
                room.free[k] = w[k]
            apply_joint_friction(s, half, w)
            damp_slowed(m.damping, room.free, w, room.damping)
            room.known[0] = 0
        for k in range(len(v)):
            if not late[k]:
                w[k], room.damping[k] = v[k], m.damping[k]
        if s.scales.loaded:
            act(s, t, q, w)
        evaluate_pushing_effects(s, q, w)


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def step_of_shared_closings(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write what `centered_step` does."""
    scales, room, half = s.scales, s.room, 0.5 * h
    drift, end, middle, w = room.drift, room.end, room.middle, room.before
    glide(s.mechanism, q, v, h, drift, end, w)
    projects = scales.projects
    room.margins[:] = 0.0
    s.corrected[0] = 0
    if projects:
        write_margins(scales.turn_squares, drift, scales.part, scales.tolerance, scales.length, room.margins)
    still = room.margins
    if projects and len(s.prescribed.motion) > 0:
        still = room.margins.copy()
        widen_margins(s, q, h, room.margins)
    s.constraints.given.time[0] = t + h
    code = search_nearby(s)
    if code != FOUND:
        return code
    near = room.near[: s.ahead.size[0]]
    count = take_near(s, drift, still, near)
    # from here on w is the velocity before the law
    glide(s.mechanism, q, v, half, drift, middle, w)
    centered_forces(s, t + half, middle, w, half)
    if count == 0:
        s.residual[0] = 0.0
        if not (move_freely(s, w, h, True, s.v) and apply_joint_friction(s, h, s.v)):
            return UNSOLVED
        glide_to_end(s, half)
        take_velocity_of_end(s)
        return DONE if make_tangent(s, 0) else UNSOLVED
    change, gap, opened = room.change[:count], room.gap[:count], room.opened[:0]
    row_speeds(s.rows.J, w, half, change)
    bounces = room.bounces[:count]
    if projects:
        mark_bouncing(s, change, bounces)
    for a in range(count):
        gap[a] = s.rows.gap[a]
    s.constraints.given.time[0] = t + half
    code = rows_in_the_middle(s, middle, change)
    if code != FOUND:
        return code
    if projects:
        row_speeds(s.rows.J, w, half, change)
        for a in range(count):
            if bounces[a]:
                # one that closes until the end bounces, also if its gap is not linear; elsewhere rounding would decide
                if s.rows.e[a] >= 1.0:
                    change[a] = min(change[a], gap[a] - s.rows.gap[a])
            else:
                # gaps that lead to those of the end, which the position projection takes to be linear
                s.rows.gap[a] = gap[a] - change[a]
        if write_closing_speeds(
            s.rows.gap[:count], s.rows.lever[:count], change, half, scales.tolerance, room.opened[:count]
        ):
            opened = room.opened[:count]
    if apply_law(s, w, h, True, opened) != DONE:
        return UNSOLVED
    if not projects:
        glide_to_end(s, half)
        take_velocity_of_end(s)
        for a in range(count):
            s.rows.gap[a] += half * s.rates[2 * count + a]
        return DONE if make_tangent(s, count) else UNSOLVED
    s.constraints.given.time[0] = t + h
    if len(opened) == 0:
        for a in range(count):
            room.opened[a] = 0.0
    glide_to_end(s, half)
    code = project_positions(s, w, h, near)
    if code == DONE and not make_tangent(s, s.rows.size[0]):
        return UNSOLVED
    return code


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def centered_step(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of `Centered` from q, v at t, whose closings share M and J_e; return a code."""
    shared = s.mechanism.equalities.shared
    shared[0] = FIRST_FINDS
    code = step_of_shared_closings(s, t, q, v, h)
    shared[0] = EACH_ITS_OWN
    return code
