"""Robots move as they did before there were compiled kernels.

`data/states_before_kernels.npz` holds q and v, one after the other, after 100 steps of h = 1e-3 of every run here. It
was computed by the version without compiled kernels. Talos's shins touch each other in its last steps: at e = 0.5 its
states are those since every corner of what two overlapping links share is a contact point; before, one of two was. The
hopper's shin, a cylinder, turns on the floor where its joints start at limits: its states are those since tilted rims
stand on their lowest points only, a tenth as far from those of fine steps.
"""

import numpy as np
import pytest

import mbvi
from support.paths import DATA
from support.robot_problems import KINDS, OWN, REAL, is_free, problem_of

AT_LIMITS = {(name, "limits") for name in ("arm", "biped", "quadruped", "panda")} | {("talos", "fall")}
RESTITUTIONS = (0.0, 0.5)
STEP, DURATION = 1e-3, 0.1

with np.load(DATA / "states_before_kernels.npz") as file:
    BEFORE = {run: file[run] for run in file}


def runs(names):
    return [(name, kind, e) for name in names for kind in KINDS[name] for e in RESTITUTIONS]


def run_of(name, kind, e):
    # the version without kernels did not couple mimic joints
    problem = problem_of(name, kind, e, mimic=False)
    return mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=DURATION, progress=False)


def test_every_run_of_the_file_is_made_again():
    assert set(BEFORE) == {f"{name}/{kind}/{e}" for name, kind, e in runs([*OWN, *REAL])}


def check(name, kind, e):
    run, before = run_of(name, kind, e), BEFORE[f"{name}/{kind}/{e}"]
    np.testing.assert_allclose(np.concatenate([run.q[-1], run.v[-1]]), before, rtol=0, atol=1e-12)
    # the free ones land, and where joints start at a limit they meet it
    met = {constraint for impact in run.impacts for constraint in impact.constraints}
    assert any(constraint.endswith("| floor") for constraint in met) == is_free(name)
    assert any(constraint.endswith("limit") for constraint in met) == ((name, kind) in AT_LIMITS)


@pytest.mark.parametrize(("name", "kind", "e"), runs(OWN))
def test_states_of_the_projects_robots(name, kind, e):
    check(name, kind, e)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind", "e"), runs(REAL))
def test_states_of_real_robots(name, kind, e):
    check(name, kind, e)
