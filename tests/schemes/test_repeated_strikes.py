"""Impacts in which corners take over load, open, or strike again at once: located, by the law (8), recorded once."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import mbvi

LENGTH, WIDTH, HEIGHT, MASS = 0.6, 0.1, 0.02, 2.0


def struck(rates, e):
    """Return rates of both ends of a rod after the law (8), applied until no end closes, and the whole percussion."""
    inverse = np.diag([1.0 / MASS, 12.0 / (MASS * (LENGTH**2 + HEIGHT**2))])
    J, count, total = np.array([[1.0, LENGTH / 2], [1.0, -LENGTH / 2]]), 0, 0.0
    G, rates = J @ inverse @ J.T, np.array(rates)
    while rates.min() < 0.0:
        wanted, count = -e * rates, count + 1
        # the least percussions under rates >= wanted: of the first end alone, or of both
        for some in ([0], [1], [0, 1]):
            p = np.zeros(2)
            p[some] = np.linalg.solve(G[np.ix_(some, some)], (wanted - rates)[some])
            if p.min() >= 0.0 and (rates + G @ p >= wanted - 1e-12).all():
                break
        rates, total = rates + G @ p, total + p.sum()
    return rates, total, count


def rod(rates, e, friction=0.0, height=0.0):
    """A rod whose ends move at two vertical speeds, the second one on the floor, the first at a height."""
    scene = mbvi.Scene(restitution=e, gravity=(0, 0, 0), friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    turn = Rotation.from_rotvec([0, np.arcsin(height / LENGTH), 0])
    low = abs(turn.as_matrix()[2]) @ (LENGTH / 2, WIDTH / 2, HEIGHT / 2)
    # a turn about y lowers the end with x > 0
    spin, mean = (rates[1] - rates[0]) / LENGTH, np.mean(rates)
    rotation = turn.inv().as_matrix()
    scene.add_box(
        (LENGTH, WIDTH, HEIGHT), MASS, position=(0, 0, low), rotation=rotation, velocity=(0, 0, mean),
        angular_velocity=(0, spin, 0), name="rod",
    )  # fmt: skip
    return scene.build()


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("scheme", [mbvi.EventDriven(1e-8), mbvi.Adaptive(1e-3)], ids=str)
def test_an_end_that_opened_and_closes_in_an_impact_strikes_again(scheme, friction):
    """The law lets an end that opens at v close at e v, if the percussion of the other presses it down."""
    rates, percussion, count = struck([-1.0, 0.1], 0.5)
    assert count == 2
    run = mbvi.simulate(rod([-1.0, 0.1], 0.5, friction), scheme, duration=0.01)
    z, spin = run.v[-1, 2], run.v[-1, 4]
    # slips are of second order in the height of the rod
    np.testing.assert_allclose([z - spin * LENGTH / 2, z + spin * LENGTH / 2], rates, atol=0.02 * (friction > 0) + 1e-9)
    assert len(run.impacts) == 2
    total = sum(impact.percussion.sum() for impact in run.impacts)
    np.testing.assert_allclose(total, MASS * (z + 0.45), atol=1e-9)
    assert friction or total == pytest.approx(percussion, abs=1e-9)


def test_it_strikes_again_within_a_run_of_adaptive():
    """The second end is open by less than what counts as closed when the first one lands."""
    start = [-1.0, 0.004]
    rates, _, count = struck(start, 0.5)
    run = mbvi.simulate(rod(start, 0.5, height=5e-3), mbvi.Adaptive(1e-2), duration=0.01)
    z, spin = run.v[-1, 2], run.v[-1, 4]
    assert len(run.impacts) == count == 2
    np.testing.assert_allclose([z - spin * LENGTH / 2, z + spin * LENGTH / 2], rates, atol=1e-3)
    total = sum(impact.percussion.sum() for impact in run.impacts)
    np.testing.assert_allclose(total, MASS * (z - np.mean(start)), atol=1e-9)


def rocking_block():
    """A block that falls back from its edge onto the other one, and the time and speed of that."""
    wide, high, angle = 0.1, 0.3, 0.15
    scene = mbvi.Scene(friction=0.8)
    scene.add_halfspace((0, 0, 1), name="floor")
    low = wide * np.sin(angle) + high * np.cos(angle)
    turn = Rotation.from_rotvec([0, angle, 0]).as_matrix()
    scene.add_box((2 * wide, 0.2, 2 * high), MASS, position=(0, 0, low), rotation=turn, name="block")
    reach, slant = np.hypot(wide, high), np.arctan2(wide, high)

    def falls(t, y):
        return [y[1], -0.75 * 9.81 / reach * np.sin(slant - y[0])]

    def flat(t, y):
        return y[0]

    flat.terminal = True
    found = solve_ivp(falls, (0, 1), [angle, 0.0], method="DOP853", rtol=1e-12, atol=1e-13, events=flat)
    return scene.build(), found.t[-1], found.y[1, -1] * (1.0 - 1.5 * np.sin(slant) ** 2)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_a_corner_that_takes_over_the_load_is_located(tolerance):
    """In the step in which the block lands its other edge opens: it is not the one that has the load."""
    problem, time, speed = rocking_block()
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=time + 1e-3)
    (impact,) = run.impacts
    assert np.count_nonzero(run.t == impact.time) == 2
    assert abs(impact.time - time) < tolerance
    after = run.v[np.searchsorted(run.t, impact.time, side="right") - 1]
    assert abs(after[4] - speed) < 10 * tolerance
    assert not any("shortest" in note for note in run.notes)


@pytest.mark.parametrize("every", [1, 3])
def test_impacts_that_are_not_located_are_recorded_once(monkeypatch, every):
    """Steps that are accepted at the shortest length hold them: they are no contacts of these steps, too."""
    monkeypatch.setattr("mbvi.schemes.adaptive.integrator.landing_time", lambda *given: None)
    scene = mbvi.Scene(friction=0.4, restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, MASS, position=(0, 0, 0.3), velocity=(1, 0, 0), name="ball")
    run = mbvi.simulate(scene.build(), mbvi.Adaptive(1e-2), duration=0.6, record="contacts", every=every)
    assert run.impacts and not any(np.count_nonzero(run.t == impact.time) == 2 for impact in run.impacts)
    total = sum((i.percussion[:, None] * i.normal + i.tangential).sum(axis=0) for i in run.impacts)
    total = total + np.diff(run.t) @ run.contact_forces("ball")[1:, :3]
    change = MASS * (run.v[-1, :3] - run.v[0, :3] - 0.6 * np.array([0, 0, -9.81]))
    np.testing.assert_allclose(total, change, atol=1e-9)
