"""Position projection raises contacts and limits that stay in penetration within two steps, whatever else strikes."""

import warnings

import numpy as np
import pytest

import mbvi
from mbvi.projection import Projector
from mbvi.schemes.positions import least_displacement, position_projection
from support.paths import real_robot
from support.robot_problems import OWN, path_of

SCHEME = mbvi.Centered(project_positions=True)
MORE = {"alex": "alex_description/urdf/alex_sake_hands.urdf", "go2": "go2_description/urdf/go2.urdf"}
# lengths of the scene: what a search leaves out of the many points of one face is below it
DEPTH = 1e-4
# steps after which a row must be raised
STEPS = 2


def dropped(name, height, e, mu, rng):
    """A robot that falls and turns; its lowest point is at a height over a floor [m]."""
    path = path_of(name) if name in OWN else real_robot(MORE[name])
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    with warnings.catch_warnings():
        # loaders of some descriptions warn about what they leave out
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        scene.add_urdf(path, position=(0, 0, 5.0), name="robot")
        problem = scene.build()
    rows, q, v = problem.constraints, problem.q0.copy(), problem.v0.copy()
    floor = [k for k in range(len(rows)) if rows.name(k).endswith("| floor")]
    q[2] += height - float(rows.gap(problem.t0, q)[floor].min())
    v += 0.5 * rng.normal(size=len(v))
    return problem.at(q, v)


def deep_and_still(problem, step, h):
    """Return the constraints with a row that is deep and would neither leave nor close by half of it in a step."""
    rows = problem.constraints.active(step.t, step.q, problem.tolerance)
    lever = problem.constraints.levers(rows.constraint)
    depth, change = -lever * rows.gap, h * lever * rows.speeds(step.v)
    return set(rows.constraint[(depth > DEPTH * problem.length) & (2.0 * np.abs(change) < depth)].tolist())


def longest(problem, h, duration):
    """Return for how many steps a row stays deep and still, and how often one is."""
    age, most, found = {}, 0, 0
    for step in mbvi.steps(problem, SCHEME, step=h):
        if step.t > duration:
            return most, found
        deep = deep_and_still(problem, step, h)
        struck = step.active.constraint[(step.percussion > 0.0) & (step.before < 0.0) & (step.active.restitution > 0.0)]
        # a rebound is another impact
        age = {c: age.get(c, 0) + 1 for c in deep.difference(struck.tolist())}
        most, found = max(most, max(age.values(), default=0)), found + len(deep)


CASES = [(name, e, mu) for name in ("quadruped", "biped", "alex", "go2") for e in (0.0, 0.5) for mu in (0.0, 0.6)]


@pytest.mark.parametrize(("name", "e", "mu"), CASES)
def test_no_row_stays_deep(name, e, mu, rng):
    for h in (1e-3, 5e-3):
        most, _ = longest(dropped(name, 0.05, e, mu, rng), h, 0.3)
        assert most <= STEPS


def test_where_contacts_cannot_be_projected_others_and_limits_are(monkeypatch):
    """Contacts of one of two robots contradict each other: the other robot, and the first one's limit, are raised."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    for k, name in enumerate(("stuck", "loose")):
        scene.add_urdf(path_of("hopper"), position=(3.0 * k, 0, 0.6), joints={"knee": 0.4}, name=name)
    problem = scene.build()
    rows, q = problem.constraints, problem.q0.copy()
    names = [rows.name(k) for k in range(len(rows))]
    gap = rows.gap(0.0, q)
    floor = np.array([name.endswith("| floor") for name in names])
    limit = next(k for k, name in enumerate(names) if name.startswith("stuck/knee upper"))
    stuck = {k for k, name in enumerate(names) if name.startswith("stuck/") and floor[k]}
    parts = problem.system.located_parts()
    for part, place, _, _ in parts:
        q[place + part.nq - 1] += gap[limit] + 1e-3
    lowest = rows.gap(0.0, q)[floor].min()
    for _, place, _, _ in parts:
        q[place + 2] -= lowest + 1e-3
    tried, displacement = [], least_displacement.least_displacement

    def contradicts(sunken, floor, sticking=None):
        raised = set(sunken.active.constraint[floor > np.minimum(sunken.active.gap, 0.0)].tolist())
        tried.append(raised)
        return None if raised & stuck else displacement(sunken, floor, sticking)

    for module in (position_projection, least_displacement):
        monkeypatch.setattr(module, "least_displacement", contradicts)
    step = SCHEME.step(problem, 0.0, q, problem.v0, 1e-3, Projector())
    before, after = rows.gap(0.0, q), rows.gap(0.0, step.q)
    deep = before < -5e-4
    held = np.isin(np.arange(len(names)), list(stuck))
    assert (deep & held).any() and deep[limit] and (deep & floor & ~held).any()
    assert tried[0] & stuck
    assert (after[deep & ~held] > -1e-7).all()
    assert (after[deep & held] > before[deep & held] - 1e-4).all()
