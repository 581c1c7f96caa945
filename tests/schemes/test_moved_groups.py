"""What one part of a scene does leaves the impacts of the others as they are, where positions are projected."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array

import mbvi
from mbvi.schemes.positions.moved_groups import find_moved_groups, moved_groups

SCHEMES = [mbvi.Centered(project_positions=True), mbvi.MoreauJean(0.5, project_positions=True)]


def hopper(far, falling, friction=0.0):
    """A hopper that bounces; far away an arm whose fingers reach their limits, and a box in the air."""
    scene = mbvi.Scene(gravity=(0.5, 0.3, -9.0), restitution=0.3, friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(mbvi.robot("hopper"), position=(0, -1.2, 0.9), name="hop", joints={"knee": 0.4})
    if falling:
        scene.add_box((0.2, 0.2, 0.2), mass=1.0, position=(0, 0.9, 45), name="box")
    if far:
        scene.add_urdf(mbvi.robot("arm"), base="fixed", position=(40, 40, 5), name="far")
    problem = scene.build()
    return problem, problem.scene.places().of("hop")


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("step", [2e-3, 5e-4])
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: scheme.name)
def test_a_far_robot_and_a_box_in_the_air_change_no_impact(scheme, step, friction):
    alone, place = hopper(False, False, friction)
    expected = mbvi.simulate(alone, scheme, step=step, duration=0.39)
    assert expected.impacts
    problem, where = hopper(True, True, friction)
    run = mbvi.simulate(problem, scheme, step=step, duration=0.39)
    # another length of the scene moves tolerances, and friction is solved to a residual
    close = 1e-12 if friction == 0.0 else 1e-7
    np.testing.assert_allclose(run.v[:, where.v], expected.v[:, place.v], rtol=0, atol=close)
    mine = [one for one in run.impacts if any(name.startswith("hop") for name in one.constraints)]
    assert len(mine) == len(expected.impacts)
    for one, other in zip(mine, expected.impacts, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-12)
        np.testing.assert_allclose(one.percussion, other.percussion, rtol=close, atol=close)


@given(st.integers(0, 2**32 - 1))
def test_groups_are_those_of_all_paths(seed):
    """Against powers of the matrix that says which parts a row connects."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 6)), int(rng.integers(0, 8))
    part = np.sort(rng.integers(0, n, 2 * n))
    J = np.where(rng.random((k, 2 * n)) < 0.3, rng.normal(size=(k, 2 * n)), 0.0)
    moved = np.where(rng.random(2 * n) < 0.2, 1.0, 0.0)
    acts = np.zeros((k, n), bool)
    for i, j in np.argwhere(J):
        acts[i, part[j]] = True
    paths = np.linalg.matrix_power(np.eye(n, dtype=int) + acts.T.astype(int) @ acts, n + 1) > 0
    touched = paths[:, np.unique(part[moved != 0.0])].any(axis=1)
    velocities, rows = touched[part], (acts & touched).any(axis=1)
    for form in (J, csr_array(J)):
        found = moved_groups(form, moved > 0.0, part)
        np.testing.assert_array_equal(found[0], velocities)
        np.testing.assert_array_equal(found[1], rows)
    written = np.empty(2 * n, bool), np.empty(k, bool)
    assert find_moved_groups(J, moved, 0.5, part, *written) == velocities.all()
    np.testing.assert_array_equal(written[0], velocities)
    np.testing.assert_array_equal(written[1], rows)
