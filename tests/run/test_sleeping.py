"""What sleeps moves as it does awake: runs with sleep and without, and who may sleep."""

import numpy as np
import pytest

import mbvi
from mbvi.run.sleeping import Sleepers
from support.paths import ROBOTS

# few bodies do not sleep in the compiled loop
pytestmark = pytest.mark.usefixtures("python_steps")

SCHEMES = (
    mbvi.Paoli(),
    mbvi.Paoli(project_positions=True),
    mbvi.MoreauJean(),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.SchatzmanPaoli(),
    mbvi.StewartTrinkle(),
)


def tower(e, heights=(0, 1, 2), **options):
    scene = mbvi.Scene(restitution=e, **options)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in heights:
        scene.add_box((0.2, 0.2, 0.1), position=(0.01 * (k % 2), 0, 0.05 + 0.1 * k), name=f"stone {k}")
    return scene


def struck(e):
    """A tower at which a ball is thrown, and a block beside it that it never meets."""
    scene = tower(e)
    scene.add_box((0.1, 0.1, 0.1), position=(3, 0, 0.05), name="far")
    scene.add_sphere(0.05, 1.0, (1.0, 0, 0.26), (-6.0, 0, 1))
    return scene


@pytest.fixture
def asleep(monkeypatch):
    """The bodies that slept, one set each time that these changed."""
    sets, change = [], Sleepers._set

    def noted(self, islands):
        change(self, islands)
        sets.append({int(k) for island in islands for k in island.bodies})

    monkeypatch.setattr(Sleepers, "_set", noted)
    return sets


def same(scene, scheme, tolerance=1e-10, step=1e-3, **options):
    runs = [mbvi.simulate(scene.build(reduce), scheme, step=step, **options) for reduce in (["rest"], [])]
    first, second = runs
    np.testing.assert_allclose(first.q, second.q, rtol=0, atol=tolerance)
    np.testing.assert_allclose(first.v, second.v, rtol=0, atol=100 * tolerance)
    np.testing.assert_allclose(first.penetration(), second.penetration(), rtol=0, atol=tolerance)
    np.testing.assert_allclose(first.energy(), second.energy(), rtol=0, atol=100 * tolerance)
    # how the corners of a face share what it carries is open, and with it which of them are named, if any
    hits = [
        [(i.time, n, p) for i in r.impacts for n, p in zip(i.constraints, i.percussion, strict=True) if "sphere" in n]
        for r in runs
    ]
    assert [name for _, name, _ in hits[0]] == [name for _, name, _ in hits[1]]
    np.testing.assert_allclose(*([t for t, *_ in hit] for hit in hits), rtol=0, atol=1e-12)
    np.testing.assert_allclose(*([p for *_, p in hit] for hit in hits), rtol=0, atol=1e3 * tolerance)
    return runs


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__ + "+" * getattr(s, "project_positions", 0))
def test_a_tower_wakes_when_it_is_struck(scheme, asleep):
    first, _ = same(struck(0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.3), scheme, duration=0.25)
    assert first.impacts
    # velocities of this scheme are differences of places, whose rounding does not come to rest
    if not isinstance(scheme, mbvi.SchatzmanPaoli):
        assert {0, 1, 2, 3} in asleep
        # each island on its own
        assert {3} in asleep and asleep[-1] == set()


def test_planar_bodies_and_those_of_a_crowd_sleep(asleep):
    scene = tower(0.2, plane="xz")
    scene.add_sphere(0.05, 1.0, (1.0, 0, 0.26), (-6.0, 0, 1))
    runs = [
        mbvi.simulate(scene.build(r), mbvi.Paoli(), step=1e-3, duration=0.25) for r in (["plane", "rest"], ["plane"])
    ]
    # the ball strikes the uppermost off the others
    assert asleep == [{0, 1, 2}, set(), {0, 1}, set()] and runs[0].impacts
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-10)
    asleep.clear()
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1))
    scene.add_boxes([(0.3 * (k % 9), 0.3 * (k // 9), 0.05) for k in range(63)], (0.2, 0.2, 0.1), density=500.0)
    # it flies on from one list of neighbours to the next
    scene.add_sphere(0.05, 1.0, (-1.0, 0.35, 0.4), (15, 0, -2))
    same(scene, mbvi.MoreauJean(), duration=0.15)
    assert asleep[0] == set(range(63)) and len(asleep[1]) == 62
    assert len(asleep) < 6


def test_what_a_robot_stands_on_or_a_ball_lies_on_does_not_sleep(asleep):
    scene = tower(0.0, heights=(0,))
    scene.add_box((0.2, 0.2, 0.1), position=(2, 0, 0.05))
    scene.add_sphere(0.05, 1.0, (2, 0, 0.15))
    scene.add_urdf(ROBOTS / "hopper" / "hopper.urdf", position=(0, 0, 0.6))
    same(scene, mbvi.Paoli(), tolerance=1e-9, duration=0.2)
    # until the robot comes
    assert asleep == [{0}, set()]


def test_neither_the_top_of_a_flight_nor_slow_sliding_is_rest(asleep):
    scene, h = mbvi.Scene(), 1e-3
    scene.add_halfspace((0, 0, 1))
    for k in range(20):
        # whatever step is watched, one of them stands still there
        scene.add_box((0.1, 0.1, 0.1), position=(k, 0, 0.2), velocity=(0, 0, 9.81 * h * (k + 5)))
    same(scene, mbvi.Paoli(), duration=0.05)
    assert not asleep
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.1, 0.1, 0.1), position=(0, 0, 0.05), velocity=(1e-8, 0, 0))
    same(scene, mbvi.Paoli(), duration=0.05)
    assert not asleep


def test_constraints_of_ones_own_keep_awake_what_they_touch(asleep):
    scene = tower(0.0, heights=(0,))
    scene.add_box((0.1, 0.1, 0.1), position=(1, 0, 0.55))
    built = scene.build()
    gradient = np.zeros(12)
    gradient[8] = 1.0
    shelf = mbvi.GapFunction(lambda q: q[9] - 0.55, lambda q: gradient)
    problem = mbvi.Problem(
        built.system, [*built.constraints.constraints, shelf], built.q0, built.v0, length=0.1, scene=built.scene
    )
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05)
    np.testing.assert_allclose(run.q[-1], problem.q0, atol=1e-12)
    assert asleep == [{0}, set()]


def test_what_moves_on_never_sleeps(asleep):
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), position=(0, 0, 0), velocity=(1e-9, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), position=(1, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), position=(2, 0, 0), angular_velocity=(0, 0, 1e-9))
    same(scene, mbvi.Paoli(), duration=0.05)
    assert asleep[0] == {1}
    asleep.clear()
    # a floor that will fall away
    scene = tower(0.0, heights=())
    motion = mbvi.motion.Oscillation(amplitude=(0, 0, 0.01), frequency=0.5)
    scene.add_halfspace((0, 0, 1), 0.2, name="lift", motion=motion)
    scene.add_box((0.1, 0.1, 0.1), position=(0, 0, 0.25))
    same(scene, mbvi.Paoli(), duration=0.05)
    assert not asleep


def test_all_are_awake_after_a_run(tmp_path):
    problem = struck(0.3).build()
    before = problem.constraints.active(0.0, problem.q0, problem.tolerance)
    force = problem.system.force(0.0, problem.q0, problem.v0)
    short = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05)
    again = problem.constraints.active(0.0, problem.q0, problem.tolerance)
    np.testing.assert_array_equal(again.constraint, before.constraint)
    np.testing.assert_array_equal(problem.system.force(0.0, problem.q0, problem.v0), force)
    # also in files, thinned, and where a last step is shorter
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.0503, every=7, out=tmp_path / "run.h5")
    np.testing.assert_allclose(run.q[-1], short.q[-1], atol=1e-2)
    assert mbvi.load(tmp_path / "run.h5").penetration().tolist() == run.penetration().tolist()
    with pytest.raises(ZeroDivisionError):
        mbvi.simulate(problem, Failing(), step=1e-3, duration=0.1)
    np.testing.assert_array_equal(problem.system.force(0.0, problem.q0, problem.v0), force)


class Failing(mbvi.Paoli):
    def step(self, problem, t, q, v, h, projector):
        if t > 0.05:
            raise ZeroDivisionError
        return super().step(problem, t, q, v, h, projector)


def test_percussions_of_what_sleeps_are_recorded():
    problem = tower(0.0).build()
    assert "rest" in problem.scene.reduce
    scheme, projector, carried = mbvi.Paoli(), mbvi.projection.Projector(1e-6), []
    with Sleepers(problem, 1e-3, projector) as sleepers:
        q, v, t = problem.q0, problem.v0, 0.0
        for k in range(40):
            h = 1e-3 if k < 39 else 5e-4

            def advance(t=t, q=q, v=v, h=h):
                return [scheme.step(problem, t, q, v, h, projector)]

            (state,) = sleepers.stepped(advance, h)
            t, q, v = state.t, state.q, state.v
            carried.append(state.percussion @ state.active.jacobian)
    weight = -problem.system.force(0.0, problem.q0, problem.v0)
    np.testing.assert_allclose(carried[20], 1e-3 * weight, atol=1e-12)
    np.testing.assert_allclose(carried[38], 1e-3 * weight, atol=1e-12)
    np.testing.assert_allclose(carried[39], 5e-4 * weight, atol=1e-12)


def test_a_swift_ball_wakes_a_thin_plate_it_would_pass_through(asleep):
    scene = tower(0.5)
    scene.add_box((0.4, 0.4, 0.02), position=(2, 0, 0.01), name="plate")
    scene.add_sphere(0.01, 0.1, (2, 0.01, 3.0), (0, 0, -60))
    first, second = same(scene, mbvi.Paoli(), tolerance=1e-9, duration=0.06)
    # a step that was taken again counts once
    assert first.notes == second.notes and "were shortened" in first.notes[-1]
    assert asleep[:2] == [{0, 1, 2, 3}, {0, 1, 2}]


def test_the_same_tower_gives_the_same_bytes_wherever_its_memory_begins():
    """Sixteen rows that depend on each other: how they share their load is not left to where a solver's memory lies."""
    rng, runs = np.random.default_rng(0), []
    for _ in range(8):
        # what is freed here is taken next
        junk = [np.empty(n) for n in rng.integers(1, 60, 40)]
        del junk[::2]
        run = mbvi.simulate(struck(0.3).build(reduce=()), mbvi.Centered(), step=1e-3, duration=0.02)
        runs.append((run.q.tobytes(), run.v.tobytes()))
    assert len(set(runs)) == 1
