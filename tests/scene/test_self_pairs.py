"""A robot's own pairs: the search for overlaps answers as one distance for each pair does."""

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mbvi.geometry.shapes.shapes import Box, Capsule, Hull, PlacedShape, Sphere, length_unit
from mbvi.scene.urdf.self_pairs import Overlaps

_TOUCHING = 1e-5


def shapes(rng, length):
    made = [Box((0.3, 0.2, 0.5)), Capsule(0.1, 0.4), Sphere(0.2), Hull(rng.normal(size=(30, 3)))]
    made += [Hull(rng.normal(size=(12, 3)) * 0.1 + 0.5)]
    scaled = [Box(tuple(length * x for x in made[0].size)), Capsule(0.1 * length, 0.4 * length), Sphere(0.2 * length)]
    scaled += [Hull(hull.vertices * length) for hull in made[3:]]
    return [PlacedShape(f"link{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate(scaled)]


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
@given(seed=st.integers(0, 2**32 - 1))
def test_overlaps_are_those_of_single_distances(length, seed):
    rng = np.random.default_rng(seed)
    placed = shapes(rng, length)
    poses = [
        [(Rotation.random(random_state=rng).as_matrix(), length * rng.normal(size=3)) for _ in placed] for _ in "ab"
    ]
    found = Overlaps(placed, poses)
    for i, a in enumerate(placed):
        for j in range(i + 1, len(placed)):
            b = placed[j]
            unit, distances = length_unit([min(a.shape.bound, b.shape.bound)]), []
            for pose in poses:
                sides = [
                    (s.shape.coal(unit), coal.Transform3s(pose[k][0], pose[k][1] / unit)) for s, k in ((a, i), (b, j))
                ]
                distances.append(coal.distance(*sides[0], *sides[1], coal.DistanceRequest(), coal.DistanceResult()))
            # both answers are right where the distance is the limit but for Coal's tolerance
            if abs(min(distances) - _TOUCHING) > 1e-5:
                assert found(i, j) == (min(distances) <= _TOUCHING)
