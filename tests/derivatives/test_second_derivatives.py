"""Second derivatives of rows, and derivatives of M w and of the law of impacts, against differences of order four."""

from copy import deepcopy

import numpy as np
import pytest

import mbvi
from mbvi.derivatives.directions import directions
from mbvi.derivatives.motion.linearised import Linearised
from support.robot_problems import tilted_quadruped


def bodies():
    """A box, a ball and a hopper in one scene, and a wall that is not level."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0.3, 0.2, 1), name="floor")
    scene.add_box((0.3, 0.5, 0.7), mass=2.0, position=(3, 0, 2), name="box")
    scene.add_sphere(radius=0.2, mass=1.0, position=(-3, 0, 2), name="ball")
    scene.add_urdf("robot:hopper", position=(0, 0, 3))
    return scene.build()


def hopper_in_a_plane():
    scene = mbvi.Scene(plane="xz")
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf("robot:hopper", position=(0, 0, 1), joints={"knee": 0.4})
    return scene.build()


def differences(values, system, q):
    """d values / d dq by differences of order four, the directions in the last axis."""
    columns = []
    for dq in np.eye(system.nv) * 2e-4:
        a, b, c, d = (values(system.integrate(q, k * dq)) for k in (-2.0, -1.0, 1.0, 2.0))
        columns.append((a - 8 * b + 8 * c - d) / (12 * 2e-4))
    return np.stack(columns, axis=-1)


def drawn(problem, seed):
    linear = Linearised(deepcopy(problem), directions(problem, ("state",), None).parameters)
    rng = np.random.default_rng(seed)
    system = linear.system
    q = system.integrate(problem.q0, 0.3 * rng.normal(size=system.nv))
    known = np.flatnonzero(linear._points.known(linear.rows.body_points(linear.rows.all)))
    return linear, q, rng.normal(size=system.nv), known, rng


PROBLEMS = [tilted_quadruped, hopper_in_a_plane, bodies]


@pytest.mark.parametrize("make", PROBLEMS)
def test_gradients_and_biases_of_rows(make):
    linear, q, v, rows, _ = drawn(make(), 1)
    assert len(rows) > 4 and (make is not bodies or {1, 2, 3} <= set(linear.rows.body_points(rows)[:, 0].astype(int)))
    gradients, biases = linear.rows_by_q(0.0, q, v, rows)
    for found, of in (
        (gradients, lambda there: linear.rows.gradients(0.0, there, rows)),
        (biases, lambda there: linear.rows.bias(0.0, there, v, rows)),
    ):
        exact = differences(of, linear.system, q)
        assert found.shape == exact.shape and np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()


@pytest.mark.parametrize("make", PROBLEMS)
def test_momenta_and_the_law(make):
    linear, q, v, known, rng = drawn(make(), 2)
    system, rows = linear.system, known[:0]
    # rows that depend on each other contradict each other
    while np.linalg.matrix_rank(linear.rows.gradients(0.0, q, rows), tol=1e-3) < 3:
        rows = np.sort(rng.choice(known, 3, replace=False))
    exact = differences(lambda there: system.metric(there).apply(v), system, q)
    assert np.abs(linear._free.momenta(q, v) - exact).max() < 1e-9 * max(np.abs(exact).max(), 1e-3)
    hit, e = np.array([True, False, True]), np.array([0.5, 0.0, 0.3])

    def after(there):
        J = linear.rows.gradients(0.0, there, rows)
        W = np.linalg.solve(system.metric(there).dense(), J.T).T
        return v - np.linalg.lstsq(J @ W.T, np.where(hit, 1 + e, 1) * (J @ v), rcond=1e-10)[0] @ W

    law, exact = linear.law(0.0, q, v, rows, hit, e), differences(after, system, q)
    assert np.abs(law.after - after(q)).max() < 1e-10 * np.abs(v).max()
    assert np.abs(law.by_q - exact).max() < 1e-8 * np.abs(exact).max()


def test_rows_without_a_formula_keep_differences():
    """A rim that rolls on a floor, beside a corner."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_cylinder(radius=0.2, length=0.5, mass=1.0, position=(0, 0, 1), rotation=(0.4, 0.3, 0), name="roller")
    scene.add_box((0.3, 0.5, 0.7), mass=2.0, position=(3, 0, 2), name="box")
    linear, q, v, known, _ = drawn(scene.build(), 3)
    rows = linear.rows.all[linear.rows.number < 2]
    assert 0 < len(np.intersect1d(known, rows)) < len(rows)
    gradients, _ = linear.rows_by_q(0.0, q, v, rows)
    exact = differences(lambda there: linear.rows.gradients(0.0, there, rows), linear.system, q)
    assert np.abs(gradients - exact).max() < 1e-8 * np.abs(exact).max()
