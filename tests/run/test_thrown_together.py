"""Bodies that fly together: the tunnelling guard asks about their motion relative to each other alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.run.tunnelling import RUNAWAY, TunnellingGuard
from mbvi.schemes import Step
from support.paths import ROBOTS

pytestmark = pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")
STEP, DURATION = 2e-3, 0.1
VELOCITIES = [(0.0, 0.0, 0.0), (50.0, 0.0, 0.0), (-20.0, 40.0, 10.0)]


def scene_of(gravity=0.0, e=0.0):
    return mbvi.Scene(gravity=(0, 0, -gravity), restitution=e, friction=0.3)


def two_boxes(velocity):
    """One falls slowly behind the other, which turns a little."""
    scene = scene_of(e=0.5)
    scene.add_box((0.1, 0.1, 0.1), 1.0, velocity=velocity)
    slower = np.subtract(velocity, (0.1, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0.105, 0, 0), velocity=slower, angular_velocity=(0, 0.3, 0.1))
    return scene.build()


def stack(velocity, gravity=0.0):
    scene = scene_of(gravity)
    for k in range(5):
        scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0.1 * k), velocity=velocity)
    return scene.build()


def falling_stack(velocity):
    return stack(velocity, 9.81)


def on_a_slab(velocity):
    """Boxes and balls on a heavy slab that slides without friction."""
    scene = scene_of(9.81)
    scene.add_halfspace((0, 0, 1), offset=-0.1, name="ice")
    scene.add_box((5, 5, 0.1), 1e6, position=(0, 0, -0.05), velocity=(*velocity[:2], 0.0), name="slab")
    scene.set_friction("slab", "ice", 0.0)
    for k in range(3):
        scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0.3 * k, 0, 0.05), velocity=(*velocity[:2], 0.0))
        scene.add_sphere(0.05, 1.0, position=(0.3 * k, 1, 0.05), velocity=(*velocity[:2], 0.0))
    return scene.build()


def on_a_turntable(velocity):
    """Boxes on a slab that turns by as much as its rim moves at half that velocity."""
    scene, spin = scene_of(), 0.1 * np.linalg.norm(velocity)
    scene.add_box((5, 5, 0.1), 1e6, position=(0, 0, -0.05), angular_velocity=(0, 0, spin))
    for k in range(5):
        place = np.array([2.2 * np.cos(k), 2.2 * np.sin(k), 0.06])
        around = np.cross((0, 0, spin), place)
        scene.add_box((0.1, 0.1, 0.1), 1.0, position=place, velocity=around, angular_velocity=(0, 0, spin))
    return scene.build()


def balls(velocity, count=6):
    scene = scene_of(e=0.5)
    for k in range(count):
        place = (0.101 * (k % 6), 0.2 * (k // 6), 0)
        scene.add_sphere(0.05, 1.0, position=place, velocity=np.subtract(velocity, (0.02 * k % 6, 0, 0)))
    return scene.build()


def many_balls_on_a_slab(velocity):
    scene = scene_of(e=0.5)
    scene.add_box((5, 5, 0.1), 1e6, position=(0, 0, -0.11), velocity=velocity)
    for k in range(60):
        own = np.subtract(velocity, (0, 0, 0.1 + 0.001 * k))
        scene.add_sphere(0.05, 1.0, position=(0.11 * (k % 6), 0.11 * (k // 6), 0), velocity=own)
    return scene.build()


def capsules(velocity):
    scene = scene_of(e=0.5)
    for k in range(5):
        slower = np.subtract(velocity, (0.02 * k, 0, 0))
        scene.add_capsule(0.05, 0.2, 1.0, position=(0.101 * k, 0, 0), velocity=slower)
    return scene.build()


def heap(velocity):
    """So many boxes that Python takes the steps."""
    rng, scene = np.random.default_rng(0), scene_of(e=0.2)
    for k in range(30):
        place, own = (0.12 * (k % 3), 0.12 * (k // 3 % 3), 0.12 * (k // 9)), velocity + 0.1 * rng.normal(size=3)
        scene.add_box((0.1, 0.1, 0.1), 1.0, position=place, velocity=own, angular_velocity=rng.normal(size=3))
    return scene.build()


def large_heap(velocity):
    """So many that pairs are found when near; none of them rests."""
    scene, own = scene_of(), np.random.default_rng(0).normal(size=(100, 3))
    places = 0.11 * np.indices((5, 5, 4)).reshape(3, -1).T
    scene.add_boxes(places, (0.1, 0.1, 0.1), 1.0, velocities=velocity + 0.1 * own)
    return scene.build()


def laden_robot(velocity):
    """A quadruped with a box above it."""
    scene = scene_of(9.81)
    base = (*velocity, 0.1, 0.2, 0.1)
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.44), base_velocity=base)
    scene.add_box((0.3, 0.2, 0.1), 1.0, position=(0, 0, 0.65), velocity=velocity)
    return scene.build()


SCENES = [
    two_boxes, stack, falling_stack, on_a_slab, on_a_turntable, balls, capsules, heap, large_heap, many_balls_on_a_slab,
    laden_robot,
]  # fmt: skip
each = pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
SCHEMES = [mbvi.Paoli(), mbvi.Centered(project_positions=True)]


@pytest.fixture
def asked(monkeypatch):
    """How often the guard follows a pair, and how often Python takes a step."""
    counts, meets = {"pairs": 0, "steps": 0}, TunnellingGuard._meets

    def counted(*arguments):
        counts["pairs"] += 1
        return meets(*arguments)

    monkeypatch.setattr(TunnellingGuard, "_meets", counted)
    for scheme in SCHEMES:
        step = type(scheme).step

        def taken(*arguments, step=step):
            counts["steps"] += 1
            return step(*arguments)

        monkeypatch.setattr(type(scheme), "step", taken)
    return counts


@each
@pytest.mark.parametrize("scheme", SCHEMES, ids=["Paoli", "Centered"])
def test_the_guard_asks_no_more_in_a_moving_frame(scene, scheme, asked):
    counts = []
    for velocity in VELOCITIES:
        before = dict(asked)
        mbvi.simulate(scene(velocity), scheme, step=STEP, duration=DURATION, progress=False)
        counts.append({name: asked[name] - before[name] for name in asked})
    assert counts[0]["pairs"] == 0
    assert all(moving[name] <= counts[0][name] for moving in counts for name in asked)


@each
@pytest.mark.parametrize("scheme", SCHEMES, ids=["Paoli", "Centered"])
def test_a_guard_that_does_not_act_changes_no_byte(scene, scheme, monkeypatch):
    run = mbvi.simulate(scene(VELOCITIES[2]), scheme, step=STEP, duration=DURATION, progress=False)
    assert not any("passed through another" in note for note in run.notes)
    build = TunnellingGuard.__init__

    def blind(self, *arguments):
        build(self, *arguments)
        self.limit = RUNAWAY

    monkeypatch.setattr(TunnellingGuard, "__init__", blind)
    other = mbvi.simulate(scene(VELOCITIES[2]), scheme, step=STEP, duration=DURATION, progress=False)
    assert run.q.tobytes() == other.q.tobytes()
    assert run.v.tobytes() == other.v.tobytes()


@pytest.mark.parametrize("scheme", [*SCHEMES, mbvi.StewartTrinkle()], ids=lambda scheme: type(scheme).__name__)
@pytest.mark.parametrize(("kind", "count"), [("box", 1), ("ball", 1), ("capsule", 1), ("box", 40), ("ball", 40)])
def test_nothing_passes_a_plate_that_flies_itself(scheme, kind, count):
    """Bodies are shot at a plate from 1 to 100 of its thicknesses a step; the velocity of all is larger than that."""
    rng = np.random.default_rng(3)
    for speed in np.geomspace(4.0, 400.0, 8) if count == 1 else (20.0,):
        turn, velocity = Rotation.random(random_state=rng.integers(1000)), 400.0 * rng.normal(size=3)
        normal, aside = turn.apply((0, 0, 1)), turn.apply((0.09, 0, 0))
        scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5)
        lying = {"rotation": turn.as_matrix(), "velocity": velocity}
        scene.add_box((20.0, 4.0, 0.02), 1e6, **lying, name="plate")
        for k in range(count):
            place = 0.22 * normal + (k - 0.5 * count) * aside
            shot = {"position": place, "velocity": velocity - speed * normal}
            if kind == "box":
                scene.add_box((0.02, 0.03, 0.01), 1e-3, rotation=turn.as_matrix(), **shot)
            elif kind == "ball":
                scene.add_sphere(0.01, 1e-3, **shot)
            else:
                # it lies along the plate
                scene.add_capsule(0.005, 0.03, 1e-3, rotation=turn.as_matrix()[:, [1, 2, 0]], **shot)
        problem = scene.build()
        run = mbvi.simulate(problem, scheme, step=5e-3, duration=0.3 / speed + 0.01, progress=False)
        for q in run.q:
            plate, *bodies = problem.system.placements(q, np.arange(1, count + 2))
            assert (((np.array(bodies)[:, 3] - plate[3]) @ plate[2]) > 0.0).all(), speed
        assert run.impacts


def thrown(rng):
    """A plate and a box that turn and fly together, while the box comes nearer by several thicknesses a step."""
    speed, velocity = 10.0 ** rng.uniform(0.7, 2.0), 100.0 * rng.normal(size=3)
    scene, turn = mbvi.Scene(gravity=(0, 0, 0)), Rotation.random(random_state=rng.integers(1000))
    start = {"rotation": turn.as_matrix(), "velocity": velocity, "angular_velocity": rng.normal(size=3)}
    scene.add_box((0.6, 0.4, 0.02), 1.0, **start)
    way = rng.normal(size=3)
    way *= speed / np.linalg.norm(way)
    start = {"velocity": velocity + way, "angular_velocity": 5.0 * rng.normal(size=3)}
    scene.add_box((0.03, 0.05, 0.02), 1.0, position=-5e-3 * way * rng.uniform(0.2, 0.9) + 0.01 * turn.apply((0, 0, 1)),
                  **start)  # fmt: skip
    return scene


@pytest.mark.parametrize("scheme", SCHEMES, ids=["Paoli", "Centered"])
def test_dense_samples_of_the_motion_show_no_pair_that_the_guard_has_missed(scheme):
    rng, h, passed = np.random.default_rng(0), 5e-3, 0
    share = np.linspace(0.0, 1.0, 401)
    for _ in range(60):
        try:
            problem = thrown(rng).build()
        except mbvi.InadmissibleStartError:
            continue
        system, family = problem.system, problem.constraints.families[0]
        q, v = problem.q0, problem.v0
        # the motion of a free step
        end, after = system.coast(v, h) if scheme.timing.coasts else (h * v, v)
        steps = [system.coast(v, x * h)[0] if scheme.timing.coasts else x * h * v for x in share]
        gaps = np.array([family.nearest_of(0.0, system.integrate(q, step), np.array([0]))[0][0] for step in steps])
        state = Step(0.0, q, v, None, None, 0.0)
        new = state._replace(t=h, q=system.integrate(q, end), v=after)
        part = TunnellingGuard(problem, scheme, h).passed(state, new, h)
        # it has passed where the gap is open at both ends and as deep as both are thick between these
        if gaps[-1] > 0.0 and gaps.min() < -0.75 * family.thickness[0]:
            passed += 1
            assert part < 1.0
            # not before they touch, and hardly deeper than that
            near = gaps[np.searchsorted(share, part) - 1]
            assert abs(near) < 0.3 * family.thickness[0]
        elif gaps.min() > 1e-6:
            assert part == 1.0
    assert passed > 10
