"""Random heaps of boxes, capsules, cylinders, hulls and spheres that fall into a box, in any order and unit."""

import numpy as np
from scipy.spatial.transform import Rotation

import mbvi

# no body reaches farther from its centre than this [m]; distance of the centres
REACH, PITCH = 0.05, 0.102
KINDS = ("box", "capsule", "cylinder", "hull", "sphere")
# without shapes whose rows leave a choice: where the edge of a face cuts the line along which it touches the side of a
# cylinder there is no row, and which point of that line is the deepest one is up to rounding
UNIQUE = ("box", "capsule", "hull", "sphere")


def heap(seed, count, e=0.0, length=1.0, gravity=9.81, order=None, box=True, kinds=KINDS):
    """Return the problem of a random heap, whose bodies have random masses, poses and velocities.

    Parameters
    ----------
    seed : int
        What is drawn.
    count : int
        The number of bodies.
    e : float
        Restitution of all contacts.
    length : float
        What all lengths, velocities and gravity are multiplied by.
    gravity : float
        Acceleration along -z [m/s^2].
    order : sequence of int, optional
        The order in which the bodies are added; spheres still come last in q.
    box : bool
        Whether a floor and four walls are around the bodies; else they fly towards their middle.
    kinds : sequence of str
        The shapes to draw from.
    """
    rng = np.random.default_rng(seed)
    along = max(2, round(count ** (1 / 3)))
    half = 0.5 * PITCH * along
    sites = PITCH * (np.stack(np.unravel_index(np.arange(count), (-(-count // along**2), along, along))[::-1], 1) + 0.5)
    sites -= [half, half, 0.0]
    scene = mbvi.Scene(gravity=(0.0, 0.0, -gravity * length), restitution=e)
    if box:
        scene.add_container(length * np.array([-half, -half, 0.0]), length * np.array([half, half]), name="box")
    drawn, turns = rng.choice(kinds, size=count), Rotation.random(count, random_state=rng.integers(1 << 30))
    masses, sizes = rng.uniform(0.2, 5.0, count), REACH * rng.uniform(0.5, 0.577, (count, 3))
    towards = sites.mean(axis=0) - sites if not box else np.array([0.0, 0.0, -0.3])
    velocities = length * (0.3 * rng.normal(size=(count, 3)) + 3.0 * towards)
    spins, corners = 2.0 * rng.normal(size=(count, 3)), rng.normal(size=(count, 12, 3))
    corners *= REACH / np.linalg.norm(corners, axis=2, keepdims=True)
    for k in range(count) if order is None else order:
        a, b, c = (length * sizes[k]).tolist()
        body = {"position": length * sites[k], "velocity": velocities[k], "name": f"body {k}"}
        turning = {"rotation": turns[k].as_matrix(), "angular_velocity": spins[k]}
        if drawn[k] == "sphere":
            scene.add_sphere(1.3 * a, masses[k], **body)
        elif drawn[k] == "box":
            scene.add_box((2 * a, 2 * b, 2 * c), masses[k], **body, **turning)
        elif drawn[k] == "capsule":
            scene.add_capsule(0.9 * a, a, masses[k], **body, **turning)
        elif drawn[k] == "cylinder":
            scene.add_cylinder(1.2 * a, 2 * b, masses[k], **body, **turning)
        else:
            at = {"rotations": turning["rotation"], "velocities": [velocities[k]], "angular_velocities": [spins[k]]}
            scene.add_convex(length * corners[k], [body["position"]], masses[k], name=body["name"], **at)
    return scene.build()


def linear(problem, v):
    """Return the velocities of the centres of mass, or positions from q, shape (n, 3)."""
    bodies = len(problem.scene.items.bodies)
    width = 7 if len(v) == problem.system.nq else 6
    return np.concatenate([v[: width * bodies].reshape(-1, width)[:, :3], v[width * bodies :].reshape(-1, 3)])


def masses(problem):
    """Return the masses in the order of `linear`, shape (n,)."""
    items = problem.scene.items
    return np.concatenate([[body.mass for body in items.bodies], *(spheres.masses for spheres in items.spheres)])
