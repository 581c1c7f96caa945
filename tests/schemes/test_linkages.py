"""Linkages, a leg as Cassie's and a delta robot with drawn lengths against their motion in minimal coordinates."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from support.linkages import CassieLeg, Delta, FiveBar, FourBar, motion

DRAWN = np.random.default_rng(3).uniform(0.9, 1.1, size=(2, 7))
SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
]  # fmt: skip


def drawn(kind, scale):
    """A linkage whose lengths are scaled."""
    return kind(tuple(scale[: len(kind().lengths)] * kind().lengths))


def linkages(*kinds):
    """Parameters of tests: two drawn linkages of each kind, and the second number for each."""
    return [
        pytest.param(drawn(kind, scale), number, id=f"{kind.__name__}-{k}")
        for kind, number in kinds
        for k, scale in enumerate(DRAWN)
    ]


def centres(linkage, duration, *floor):
    """Where the bodies should be, and the times of impacts."""
    s, times = motion(linkage.rods, linkage.start, duration, *floor)
    return np.array([0.5 * (begin + end) for begin, end, *_ in linkage.rods(s)]), times


def found_centres(run, linkage):
    """Where they are."""
    bodies = list(run.problem.system.bodies[1:])
    return run.q[-1].reshape(-1, 7)[[bodies.index(name) for name in linkage.names], :3]


@pytest.mark.parametrize(
    ("linkage", "duration"), linkages((FourBar, 0.4), (FiveBar, 0.2), (CassieLeg, 0.2), (Delta, 0.12))
)
def test_the_motion_is_that_in_minimal_coordinates(linkage, duration):
    """`EventDriven` within ten tolerances, `Centered` at order 2; loops are closed to rounding."""
    problem, (expected, _) = linkage.scene().build(), centres(linkage, duration)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-10), duration=duration)
    assert np.abs(found_centres(run, linkage) - expected).max() <= 1e-9
    errors = []
    for step in (2e-3, 1e-3):
        run = mbvi.simulate(problem, mbvi.Centered(), step=step, duration=duration)
        errors.append(np.abs(found_centres(run, linkage) - expected).max())
        assert run.loop_gap().max() <= 1e-12
    assert 3.5 < errors[0] / errors[1] < 4.5, errors
    # it has moved
    assert np.abs(expected - centres(linkage, 0.0)[0]).max() > 0.03


def lowest(linkage):
    """Height of the lowest end at the start."""
    return min(min(begin[2], end[2]) for begin, end, *_ in linkage.rods(linkage.start))


def on_floor(linkage, drop, e, mu=0.0):
    """The problem above a floor, which a platform meets alone, and the height of that."""
    scene, height = linkage.scene(restitution=e, friction=mu), lowest(linkage) - drop
    scene.add_halfspace((0, 0, 1), height, name="floor")
    for name in linkage.names[:-1] if "platform" in linkage.names else ():
        scene.exclude("floor", name)
    return scene.build(), height


@pytest.mark.slow
@pytest.mark.parametrize(
    ("linkage", "case"),
    linkages((FourBar, (0.6, 0.3)), (FiveBar, (0.16, 0.04)), (CassieLeg, (0.16, 0.05)), (Delta, (0.12, 0.03))),
)
def test_impacts_are_those_in_minimal_coordinates(linkage, case):
    """`EventDriven` within ten tolerances, times of impacts too; fixed steps at order 1."""
    (duration, drop), e = case, 0.8
    problem, height = on_floor(linkage, drop, e)
    expected, times = centres(linkage, duration, height, e)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-10), duration=duration)
    assert len(times) > 0 and run.notes == ()
    np.testing.assert_allclose([impact.time for impact in run.impacts], times, rtol=0.0, atol=1e-9)
    assert np.abs(found_centres(run, linkage) - expected).max() <= 1e-9
    steps = duration / np.round(duration / np.array([1e-3, 5e-4, 2.5e-4, 1.25e-4]))
    for scheme in SCHEMES:
        runs = [mbvi.simulate(problem, scheme, step=h, duration=duration) for h in steps]
        errors = [np.abs(found_centres(run, linkage) - expected).max() for run in runs]
        # where in a step an impact falls makes errors irregular
        assert (errors <= 6.0 * steps).all(), scheme


def ends_apart(run, linkage):
    """How far both sides of each connection are apart, from the poses of the run and the points of the scene alone."""
    poses, bodies = run.q.reshape(len(run.t), -1, 7), list(run.problem.system.bodies[1:])
    starts = {
        name: 0.5 * (rod[0] + rod[1]) for name, rod in zip(linkage.names, linkage.rods(linkage.start), strict=True)
    }

    def seen(body, point):
        """Where a point that a body has at the start is, in the world."""
        if body == "world":
            return np.tile(point, (len(poses), 1))
        own = poses[:, bodies.index(body)]
        turns = Rotation.from_quat(own[:, 3:])
        return own[:, :3] + turns.apply(turns[0].inv().apply(point - starts[body]))

    apart = 0.0
    for one in run.problem.scene.items.connections:
        points = [one.at] if one.axis is None else [one.at, one.at + one.axis]
        for point in points:
            apart = max(apart, np.abs(seen(one.first, point) - seen(one.second, point)).max())
    return apart


# with friction and restitution Newton's law may raise the energy
@pytest.mark.filterwarnings("ignore:at t = .* raised the energy:mbvi.MbviWarning")
@pytest.mark.slow(seconds=15)
@pytest.mark.parametrize("kind", [FourBar, FiveBar, CassieLeg, Delta])
def test_loops_are_closed_for_ten_seconds_on_a_floor(kind, rng):
    """Other lengths and another scheme for each e, with and without friction."""
    cases = itertools.product((0.0, 0.5, 1.0), (0.0, 0.6))
    for (e, mu), scheme in zip(cases, itertools.cycle(SCHEMES), strict=False):
        linkage = drawn(kind, rng.uniform(0.9, 1.1, size=7))
        problem, _ = on_floor(linkage, 0.05, e, mu)
        run = mbvi.simulate(problem, scheme, step=2e-3, duration=10.0)
        assert run.impacts
        assert run.loop_gap().max() <= 1e-12
        assert ends_apart(run, linkage) <= 1e-12
