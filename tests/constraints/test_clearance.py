"""Clearances of pairs in the compiled loop: never above the distances, so that no row is missed."""

import numpy as np
import pytest

import mbvi
from mbvi.constraints.mechanism.rows import active_rows
from mbvi.constraints.mechanism.state import MechanismState, row_buffer
from mbvi.constraints.mechanism.tables import FOUND, PAIRS, way_of
from mbvi.system.mechanisms.joined import joined
from support.paths import ROBOTS


def quadruped_and_box():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.44))
    scene.add_box((0.1, 0.2, 0.1), 1.0, position=(0.4, 0.0, 0.3), name="box")
    return scene.build()


@pytest.mark.parametrize("seed", range(6))
def test_no_row_is_missed_however_the_tolerance_changes(seed):
    rng, problem, measured = np.random.default_rng(seed), quadruped_and_box(), quadruped_and_box()
    q, system, number = problem.q0.copy(), problem.system, 0
    problem.constraints.active(0.0, q, 0.01)
    state, mechanism = MechanismState(problem.constraints), joined(system).mechanism()
    assert state.enter()
    rows, moved = row_buffer(system.nv, problem.constraints.frictional), np.zeros(system.nv)
    pairs, cache = state.arrays.pairs, state.arrays.cache
    (family,) = (one for one in measured.constraints.families if type(one).__name__ == "SignedDistances")
    for _ in range(80):
        direction = rng.normal(size=system.nv) * rng.choice([1e-4, 3e-3, 2e-2])
        q = system.integrate(q, direction)
        tolerance = float(rng.choice([1e-8, 2e-3, 0.02]))
        assert active_rows(mechanism, state.arrays, q[:0], moved, q, tolerance, rows) == FOUND
        measured.constraints.cache.forget()
        every = measured.constraints.active(0.0, q, tolerance)
        m = rows.size[0]
        np.testing.assert_array_equal(rows.number[:m], every.constraint)
        np.testing.assert_allclose(rows.gap[:m], every.gap, rtol=0.0, atol=1e-12)
        distance = family.nearest_of(0.0, q, np.arange(family.size))[0]
        way = np.array([way_of(pairs, cache.travel[cache.slot[cache.kind == PAIRS][0]], k) for k in range(family.size)])
        assert (pairs.clearance - way <= distance + 1e-12).all()
        number += m
    assert number >= 100
