"""Position projection with restitution does not depend on the order in which bodies are added to a scene."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi

SCHEMES = [
    mbvi.Centered(project_positions=True), mbvi.Paoli(project_positions=True), mbvi.MoreauJean(project_positions=True)
]  # fmt: skip
STEP, DURATION = 4e-3, 0.8


def bodies_that_fall(seed, order, friction):
    """Boxes, cylinders and hulls above each other, turned and spinning at random, added in an order."""
    rng, scene, parts = np.random.default_rng(seed), mbvi.Scene(restitution=0.5, friction=friction), []
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(len(order)):
        kind, place = rng.integers(3), np.array([*rng.uniform(-0.03, 0.03, 2), 0.25 + 0.32 * k])
        turn = Rotation.random(random_state=int(rng.integers(1e6))).as_matrix()
        velocity, spin, points = 0.3 * rng.normal(size=3), 2.0 * rng.normal(size=3), rng.normal(size=(12, 3))
        points *= (0.15, 0.13, 0.1) / np.linalg.norm(points, axis=1)[:, None]
        parts.append((kind, place, turn, velocity, spin, points, rng.uniform(0.5, 2.0)))
    for k in order:
        kind, place, turn, velocity, spin, points, mass = parts[k]
        start = {"position": place, "rotation": turn, "velocity": velocity, "angular_velocity": spin, "mass": mass}
        if kind == 0:
            scene.add_box((0.25, 0.18, 0.12), **start)
        elif kind == 1:
            scene.add_cylinder(0.08, 0.16, **start)
        else:
            moves = {"rotations": [turn], "velocities": [velocity], "angular_velocities": [spin]}
            scene.add_convex(points, [place], [mass], **moves)
    return scene.build()


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_order_in_which_bodies_are_added_does_not_matter(scheme, count, friction):
    """Which contact is the same as one before is told by points that both bodies carry, not the first of them."""
    for seed in range(6):
        found = []
        for order in (list(range(count)), list(range(count))[::-1]):
            problem = bodies_that_fall(seed, order, friction)
            run = mbvi.simulate(problem, scheme, step=STEP, duration=DURATION, progress=False)
            found.append(run.q.reshape(len(run.q), -1, 7)[:, np.argsort(order), :3])
        np.testing.assert_allclose(found[1], found[0], rtol=0.0, atol=1e-9, err_msg=str(seed))
