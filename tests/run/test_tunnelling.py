"""Nothing passes through anything between two steps, at any speed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints.families.broad_phase import BroadPhasePairs
from mbvi.constraints.families.signed_distance import SignedDistances
from mbvi.geometry.broad.sweep import may_pass
from support.paths import DATA, real_robot

SCHEMES = [
    mbvi.Paoli(),
    mbvi.MoreauJean(),
    mbvi.Centered(),
    mbvi.SchatzmanPaoli(),
    mbvi.Centered(project_positions=True),
]
each = pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)


def shot_at_a_plate(e, speed, body="ball"):
    """A ball aslant, or a box flat, in front of a plate a centimetre thick that is tilted and fixed."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e)
    normal = np.array([0.6, 0.0, 0.8])
    tilt = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])
    scene.add_box((2.0, 2.0, 0.01), position=(0, 0, 0), rotation=tilt, fixed=True, name="plate")
    if body == "ball":
        scene.add_sphere(0.003, position=(0, 0, 0.7123), velocity=(0, 0, -speed))
    else:
        scene.add_box((0.02, 0.03, 0.01), position=0.7123 * normal, rotation=tilt, velocity=-speed * normal)
    return scene.build(), normal


@each
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("body", ["ball", "box"])
@pytest.mark.parametrize("speed", [40.0, 1e3, 1e5])
def test_nothing_passes_a_plate(scheme, e, body, speed):
    problem, normal = shot_at_a_plate(e, speed, body)
    run = mbvi.simulate(problem, scheme, step=1e-2, duration=0.05)
    ahead = run.q[:, :3] @ normal
    assert ahead.min() > 0.0
    assert run.impacts
    assert "would have passed through another" in run.notes[-1]
    after, before = run.v[-1][:3], run.v[0][:3]
    np.testing.assert_allclose(after, before - (1 + e) * (before @ normal) * normal, rtol=1e-6, atol=1e-6 * speed)


@each
@pytest.mark.parametrize("body", ["ball", "box"])
def test_nothing_passes_a_plate_at_about_its_thickness_a_step(scheme, body):
    for speed in np.geomspace(0.3, 4.0, 40):
        problem, normal = shot_at_a_plate(0.5, speed, body)
        run = mbvi.simulate(problem, scheme, step=1e-2, duration=0.75 / speed)
        assert run.impacts, speed
        assert (run.q[:, :3] @ normal).min() > 0.0, speed


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_a_box_that_spins_fast_clatters_on_a_plate_and_stays_on_its_side(scheme):
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5)
    scene.add_box((2.0, 2.0, 0.01), fixed=True)
    scene.add_box((0.03, 0.03, 0.03), position=(0, 0, 0.1), velocity=(0, 0, -20.0), angular_velocity=(300, 100, 0))
    run = mbvi.simulate(scene.build(), scheme, step=1e-2, duration=0.05)
    assert run.q[:, 2].min() > 0.0
    assert run.v[-1, 2] > 0.0


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True)], ids=str)
@pytest.mark.parametrize("speed", [8.0, 50.0])
def test_a_robot_of_hulls_falls_through_no_field_in_the_loop(scheme, speed, loops):
    scene = mbvi.Scene(friction=0.3)
    scene.add_heightfield(0.05 * np.random.default_rng(3).random((24, 24)), (2.4, 2.4))
    scene.add_urdf(DATA / "brick.urdf", "free", (0.1, 0.05, 0.4), base_velocity=(0.5, 0, -speed, 1, 2, 0))
    problem, h, duration = scene.build(), 2e-3, 0.06
    run = mbvi.simulate(problem, scheme, step=h, duration=duration, progress=False)
    assert loops[0] is not None
    assert run.q[:, 2].min() > 0.0
    # the guard of the Python step follows every swift step
    last = next(state for state in mbvi.steps(problem, scheme, step=h) if state.t > duration - 0.5 * h)
    np.testing.assert_allclose(run.q[-1], last.q, rtol=0, atol=1e-9)


def test_links_that_are_not_watched_on_a_way_do_not_meet_on_it(rng):
    """A quadruped's legs swing by up to a radian; the gaps of the pairs that are left out stay open."""
    scene = mbvi.Scene()
    scene.add_urdf(mbvi.robot("quadruped"))
    problem = scene.build()
    links = next(c for c in problem.constraints.constraints if isinstance(c, SignedDistances))
    every, left_out = np.arange(len(links.names)), 0
    for _ in range(20):
        way = np.concatenate([np.zeros(6), rng.uniform(-1.0, 1.0, problem.system.nv - 6)])
        swift = links.reach() @ np.abs(way) > links.thickness
        watched = links.passable(problem.q0, way)[0]
        assert swift[watched].all()
        out = np.setdiff1d(every[swift], watched)
        left_out += len(out)
        for share in np.linspace(0.0, 1.0, 6):
            assert (links.nearest_of(0.0, problem.system.integrate(problem.q0, share * way), out)[0] > 0.0).all()
    assert left_out > 100


def test_steps_by_hand_are_cut_too():
    problem, normal = shot_at_a_plate(0.5, 1e3)
    found = [step for step, _ in zip(mbvi.steps(problem, mbvi.Paoli(), step=1e-2), range(4), strict=False)]
    assert found[0].t < 1e-3
    assert all(step.q[:3] @ normal > 0.0 for step in found)


def test_slow_motion_is_left_as_it_is():
    problem, _ = shot_at_a_plate(0.5, 0.3)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-2, duration=3.0)
    assert (len(run.impacts), run.notes) == (1, ())


def test_what_slides_fast_along_a_plate_is_not_cut():
    """The ball rests on the plate; both ends of a step touch, and so does all between."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_box((50.0, 2.0, 0.01), position=(0, 0, -0.005), fixed=True)
    scene.add_sphere(0.003, position=(-20, 0, 0.003), velocity=(30, 0, 0))
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-2, duration=1.0)
    assert run.notes == ()
    np.testing.assert_allclose(run.q[-1], (10, 0, 0.003), atol=1e-6)


@pytest.mark.parametrize("count", [2, 40], ids=["pairs", "bulk"])
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_spheres_pass_neither_each_other_nor_a_plate(scheme, count):
    """In the first row one is shot at the next; all are shot at a plate, by far more than they are thick a step."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    scene.add_box((50.0, 2.0, 0.01), position=(0, 0, -1.0), fixed=True)
    place = np.zeros((count, 3))
    place[:, 0] = np.arange(count) - 0.5 * count
    for p in place[1:]:
        scene.add_sphere(0.01, position=p, velocity=(0, 0, -300.0))
    scene.add_sphere(0.01, position=place[0] - (5.0, 0, 0), velocity=(900.0, 0, 0))
    scene.add_sphere(0.01, position=place[0], velocity=(0, 0, 0))
    problem = scene.build()
    run = mbvi.simulate(problem, scheme, step=1e-2, duration=0.02)
    v = run.v[-1].reshape(-1, 3)
    np.testing.assert_allclose(v[:-2], np.tile((0, 0, 300.0), (count - 1, 1)), rtol=1e-4)
    assert run.q[-1].reshape(-1, 3)[:-2, 2].min() > -1.0
    # the one that rested took all of the other's speed
    np.testing.assert_allclose(v[-2:, 0].tolist(), (0.0, 900.0), rtol=1e-5, atol=1e-2)


def test_many_boxes_pass_through_nothing():
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.0)
    scene.add_box((50.0, 2.0, 0.01), position=(0, 0, -1.0), fixed=True)
    for k in range(70):
        scene.add_box((0.02, 0.02, 0.02), position=(0.5 * k - 17.0, 0, 0), velocity=(0, 0, -300.0 - k))
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-2, duration=0.02)
    assert run.q[-1].reshape(-1, 7)[:, 2].min() > -1.0
    np.testing.assert_allclose(run.v[-1].reshape(-1, 6)[:, 2], 0.0, atol=1e-6)


def test_a_blade_that_spins_among_many_boxes_strikes_what_it_would_sweep_over():
    """Its centre rests: only its tips travel, a turn and a half in a step."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    scene.add_box((1.0, 0.02, 0.02), mass=100.0, angular_velocity=(0, 0, 900.0), name="blade")
    scene.add_box((0.02, 0.02, 0.02), position=(0.3, 0.2, 0), name="struck")
    for k in range(70):
        scene.add_box((0.02, 0.02, 0.02), position=(5.0 + 0.5 * k, 0, 0))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.01)
    assert any(set(impact.constraints[0].split(" | ")) == {"blade", "struck"} for impact in run.impacts)


def meeting(seed):
    """Balls on straight ways, against positions at many instants."""
    rng = np.random.default_rng(seed)
    centres, moved, radii = rng.random((30, 3)), rng.normal(size=(30, 3)), rng.uniform(0.02, 0.05, 30)
    found = set(zip(*(x.tolist() for x in may_pass(
        centres, moved, np.linalg.norm(moved, axis=1), radii, radii
    )), strict=True))  # fmt: skip
    i, j = np.triu_indices(30, 1)
    met = np.zeros(len(i), bool)
    for x in np.linspace(0.0, 1.0, 2001):
        place = centres + x * moved
        met |= np.linalg.norm(place[i] - place[j], axis=1) < radii[i] + radii[j]
    met &= np.linalg.norm(moved[i] - moved[j], axis=1) > radii[i] + radii[j]
    assert set(zip(i[met].tolist(), j[met].tolist(), strict=True)) <= found
    # and few others: what only touches between two instants
    assert len(found) <= met.sum() + 2
    return int(met.sum())


def test_what_may_pass_holds_every_pair_that_meets():
    assert sum(meeting(seed) for seed in range(20)) > 20


def test_what_the_arm_moves_as_one_passes_nothing_in_the_hand():
    """The hand of TIAGo has thousands of pairs: how far they move is bounded by the joints between their links."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(real_robot("tiago_description/robots/tiago.urdf"), position=(0, 0, 1))
    problem = scene.build()
    system, q, rng = problem.system, problem.q0, np.random.default_rng(0)
    (family,) = (c for c in problem.constraints.families if isinstance(c, BroadPhasePairs))
    way = np.zeros(system.nv)
    way[:6] = rng.normal(size=6)
    assert not len(family.passable(q, way)[0])
    i, j = np.triu_indices(len(family._shapes), 1)
    pairs = family._allowed(i * len(family._shapes) + j)
    inner = family._shapes.inner[np.stack(np.divmod(pairs, len(family._shapes)))].sum(axis=0)
    for _ in range(5):
        way[:] = rng.uniform(-1.0, 1.0, system.nv)
        passed, travel, thickness = family.passable(q, way)
        assert 0 < len(passed) < len(pairs)
        before, after = (family.nearest_of(0.0, at, pairs)[0] for at in (q, system.integrate(q, way)))
        listed = np.searchsorted(pairs, np.sort(passed))
        order = np.argsort(passed)
        np.testing.assert_array_equal(thickness[order], inner[listed])
        assert ((before - after)[listed] <= travel[order] + 1e-12).all()
        others = np.setdiff1d(np.arange(len(pairs)), listed)
        assert ((before - after <= inner + 1e-12) | (np.minimum(before, after) > 0.0))[others].all()


def crowded(kind):
    """Bodies close to each other, a plate, and where there are few spheres so many that all is in bulk."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((1.0, 1.0, 0.01), position=(0, 0, -0.03), fixed=True)
    places = 0.045 * np.indices((5, 5, 3)).reshape(3, -1).T
    if kind == "spheres":
        scene.add_spheres(places, radius=np.linspace(0.01, 0.02, 75), mass=1.0)
    else:
        scene.add_boxes(places, (0.03, 0.02, 0.03), 1.0)
    return scene.build()


@pytest.mark.parametrize("kind", ["spheres", "boxes"])
def test_up_to_the_least_displacement_nothing_passes_and_beyond_it_something_may(kind):
    problem, rng = crowded(kind), np.random.default_rng(0)
    watched = [
        c for c in problem.constraints.families if c.passed_share() is None and np.isfinite(c.least_displacement())
    ]
    assert watched
    for constraint in watched:
        beyond = 0
        for _ in range(200):
            way = rng.uniform(-1.0, 1.0, problem.system.nv)
            way *= constraint.least_displacement() / np.abs(way).max()
            assert not len(constraint.passable(problem.q0, 0.999 * way)[0])
            beyond += len(constraint.passable(problem.q0, 8.0 * way)[0]) > 0
        assert beyond


def shot_in_a_turned_scene(kind, plate, many, speed, turn):
    """Bodies that fly aslant at a thin plate, in a scene that is turned as a whole."""
    scene, way = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5), np.array([0.1, 0.3, -1.0])
    if plate == "box":
        scene.add_box((2.0, 2.0, 0.01), rotation=turn, fixed=True)
    else:
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        scene.add_surface(corners @ turn.T, [[0, 1, 2], [0, 2, 3]])
    for k in range(many):
        start = {"velocity": turn @ (speed * way), "position": turn @ (0.06 * k, 0.0, 0.0423 + 7e-4 * k)}
        if kind == "ball":
            scene.add_sphere(0.003, **start)
        else:
            own = Rotation.from_rotvec((0.3, 0.2, 0.1)).as_matrix()
            scene.add_box(
                (0.02, 0.03, 0.01), rotation=turn @ own, angular_velocity=turn @ (10.0, -20.0, 15.0), **start
            )  # fmt: skip
    return scene.build()


@pytest.mark.parametrize("scheme", [*SCHEMES, mbvi.StewartTrinkle()], ids=repr)
@pytest.mark.parametrize(
    ("kind", "plate", "many"), [("ball", "box", 1), ("ball", "sheet", 1), ("ball", "sheet", 70), ("box", "box", 1)]
)
def test_a_turned_scene_has_the_same_shortened_steps(scheme, kind, plate, many):
    """Whether a body passes depends on how far it moves, and not on the axes of the world."""
    for speed in (0.7, 1.5, 3.0):
        places = []
        for turn in (np.eye(3), *Rotation.random(2, random_state=1).as_matrix()):
            problem = shot_in_a_turned_scene(kind, plate, many, speed, turn)
            run = mbvi.simulate(problem, scheme, step=1e-2, duration=0.08, progress=False)
            assert run.impacts
            places.append(run.q.reshape(len(run.q), many, -1)[:, :, :3] @ turn)
        for place in places[1:]:
            np.testing.assert_allclose(place, places[0], rtol=0.0, atol=1e-11, err_msg=str(speed))


def thrown_down(kind, size, seed, speed, e, *, field):
    """A body that falls on flat ground of triangles, turned and spinning at random, slightly aslant."""
    rng, turn = np.random.default_rng(seed), Rotation.random(random_state=seed).as_matrix()
    way = np.array([*(0.15 * rng.normal(size=2)), -1.0])
    height, spin = 0.7 + rng.uniform(0, 0.3), 5.0 * rng.normal(size=3)
    scene = mbvi.Scene(restitution=e)
    if field:
        scene.add_heightfield(np.zeros((9, 9)), (4, 4))
    else:
        corners = [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]
        scene.add_surface(corners, [[0, 1, 2], [0, 2, 3]], one_sided=True)
    start = {"position": (0.03, 0.04, height), "rotation": turn, "angular_velocity": spin}
    start["velocity"] = speed * way / np.linalg.norm(way)
    if kind == "box":
        scene.add_box((2 * size, 1.4 * size, 0.6 * size), **start)
    elif kind == "capsule":
        scene.add_capsule(0.5 * size, size, **start)
    else:
        scene.add_cylinder(0.7 * size, size, **start)
    return scene.build(), (height + 0.3) / speed + 0.06


def stays_above(run, size):
    inside = (np.abs(run.q[:, :2]) < 1.8).all(axis=1)
    # all of the body is within two sizes of its centre
    return run.q[inside, 2].min() > -2 * size


@pytest.mark.parametrize("field", [False, True], ids=["mesh", "field"])
@pytest.mark.parametrize("kind", ["box", "cylinder", "capsule"])
@pytest.mark.parametrize(
    "scheme", [mbvi.StewartTrinkle(), mbvi.Centered(project_positions=True), mbvi.MoreauJean()], ids=lambda s: s.name
)
def test_no_swift_body_falls_through_flat_ground(scheme, kind, field):
    """At 50 m/s, of bodies of 1 cm that turn far within a step after they strike, too."""
    for seed in range(12):
        problem, duration = thrown_down(kind, 0.01, seed, 50.0, 0.0, field=field)
        h = (2e-3, 5e-3, 1e-2)[seed % 3]
        assert stays_above(mbvi.simulate(problem, scheme, step=h, duration=duration), 0.01), (seed, h)


@pytest.mark.parametrize(
    ("size", "seed", "h", "speed", "e", "field"),
    [
        (0.01, 1047, 5.52e-3, 48.5, 1.0, True),
        (0.02, 1292, 5.39e-3, 32.2, 0.5, False),
        (0.1, 1548, 1.59e-3, 51.3, 1.0, False),
        (0.1, 1582, 1.71e-3, 39.1, 0.0, False),
    ],
)
def test_a_body_passes_in_no_step_of_two_short_halves(size, seed, h, speed, e, field):
    """Each half is shorter than the body is thick, and at the end of both it would be through."""
    scheme = mbvi.Centered(project_positions=True)
    for step in h * np.linspace(0.9, 1.1, 9):
        problem, duration = thrown_down("capsule", size, seed, speed, e, field=field)
        assert stays_above(mbvi.simulate(problem, scheme, step=step, duration=duration), size), step


@pytest.mark.parametrize(
    "scheme", [mbvi.StewartTrinkle(), mbvi.MoreauJean(1.0), mbvi.Paoli()], ids=["trinkle", "jean", "paoli"]
)
def test_a_rod_that_turns_by_more_than_half_a_turn_strikes_what_is_in_its_way(scheme):
    """Its ends alone do not say how far it turned; the cube is in the way of one of its halves at any angle."""
    h = 1e-2
    for turn in (4.0, 5.0, 6.0):
        for angle in np.linspace(0.5, 2.9, 6):
            scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5)
            scene.add_box((1.0, 0.02, 0.02), position=(0, 0, 0), angular_velocity=(0, 0, turn / h), name="rod")
            scene.add_box((0.06, 0.06, 0.06), position=(0.4 * np.cos(angle), 0.4 * np.sin(angle), 0), name="cube")
            run = mbvi.simulate(scene.build(), scheme, step=h, duration=h)
            assert np.abs(run.v[-1][6:]).max() > 1e-6, (turn, angle)


def thrown_needle(seed, rough, kind):
    """A needle of 2 x 2 x 50 cm that meets a field at 50 m/s, aslant and spinning; afterwards it spins very fast."""
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene(restitution=0.4)
    scene.add_heightfield(rough * rng.uniform(size=(8, 9)), size=(6, 6))
    velocity = np.append(5 * rng.normal(size=2), -50.0)
    body = {
        "position": np.append(rng.uniform(-0.5, 0.5, 2) - 0.024 * velocity[:2], 1.4),
        "rotation": Rotation.random(random_state=seed).as_matrix(),
        "velocity": velocity,
        "angular_velocity": 10 * rng.normal(size=3),
    }
    scene.add_box((0.02, 0.02, 0.5), **body) if kind == "box" else scene.add_cylinder(0.01, 0.5, **body)
    return scene.build()


@pytest.mark.parametrize(
    ("kind", "rough", "seeds"), [("box", 0.0, (2, 12, 34, 36)), ("box", 0.6, (3,)), ("cylinder", 0.6, (4,))]
)
def test_a_needle_that_tumbles_fast_passes_no_field(kind, rough, seeds):
    """Free bodies of `Centered` move as nothing acts on them, not at constant velocity along the body's axes."""
    for seed in seeds:
        problem = thrown_needle(seed, rough, kind)
        run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=1e-2, duration=0.15)
        assert run.q[:, 2].min() > -0.02, seed


TIPPING = [*SCHEMES, mbvi.Paoli(project_positions=True), mbvi.StewartTrinkle()]


@pytest.mark.parametrize("spin", [5.0, 20.0])
@pytest.mark.parametrize("kind", ["box", "capsule"])
@pytest.mark.parametrize("scheme", TIPPING, ids=repr)
def test_a_rod_that_tips_over_its_end_stays_on_its_side_of_a_thin_plate(scheme, kind, spin):
    """Its lower end touches the plate and stands still: the rod neither approaches nor parts when a step begins."""
    for angle in (0.02, 0.1):
        scene = mbvi.Scene(gravity=(0, 0, 0))
        scene.add_box((3.0, 3.0, 0.01), position=(0, 0, -0.005), fixed=True, name="plate")
        along, up = np.array([np.cos(angle), 0.0, np.sin(angle)]), np.array([-np.sin(angle), 0.0, np.cos(angle)])
        place = 0.5 * along + 0.005 * (up if kind == "box" else np.array([0.0, 0.0, 1.0]))
        motion = {"velocity": np.cross((0.0, spin, 0.0), place), "angular_velocity": (0.0, spin, 0.0)}
        if kind == "box":
            scene.add_box((1.0, 0.02, 0.01), 1.0, position=place, rotation=(0, -angle, 0), **motion)
        else:
            scene.add_capsule(0.005, 1.0, 1.0, position=place, rotation=(0, np.pi / 2 - angle, 0), **motion)
        run = mbvi.simulate(scene.build(), scheme, step=1e-2, duration=0.05, progress=False)
        # its axis is above the middle of the plate
        ends = 0.5 * np.abs(Rotation.from_quat(run.q[:, 3:7]).as_matrix()[:, 2, 0 if kind == "box" else 2])
        assert (run.q[:, 2] - ends).min() > -0.005 and np.linalg.norm(run.v[-1, :3]) < 2.0 * spin
