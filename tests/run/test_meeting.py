"""Where the tunnelling guard shortens a step, against separations of boxes at thousands of places, in plain numpy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints.relative_ways import steady_approach
from mbvi.run.meeting import DEPTH, Meeting
from mbvi.run.tunnelling import TunnellingGuard
from mbvi.schemes import Step

STEP = 5e-3
SHARE = np.linspace(0.0, 1.0, 2001)
# edges of both boxes [m]
SIZES = {
    "plate and box": ((0.6, 0.4, 0.02), (0.03, 0.05, 0.02)),
    "plate and needle": ((0.6, 0.4, 0.02), (0.5, 0.01, 0.01)),
    "thin plates": ((0.3, 0.3, 0.004), (0.2, 0.2, 0.004)),
    "needles": ((0.6, 0.01, 0.01), (0.6, 0.01, 0.01)),
}


def separations(first, second, sizes):
    """The largest separation of two boxes along an axis at each of n poses, negative where they overlap, shape (n,)."""
    (turn, place), (other, there) = first, second
    half, wide = 0.5 * np.array(sizes)
    edges = [np.cross(turn[:, :, i], other[:, :, j]) for i in range(3) for j in range(3)]
    axes = np.stack([*np.moveaxis(turn, 2, 0), *np.moveaxis(other, 2, 0), *edges], axis=1)
    length = np.linalg.norm(axes, axis=2)
    axes /= np.maximum(length, 1e-6)[:, :, None]
    found = np.abs(np.einsum("nai,ni->na", axes, there - place))
    found -= np.abs(axes @ turn) @ half + np.abs(axes @ other) @ wide
    return np.where(length > 1e-6, found, -np.inf).max(axis=1)


def thrown(rng, sizes, turn):
    """Two boxes that fly together and turn by up to `turn` in a step; one may strike the other or just miss it."""
    common = rng.choice([0.0, 100.0, 400.0]) * rng.normal(size=3)
    thickness = 0.5 * (min(sizes[0]) + min(sizes[1]))
    poses = Rotation.random(2, random_state=rng.integers(1 << 30))
    spins = rng.normal(size=(2, 3))
    spins *= turn * rng.uniform(size=(2, 1)) / STEP / np.linalg.norm(spins, axis=1, keepdims=True)
    way = rng.normal(size=3)
    way *= 10.0 ** rng.uniform(0.7, 2.0) / np.linalg.norm(way)
    aim = poses[0].apply(rng.uniform(-0.8, 0.8, 3) * sizes[0]) + rng.choice([0.0, 0.5, 2.0]) * thickness * rng.normal(
        size=3
    )
    scene = mbvi.Scene(gravity=(0, 0, 0))
    places, velocities = (np.zeros(3), aim - STEP * rng.uniform(0.1, 0.9) * way), (common, common + way)
    for size, pose, spin, place, velocity in zip(sizes, poses, spins, places, velocities, strict=True):
        start = {"position": place, "rotation": pose.as_matrix(), "velocity": velocity, "angular_velocity": spin}
        scene.add_box(size, 1.0, **start)
    return scene


def along(problem, scheme):
    """The free motion of a step: both ends, and poses of both bodies at each share, without the common velocity."""
    system, q, v = problem.system, problem.q0, problem.v0
    coasts = scheme.timing.coasts
    end, after = system.coast(v, STEP) if coasts else (STEP * v, v)
    state = Step(0.0, q, v, None, None, 0.0)
    new = state._replace(t=STEP, q=system.integrate(q, end), v=after)
    begin, last = (system.placements(state.q, np.array([1, 2])) for state in (state, new))
    # its second half is known from the end
    back = SHARE > scheme.timing.jump
    half = [
        system.coast(w, (x - y) * STEP)[0]
        for x, y, w in zip(SHARE, back, np.where(back[:, None], after, v), strict=True)
    ]
    poses = []
    for k in range(2):
        turns = np.array(half)[:, 6 * k + 3 : 6 * k + 6] if coasts else SHARE[:, None] * STEP * v[6 * k + 3 : 6 * k + 6]
        # rows of a placement are axes of the body
        start = np.where((back & coasts)[:, None, None], last[k, :3].T, begin[k, :3].T)
        place = begin[k, 3] + SHARE[:, None] * STEP * (v[6 * k : 6 * k + 3] - v[:3])
        poses.append((start @ Rotation.from_rotvec(turns).as_matrix(), place))
    return state, new, poses


def judged(rng, sizes, turn, scheme):
    """Separations along a step, and the part of it that the guard takes; None where the boxes overlap at the start."""
    try:
        problem = thrown(rng, sizes, turn).build()
    except mbvi.InadmissibleStartError:
        return None
    state, new, poses = along(problem, scheme)
    return separations(*poses, sizes), TunnellingGuard(problem, scheme, STEP).passed(state, new, STEP)


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered()], ids=["straight", "coasting"])
@pytest.mark.parametrize("turn", [0.0, 0.25, 1.0])
@pytest.mark.parametrize("kind", SIZES)
def test_the_guard_acts_where_bodies_meet_and_nowhere_else(kind, turn, scheme):
    rng, passed, apart, sizes = np.random.default_rng(1), 0, 0, SIZES[kind]
    thickness = 0.5 * (min(sizes[0]) + min(sizes[1]))
    for _ in range(90):
        found = judged(rng, sizes, turn, scheme)
        if found is None:
            continue
        gaps, part = found
        if gaps[-1] > 0.0 and gaps.min() < -0.3 * thickness:
            passed += 1
            assert part < 1.0
        if gaps.min() > 1e-5 * thickness:
            apart += 1
            assert part == 1.0
        elif part < 1.0:
            # just after they touch
            before = np.searchsorted(SHARE, part)
            assert gaps[:before].min() > -2.0 * DEPTH * thickness
            assert gaps[max(before - 1, 0) : before + 1].min() < 1e-3 * thickness
    assert passed > 3
    assert apart > 3


def rolling(gap, spin):
    """A needle that slides along a plate by fifty thicknesses and turns about its normal, above it or within it."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((4.0, 4.0, 0.02), 1.0, velocity=(30, 0, 300))
    start = {"position": (0, 0, 0.015 + gap), "velocity": (130, 0, 300), "angular_velocity": (0, 0, spin)}
    scene.add_box((0.2, 0.01, 0.01), 1.0, **start)
    return scene.build()


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered()], ids=["straight", "coasting"])
@pytest.mark.parametrize("spin", [0.0, 40.0, 200.0])
@pytest.mark.parametrize("gap", [3e-6, 1e-4])
def test_what_slides_past_closely_is_not_cut(gap, spin, scheme):
    problem = rolling(gap, spin)
    state, new, _ = along(problem, scheme)
    assert TunnellingGuard(problem, scheme, STEP).passed(state, new, STEP) == 1.0


def test_a_gap_that_stays_undecided_counts_as_met():
    """The bound is a thousand times larger than the gap changes, and the search ends before the pair meets."""
    asked = []

    def approach(x, close):
        asked.append(x)
        return steady_approach(0.9 - x, 1e3)

    share = Meeting(approach, 1e-8, 1e3, 0.1).touching()
    assert 0.0 < share < 0.9
    assert len(asked) < 1000


def test_what_touches_at_the_start_is_cut_before_it_is_deep_although_it_sinks_slowly():
    """A small box slides along a plate by a hundred times its thickness, and sinks by more than that of both."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((4.0, 4.0, 0.02), 1e3)
    start = {"position": (-1.0, 0, 0.0149999999), "velocity": (400.0, 0, -6.0)}
    scene.add_box((0.01, 0.01, 0.01), 1.0, **start)
    problem = scene.build()
    state, new, poses = along(problem, mbvi.Paoli())
    gaps = separations(*poses, ((4.0, 4.0, 0.02), (0.01, 0.01, 0.01)))
    assert gaps.min() < -0.9 * 0.015
    part = TunnellingGuard(problem, mbvi.Paoli(), STEP).passed(state, new, STEP)
    assert part < 1.0
    assert gaps[np.searchsorted(SHARE, part)] > -0.05 * 0.015
