"""Contacts between free bodies keep momentum and angular momentum, wherever positions are projected or not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from support.momentum import momentum

PROJECTING = [scheme(project_positions=True) for scheme in (mbvi.Centered, mbvi.Paoli, mbvi.MoreauJean)]
SCHEMES = [*PROJECTING, mbvi.Centered(), mbvi.Paoli()]
OCTAHEDRON = "".join(f"v {x} {y} {z}\n" for x, y, z in 0.15 * np.concatenate([np.eye(3), -np.eye(3)]))
OCTAHEDRON += "f 1 2 3\nf 2 4 3\nf 4 5 3\nf 5 1 3\nf 2 1 6\nf 4 2 6\nf 5 4 6\nf 1 5 6\n"


@pytest.fixture(scope="module", autouse=True)
def octahedron(tmp_path_factory):
    (tmp_path_factory.getbasetemp() / "octahedron.obj").write_text(OCTAHEDRON)


def add_even(scene, kind, folder, **body):
    """Add a body of equal moments of inertia: in flight it keeps its angular velocity."""
    turn = {name: body.pop(name) for name in ("rotation", "angular_velocity")}
    if kind == "ball":
        scene.add_sphere(0.15, **body)
    elif kind == "round":
        scene.add_ellipsoid((0.12, 0.12, 0.12), **body, **turn)
    elif kind == "cube":
        scene.add_box((0.2, 0.2, 0.2), **body, **turn)
    else:
        scene.add_mesh(folder / "octahedron.obj", **body, **turn)


def meeting(kinds, e, mu, rng, folder, add=add_even):
    """Two bodies alone in space that meet obliquely, each turned and spinning."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e, friction=mu)
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    for kind, side in zip(kinds, (-1.0, 1.0), strict=True):
        add(
            scene, kind, folder, mass=rng.uniform(0.5, 3.0), position=0.25 * side * n + 0.04 * rng.normal(size=3),
            rotation=Rotation.random(rng=rng).as_matrix(), velocity=-2.0 * side * n + 0.4 * rng.normal(size=3),
            angular_velocity=4.0 * rng.normal(size=3),
        )  # fmt: skip
    return scene.build()


def largest_changes(problem, states):
    """Return the largest relative changes of both momenta from one state to the next."""
    found, before = np.zeros(2), momentum(problem, problem.q0, problem.v0)
    for q, v in states:
        after = momentum(problem, q, v)
        changes = [np.linalg.norm(a - b) for a, b in zip(after[:2], before[:2], strict=True)]
        found, before = np.maximum(found, np.array(changes) / before[2:]), after
    return found


EVEN = [("ball", "ball"), ("round", "ball"), ("cube", "ball"), ("cube", "cube"), ("hull", "cube"), ("hull", "hull")]


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("kinds", EVEN, ids="-".join)
def test_two_bodies_that_meet_keep_both_momenta_in_every_step(kinds, e, mu, tmp_path_factory):
    struck = 0
    for seed in range(3):
        problem = meeting(kinds, e, mu, np.random.default_rng([seed, 7]), tmp_path_factory.getbasetemp())
        for scheme, h in [(SCHEMES[0], 1e-3), (SCHEMES[0], 6e-3), *((scheme, 4e-3) for scheme in SCHEMES[1:])]:
            steps = [step for _, step in zip(range(int(0.25 / h)), mbvi.steps(problem, scheme, step=h), strict=False)]
            struck += any(step.percussion.any() for step in steps)
            assert largest_changes(problem, [(step.q, step.v) for step in steps]).max() < 1e-13
    assert struck > 12
