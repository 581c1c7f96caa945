"""Poses of the shapes of a scene."""

import numpy as np


def places_of(problem, q, names):
    """Poses of shapes by name, shape (n, 4, 3)."""
    shapes = {s.name: s for s in problem.scene.shapes}
    poses = []
    for name in names:
        placed = shapes[name]
        own = np.vstack([placed.rotation.T, placed.position])
        if placed.body:
            world = problem.system.placements(q, np.array([placed.body]))[0]
            own = np.vstack([own[:3] @ world[:3], own[3] @ world[:3] + world[3]])
        poses.append(own)
    return np.array(poses)
