"""Random arguments of the kernels that keep rows of a robot closed, and that take stages of its motion."""

import numpy as np

from mbvi.constraints.features.feature_kernels import (
    EDGES,
    FACE_RIM,
    FACE_VERTEX,
    LINE_VERTEX,
    POINTS,
    RIM_FACE,
    VERTEX_FACE,
    VERTEX_LINE,
)
from mbvi.constraints.mechanism.held_rows import LIMIT, RowParts, held_rows_of, hold, row_room, write_held, write_row
from mbvi.schemes.event_driven.finding.interpolants import PARTS
from mbvi.schemes.event_driven.runge_kutta import DEGREE
from mbvi.schemes.event_driven.stages import accelerate, smooth_motion
from support.closing_arguments import random_surfaces
from support.joint_tree_arguments import moved_model, tree_of
from support.robot_arguments import moving_robot, unit

FEATURES = [VERTEX_FACE, FACE_VERTEX, EDGES, FACE_RIM, RIM_FACE, LINE_VERTEX, VERTEX_LINE, POINTS]


def random_parts(rng, model, count):
    """Features of two bodies each, and limits of joints with one velocity; one row may be there twice."""
    kinds = np.array([*FEATURES, LIMIT])
    single = [j for j in range(1, model.njoints) if model.nvs[j] == 1 and model.nqs[j] == 1]
    kind = rng.choice(kinds if single else kinds[:-1], size=count)
    sides, parts = np.zeros((count, 2), np.int64), rng.normal(size=(count, 2, 2, 3))
    parts[:, :, 1] = unit(rng, count, 2)
    for i in range(count):
        if kind[i] == LIMIT:
            joint = int(rng.choice(single))
            sides[i], parts[i, 0, 0, 0] = (model.idx_qs[joint], model.idx_vs[joint]), rng.choice([-1.0, 1.0])
        else:
            sides[i] = rng.permutation(model.njoints)[:2]
        if kind[i] in (FACE_RIM, RIM_FACE):
            # an axis as long as the radius
            parts[i, 1 if kind[i] == FACE_RIM else 0, 1] *= 0.1 + rng.random()
    radius = np.where(rng.random(count) < 0.5, 0.0, 0.1 + rng.random(count))
    radius[kind >= LINE_VERTEX] += 0.1
    radius[kind == LIMIT] = 0.0
    if count > 1 and rng.random() < 0.4:
        kind[-1], sides[-1], parts[-1], radius[-1] = kind[0], sides[0], parts[0], radius[0]
    return RowParts(kind, sides, parts, radius, rng.choice([0.0, 0.2, -0.3], size=count))


def moving(rng):
    """The record of a robot that moves, rows that stay closed, and a state."""
    system, q, v = moving_robot(rng)
    motion = smooth_motion(system.mechanism(), system.nq, system.nv)
    motion.torque[:] = rng.normal(size=system.nv)
    rows = held_rows_of(random_parts(rng, system.model, int(rng.integers(0, 5))), system.nv)
    return system, motion, rows, np.array(q), v


def _accelerated(rng):
    system, motion, rows, q, v = moving(rng)
    accelerate(motion, rows, q, v)
    return system, motion, rows, q, v


def _written(rng):
    _, motion, rows, _, _ = _accelerated(rng)
    rows.rows[len(motion.v) :] = np.nan
    return motion.mechanism, rows


def _held(rng):
    _, motion, rows, _, _ = _accelerated(rng)
    write_held(motion.mechanism, rows)
    return motion.mechanism, rows, motion.free, np.full(len(motion.v), np.nan)


def _forced(rng):
    mechanism, rows, free, out = _held(rng)
    hold(mechanism, rows, free, out)
    return rows, free


def _scales(rng):
    rows, free = _forced(rng)
    return rows, free, np.full(len(rows.kind), np.nan)


def _margins(rng):
    rows, free = _forced(rng)
    return rows, free, 1e-9, *np.full((2, len(rows.kind)), np.nan)


def _measured(rng):
    system, motion, _, q, _ = _accelerated(rng)
    parts = random_parts(rng, system.model, 5)
    index = rng.permutation(5)[:3]
    return motion.mechanism, parts, index, q, np.full(3, np.nan)


def _measured_in_room(rng):
    *found, gap = _measured(rng)
    return *found, *np.full((2, 2, 3), np.nan), gap


def _some_of(rng):
    """Five rows of a robot, of which three are asked for; the robot was placed elsewhere."""
    system, motion, _, q, v = moving(rng)
    parts = random_parts(rng, system.model, 5)
    return motion.mechanism, parts, rng.permutation(5)[:3], q, v


def _gaps_at(rng):
    mechanism, parts, index, q, _ = _some_of(rng)
    return mechanism, parts, index, q, np.full(3, np.nan)


def _points_at(rng):
    mechanism, parts, index, q, _ = _some_of(rng)
    return mechanism, parts, row_room(), index, q, *np.full((2, len(index), 3), np.nan)


def _gradients_at(rng):
    mechanism, parts, index, q, v = _some_of(rng)
    return mechanism, parts, row_room(), index, q, np.full((3, len(v)), np.nan)


def _biases_at(rng):
    mechanism, parts, index, q, v = _some_of(rng)
    return mechanism, parts, row_room(), index, q, v, np.full((3, len(v)), np.nan), np.full(3, np.nan)


def _one_row(rng):
    system, motion, _, q, v = _accelerated(rng)
    parts = random_parts(rng, system.model, 1)
    one = int(parts.kind[0]), parts.sides[0], parts.parts[0], float(parts.radius[0])
    return motion.mechanism, *one, q, row_room(), np.full(len(v), np.nan)


def _drifted(rng):
    _, motion, rows, q, v = moving(rng)
    # gaps that Newton's method closes
    rows.parts[:, 0, 0] *= 1e-3
    return motion, rows, q, v, np.full(len(rows.kind), np.nan)


def _interpolated(rng):
    degree, count = int(rng.integers(2, 6)), int(rng.integers(1, 4))
    values = rng.normal(size=(degree + 1, count)) + rng.choice([0.0, 3.0, 30.0])
    values[rng.random(values.shape) < 0.05] = np.nan
    return rng.normal(size=(2, degree + 1)), rng.random((9, degree + 1)), values, np.full(count, np.nan)


def _may_close(rng):
    reach, m = rng.choice([0.0, 0.5, np.inf], size=(3, 4)), 8
    closed = rng.permutation(m)[: int(rng.integers(0, 4))]
    rest = rng.choice([0.0, 0.2], size=4), rng.choice([-np.inf, 0.01, 5.0], size=m), closed
    return reach, rng.integers(0, 3, size=m), *rest, *np.full((2, m), np.nan), np.zeros(m, np.int64)


def _outside(rng):
    kind, _, places, _ = _features(rng, 4)
    found = kind, rng.random(4), places, rng.normal(size=4), *rng.normal(size=(2, 4, 3))
    return *found, random_surfaces(rng, 4), np.full(4, np.nan)


def _point(rng):
    _, motion, *_ = _accelerated(rng)
    return motion.mechanism.tree, int(rng.integers(len(motion.mechanism.tree.kind))), rng.normal(size=3)


def _stages(rng):
    _, motion, rows, q, v = moving(rng)
    nv, n = len(v), 4
    K = rng.normal(size=(n, (3 if len(rows.kind) else 2) * nv))
    return motion, rows, np.tril(rng.random((n, n)), -1), 0.1, 1, n, q, v, K


def _along(rng):
    _, motion, rows, q, v = moving(rng)
    return motion, rows, rng.normal(size=(2, len(v), DEGREE)), 1e-2, rng.random(3), q, v


def _whole_step(rng):
    motion, rows, weights, h, _, _, q, v, K = _stages(rng)
    n = len(K)
    return (
        motion,
        rows,
        weights,
        rng.normal(size=(2, n)),
        h,
        q,
        v,
        K,
        np.full(len(v), np.nan),
        np.full(K.shape[1], np.nan),
    )


def _dense_output(rng):
    motion, rows, weights, h, first, _, q, v, K = _stages(rng)
    polynomials, dense = rng.normal(size=(len(K), DEGREE)), np.full((2, len(v), DEGREE), np.nan)
    return motion, rows, weights, polynomials, h, q, v, K, first, dense


def _on_grid(rng):
    x, k = np.linspace(0.0, 1.0, PARTS + 1), rng.integers(1, 9, size=3)
    values = rng.normal(size=3) @ np.cos(k[:, None] * x + rng.random((3, 1))) + rng.choice([0.0, 1.0])
    return values, float(rng.choice([0.0, 1e-3]))


def _margins_along(rng):
    motion, rows, *rest = _along(rng)
    return motion, rows, *rest, 1e-9, np.full((3, len(rows.kind)), np.nan)


def _gaps_along(rng):
    system, motion, _, q, v = moving(rng)
    dense, index = rng.normal(size=(2, len(v), DEGREE)), rng.permutation(5)[:3]
    return motion, random_parts(rng, system.model, 5), index, dense, 1e-2, rng.random(2), q, v, np.full((2, 3), np.nan)


def _state(rng):
    motion, _, dense, h, shares, q, v = _along(rng)
    return motion, dense, h, float(shares[0]), q, v


def _features(rng, count):
    parts, places = rng.normal(size=(count, 2, 2, 3)), rng.normal(size=(count, 2, 4, 3))
    return rng.choice(FEATURES, size=count), parts, places, np.full((count, 2, 3), np.nan)


def _disc(rng):
    n, axis = unit(rng), unit(rng)
    # a disc that lies flat, and whose axis is one of the world's
    axis = rng.choice([0.1, 2.0]) * (n if rng.random() < 0.2 else axis if rng.random() < 0.6 else np.eye(3)[0])
    return n, axis


def _rolling(rng):
    (n, axis), disc, (along, turning, across) = _disc(rng), int(rng.integers(2)), rng.normal(size=(3, 2, 3))
    along[disc] = axis
    return disc, n, along, turning, across


def _touch(rng):
    kind, parts, places, along = _features(rng, 1)
    both = places[0, 0].copy(), places[0, 1].copy()
    return int(kind[0]), parts[0], rng.random(), *both, along[0], *np.full((2, 3), np.nan)


def _touch_each(rng):
    kind, parts, places, along = _features(rng, 4)
    return kind, parts, rng.random(4), places, along, np.full(4, np.nan), *np.full((2, 4, 3), np.nan)


def _turning(rng):
    return int(rng.choice(FEATURES)), rng.random(), unit(rng), *rng.normal(size=(3, 2, 3)), *rng.normal(size=3).tolist()


def _contact_ways(rng):
    kind, radius, n, *vectors = _turning(rng)[:6]
    return kind, radius + 0.1, n, *vectors, rng.normal(size=3), *np.full((2, 3), np.nan)


def _slip(rng):
    kind, radius, n, *vectors = _turning(rng)[:6]
    numbers = rng.normal(size=(2, 3)), *rng.normal(size=(2, 3)), np.full(2, np.nan)
    return kind, radius + 0.1, float(rng.normal()), n, *vectors, rng.normal(size=(2, 3)), *numbers


def _moving_each(rng):
    return rng.choice(FEATURES, size=3), 0.1 + rng.random(3), unit(rng, 3), *rng.normal(size=(4, 3, 2, 3))


def _slipping_each(rng):
    kind, radius, *others = _moving_each(rng)
    return kind, radius, rng.normal(size=3), *others, np.full((3, 2), np.nan)


def _slip_of_row(rng):
    mechanism, kind, sides, parts, radius, _, room, J = _one_row(rng)
    if kind == LIMIT:
        return _slip_of_row(rng)
    write_row(mechanism, kind, sides, parts, radius, room, J)
    return mechanism, kind, sides, radius, float(rng.normal()), room, np.full((2, len(J)), np.nan), np.full(2, np.nan)


def _slips_at(rng):
    mechanism, parts, index, q, v = _some_of(rng)
    T = np.full((3, 2, len(v)), np.nan)
    return (
        mechanism,
        parts,
        row_room(),
        index,
        rng.choice([0.0, 0.5], size=3),
        q,
        v,
        T[0, 0].copy(),
        T,
        T[:, :, 0].copy(),
        np.full((3, 2, 3), np.nan),
    )


def _rates(rng):
    model, _, v = moved_model(rng)
    return tree_of(model), rng.choice([0.01, 0.3, 1.0]) * rng.normal(size=model.nv), v, np.full(model.nv, np.nan)


HELD_ROW_ARGUMENTS = {
    "write_members": lambda rng: (*rng.integers(0, 9, size=(2, 5)), np.zeros(5, bool)),
    "gaps_at": _gaps_at,
    "gradients_at": _gradients_at,
    "points_at": _points_at,
    "biases_at": _biases_at,
    "evaluate_row": _one_row,
    "write_row": lambda rng: (*(made := _one_row(rng))[:5], *made[6:]),
    "remove_drift_of": _drifted,
    "interpolation_error": lambda rng: (*_interpolated(rng)[::2], 0),
    "write_soonest": _interpolated,
    "all_stay_positive": lambda rng: _interpolated(rng)[:3],
    "root_of_parabola": lambda rng: tuple(rng.normal(size=3).tolist()),
    "root_on_grid": _on_grid,
    "largest_error": lambda rng: (rng.random(3 * 4), rng.normal(size=4), 0.1 + rng.random(4)),
    "take_whole_step": _whole_step,
    "write_dense_output": _dense_output,
    "write_candidates": _may_close,
    "write_outside": _outside,
    "lowest_of_rim": _disc,
    "way_along_rim": _rolling,
    "along_vector": lambda rng: (rng.normal(size=(2, 3)), int(rng.integers(2)), *rng.normal(size=3).tolist()),
    "edges_bias": lambda rng: _turning(rng)[1:],
    "touch": _touch,
    "touch_each": _touch_each,
    "turning_bias": _turning,
    "turn_with_bodies": lambda rng: (*rng.normal(size=(2, 2, 3)), unit(rng), *np.full((2, 2, 3), np.nan)),
    "way_along_edges": lambda rng: _turning(rng)[1:],
    "way_of_contact": _contact_ways,
    "write_tangent_rates": lambda rng: (unit(rng), rng.normal(size=3), np.full((2, 3), np.nan)),
    "slip_bias": _slip,
    "write_biases": lambda rng: (*_moving_each(rng), np.full(3, np.nan)),
    "write_slip_biases": _slipping_each,
    "write_slip": _slip_of_row,
    "slips_at": _slips_at,
    "write_tangents_of": lambda rng: (unit(rng), np.full((2, 3), np.nan)),
    "write_gaps_of": _measured,
    "write_each_gap": _measured_in_room,
    "point_motion": _point,
    "write_held": _written,
    "hold": _held,
    "write_forces": lambda rng: _forced(rng)[:1],
    "write_scales": _scales,
    "force_margins": _margins,
    "commutator_factors": lambda rng: (float(3.0 * rng.random()),),
    "commute": lambda rng: tuple(rng.normal(size=(2, 6))),
    "joint_chart_rates": _rates,
    "accelerate": lambda rng: moving(rng)[1:],
    "take_stages": _stages,
    "state_at": _state,
    "margins_along": _margins_along,
    "gaps_along": _gaps_along,
}
