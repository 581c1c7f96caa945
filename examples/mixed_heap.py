"""A quadruped stands in a shower of boxes, capsules, cylinders, hulls and spheres: the floor carries them all.

`python examples/mixed_heap.py mixed.html 500` runs it among 500 boxes and writes the replay too.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import mbvi

robots = Path(__file__).parents[1] / "robots"
G, DENSITY, R = 9.81, 500.0, 0.03
CROUCH = np.tile([0.0, 0.7, -1.4], 4)


def hold(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return torques of springs in the twelve joints; the first six entries belong to the free base and are zero."""
    torque = np.zeros(18)
    torque[6:] = 60.0 * (CROUCH - q[7:]) - 1.0 * v[6:]
    return torque


def scene_of(boxes: int) -> mbvi.Scene:
    """Return a scene of so many boxes, a fifth as many of each other shape, and a quadruped below them."""
    kinds = np.repeat(np.arange(5), [boxes, *[boxes // 5] * 4])
    rng = np.random.default_rng(1)
    rng.shuffle(kinds)
    # layers of random poses above the robot, in a container that they fill about half as high as it is wide
    along = max(6, round((2.0 * len(kinds)) ** (1 / 3)))
    layer, row, column = np.unravel_index(np.arange(len(kinds)), (-(-len(kinds) // along**2), along, along))
    pitch = 4.0 * R
    places = pitch * np.stack([row - 0.5 * (along - 1), column - 0.5 * (along - 1), layer], axis=1) + [0, 0, 0.55]
    turns = Rotation.random(len(kinds), random_state=2).as_matrix()

    scene, half = mbvi.Scene(), 0.5 * pitch * along
    scene.add_container((-half, -half, 0.0), (half, half), name="box")
    angles = zip(("hip", "thigh", "calf"), CROUCH[:3], strict=True)
    joints = {f"{leg}_{part}_joint": angle for part, angle in angles for leg in ("FL", "FR", "RL", "RR")}
    scene.add_urdf(robots / "quadruped/quadruped.urdf", position=(0, 0, 0.34), joints=joints, control=hold)
    at = [np.flatnonzero(kinds == kind) for kind in range(5)]
    scene.add_boxes(places[at[0]], (2 * R, 1.6 * R, 1.2 * R), density=DENSITY, rotations=turns[at[0]])
    for k in at[1]:
        scene.add_capsule(0.7 * R, 1.4 * R, 0.03, position=places[k], rotation=turns[k])
    for k in at[2]:
        scene.add_cylinder(0.8 * R, 1.6 * R, 0.05, position=places[k], rotation=turns[k])
    # corners on a spiral around a ball
    z = np.linspace(-1.0, 1.0, 18)[1:-1]
    angle = 2.4 * np.arange(len(z))
    stone = 0.9 * R * np.stack([np.sqrt(1.0 - z * z) * np.cos(angle), np.sqrt(1.0 - z * z) * np.sin(angle), z], axis=1)
    scene.add_convex(stone, places[at[3]], density=DENSITY, rotations=turns[at[3]], name="stones")
    scene.add_spheres(places[at[4]], 0.8 * R, density=DENSITY)
    return scene


def main(page: str | None = None, boxes: int = 20, duration: float = 0.5) -> float:
    """Return the percussions of the floor over weight times duration plus the gain of momentum, which is 1."""
    problem = scene_of(boxes).build()
    run = mbvi.simulate(problem, step=2e-3, duration=duration, every=5, record="contacts")
    print(run.notes[0])
    print("\n".join(line.strip() for line in problem.report().splitlines() if "pairs of" in line))
    # of the velocities, those that lift the base of the robot, the bodies and the spheres
    up, spheres = np.zeros(problem.system.nv), 3 * (boxes // 5)
    up[2], up[20 : len(up) - spheres : 6], up[len(up) - spheres + 2 :: 3] = 1.0, 1.0, 1.0
    weight = -float(problem.system.force(0.0, problem.q0, problem.v0) @ up)
    # contact_forces gives the mean force on the floor between two recorded states, which points down
    floor = -float(run.contact_forces("box/floor")[1:, 2] @ np.diff(run.t))
    gained = upward_momentum(problem, run.q[-1], run.v[-1])
    print(f"the floor gives {floor:.3f} N s, weight times time is {weight * duration:.3f}, momentum gains {gained:.3f}")
    print(f"deepest penetration {run.penetration().max():.1e} m")
    if page:
        run.replay_html(page)
    return floor / (weight * duration + gained)


def upward_momentum(problem: mbvi.Problem, q: np.ndarray, v: np.ndarray) -> float:
    """Return the momentum of all along z [kg m/s]: the rate of the potential energy over g."""
    system, h = problem.system, 1e-6
    above, below = (system.potential_energy(0.0, system.integrate(q, sign * h * v)) for sign in (1.0, -1.0))
    return float(above - below) / (2.0 * h * G)


if __name__ == "__main__":
    print(f"the floor gives {main(*sys.argv[1:2], *map(int, sys.argv[2:3])):.4f} of what the momentum demands")
