"""`mbvi.sensitivity` of motions with Coulomb friction, against closed forms and differences of runs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from support.derivatives import agrees, slopes

G = 9.81


def point(force, q, v, e, mu):
    """A point of unit mass above the line or plane where its last coordinate is zero."""
    n = len(q)
    up, along = np.eye(n)[-1], np.zeros((2, n))
    along[range(n - 1), range(n - 1)] = 1.0
    system = mbvi.LagrangianSystem(lambda q: np.eye(n), force, n)
    floor = mbvi.GapFunction(lambda q: q[-1], lambda q: up, name="floor", tangents=lambda q: along)
    return mbvi.Problem(system, [floor], q, v, restitution=e, friction=mu)


def differentiated(problem, duration, wrt=("state", "friction"), tolerance=1e-11):
    return mbvi.sensitivity(problem, mbvi.EventDriven(tolerance), duration=duration, wrt=wrt)


def on_slope(x, pull, duration):
    """Place and speed on a slope, from (place, speed, mu): up to a stop, then down, or at rest where mu holds it."""
    s, v, mu = x
    stop = v / (pull + mu * G)
    if stop.real > np.real(duration):
        return np.array([s + v * duration - 0.5 * (pull + mu * G) * duration**2, v - (pull + mu * G) * duration])
    s, left = s + 0.5 * v * stop, duration - stop
    down = pull - mu * G if pull > mu.real * G else 0.0
    return np.array([s - 0.5 * down * left**2, -down * left])


@pytest.mark.parametrize("seed", range(6))
def test_a_point_on_a_rough_plane(seed):
    """It slides up, stops, and then rests or slides down."""
    rng = np.random.default_rng(seed)
    x = np.array([rng.normal(), rng.uniform(0.5, 2), rng.uniform(0.1, 0.5)])
    pull = (rng.uniform(0.1, 0.8) if seed % 2 else rng.uniform(1.2, 2)) * x[2] * G
    found = differentiated(point(lambda t, q, v: np.array([-pull, -G]), [x[0], 0], [x[1], 0], 0, x[2]), 0.9)
    agrees(found.matrix[::2][:, [0, 2, 4]], slopes(lambda x: on_slope(x, pull, 0.9), x))


def thrown(x, e, r, duration):
    """Centre, velocity and spin of a ball over a rough floor, in the world, from those at the start and mu.

    It bounces; with e = 0 it stays, slides and rolls.
    """
    c, v, w, mu, left = x[:3], x[3:6], x[6:9], x[9], duration
    up, gravity = np.eye(3)[2], np.array([0, 0, -G])
    while True:
        t = (v[2] + np.sqrt(v[2] ** 2 + 2 * G * (c[2] - r))) / G
        if t.real > np.real(left):
            return np.concatenate([c + v * left + 0.5 * gravity * left**2, v + gravity * left, w])
        c, v, left = c + v * t + 0.5 * gravity * t**2, v + gravity * t, left - t
        press = -(1 + e) * v[2]
        v, w = strikes(v, w, mu * press, r, up)
        v = v + press * up
        if e == 0.0:
            slip = v + np.cross(w, -r * up)
            size = np.sqrt(slip @ slip)
            stop = size / (3.5 * mu * G)
            slides = stop if stop.real < np.real(left) else left
            way = slip / size if size.real > 1e-9 else 0 * slip
            c = c + v * slides - 0.5 * mu * G * way * slides**2
            v, w = v - mu * G * way * slides, w + 2.5 / r * mu * G * np.cross(up, way) * slides
            return np.concatenate([c + v * (left - slides), v, w])


def strikes(v, w, most, r, up):
    """Velocity and spin after the friction of a percussion that is at most so large."""
    slip = v + np.cross(w, -r * up)
    slip[2] = 0.0
    size = np.sqrt(slip @ slip)
    pull = -slip * 2 / 7 if (2 / 7 * size).real < most.real else -slip / size * most
    return v + pull, w + 2.5 / r * np.cross(-up, pull)


def in_world(matrix, q, v):
    """The rows of centre, velocity and spin of one free body, in the world, where only the spin is in its own axes."""
    x, y, z, s = q[3:7]
    turned = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - s * z), 2 * (x * z + s * y)],
        [2 * (x * y + s * z), 1 - 2 * (x * x + z * z), 2 * (y * z - s * x)],
        [2 * (x * z - s * y), 2 * (y * z + s * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    place, angle, velocity, spin = matrix[:3], matrix[3:6], matrix[6:9], matrix[9:12]
    return np.vstack([place, velocity, turned @ (spin + np.cross(angle, v[3:], axisa=0).T)])


SLIDES = pytest.mark.slow(seconds=15)


@pytest.mark.parametrize(
    ("e", "mu", "duration"),
    [
        pytest.param(0.6, 0.4, 0.9, id="bounces that stick"),
        pytest.param(0.6, 0.03, 0.9, id="bounces that slip"),
        pytest.param(0.0, 0.03, 0.7, id="sliding", marks=SLIDES),
        pytest.param(0.0, 0.1, 0.9, id="sliding, then rolling", marks=SLIDES),
    ],
)
@pytest.mark.parametrize("seed", range(2))
def test_a_ball_on_a_rough_floor(e, mu, duration, seed):
    rng = np.random.default_rng(seed)
    x = np.concatenate([[0, 0, rng.uniform(0.4, 0.6)], rng.normal(size=3) * [1, 1, 0.3], 3 * rng.normal(size=3), [mu]])
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.3, position=x[:3], name="ball")
    problem = scene.build()
    found = differentiated(problem.at(problem.q0, x[3:9]), duration, ("state", "friction of ball | floor"))
    run, exact = found.run, slopes(lambda x: thrown(x, e, 0.1, duration), x)
    world = in_world(found.matrix, run.q[-1], run.v[-1])[:, [0, 1, 2, 6, 7, 8, 9, 10, 11, 12]]
    agrees(world, exact)
    assert len(run.impacts) > 0


@pytest.mark.slow(seconds=40)
def test_stops_whose_direction_turns():
    """A ball that is pulled sideways while it slides turns towards the pull, and stops in it."""
    scene = mbvi.Scene(friction=0.3)
    normal = np.array([np.sin(0.3), 0, np.cos(0.3)])
    scene.add_halfspace(normal, name="slope")
    scene.add_sphere(radius=0.1, position=0.1 * normal, name="ball")
    problem = scene.build()
    across = np.array([0.3 * normal[2], 1.0, -0.3 * normal[0]])
    found = mbvi.sensitivity(problem.at(problem.q0, [*across, 0, 0, 0]), duration=0.25, wrt=["state", "friction"])
    assert not found.run.notes
    assert found.check(1).error.max() < 1e-6


@pytest.mark.slow(seconds=15)
@pytest.mark.parametrize(("most", "rate"), [(6, 3), (4, 9)])
def test_a_point_that_sticks_slips_and_stops(most, rate):
    given = point(lambda t, q, v: np.array([most * np.sin(rate * t), -G]), [0, 0], [0, 0], 0.0, 0.3)
    found = differentiated(given, 1.6)
    moves = np.abs(found.run.v[:, 0]) > 1e-9
    # it begins to slip and it stops
    assert (moves[1:] & ~moves[:-1]).any() and (moves[:-1] & ~moves[1:]).any()
    assert found.check(1).error.max() < 1e-7


def test_the_gradient_of_a_number_is_its_row_times_the_matrix():
    pull = 0.5
    given = point(lambda t, q, v: np.array([-pull - 0.3 * q[0], -G]), [0, 0.02], [0.9, 0], 0.0, 0.2)
    scheme, wrt = mbvi.EventDriven(1e-10), ["state", "friction"]
    row = np.array([1.0, 0, 0.7, 0])
    found = mbvi.gradient(given, lambda q, v: (q[0] + 0.7 * v[0], row), scheme, duration=0.8, wrt=wrt)
    matrix = mbvi.sensitivity(given, scheme, duration=0.8, wrt=wrt).matrix
    agrees(found.gradient, row @ matrix)
    assert np.abs(found.gradient).max() > 0.01


def two_feet():
    scene = mbvi.Scene(restitution=0.5, friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(2):
        scene.add_sphere(radius=0.1, position=(k, 0, 0.5), name=f"ball {k}")
    return scene.build()


def prism(corners, velocity):
    """A prism on a rough floor, whose base has these corners on an oval."""
    angle = 2 * np.pi * np.arange(corners) / corners
    base = 0.2 * np.column_stack([np.cos(angle) * (1 + 0.3 * np.cos(3 * angle)), np.sin(angle)])
    scene = mbvi.Scene(friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    points = np.vstack([np.column_stack([base, np.full(corners, z)]) for z in (0, 0.1)])
    scene.add_convex(points, positions=[(0, 0, 0)], density=800.0, name="prism")
    problem = scene.build()
    return problem.at(problem.q0, velocity)


def test_a_prism_that_slides_on_three_corners_and_turns():
    found = mbvi.sensitivity(prism(3, [1.5, 0, 0, 0, 0, 1.0]), duration=0.3, wrt=["state", "friction"])
    assert found.check(2).error.max() < 1e-7


@pytest.mark.slow(seconds=10)
def test_a_box_that_slides_on_four_corners_and_stops():
    """Their shares of the load do not matter, because they are those of a rectangle."""
    scene = mbvi.Scene(friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.3, 0.1), position=(0, 0, 0.05), velocity=(1.5, 0, 0), name="box")
    found = mbvi.sensitivity(scene.build(), duration=0.8, wrt=["state", "friction of box | floor"])
    assert np.abs(found.run.v[-1]).max() < 1e-12
    # the way is v^2 / (2 mu g)
    assert found.matrix[0, 6] == pytest.approx(1.5 / (0.3 * G), rel=1e-8)
    assert found.matrix[0, 12] == pytest.approx(-(1.5**2) / (2 * 0.3**2 * G), rel=1e-8)


def test_where_there_is_none():
    # a variation that turns it depends on how five corners share the load
    with pytest.raises(mbvi.SensitivityError, match="contacts share their load at will"):
        mbvi.sensitivity(prism(5, [1.5, 0, 0, 0, 0, 0]), duration=0.3)
    with pytest.raises(mbvi.SensitivityError, match="several close at once where there is friction"):
        mbvi.sensitivity(two_feet(), duration=0.5)
    with pytest.raises(mbvi.SensitivityError, match="along runs of EventDriven only, not of Paoli"):
        mbvi.sensitivity(two_feet(), mbvi.Paoli(), duration=0.1)
    with pytest.raises(mbvi.InputError, match=r"constraints that have friction are ball 0 | floor, ball 1 | floor"):
        mbvi.sensitivity(two_feet(), duration=0.1, wrt=["friction of ball 0"])


def landing(offset=0.0, mu=0.2):
    """A ball that falls, slides and rolls."""
    scene = mbvi.Scene(friction=mu)
    scene.add_halfspace((0, 0, 1), offset=offset, name="floor")
    scene.add_sphere(0.1, position=(0, 0, 0.3), velocity=(2, 0.4, 0), name="ball")
    return scene.build()


@pytest.mark.parametrize("duration", [0.22, 0.25, 0.4])
def test_a_floor_carries_what_slides_and_rolls_on_it(duration):
    """The height follows the floor, before and after the ball begins to roll; the gradient says the same."""
    found = mbvi.sensitivity(landing(), duration=duration, wrt=["offset of floor", "state"])
    d = 1e-6
    high, low = (mbvi.simulate(landing(x), mbvi.EventDriven(1e-12), duration=duration).q[-1] for x in (d, -d))
    expected = (high[:3] - low[:3]) / (2 * d)
    np.testing.assert_allclose(found.matrix[:3, 0], expected, atol=1e-6)
    assert found.matrix[2, 0] == pytest.approx(1.0, abs=1e-9)
    row = np.eye(12)[2]
    found = mbvi.gradient(landing(), lambda q, v: (q[2], row), duration=duration, wrt=["offset of floor"])
    np.testing.assert_allclose(found.gradient, [1.0], atol=1e-8)


@pytest.mark.parametrize("others", [1, 2])
def test_a_ball_lands_while_others_slide(others):
    """By parameters: by gravity and friction against v T - mu g T^2 / 2 of those that slide."""
    scene = mbvi.Scene(friction=0.2)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(others):
        scene.add_sphere(0.1, position=(0, 3 * k, 0.1), velocity=(2 + 0.4 * k, 0, 0), name=f"ball {k}")
    scene.add_sphere(0.1, position=(0, 9, 0.3), velocity=(3, 0, 0), name="last")
    T = 0.25
    found = mbvi.sensitivity(scene.build(), duration=T, wrt=["gravity", "friction"])
    for k in range(others):
        np.testing.assert_allclose(found.matrix[6 * k, -2:], [0.2 * T**2 / 2, -G * T**2 / 2], rtol=1e-8)
    # what lands has the jump of v by mu g t, then less time
    fall = np.sqrt(2 * 0.2 / G)
    left = T - fall
    by_friction = -G * fall * left - G * left**2 / 2
    assert found.matrix[6 * others, -1] == pytest.approx(by_friction, rel=1e-8)


def on_a_steep_slope(slope, mu, e):
    """A ball above a slope that meets it without slip."""
    speed, radius = np.sqrt(2 * G * np.cos(slope) * 0.2), 0.1
    scene = mbvi.Scene(gravity=(G * np.sin(slope), 0, -G * np.cos(slope)), friction=mu, restitution=e)
    scene.add_halfspace((0, 0, 1), name="slope")
    scene.add_sphere(radius, 1.0, (0, 0, radius + 0.2), name="ball")
    problem = scene.build()
    return problem.at(problem.q0, [0, 0, 0, 0, speed * np.tan(slope) / radius, 0]), speed


def test_by_restitution_none_where_a_contact_sticks_in_the_impact_and_slips_after_it():
    """A small e takes mu v off the friction of its first bounce, where the ball leaves the slope without slip."""
    slope, mu = 0.8, 0.1
    (problem, speed), e = on_a_steep_slope(slope, mu, 0.0), 1e-4
    ends = [
        mbvi.simulate(one, mbvi.EventDriven(1e-12), duration=0.5).v[-1]
        for one in (problem, on_a_steep_slope(slope, mu, e)[0])
    ]
    exact = mu * speed * np.array([1, 0, 0, 0, -2.5 / 0.1, 0])
    np.testing.assert_allclose((ends[1] - ends[0]) / e, exact, rtol=1e-3, atol=1e-3)
    with pytest.raises(mbvi.SensitivityError, match="sticks in the impact and slips after it"):
        differentiated(problem, 0.5, ["restitution"])
    # the others exist: it slides down with the acceleration g (sin - mu cos) from the speed g sin t1
    found = differentiated(problem, 0.5, ["friction"])
    start = np.sqrt(2 * 0.2 / (G * np.cos(slope)))
    np.testing.assert_allclose(found.matrix[6, 0], -G * np.cos(slope) * (0.5 - start), rtol=1e-7)
    # on a gentle slope it rolls on, and nothing depends on e
    problem, _ = on_a_steep_slope(0.2, mu, 0.0)
    assert np.abs(differentiated(problem, 0.5, ["restitution"]).matrix).max() < 1e-9


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_by_restitution_where_a_body_slides_on_after_its_impact(seed):
    """Friction of the impact has the direction of the slip after it, which e turns: runs at small e say by how much."""
    rng = np.random.default_rng([7, seed])
    slope, spin, velocity = rng.uniform(0.2, 0.5), rng.normal(size=3), 0.7 * rng.normal(size=3)
    turn = Rotation.from_rotvec(0.5 * rng.normal(size=3)).as_matrix()

    def thrown_body(e):
        scene = mbvi.Scene(gravity=(G * np.sin(slope), 0, -G * np.cos(slope)), friction=0.15, restitution=e)
        scene.add_halfspace((0, 0, 1), name="slope")
        body = {"position": (0, 0, 0.5), "velocity": velocity, "rotation": turn, "angular_velocity": spin}
        scene.add_capsule(0.08, 0.3, 2.0, **body)
        return scene.build()

    found = differentiated(thrown_body(0.0), 0.4, ["restitution"], tolerance=1e-9)
    assert [impact.regime for impact in found.run.impacts][:1] == [("slip",)]
    first, second = (mbvi.simulate(thrown_body(e), mbvi.EventDriven(1e-12), duration=0.4) for e in (1e-5, 2e-5))
    start = mbvi.simulate(thrown_body(0.0), mbvi.EventDriven(1e-12), duration=0.4)
    # from one side, of order two
    ends = [
        np.append(found.run.problem.system.difference(start.q[-1], run.q[-1]), run.v[-1] - start.v[-1])
        for run in (first, second)
    ]
    slope_by_e = (4.0 * ends[0] - ends[1]) / 2e-5
    assert np.abs(found.matrix[:, 0]).max() > 0.01
    np.testing.assert_allclose(found.matrix[:, 0], slope_by_e, atol=1e-4 * np.abs(slope_by_e).max())
