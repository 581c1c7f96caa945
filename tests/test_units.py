"""No unit of length or of mass matters: lengths, velocities and gravity times s give the same motion times s."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.run.default_scheme import default_scheme
from mbvi.system.parts import velocity_units
from support.random_scenes import SHAPES, add_robot, add_shape, random_scene

PAIRS = [(a, b) for k, a in enumerate(SHAPES) for b in SHAPES[k:]]
PLACES = ("free", "fixed", "half-space")
FIXED_STEP = {
    "Paoli": mbvi.Paoli(),
    "Centered": mbvi.Centered(),
    "lifting": mbvi.Centered(project_positions=True),
    "MoreauJean": mbvi.MoreauJean(),
    "SchatzmanPaoli": mbvi.SchatzmanPaoli(),
    "StewartTrinkle": mbvi.StewartTrinkle(),
}
SCHEMES = {**FIXED_STEP, "EventDriven": mbvi.EventDriven(1e-8), "default": None}
# powers of two leave no rounding to excuse a difference
BINARY = 2.0**-13
LENGTHS = [1e-4, 1e3]
# every two shapes with every scheme and in every place, and every scheme in every place
MEETINGS = [
    (a, b, PLACES[(k + n) % len(PLACES)], scheme) for k, (a, b) in enumerate(PAIRS) for n, scheme in enumerate(SCHEMES)
]
# every random scene with two schemes
SCENES = [(scheme, seed) for k, scheme in enumerate(FIXED_STEP) for seed in range(40) if (seed - k) % 3 == 0]


def dimensionless(run, length, times):
    """Velocities at some times in lengths of `length`."""
    v = run.v if times is None else np.array([run.at(t)[1] for t in times])
    return v / velocity_units(run.problem.system, length)


def compared_at(run, duration):
    """None for all states of fixed steps; under error control some times that no impact is near."""
    if run.step:
        return None
    struck = np.array([-1.0, *(impact.time for impact in run.impacts)])
    times = np.linspace(0.0, duration, 60)
    return times[np.abs(times[:, None] - struck).min(axis=1) > 1e-5]


def simulate(problem, scheme, duration):
    step = {"step": 2e-3} if isinstance(scheme, tuple(type(s) for s in FIXED_STEP.values())) else {}
    return mbvi.simulate(problem, scheme, duration=duration, progress=False, **step)


def meeting(a, b, length=1.0, mass=1.0, seed=0, e=0.5, fixed=False, plane=False):
    """Two random shapes that meet in the air, or one that meets one of the world, or a half-space."""
    rng = np.random.default_rng(seed)
    towards, off = rng.normal(size=3), 0.03 * rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    scene = mbvi.Scene(gravity=length * np.array([0.0, 0.0, -0.3]), restitution=e)
    if plane:
        scene.add_halfspace(-towards, -0.12 * length)
    names = [
        add_shape(scene, a, rng, length, mass, at=-0.25 * towards),
        add_shape(scene, b, rng, length, mass, at=0.25 * towards + off, fixed=fixed) if not plane else None,
    ]
    bodies = {item.name: item for item in scene._items.bodies}
    bodies |= {item.name: item for item in scene._items.spheres}
    for name, sign in zip(names, (1.0, -1.0), strict=True):
        if name is None:
            continue
        item = bodies[name]
        velocity = sign * length * 1.5 * towards
        if hasattr(item, "velocities"):
            item.velocities[:] = velocity
        elif not item.fixed:
            item.velocity[:] = velocity
    return scene.build()


def hard_impacts(run):
    """When impacts were, and what took part by more than rounding: contacts that last strike again by that."""
    least = 1e-9 * max((impact.percussion.max() for impact in run.impacts), default=0.0)
    found = [(round(i.time, 9), [i.constraints[k] for k in np.flatnonzero(i.percussion > least)]) for i in run.impacts]
    return [impact for impact in found if impact[1]]


def check(make, scheme, duration, lengths=(BINARY, *LENGTHS), masses=()):
    """Compare runs of make(length, mass) with that of (1, 1); return it."""
    run = simulate(make(1.0, 1.0), scheme, duration)
    times = compared_at(run, duration)
    first = dimensionless(run, 1.0, times)
    for length, mass in [*((s, 1.0) for s in lengths), *((1.0, k) for k in masses)]:
        other = simulate(make(length, mass), scheme, duration)
        v = dimensionless(other, length, times)
        np.testing.assert_allclose(v, first, rtol=0, atol=1e-6 * max(1.0, np.abs(first).max()))
        # several points of one pair may share a percussion in more than one way
        if run.step and all(len(set(names)) == len(names) for _, names in hard_impacts(run)):
            assert hard_impacts(other) == hard_impacts(run)
        if run.step and np.log2(length) % 1.0 == 0.0 and np.log2(mass) % 1.0 == 0.0:
            np.testing.assert_array_equal(v, first)
    return run


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_every_two_shapes_meet_the_same_at_any_unit(a, b):
    number = PAIRS.index((a, b))
    scheme = list(SCHEMES.values())[number % len(SCHEMES)]
    e = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.5
    run = check(lambda s, m: meeting(a, b, s, m, number, e), scheme, 0.25, masses=(2.0**20, 1e-6))
    assert run.impacts


@pytest.mark.slow
@pytest.mark.parametrize(("a", "b", "where", "scheme"), MEETINGS)
def test_every_two_shapes_meet_the_same_with_every_scheme(a, b, where, scheme):
    options = {
        "fixed": where == "fixed",
        "plane": where == "half-space",
        "e": 0.0 if scheme == "StewartTrinkle" else 0.5,
    }
    met = 0
    for seed in range(3):
        run = check(
            lambda s, m, seed=seed: meeting(a, b, s, m, seed, **options), SCHEMES[scheme], 0.25,
            (BINARY, 1e-4, 0.037, 1e3), (2.0**20, 1e-6, 1e6),
        )  # fmt: skip
        met += len(run.impacts)
    assert met


@settings(max_examples=12)
@given(seed=st.integers(0, 10_000), exponent=st.floats(-4.0, 3.0), scheme=st.sampled_from(sorted(FIXED_STEP)))
def test_random_scenes_move_the_same_at_any_unit(seed, exponent, scheme):
    e = 0.0 if scheme == "StewartTrinkle" else None
    check(lambda s, m: random_scene(seed, s, m, e).build(), FIXED_STEP[scheme], 0.1, (BINARY, 10.0**exponent), (1e6,))


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "seed"), SCENES)
def test_random_scenes_move_the_same_with_every_scheme(seed, scheme):
    e = 0.0 if scheme == "StewartTrinkle" else None
    check(lambda s, m: random_scene(seed, s, m, e).build(), FIXED_STEP[scheme], 0.25, (BINARY, *LENGTHS), (1e-6,))


def falling_robot(name, height, length, mass):
    rng = np.random.default_rng(0)
    scene = mbvi.Scene(gravity=(0.0, 0.0, -9.81 * length), restitution=0.3)
    if name != "arm":
        scene.add_halfspace((0, 0, 1), 0.0)
    add_robot(scene, name, rng, length, mass, at=(0.0, 0.0, height))
    return scene.build()


@pytest.mark.parametrize(
    ("name", "height", "scheme"),
    [
        *(
            (name, height, scheme)
            for name, height in (("arm", 0.0), ("hopper", 0.55))
            for scheme in ("lifting", "EventDriven")
        ),
        # its feet strike at once: error control would tell rounding apart
        ("quadruped", 0.5, "Centered"),
    ],
)
def test_robots_reach_their_limits_and_the_floor_the_same(name, height, scheme):
    run = check(lambda s, m: falling_robot(name, height, s, m), SCHEMES[scheme], 0.35, (BINARY, *LENGTHS), (1e-6,))
    assert run.impacts


def test_joints_rest_at_their_limits_the_same():
    """Angles are held against radians: a limit that is reached earlier or later by a length would show here."""
    run = check(lambda s, m: falling_robot("arm", 0.0, s, m), mbvi.Centered(project_positions=True), 1.0, (BINARY, 1e3))
    assert any("limit" in name for impact in run.impacts for name in impact.constraints)


def bouncing(length, mass):
    scene = mbvi.Scene(gravity=(0.0, 0.0, -9.81 * length), restitution=0.5)
    scene.add_halfspace((0.1, 0, 1), 0.0)
    scene.add_sphere(0.1 * length, mass, position=(0, 0, 0.5 * length), velocity=(0.3 * length, 0, 0))
    return scene.build()


def test_bounces_are_put_to_rest_after_as_many_impacts():
    runs = [simulate(bouncing(s, 1.0), mbvi.EventDriven(1e-8), 1.5) for s in (1.0, BINARY, *LENGTHS)]
    counts = [len(run.impacts) for run in runs]
    assert counts[0] > 10 and len(set(counts)) == 1
    # steps and all
    np.testing.assert_array_equal(runs[1].t, runs[0].t)
    np.testing.assert_array_equal(runs[1].v / BINARY, runs[0].v)


@pytest.mark.parametrize("scheme", ["Paoli", "lifting"])
@pytest.mark.parametrize("kind", ["sphere", "ellipsoid", "capsule", "cylinder"])
@pytest.mark.parametrize("length", [1e-3, 1.0])
def test_what_rests_on_a_box_stays_where_it_is(kind, scheme, length):
    scene = mbvi.Scene(gravity=(0.0, 0.0, -9.81 * length))
    scene.add_box(length * np.array([1.0, 1.0, 0.2]), position=(0, 0, -0.1 * length), fixed=True)
    at = {"position": length * np.array([0.013, 0.021, 0.1])}
    if kind == "sphere":
        scene.add_sphere(0.1 * length, 1.0, **at)
    elif kind == "ellipsoid":
        scene.add_ellipsoid(length * np.array([0.2, 0.15, 0.1]), 1.0, **at)
    elif kind == "cylinder":
        scene.add_cylinder(0.1 * length, 0.2 * length, 1.0, **at)
    else:
        turn = Rotation.from_euler("y", 90, degrees=True).as_matrix()
        scene.add_capsule(0.1 * length, 0.2 * length, 1.0, rotation=turn, **at)
    # nothing sleeps, and every contact is measured again
    run = mbvi.simulate(scene.build(reduce=[]), SCHEMES[scheme], step=1e-3, duration=0.5, progress=False)
    assert np.abs(run.q[-1] - run.q[0]).max() <= 1e-12 * length


@pytest.mark.parametrize(
    "make", [lambda s: meeting("box", "box", s), lambda s: falling_robot("quadruped", 0.5, s, 1.0)]
)
def test_the_default_scheme_and_its_step_are_the_same(make):
    found = [default_scheme(make(s), 1.0)[:2] for s in (1.0, *LENGTHS)]
    assert all(type(scheme) is type(found[0][0]) and h == found[0][1] for scheme, h in found)


def test_which_velocities_are_lengths():
    scene = mbvi.Scene()
    add_robot(scene, "hopper", np.random.default_rng(0), at=(0.0, 0.0, 2.0))
    add_shape(scene, "box", np.random.default_rng(0), at=(3.0, 0.0, 2.0))
    add_shape(scene, "sphere", np.random.default_rng(0), at=(6.0, 0.0, 2.0))
    system = scene.build().system
    turning = [True] * 3 + [False] * 3
    hopper = turning + [False] * (system.nv - 15)
    assert system.are_lengths().tolist() == [*hopper, *turning, True, True, True]
