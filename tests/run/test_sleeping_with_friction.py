"""Bodies that friction holds sleep: runs with sleep and without agree, records are complete, and loads wake."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi import motion
from mbvi.run.sleeping import Sleepers
from support.paths import ROBOTS

# few bodies do not sleep in the compiled loop
pytestmark = pytest.mark.usefixtures("python_steps")

G, MU, STEP = 9.81, 0.5, 1e-3
SCHEMES = (
    mbvi.Paoli(),
    mbvi.Paoli(project_positions=True),
    mbvi.MoreauJean(),
    mbvi.Centered(project_positions=True),
    mbvi.StewartTrinkle(),
)


@pytest.fixture
def asleep(monkeypatch):
    """The bodies that slept, one set each time that these changed."""
    sets, change = [], Sleepers._set

    def noted(self, islands):
        change(self, islands)
        sets.append({int(k) for island in islands for k in island.bodies})

    monkeypatch.setattr(Sleepers, "_set", noted)
    return sets


def incline(steepness, boxes=2, **options):
    """A tower on a floor whose slope is `steepness` times the steepest at which it does not slide."""
    angle = np.arctan(steepness * MU)
    scene = mbvi.Scene(gravity=(G * np.sin(angle), 0, -G * np.cos(angle)), friction=MU, **options)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(boxes):
        scene.add_box((0.2, 0.2, 0.05), 1.0, position=(0, 0, 0.025 + 0.05 * k), name=f"stone {k}")
    return scene


def with_and_without(scene, scheme, duration, tolerance=1e-10, **options):
    runs = [mbvi.simulate(scene.build(r), scheme, step=STEP, duration=duration, **options) for r in (["rest"], [])]
    first, second = runs
    np.testing.assert_allclose(first.q, second.q, rtol=0, atol=tolerance)
    np.testing.assert_allclose(first.v, second.v, rtol=0, atol=100 * tolerance)
    np.testing.assert_allclose(first.penetration(), second.penetration(), rtol=0, atol=tolerance)
    return runs


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_tower_on_an_incline_sleeps_and_wakes_when_a_ball_hits_it(scheme, asleep):
    scene = incline(0.9)
    scene.add_sphere(0.02, 0.2, (-0.3, 0, 0.03), (2.0, 0, 0))
    first, _ = with_and_without(scene, scheme, 0.25, 1e-9)
    assert {0, 1} in asleep and set() in asleep[asleep.index({0, 1}) :]
    moved = first.q.reshape(len(first.t), -1, 7)[:, 0, 0]
    assert moved[-1] > 1e-4
    # nothing creeps until the ball comes
    assert np.abs(moved[first.t < 0.08]).max() < 1e-12


def test_a_steeper_incline_lets_nothing_sleep(asleep):
    run = mbvi.simulate(incline(1.0001, 1).build(), mbvi.StewartTrinkle(), step=STEP, duration=0.2)
    angle = np.arctan(1.0001 * MU)
    np.testing.assert_allclose(run.v[-1, 0], 0.2 * G * (np.sin(angle) - MU * np.cos(angle)), rtol=1e-6)
    assert not asleep


def test_a_pull_below_the_friction_holds_and_one_above_it_slides(asleep):
    scene = incline(0.0, 1)
    # grows until it exceeds mu m g at 0.2 s
    scene.add_force("stone 0", lambda t, q, v: np.array([max(0.0, t - 0.1) * 10.0 * MU * G, 0, 0, 0, 0, 0]))
    first, _ = with_and_without(scene, mbvi.StewartTrinkle(), 0.25)
    speed = first.v[:, 0]
    assert np.abs(speed[first.t <= 0.2]).max() < 1e-12
    np.testing.assert_allclose(speed[-1], 10.0 * MU * G * 0.05**2 / 2, rtol=0.03)


def test_a_belt_carries_what_lies_on_it(asleep):
    scene = mbvi.Scene(friction=MU)
    scene.add_halfspace((0, 0, 1), name="belt", motion=motion.Oscillation((0.01, 0, 0), frequency=1.0))
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0.05))
    first, _ = with_and_without(scene, mbvi.StewartTrinkle(), 0.2)
    assert not asleep
    assert first.q[-1, 0] > 5e-3


def test_a_wall_that_moves_along_its_face_wakes_what_it_touches(asleep):
    scene = incline(0.0, 1)
    # reaches the side of the sleeping box after 0.1 s, and then drags it along
    scene.add_halfspace((0, 1, 0), -0.12, name="wall", motion=motion.Translation((1.0, 0.2, 0)))
    first, _ = with_and_without(scene, mbvi.StewartTrinkle(), 0.2)
    assert asleep[:2] == [{0}, set()]
    np.testing.assert_allclose(first.q[first.t < 0.095, 0], 0.0, atol=1e-12)
    assert first.q[-1, 0] > 1e-3 and first.q[-1, 1] > 1e-2


def test_what_a_robot_stands_on_does_not_sleep(asleep):
    scene = incline(0.0, 1)
    scene.add_urdf(ROBOTS / "hopper" / "hopper.urdf", position=(0, 0, 0.6))
    with_and_without(scene, mbvi.Paoli(), 0.2, 1e-9)
    assert asleep[0] == {0} and asleep[-1] == set()


def test_percussions_of_what_sleeps_carry_its_weight_along_tangents_too(asleep):
    problem, scheme, projector = incline(0.9).build(), mbvi.StewartTrinkle(), mbvi.projection.Projector(1e-6)
    carried = []
    with Sleepers(problem, STEP, projector) as sleepers:
        q, v, t = problem.q0, problem.v0, 0.0
        for k in range(40):
            h = STEP if k < 39 else 0.5 * STEP

            def advance(t=t, q=q, v=v, h=h):
                return [scheme.step(problem, t, q, v, h, projector)]

            (state,) = sleepers.stepped(advance, h)
            t, q, v = state.t, state.q, state.v
            rows = state.active
            assert state.slip.shape == (4, len(rows.gap), 2)
            carried.append(state.percussion @ rows.jacobian + state.slip[0].ravel() @ rows.tangents.jacobian)
    assert asleep[0] == {0, 1}
    weight = -problem.system.force(0.0, problem.q0, problem.v0)
    np.testing.assert_allclose(carried[20], STEP * weight, atol=1e-12)
    np.testing.assert_allclose(carried[38], STEP * weight, atol=1e-12)
    np.testing.assert_allclose(carried[39], 0.5 * STEP * weight, atol=1e-12)


def test_contacts_of_what_sleeps_are_recorded_beside_those_of_what_slides():
    scene = incline(0.5)
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(1, 0, 0.05), velocity=(1.0, 0, 0), name="slider")
    first, second = with_and_without(scene, mbvi.StewartTrinkle(), 0.1, record="contacts")
    for t in (0.05, 0.09):
        asleep, awake = ({c.name for c in r.contacts(t)} for r in (first, second))
        assert asleep == awake and any("slider" in name for name in awake) and any("stone" in name for name in awake)


@pytest.mark.slow
def test_a_rough_pile_rests_asleep_and_awake_within_its_residual(asleep):
    edge, count = 0.04, 24
    cell = np.stack(np.unravel_index(np.arange(count), (6, 2, 2)), axis=1)[:, ::-1]
    scene = mbvi.Scene(friction=MU)
    scene.add_container((0, 0, 0), (3.6 * edge, 3.6 * edge))
    turned = Rotation.random(count, random_state=1).as_matrix()
    scene.add_boxes(1.8 * edge * (cell + 0.5), (edge,) * 3, mass=1.0, rotations=turned)

    def run(problem, duration):
        return mbvi.simulate(problem, mbvi.StewartTrinkle(), step=2e-3, duration=duration, every=25)

    awake = run(scene.build([]), 1.0)
    # islands are solved together, so that impacts differ: both go on from the same state at rest
    start = awake.q[-1], awake.v[-1]
    runs = [run(scene.build(r).at(*start), 0.5) for r in (["rest"], [])]
    assert set(range(count)) in asleep and not runs[0].v[-1].any()
    # what is awake creeps by less than the accepted depth
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-3 * edge)
    for result in [awake, *runs]:
        assert result.penetration().max() < 1e-3 * edge
        assert result.energies()[0][-1] < 1e-8 * count * G * edge
        assert (np.diff(result.energy()) <= 1e-6 * count * G * edge).all()
