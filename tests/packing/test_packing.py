"""Packings: nothing overlaps, all is inside, the same seed gives the same bytes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import mbvi
from mbvi import packing
from mbvi_studies.spheres import cube_of_spheres

SIZES = {
    "constant": 0.05,
    "uniform 1:20": packing.uniform(0.005, 0.1),
    "lognormal": packing.lognormal(0.03, 0.5, 0.01, 0.1),
}
LOW, HIGH = np.array([-1.0, 0.0, 2.0]), np.array([0.0, 1.5, 3.0])


def least_gap(pack):
    """The least distance of two surfaces [m]."""
    positions, radii = pack
    i, j = cKDTree(positions).query_pairs(2.2 * radii.max(), output_type="ndarray").T
    apart = np.linalg.norm(positions[i] - positions[j], axis=1) - radii[i] - radii[j]
    return apart.min(initial=np.inf)


def volume(pack):
    return 4 / 3 * np.pi * (pack.radii**3).sum()


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@given(seed=st.integers(0, 2**32), fraction=st.floats(0.02, 0.25))
@settings(max_examples=8)
def test_a_random_packing_fills_its_fraction_of_the_box_without_overlap(size, seed, fraction):
    pack = packing.random_loose(LOW, HIGH, size, fraction=fraction, seed=seed)
    assert least_gap(pack) >= 0.0
    assert (pack.positions - pack.radii[:, None] >= LOW - 1e-12).all()
    assert (pack.positions + pack.radii[:, None] <= HIGH + 1e-12).all()
    # to within one sphere, of which the largest has 4.2e-3 m^3
    assert fraction * 1.5 - 4.2e-3 < volume(pack) <= fraction * 1.5
    again = packing.random_loose(LOW, HIGH, size, fraction=fraction, seed=seed)
    assert [a.tobytes() for a in again] == [a.tobytes() for a in pack]


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@given(seed=st.integers(0, 2**32), clearance=st.floats(0.0, 0.5))
@settings(max_examples=20)
def test_layers_overlap_nowhere_and_stay_above_their_floor(size, seed, clearance):
    pack = packing.layers((0, 0, 1), (1.0, 0.7), size, count=300, clearance=clearance, seed=seed)
    assert least_gap(pack) >= -1e-12
    lowest, highest = pack.positions - pack.radii[:, None], pack.positions + pack.radii[:, None]
    assert (lowest >= np.array([0, 0, 1]) - 1e-12).all() and (highest[:, :2] <= np.array([1.0, 0.7]) + 1e-12).all()
    again = packing.layers((0, 0, 1), (1.0, 0.7), size, count=300, clearance=clearance, seed=seed)
    assert [a.tobytes() for a in again] == [a.tobytes() for a in pack]


@given(jitter=st.floats(0.0, 0.5), seed=st.integers(0, 2**32))
def test_a_lattice_with_jitter_never_overlaps(jitter, seed):
    pack = packing.lattice((3, 4, 5), packing.uniform(0.1, 0.2), corner=(1, 2, 3), jitter=jitter, seed=seed)
    assert len(pack.radii) == 60 and least_gap(pack) >= -1e-12
    assert np.abs(pack.positions.min(axis=0) - [1, 2, 3]).max() <= jitter


def test_the_cube_of_spheres_that_is_shipped():
    problem = cube_of_spheres(0.5)
    pack = packing.Packing(problem.q0.reshape(-1, 3), np.full(216, 0.1))
    assert pack.positions[:, 2].min() == pytest.approx(1.101)
    np.testing.assert_allclose(pack.positions[:, :2].mean(axis=0), 0.0, atol=1e-3)
    assert 0.0 < least_gap(pack) < 0.01
    assert problem.constraints.largest_restitution == 0.5


def test_sizes_follow_their_distribution():
    radii = packing.random_loose((0, 0, 0), (9, 9, 9), packing.lognormal(0.03, 0.4, 0.005, 0.2), count=4000).radii
    assert np.median(radii) == pytest.approx(0.03, rel=0.03) and np.log(radii).std() == pytest.approx(0.4, rel=0.05)
    radii = packing.layers((0, 0, 0), (9, 9), packing.uniform(0.1, 0.2), count=4000).radii
    assert radii.mean() == pytest.approx(0.15, rel=0.02) and radii.std() == pytest.approx(0.1 / np.sqrt(12), rel=0.05)


def test_given_radii_keep_their_order():
    radii = np.array([0.1, 0.3, 0.2, 0.05])
    assert (packing.random_loose((0, 0, 0), (2, 2, 2), radii).radii == radii).all()
    assert (packing.layers((0, 0, 0), (2, 2), radii).radii == radii).all()
    assert (packing.lattice((2, 2, 1), radii).radii == radii).all()


def test_ten_thousand_spheres_of_1_to_20():
    pack = packing.random_loose((0, 0, 0), (3.5, 3.5, 4), packing.uniform(0.005, 0.1), count=10_000, seed=3)
    assert len(pack.radii) == 10_000 and least_gap(pack) >= 0.0


def test_what_was_poured_lies_in_the_box_and_starts_a_scene():
    low, high, sizes = (-0.1, -0.1, 0.2), (0.1, 0.1), packing.uniform(0.015, 0.02)
    pack = packing.poured(low, high, sizes, count=150, seed=5)
    loose = packing.layers(low, high, sizes, count=150, seed=5)
    assert least_gap(pack) >= -1e-15
    assert (pack.positions - pack.radii[:, None] >= np.array(low) - 1e-15).all()
    assert (pack.positions[:, :2] + pack.radii[:, None] <= np.array(high) + 1e-15).all()
    np.testing.assert_allclose(pack.radii, loose.radii, rtol=1e-4)
    # a dense packing under its own top: most of a random close one, that is 0.64 without walls
    top = np.quantile(pack.positions[:, 2], 0.9)
    below = pack.positions[:, 2] < top
    fraction = 4 / 3 * np.pi * (pack.radii[below] ** 3).sum() / (0.04 * (top - 0.2))
    assert 0.5 < fraction < 0.64
    scene = mbvi.Scene()
    scene.add_container(low, high)
    scene.add_spheres(*pack, density=2500.0)
    problem = scene.build()
    again = packing.poured(low, high, sizes, count=150, seed=5)
    assert [a.tobytes() for a in again] == [a.tobytes() for a in pack]
    # it stays where it is but for the last of its sloshing
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=2e-3, duration=0.1)
    assert np.abs(run.q[-1] - run.q[0]).max() < 0.01


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: packing.uniform(0.2, 0.1), "between two positive numbers"),
        (lambda: packing.lognormal(0.1, -1.0), "must be positive"),
        (lambda: packing.lognormal(0.1, 0.1, 0.2, 0.3), "between low and high"),
        (lambda: packing.lattice((2, 2, 2), 0.1, spacing=0.19), "could overlap"),
        (lambda: packing.lattice((2, 0, 2), 0.1), "three positive integers"),
        (lambda: packing.lattice((2, 2, 2), [0.1, 0.1]), "one number or 8 of them"),
        (lambda: packing.random_loose((0, 0, 0), (1, 1, 1), 0.1), "number of spheres is missing"),
        (lambda: packing.random_loose((0, 0, 0), (1, 1, 1), 0.1, fraction=1.5), "fraction must lie in"),
        (lambda: packing.random_loose((0, 0, 0), (1, 1, 1), 0.6, count=1), "does not fit"),
        (lambda: packing.random_loose((0, 0, 0), (1, 1, 1), 0.4, fraction=0.1), "one sphere is larger"),
        (lambda: packing.random_loose((0, 0, 0), (1, 1, 1), 0.3, count=5), "do not fit at random"),
        (lambda: packing.random_loose((0, 0, 0), (1, 0, 1), 0.1, count=5), "corners of a box"),
        (lambda: packing.random_loose((0, 0, 0), (1, 1, 1), [0.1, -0.1]), "every radius"),
        (lambda: packing.layers((0, 0, 0), (0.1, 1), 0.1, count=3), "no room"),
        (lambda: packing.layers((0, 0, 0), (1, 1), 0.1, count=3, clearance=-1.0), "clearance"),
        (lambda: packing.layers((0, 0), (1, 1), 0.1, count=3), "lower has shape"),
    ],
)
def test_wrong_input_says_what_is_wrong(call, message):
    with pytest.raises(mbvi.InputError, match=message):
        call()
