"""A step with projected positions adds no more energy than that of its displacement, which is recorded.

What remains is the error of the integrator: in flight that of the same step without constraints, in contact the work
that percussions do while the gradients turn within a step. Both are of second order in h.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.projection import Projector
from mbvi.results.diagnosis.energies import energy_of_projection
from support.robot_problems import OWN, REAL, built_once, path_of

SCHEMES = {"default": mbvi.Centered(project_positions=True), "moreau_jean": mbvi.MoreauJean(project_positions=True)}
H = 2e-3
# energy added in contact, over the largest, at h = 2 ms: the largest measured is 1.1e-5 in robots on sticking feet
CONTACT = 2e-5
# depth of the states that are projected, in lengths of the scene
SUNK = 5e-3


@built_once
def resting(name, mu):
    """A robot without restitution 5 cm over a floor."""
    scene = mbvi.Scene(friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(path_of(name), position=(0, 0, 5.0))
    problem = scene.build()
    rows, q = problem.constraints, problem.q0.copy()
    floor = [k for k in range(len(rows)) if rows.name(k).endswith("| floor")]
    q[2] += 0.05 - float(rows.gap(problem.t0, q)[floor].min())
    return problem.at(q, problem.v0)


def dropped(name, mu, rng):
    """It falls, turning."""
    problem = resting(name, mu)
    return problem.at(problem.q0, problem.v0 + 0.5 * rng.normal(size=problem.system.nv))


def energy(system, q, v):
    return system.kinetic_energy(q, v) + system.potential_energy(0.0, q)


def free_defect(problem, scheme, q, v, h):
    """The energy error of a step without constraints."""
    free = mbvi.Problem(problem.system, [], q, v)
    step = scheme.step(free, 0.0, q, v, h, Projector())
    return abs(energy(problem.system, step.q, step.v) - energy(problem.system, q, v))


def excess(problem, scheme, q, v, h):
    """Energy that a step adds beside the recorded one, less that of the integrator in flight; and the recorded one."""
    step = scheme.step(problem, 0.0, q, v, h, Projector())
    jump = scheme.timing.jump
    acted = problem.system.integrate(q, jump * h * v)
    recorded = energy_of_projection(problem, step.t, acted, step.q, step.v, (1.0 - jump) * h)
    added = energy(problem.system, step.q, step.v) - energy(problem.system, q, v) - recorded
    return added - free_defect(problem, scheme, q, v, h) - free_defect(problem, scheme, step.q, step.v, h), recorded


def tangent_velocity(problem, q, v):
    """The part of v that moves along the contacts at q: no law takes energy from it."""
    M, J = problem.system.metric(q).dense(), problem.constraints.active(0.0, q, problem.tolerance).jacobian
    across = np.linalg.solve(M, J.T)
    return v - across @ (np.linalg.pinv(J @ across, 1e-9, hermitian=True) @ (J @ v)) if len(J) else v


ROBOTS = [name for name in (*OWN, *REAL) if name in ("quadruped", "biped", "hopper", "solo12", "talos")]


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("name", ROBOTS)
def test_no_step_adds_more_energy_than_is_recorded(name, mu, rng):
    problem = dropped(name, mu, rng)
    run = mbvi.simulate(problem, SCHEMES["default"], step=H, duration=0.3, progress=False)
    system, most = problem.system, 0.0
    levels = np.array([energy(system, q, v) for q, v in zip(run.q, run.v, strict=True)])
    recorded, largest = run.projection_energy(), np.abs(levels).max()
    assert recorded.shape == run.t.shape
    assert recorded.any()
    rest = np.diff(levels) - recorded[1:]
    for i in np.flatnonzero(rest > CONTACT * largest).tolist():
        defects = [free_defect(problem, SCHEMES["default"], run.q[k], run.v[k], H) for k in (i, i + 1)]
        most = max(most, rest[i] - sum(defects))
    assert most <= CONTACT * largest


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("name", ROBOTS)
def test_nor_does_a_step_that_raises_a_robot_out_of_deep_contact(name, scheme, rng):
    """Deep contacts move links so far that M changes: what that adds to the kinetic energy is recorded too."""
    problem = dropped(name, 0.0, rng)
    run = mbvi.simulate(problem, SCHEMES["default"], step=H, duration=0.3, progress=False)
    largest, raised = np.abs(run.energy()).max(), 0
    for i in range(60, 150, 2):
        sunk = problem.system.integrate(run.q[i], SUNK * problem.length * rng.normal(size=problem.system.nv))
        v = tangent_velocity(problem, sunk, run.v[i] + rng.normal(size=problem.system.nv))
        added, recorded = excess(problem, SCHEMES[scheme], sunk, v, H)
        assert added <= CONTACT * largest
        raised += recorded != 0.0
    assert raised >= 5


def test_the_diagnosis_has_the_sum(rng):
    problem = dropped("quadruped", 0.0, rng)
    whole, thinned = (
        mbvi.simulate(problem, SCHEMES["default"], step=H, duration=0.2, every=every, progress=False)
        for every in (1, 3)
    )
    total = whole.projection_energy().sum()
    assert total > 0.0
    for run in (whole, thinned):
        assert run.diagnosis().projection_energy == pytest.approx(total, rel=1e-9)
    assert f"position projection: {total:.3g} J" in whole.diagnosis().report()
    with pytest.raises(mbvi.InputError, match="every"):
        thinned.projection_energy()
    assert not mbvi.simulate(problem, mbvi.Centered(), step=H, duration=0.2, progress=False).projection_energy().any()


class InPython(mbvi.Centered):
    """The scheme without its kernel."""

    step_kernel = None


def crowd(seed):
    """Four elastic bodies that spin fast meet in a row in free space: several contacts within a step."""
    rng = np.random.default_rng([seed, 3])
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    for place in (-1.5, -0.5, 0.5, 1.5):
        body = {
            "mass": rng.uniform(0.5, 2), "position": (0.34 * place, *0.05 * rng.normal(size=2)),
            "velocity": (-2.0 * place, *0.3 * rng.normal(size=2)), "angular_velocity": 8 * rng.normal(size=3),
            "rotation": Rotation.random(rng=rng).as_matrix(),
        }  # fmt: skip
        if rng.random() < 0.7:
            scene.add_box((0.2, 0.15, 0.25), **body)
        else:
            scene.add_capsule(0.07, 0.15, **body)
    return scene.build(resolve=True)


@pytest.mark.parametrize("scheme", [mbvi.Centered, InPython], ids=["kernel", "python"])
def test_elastic_bodies_keep_their_energy_though_positions_are_projected(scheme):
    """No contact that is about to close is braked before it bounces."""
    struck = 0
    for seed in range(40):
        problem = crowd(seed)
        run = mbvi.simulate(problem, scheme(project_positions=True), step=5e-3, duration=0.2)
        np.testing.assert_allclose(run.energy(), run.energy()[0], rtol=1e-12, err_msg=f"seed {seed}")
        struck += len(run.impacts)
    assert struck > 100
