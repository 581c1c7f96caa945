"""Robots move as they did before there were compiled kernels.

`states_before_kernels.npz` holds q and v, one after the other, after 100 steps of h = 1e-3 of every run here. It was
computed by the version without compiled kernels; Talos's, whose own links touch edge to edge, with plain numpy forms
since crossing edges touch where they are deepest.
"""

import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from conftest import ROBOTS, real_robot

import mbvi
from mbvi.constraints import HalfSpaceContacts

OWN = {"arm": "fixed", "biped": "free", "double_pendulum": "fixed", "hopper": "free", "quadruped": "free"}
REAL = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "fixed"),
    "panda": ("panda_description/urdf/panda.urdf", "fixed"),
    "solo12": ("solo_description/robots/solo12.urdf", "free"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "free"),
}
# in the middle of its joints' ranges a self-collision of the UR5 and of Talos is inadmissible
KINDS = {name: ("fall",) if name in ("ur5", "talos") else ("fall", "limits") for name in (*OWN, *REAL)}
AT_LIMITS = {(name, "limits") for name in ("arm", "biped", "quadruped", "panda")} | {("talos", "fall")}
RESTITUTIONS = (0.0, 0.5)
STEP, DURATION = 1e-3, 0.1

with np.load(Path(__file__).parent / "states_before_kernels.npz") as file:
    BEFORE = {run: file[run] for run in file}


def runs(names):
    return [(name, kind, e) for name in names for kind in KINDS[name] for e in RESTITUTIONS]


def is_free(name):
    return (OWN[name] if name in OWN else REAL[name][1]) == "free"


def path_of(name):
    return ROBOTS / name / f"{name}.urdf" if name in OWN else real_robot(REAL[name][0])


def problem_of(name, kind, e):
    """A robot one centimetre above a floor, or a fixed one; with `limits` four in ten joints run into one."""
    path, free = path_of(name), is_free(name)
    # loaders of some descriptions warn about what they leave out
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        joints, velocity = state_of(path, free, kind, np.random.default_rng(len(name)))

        def build(height):
            scene = mbvi.Scene(restitution=e)
            if free:
                scene.add_halfspace(normal=(0, 0, 1), offset=0.0)
            if name == "double_pendulum":
                scene.add_halfspace(normal=(-1, 0, 0), offset=-0.2)
            where = {"position": (0, 0, height)} if free else {}
            start = {"joints": joints, "velocity": velocity} if kind == "limits" else {}
            scene.add_urdf(path, base="free" if free else "fixed", **start, **where)
            return scene.build()

        if not free:
            return build(0.0)
        above = build(5.0)
        floor = next(c for c in above.constraints.constraints if isinstance(c, HalfSpaceContacts))
        problem = build(5.01 - floor.gap(0.0, above.q0).min())
    v0 = problem.v0.copy()
    v0[2] = -0.5
    return mbvi.Problem(
        problem.system, problem.constraints.constraints, problem.q0, v0, restitution=problem.restitution,
        length=problem.length, scene=problem.scene,
    )  # fmt: skip


def state_of(path, free, kind, rng):
    """Positions and velocities of the joints by name."""
    model = pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if free else []))
    joints, velocity = {}, {}
    for joint in range(2 if free else 1, model.njoints):
        if model.nqs[joint] != 1:
            continue
        name, k = model.names[joint], model.idx_qs[joint]
        lower, upper = model.lowerPositionLimit[k], model.upperPositionLimit[k]
        if kind == "limits" and np.isfinite(lower) and np.isfinite(upper) and upper - lower < 20.0:
            near = rng.random() < 0.4
            joints[name] = upper - 0.02 * (upper - lower) * rng.random() if near else 0.5 * (lower + upper)
            velocity[name] = 1.0 if near else 0.3 * rng.normal()
        else:
            velocity[name] = 0.3 * rng.normal()
    return joints, velocity


def run_of(name, kind, e):
    return mbvi.simulate(problem_of(name, kind, e), mbvi.Paoli(), step=STEP, duration=DURATION, progress=False)


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
