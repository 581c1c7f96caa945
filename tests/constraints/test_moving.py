"""Walls with a prescribed motion, against exact solutions and the laws of a change of frame."""

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.geometry.motion import Oscillation, Rotation, Translation
from support.shaken_table import Table

G = 9.81
SCHEMES = {
    "Paoli": (mbvi.Paoli(), 2.0),
    "Paoli lifted": (mbvi.Paoli(project_positions=True), 2.0),
    "Moreau-Jean": (mbvi.MoreauJean(), 2.0),
    "Centered": (mbvi.Centered(), 1.0),
    "Schatzman-Paoli": (mbvi.SchatzmanPaoli(), 2.0),
}


ALL = {name: scheme for name, (scheme, _) in SCHEMES.items()} | {"Stewart-Trinkle": mbvi.StewartTrinkle()}


class Bounce:
    """A ball that meets a table once a period T, always at the same phase.

    It leaves with g T / 2 and comes back with -g T / 2; that e (g T / 2 + s') is g T / 2 - s' gives the speed s' of the
    table then.
    """

    a, w, e = 0.05, 4 * np.pi, 0.8
    T = 2 * np.pi / w
    speed = 0.5 * G * T
    phase = float(np.arccos((1 - e) / (1 + e) * speed / (a * w)))

    def height(self, t):
        since = np.mod(t, self.T)
        return self.a * np.sin(self.phase) + self.speed * since - 0.5 * G * since**2


def bounced(scheme, steps, given_as_function):
    bounce = Bounce()
    if given_as_function:
        system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=lambda t, q, v: np.array([-G]), dim=1)
        start = [bounce.a * np.sin(bounce.phase)]
        table = Table(bounce.a, bounce.w)
        t0 = bounce.phase / bounce.w
        problem = mbvi.Problem(system, [table], start, [bounce.speed], restitution=bounce.e, t0=t0)
    else:
        scene = mbvi.Scene(restitution=bounce.e)
        motion = Oscillation((0, 0, bounce.a), bounce.w / (2 * np.pi), bounce.phase)
        scene.add_halfspace((0, 0, 1), motion=motion)
        scene.add_sphere(0.1, position=(0, 0, 0.1 + bounce.a * np.sin(bounce.phase)), velocity=(0, 0, bounce.speed))
        problem = scene.build()
    run = mbvi.simulate(problem, scheme, step=bounce.T / steps, duration=4.5 * bounce.T)
    q = run.q[:, 0] if given_as_function else run.q[:, 2] - 0.1
    return run, float(np.abs(q - bounce.height(run.t - run.t[0])).max())


@pytest.mark.parametrize("name", SCHEMES)
def test_the_ball_on_a_shaken_table_keeps_its_period(name):
    """At order one: the error falls in proportion to the step."""
    scheme, factor = SCHEMES[name]
    steps = [200.37, 400.37, 800.37]
    errors = [bounced(scheme, n, name != "Centered")[1] for n in steps]
    run = bounced(scheme, steps[-1], True)[0]
    assert len(run.impacts) == 4
    for n, error in zip(steps, errors, strict=True):
        # a step's travel at the relative speed of impact
        assert error < factor * 2 * Bounce.speed * Bounce.T / n
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] < -0.9
    relative = -Bounce.speed - (1 - Bounce.e) / (1 + Bounce.e) * Bounce.speed
    np.testing.assert_allclose([i.before[0] for i in run.impacts], relative, rtol=4e-3)
    if name != "Schatzman-Paoli":
        # whose impacts take two steps
        np.testing.assert_allclose([i.after[0] / i.before[0] for i in run.impacts], -Bounce.e, atol=4e-3)
    # the table gives the energy that impacts take: as it sees them they lose
    assert run.diagnosis().energy_excess == 0.0 and all(i.energy_change < 0.0 for i in run.impacts)


def test_a_table_given_as_a_function_and_one_of_a_scene_are_the_same():
    one, two = (bounced(mbvi.Paoli(), 400.37, given_as_function)[0] for given_as_function in (True, False))
    np.testing.assert_allclose(two.q[:, 2] - 0.1, one.q[:, 0], rtol=0, atol=1e-12)


def box(velocity, e, spheres, wall=None):
    """Spheres, a box and a robot's worth of shapes in a container that moves at constant velocity."""
    rng = np.random.default_rng(5)
    scene = mbvi.Scene(gravity=(0, 0, -2.0), restitution=e)
    motion = Translation(velocity) if np.any(velocity) else None
    scene.add_container((-1, -1, 0), (1, 1), motion=motion)
    scene.add_box((0.3, 0.3, 0.3), position=(0, 0, 0.15), name="block", fixed=True, motion=motion)
    places = rng.uniform((-0.8, -0.8, 0.7), (0.8, 0.8, 2.3), (spheres, 3))
    speeds = rng.uniform(-2, 2, (spheres, 3))
    scene.add_spheres(places, 0.1, mass=1.0, velocities=speeds + velocity)
    scene.add_capsule(0.1, 0.3, position=(0.2, 0.6, 0.5), velocity=np.array([0.4, -2, -1]) + velocity)
    return scene.build()


@pytest.mark.parametrize("name", [*SCHEMES, "Stewart-Trinkle"])
@given(velocity=st.tuples(*[st.floats(-2, 2)] * 3), e=st.sampled_from([0.0, 0.6, 1.0]))
@settings(max_examples=3, phases=[Phase.explicit, Phase.generate])
def test_a_box_at_constant_speed_is_a_box_at_rest_seen_from_elsewhere(name, velocity, e):
    scheme, velocity = ALL[name], np.array(velocity)
    e = 0.0 if name == "Stewart-Trinkle" else e
    runs = [mbvi.simulate(box(u, e, 2), scheme, step=2e-3, duration=0.7) for u in (np.zeros(3), velocity)]
    still, moved = runs
    capsule, spheres = np.array([0, 1, 2]), 7 + np.arange(6)
    where = np.concatenate([capsule, spheres]).reshape(-1, 3)
    shift = moved.q[:, where] - still.q[:, where] - moved.t[:, None, None] * velocity
    assert len(still.impacts) > 2 and len(moved.impacts) == len(still.impacts)
    assert np.abs(shift).max() < 1e-9
    np.testing.assert_allclose(moved.penetration(), still.penetration(), atol=1e-9)
    for a, b in zip(still.impacts, moved.impacts, strict=True):
        # a row whose percussion is rounding may belong to one of them only
        one, other = (dict(zip(i.constraints, i.percussion.tolist(), strict=True)) for i in (a, b))
        for name in {*one, *other}:
            assert other.get(name, 0.0) == pytest.approx(one.get(name, 0.0), abs=1e-8), name
        np.testing.assert_allclose(b.energy_change, a.energy_change, atol=1e-8)


LIFTING = [scheme(project_positions=True) for scheme in (mbvi.Centered, mbvi.MoreauJean, mbvi.Paoli)]


def landing(velocity, seed):
    """A box or a capsule that falls tilted on a floor, all of it at a constant velocity besides."""
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene()
    if rng.random() < 0.5:
        scene.add_halfspace((0, 0, 1), motion=Translation(velocity))
    else:
        scene.add_box((4, 4, 0.4), position=(0, 0, -0.2), fixed=True, motion=Translation(velocity))
    drop = {
        "mass": rng.uniform(0.5, 2.0), "position": (0, 0, rng.uniform(0.3, 0.5)),
        "velocity": 0.5 * rng.normal(size=3) + velocity, "angular_velocity": 2.0 * rng.normal(size=3),
        "rotation": rng.uniform(-3, 3, 3),
    }  # fmt: skip
    if rng.random() < 0.5:
        scene.add_box((0.2, 0.15, 0.25), **drop)
    else:
        scene.add_capsule(0.07, 0.15, **drop)
    return scene.build()


@pytest.mark.parametrize("scheme", LIFTING, ids=str)
def test_a_body_that_lands_on_a_moving_floor_does_so_as_on_one_at_rest(scheme):
    """Contacts that join the law after the position projection count the speed of the floor, too."""
    rng, landed = np.random.default_rng(31), 0
    for seed in range(16):
        velocity = rng.uniform(-1, 1, 3)
        still, moved = (
            mbvi.simulate(landing(u, seed), scheme, step=[1e-3, 2e-3, 5e-3][seed % 3], duration=0.35)
            for u in (np.zeros(3), velocity)
        )
        shift = moved.q - still.q
        shift[:, :3] -= moved.t[:, None] * velocity
        assert np.abs(shift).max() < 1e-8, seed
        landed += len(still.impacts) > 1
    assert landed > 8


@pytest.mark.parametrize("name", [*SCHEMES, "Stewart-Trinkle"])
def test_a_ball_rests_on_a_table_that_accelerates_gently(name):
    """It stays where the table's acceleration is below g: to the order of a step, whatever the phase."""
    scene = mbvi.Scene()
    motion = Oscillation((0, 0, 0.02), 2.0)
    scene.add_halfspace((0, 0, 1), motion=motion)
    scene.add_sphere(0.1, position=(0, 0, 0.1))
    run = mbvi.simulate(scene.build(), ALL[name], step=1e-3, duration=1.0)
    table = np.array([motion.pose(t)[1][2] for t in run.t])
    # largest acceleration 3.2 m/s^2
    assert np.abs(run.q[:, 2] - 0.1 - table).max() < 2e-3
    # the scheme for piles keeps gaps to second order
    assert run.penetration().max() < (1e-6 if name == "Stewart-Trinkle" else 2e-3)


def test_a_turning_wall_gives_only_its_normal_motion():
    """A horizontal disc that turns leaves a ball on it where it is; a turning vertical wall drives it as a lever."""
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1), name="disc", motion=Rotation((0, 0, 1), 7.0))
    scene.add_sphere(0.1, position=(0.4, 0.3, 0.1))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.5)
    np.testing.assert_allclose(run.q, np.tile([0.4, 0.3, 0.1], (len(run.t), 1)), atol=1e-5)

    # a plane through the axis, pushing without gravity: r'' = w^2 r along it, while r' = w r... cosh and sinh
    w, d, r = 2.0, 0.5, 0.05
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_halfspace((0, 1, 0), name="paddle", motion=Rotation((0, 0, 1), w))
    scene.add_sphere(r, position=(d, r, 0), velocity=(0, w * d, 0))
    errors = []
    for h in (2e-3, 1e-3, 5e-4):
        run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=h, duration=1.0)
        # on the paddle x = s along, r above: s'' = w^2 s with s(0) = d and s'(0) = w r, for v = v_rel + w x (s, r)
        s = d * np.cosh(w * run.t) + r * np.sinh(w * run.t)
        along = np.stack([np.cos(w * run.t), np.sin(w * run.t)], axis=1)
        exact = s[:, None] * along + r * along[:, ::-1] * [-1, 1]
        errors.append(np.abs(run.q[:, :2] - exact).max())
    assert errors[-1] < 5e-3 and errors[2] < 0.6 * errors[1] < 0.36 * errors[0]


@given(st.floats(-3, 3), st.floats(0.1, 2 * np.pi))
@settings(max_examples=10)
def test_rates_are_the_derivative_of_gaps(t, rate):
    motion = Rotation((1, 2, -1), rate, (0.3, 0.1, -0.2))
    scene = mbvi.Scene()
    scene.add_halfspace((0.1, 0, 1), offset=-9.0, motion=motion)
    scene.add_box((1, 2, 3), position=(0, 0, -4), motion=motion, name="paddle")
    scene.add_surface([[-1, -1, -2], [1, -1, -2], [0, 2, -2.5]], [[0, 1, 2]], motion=motion)
    scene.add_sphere(0.2, position=(0.3, 0, 1.0))
    scene.add_spheres(np.array([[2.0, 0, 1.0], [-1.0, 0.2, 1.0]]), 0.2, mass=1.0)
    problem = scene.build()
    h = 1e-5
    for constraint in problem.constraints.constraints:
        if constraint.moving:
            ends = [np.array(constraint.gap(t + k * h, problem.q0)) for k in (1, -1)]
            np.testing.assert_allclose(constraint.rate(t, problem.q0), (ends[0] - ends[1]) / (2 * h), atol=1e-6)
    assert problem.constraints.moving


def test_only_what_moves_has_rates():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, 0, 0.1))
    still = scene.build()
    assert not still.constraints.moving
    assert still.constraints.active(0.0, still.q0, still.tolerance).rate is None
    scene.add_halfspace((1, 0, 0), offset=-0.1, motion=Translation((-1.0, 0, 0)))
    both = scene.build()
    np.testing.assert_allclose(both.constraints.active(0.0, both.q0, both.tolerance).rate, [0.0, 1.0])


def test_a_wall_that_strikes_at_the_start_is_met_by_the_law_there():
    scene = mbvi.Scene(restitution=0.5, gravity=(0, 0, 0))
    scene.add_halfspace((0, 0, 1), motion=Translation((0, 0, 2.0)))
    scene.add_sphere(0.1, position=(0, 0, 0.1))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1)
    assert run.impacts[0].time == 0.0 and run.impacts[0].before == pytest.approx([-2.0])
    np.testing.assert_allclose(run.v[:, 2], 3.0)
    assert run.diagnosis().energy_excess == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.add_halfspace((0, 0, 1), motion=Translation), "must be an object"),
        (lambda s: s.add_container((0, 0, 0), (1, 1), motion=3.0), "must be an object"),
        (lambda s: Oscillation((0, 0), 1.0), r"must have \(3,\)"),
        (lambda s: Oscillation((0, 0, 1), np.nan), "frequency must be a finite number"),
        (lambda s: Rotation((0, 0, 0), 1.0), "must not be zero"),
        (lambda s: Translation("fast"), "velocity must be numbers of shape"),
        (lambda s: s.add_halfspace((0, 0, 1), motion=Liar()), "is not the velocity of"),
        (lambda s: s.add_halfspace((0, 0, 1), motion=Odd()), "must return shapes"),
    ],
)
def test_wrong_motions_say_what_is_wrong(call, message):
    with pytest.raises(mbvi.InputError, match=message):
        call(mbvi.Scene())


class Liar(Translation):
    def __init__(self):
        super().__init__((0, 0, 1.0))

    def twist(self, t):
        return np.array([0, 0, 2.0]), np.zeros(3)


class Odd(Liar):
    def pose(self, t):
        return np.eye(2), np.zeros(3)


def test_error_control_says_that_it_knows_no_moving_walls():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), motion=Translation((0, 0, 1.0)))
    scene.add_sphere(0.1, position=(0, 0, 0.2))
    with pytest.raises(mbvi.UnsuitableError, match="EventDriven does not know walls that move"):
        mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.1)


def moving_scene(motion):
    scene = mbvi.Scene(restitution=0.3)
    scene.add_container((-1, -1, 0), (1, 1), motion=motion)
    scene.add_surface([[-1, -1, 0.2], [1, -1, 0.2], [0, 1, 0.3]], [[0, 1, 2]], name="shelf", motion=motion)
    scene.add_box((0.2, 0.2, 0.2), position=(0.5, 0.5, 0.8), name="paddle", motion=Rotation((0, 0, 1), 2.0))
    scene.add_spheres(np.array([[0, 0, 0.6], [0.3, 0.1, 1.5]]), 0.1, density=1000.0)
    return scene.build()


def test_a_file_brings_moving_walls_back(tmp_path):
    run = mbvi.simulate(moving_scene(Oscillation((0, 0, 0.05), 3.0)), mbvi.Paoli(), step=2e-3, duration=0.5)
    run.save(tmp_path / "run.h5")
    back = mbvi.load(tmp_path / "run.h5")
    again = mbvi.simulate(back.problem, mbvi.Paoli(), step=2e-3, duration=0.5)
    assert again.q.tobytes() == run.q.tobytes() and len(run.impacts) > 0
    assert back.diagnosis().energy_excess == run.diagnosis().energy_excess


class Own(Translation):
    pass


def test_a_file_says_that_it_lost_a_motion_of_the_users_own(tmp_path):
    run = mbvi.simulate(moving_scene(Own((0, 0, 0.1))), mbvi.Paoli(), step=2e-3, duration=0.2)
    run.save(tmp_path / "run.h5")
    with pytest.warns(mbvi.MbviWarning, match="motion of "):
        back = mbvi.load(tmp_path / "run.h5")
    with pytest.raises(mbvi.InputError, match="motion of "):
        mbvi.simulate(back.problem, mbvi.Paoli(), step=2e-3, duration=0.2)
    assert np.isnan(back.diagnosis().energy_excess)
    np.testing.assert_allclose(back.energy(), run.energy())


def test_many_spheres_meet_moving_walls_in_bulk_as_few_do_one_by_one():
    """34 spheres far apart: each as if it were alone."""
    places = np.stack([*np.meshgrid(np.arange(6.0), np.arange(6.0), indexing="ij"), np.full((6, 6), 0.4)], axis=-1)
    places = places.reshape(-1, 3)[:34]
    motion = Oscillation((0.02, 0.03, 0.05), 4.0)

    def shaken(positions):
        scene = mbvi.Scene(restitution=0.4)
        scene.add_halfspace((0.1, 0, 1), motion=motion)
        scene.add_box((20, 20, 0.1), position=(0, 0, 0.1), motion=motion)
        scene.add_spheres(positions, 0.1, mass=1.0)
        return mbvi.simulate(scene.build(), mbvi.Paoli(), step=2e-3, duration=0.4)

    many = shaken(places)
    for k in (0, 17, 33):
        one = shaken(places[k : k + 1])
        np.testing.assert_allclose(many.q[:, 3 * k : 3 * k + 3], one.q, atol=1e-9)
    assert len(many.impacts) > 0 and many.penetration().max() < 0.01


def test_many_boxes_meet_moving_ones_as_few_do():
    """320 pairs are found when near, 160 are all kept: the same contacts."""
    rng = np.random.default_rng(3)
    places = np.stack(np.meshgrid(np.arange(10.0), np.arange(8.0), [0.6], indexing="ij"), axis=-1).reshape(-1, 3)
    turns = np.array([Rotation(axis, 1.0).pose(0.4)[0] for axis in rng.normal(size=(80, 3))])
    motion = Rotation((0, 0, 1), 0.3, (4.5, 3.5, 0))

    def near_blades(chosen, t):
        """The deepest gap and its rate of each pair of a blade and a box."""
        scene = mbvi.Scene(restitution=0.4)
        for k, corner in enumerate([(2, 1.5), (7, 1.5), (2, 5.5), (7, 5.5)]):
            scene.add_box((4.8, 3.8, 0.2), position=(*corner, 0), name=f"blade{k}", motion=motion)
        scene.add_boxes(places[chosen], (0.5, 0.5, 0.4), mass=1.0, rotations=turns[chosen])
        problem = scene.build()
        rows = problem.constraints.active(t, problem.q0, 0.25)
        found = {}
        for k in np.argsort(-rows.gap):
            first, second = problem.constraints.name(int(rows.constraint[k])).split(" | ")
            if first.startswith("blade"):
                found[first, chosen[int(second[6:-1])]] = rows.gap[k], rows.rate[k]
        return found

    every = list(range(80))
    for t in (0.0, 0.7):
        many, few = near_blades(every, t), near_blades(every[:40], t) | near_blades(every[40:], t)
        assert len(many) > 10 and many.keys() == few.keys()
        np.testing.assert_allclose([many[key] for key in few], list(few.values()), atol=1e-9)


def test_the_default_scheme_of_moving_walls_is_one_of_fixed_steps():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), motion=Oscillation((0, 0, 0.02), 2.0))
    scene.add_sphere(0.1, position=(0, 0, 0.3))
    run = mbvi.simulate(scene.build(), duration=0.5)
    assert run.scheme == "Centered" and "walls move on their own" in run.notes[0]
