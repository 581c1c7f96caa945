"""The other time-stepping schemes against their equations written out by hand, and closed contacts lifted out."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi import reference
from mbvi.constraints.rows import match_contacts
from mbvi_studies.chart.errors import fitted_order
from support.paths import ROBOTS

G = 9.81
LIFTING = [scheme(project_positions=True) for scheme in (mbvi.Paoli, mbvi.MoreauJean, mbvi.Centered)]
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.MoreauJean(0.7), mbvi.Centered(), mbvi.SchatzmanPaoli(), *LIFTING]


def named(scheme):
    theta = f" {scheme.theta:g}" if hasattr(scheme, "theta") else ""
    return type(scheme).__name__ + theta + (", lifting" if getattr(scheme, "project_positions", False) else "")


each = pytest.mark.parametrize("scheme", SCHEMES, ids=named)
lifting = pytest.mark.parametrize("scheme", LIFTING, ids=named)


class Curved:
    """Two curved walls, a mass that depends on q and a force that depends on everything."""

    gaps = (
        mbvi.GapFunction(lambda q: q[1] - 0.1 * q[0] ** 2, lambda q: np.array([-0.2 * q[0], 1.0])),
        mbvi.GapFunction(lambda q: q[1] + 0.5 * q[0], lambda q: np.array([0.5, 1.0])),
    )

    def mass(self, q):
        return np.diag([1.0 + q[0] ** 2, 2.0 + np.sin(q[1])])

    def force(self, t, q, v):
        return np.array([np.cos(t) - v[0] * v[1], -G + q[0] * v[0]])

    def problem(self, e):
        system = mbvi.LagrangianSystem(self.mass, self.force, 2)
        return mbvi.Problem(system, self.gaps, [0.02, 0.1], [-0.4, -1.5], restitution=e, t0=0.3)

    def law(self, t, q, v, h, e, active, at=None):
        J = np.array([g.gradient(t, q)[0] for g in active]).reshape(-1, 2)
        M = self.mass(q)
        free = v + h * np.linalg.solve(M, self.force(t, q, v if at is None else at))
        return mbvi.project(free, M, J, -e * (J @ v)).velocity

    def active(self, t, q):
        return [g for g in self.gaps if g.gap(t, q)[0] <= 1e-8]


def agree(e, scheme, by_hand, h=7e-3, count=150):
    """Follow a scheme step by step; `by_hand` takes (curved, t, q, v) to (q, v, how many rows)."""
    curved, seen = Curved(), set()
    problem = curved.problem(e)
    q, v = problem.q0, problem.v0
    for k, step in zip(range(count), mbvi.steps(problem, scheme, step=h), strict=False):
        q, v, rows = by_hand(curved, 0.3 + k * h, q, v)
        seen.add(rows)
        np.testing.assert_allclose(step.q, q, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(step.v, v, rtol=1e-9, atol=1e-11)
        q, v = step.q, step.v
    assert {0, 1} <= seen


restitutions = pytest.mark.parametrize("e", [0.0, 0.4, 1.0])


@restitutions
@pytest.mark.parametrize("theta", [0.0, 0.3, 0.5, 1.0])
def test_moreau_jean_is_its_equations(e, theta, h=7e-3):
    def by_hand(curved, t, q, v):
        t, middle = t + (1 - theta) * h, q + (1 - theta) * h * v
        active = curved.active(t, middle)
        w = curved.law(t, middle, v, h, e, active)
        return q + h * ((1 - theta) * v + theta * w), w, len(active)

    agree(e, mbvi.MoreauJean(theta), by_hand)


@restitutions
def test_centered_is_its_equations(e, h=7e-3):
    def by_hand(curved, t, q, v):
        middle = q + 0.5 * h * v
        active = curved.active(t + h, q + h * v)
        half_on = v + 0.5 * h * np.linalg.solve(curved.mass(middle), curved.force(t + 0.5 * h, middle, v))
        w = curved.law(t + 0.5 * h, middle, v, h, e, active, half_on)
        return middle + 0.5 * h * w, w, len(active)

    agree(e, mbvi.Centered(), by_hand)


def flying(name):
    """A body that tumbles, or a robot whose legs move, and nothing near."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    if name == "box":
        scene.add_box((0.3, 0.2, 0.1), mass=2.0, angular_velocity=(5.0, 0.3, 1.0))
    else:
        scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", velocity={"FL_hip_joint": 2.0, "RR_calf_joint": -3.0})
    return scene.build()


@pytest.mark.parametrize("name", ["box", "quadruped"])
def test_centered_is_of_order_two_in_flight(name):
    problem = flying(name)
    exact = mbvi.simulate(problem, mbvi.EventDriven(1e-12), duration=0.2).q[-1]
    steps = 0.2 / np.array([20, 27, 36, 48, 64])
    ends = [mbvi.simulate(problem, mbvi.Centered(), step=h, duration=0.2).q[-1] for h in steps.tolist()]
    errors = [np.abs(problem.system.difference(exact, q)).max() for q in ends]
    assert 1.9 < fitted_order(steps, errors) < 2.3


def test_a_control_is_called_once_a_step():
    times = []

    def control(t, q, v):
        times.append(t)
        return np.zeros(18)

    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 5), control=control)
    problem = scene.build()
    times.clear()
    mbvi.simulate(problem, mbvi.Centered(), step=1e-2, duration=0.1)
    np.testing.assert_allclose(times, 5e-3 + 1e-2 * np.arange(10))


def test_a_row_reached_ahead_alone_keeps_its_gradient():
    """Of rows that are active at the end of a step there may be none in its middle."""
    steep = mbvi.GapFunction(lambda q: 1.0 - 1e3 * q[0] ** 6, lambda q: np.array([-6e3 * q[0] ** 5]))
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.zeros(1), 1)
    problem = mbvi.Problem(system, [steep], [0.3], [0.0])
    rows = problem.constraints.active(0.0, np.array([0.5]), 0.0)
    nothing = problem.constraints.active(0.0, np.array([0.1]), 0.0)
    assert (len(rows.gap), len(nothing.gap)) == (1, 0)
    np.testing.assert_array_equal(match_contacts(rows, nothing), [-1])


@restitutions
def test_schatzman_paoli_is_its_equation_in_positions(e, h=7e-3):
    """Onto a half-plane, where the projection is exact: 2 q_i - (1 - e) q_{i-1} + h^2 M^-1 g and all."""
    n, M = np.array([0.6, 0.8]), np.array([[2.0, 0.3], [0.3, 1.0]])

    def force(t, q, v):
        return np.array([np.cos(t) - v[0], -G + q[0]])

    system = mbvi.LagrangianSystem(lambda q: M, force, 2)
    problem = mbvi.Problem(
        system, [mbvi.GapFunction(lambda q: n @ q, lambda q: n)], [0.1, 0.1], [0.0, -1.5], restitution=e
    )
    before, q = None, problem.q0
    struck = 0
    for k, step in zip(range(300), mbvi.steps(problem, mbvi.SchatzmanPaoli(), step=h), strict=False):
        if before is None:
            after = q + h * problem.v0 + 0.5 * h**2 * np.linalg.solve(M, force(0.0, q, problem.v0))
        else:
            pushed = h**2 * np.linalg.solve(M, force(k * h, q, (q - before) / h))
            aim = (2 * q - (1 - e) * before + pushed) / (1 + e)
            nearest = aim + max(0.0, -(n @ aim)) / (n @ np.linalg.solve(M, n)) * np.linalg.solve(M, n)
            after = -e * before + (1 + e) * nearest
            struck += n @ aim < 0
        np.testing.assert_allclose(step.q, after, rtol=1e-10, atol=1e-12)
        before, q = q, step.q
    assert struck > 3


def test_moreau_jean_with_theta_0_is_the_papers_scheme():
    problem = Curved().problem(0.5)
    a, b = (mbvi.simulate(problem, s, step=7e-3, duration=1.0) for s in (mbvi.Paoli(), mbvi.MoreauJean(0.0)))
    np.testing.assert_array_equal(a.q, b.q)
    np.testing.assert_array_equal(a.energy(), b.energy())


@pytest.mark.parametrize("theta", [-0.1, 1.1, np.nan, "half"])
def test_a_theta_that_is_none_is_refused(theta):
    with pytest.raises(mbvi.InputError, match="theta"):
        mbvi.MoreauJean(theta)


def tumbling_box():
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1))
    scene.add_halfspace((1, 0, 0.2), -0.4)
    scene.add_box((0.2, 0.3, 0.4), position=(0, 0, 0.5), velocity=(-2, 0.3, -1), angular_velocity=(1, 2, 3))
    return scene.build()


def robot(name="hopper", **more):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / f"{name}/{name}.urdf", base="free", position=(0, 0, 1.0), **more)
    return scene.build()


@each
@pytest.mark.parametrize("problem", [tumbling_box(), robot()], ids=["box", "hopper"])
def test_percussions_balance_the_jump(scheme, problem, h=2e-3):
    """M (v_{i+1} - v_i) - h g = J' p with p >= 0, M and g where the law is applied, on configuration manifolds.

    `Centered` takes g of robots at the velocity half a step on. Its free bodies obey the law in the middle of the step,
    which is that of both momenta in the world; see `test_percussions_are_the_momenta_of_a_body`.
    """
    if isinstance(scheme, mbvi.Centered) and problem.system.free_bodies:
        pytest.skip("its free bodies turn on after the law")
    system, q, v, pressed = problem.system, problem.q0, problem.v0, 0
    for k, step in zip(range(500), mbvi.steps(problem, scheme, step=h), strict=False):
        t, place = problem.t0 + k * h + scheme.timing.jump * h, system.integrate(q, scheme.timing.jump * h * v)
        if step.percussion.any() and k:
            at = 0.5 * (v + system.free_velocity(t, place, v, h)) if isinstance(scheme, mbvi.Centered) else v
            free = system.free_velocity(t, place, v, h)
            if system.model is not None:
                free = v + system.free_velocity(t, place, at, h) - at
            jump = system.metric(place).apply(step.v - free)
            drifted = system.integrate(place, (1.0 - scheme.timing.jump) * h * step.v)
            displaced = not np.allclose(step.q, drifted, rtol=0.0, atol=1e-12)
            balanced = slice(3) if displaced and system.free_bodies else slice(None)
            pushed = step.active.jacobian.T @ step.percussion
            np.testing.assert_allclose(pushed[balanced], jump[balanced], atol=1e-7)
            np.testing.assert_allclose(step.after, step.active.jacobian @ step.v, atol=1e-9)
            np.testing.assert_allclose(step.before, step.active.jacobian @ v, atol=1e-9)
            pressed += 1
        assert (step.percussion >= 0).all()
        q, v = step.q, step.v
    assert pressed > 5


@pytest.mark.parametrize("scheme", [mbvi.Centered(), mbvi.Centered(project_positions=True)], ids=repr)
def test_percussions_are_the_momenta_of_a_body(scheme, h=2e-3):
    """m (u+ - u) - h m g = sum of p n, and R+ I w+ - R I w = sum of p (x - c) x n with the centre c in the middle.

    The law holds there: at the velocity to which the body has turned by then. The angular part is that of steps that
    displace nothing.
    """
    problem = tumbling_box()
    system, q, v, whole = problem.system, problem.q0, problem.v0, 0
    mass, inertia = system.masses[0], system.inertias[0]
    for _, step in zip(range(500), mbvi.steps(problem, scheme, step=h), strict=False):
        rows, p, middle = step.active, step.percussion, q[:3] + 0.5 * h * v[:3]
        assert (p >= 0).all()
        if p.any():
            given = mass * (step.v[:3] - v[:3] - h * np.array([0.0, 0.0, -9.81]))
            np.testing.assert_allclose(given, p @ rows.normal, rtol=0, atol=1e-7)
            if np.allclose(step.q[:3], middle + 0.5 * h * step.v[:3], rtol=0.0, atol=1e-12):
                turns = [Rotation.from_quat(x[3:].copy()).apply(inertia @ w[3:]) for x, w in ((q, v), (step.q, step.v))]
                moment = p @ np.cross(rows.point - middle, rows.normal)
                np.testing.assert_allclose(turns[1] - turns[0], moment, rtol=0, atol=1e-9)
                before, after = system.coast(v, 0.5 * h)[1], system.coast(step.v, -0.5 * h)[1]
                np.testing.assert_allclose(step.before, rows.jacobian @ before, atol=1e-9)
                np.testing.assert_allclose(step.after, rows.jacobian @ after, atol=1e-9)
                whole += 1
        q, v = step.q, step.v
    assert whole > 5


@each
def test_a_robot_falls_and_comes_to_rest_on_the_floor(scheme):
    run = mbvi.simulate(robot(), scheme, step=2e-3, duration=2.0)
    assert run.impacts
    assert run.energy()[-1] < run.energy()[0]
    assert run.residual.max() < 1e-9
    assert run.diagnosis().energy_excess < 1e-9 * run.energy()[0]


@each
def test_velocities_of_the_run_are_those_that_move_it(scheme):
    """What `at` gives between states: the velocity before the jump until there, the next from there on."""
    run = mbvi.simulate(Curved().problem(0.5), scheme, step=1e-2, duration=0.5)
    h, part = 1e-2, scheme.timing.jump
    for i in range(5, 40):
        moved = part * run.v[i] + (1 - part) * run.v[i + 1]
        if not getattr(scheme, "project_positions", False):
            np.testing.assert_allclose(run.q[i + 1] - run.q[i], h * moved, atol=1e-12)
        if part > 0.0:
            np.testing.assert_array_equal(run.at(run.t[i] + 0.999 * part * h)[1], run.v[i])
        np.testing.assert_array_equal(run.at(run.t[i] + (0.999 * part + 0.0015) * h)[1], run.v[i + 1])


@each
def test_energy_in_flight_is_exact_at_consistent_times(scheme, tmp_path):
    scene = mbvi.Scene()
    scene.add_sphere(0.1, position=(0, 0, 2), velocity=(1, 0, 3))
    run = mbvi.simulate(scene.build(), scheme, step=1e-2, duration=1.0)
    np.testing.assert_allclose(run.energy()[1:], run.energy()[1], rtol=1e-12)
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    np.testing.assert_array_equal(again.energy(), run.energy())
    np.testing.assert_array_equal(again.at(0.567)[1], run.at(0.567)[1])


LEVEL = [s for s in SCHEMES if not isinstance(s, mbvi.SchatzmanPaoli)]


@pytest.mark.parametrize("h", [1e-3, 1e-2, 0.05, 0.1, 0.25, 0.5])
@pytest.mark.parametrize("scheme", LEVEL, ids=named)
def test_an_elastic_ball_keeps_its_energy_at_any_step(scheme, h):
    run = mbvi.simulate(reference.bouncing_ball(1.0).problem, scheme, step=h, duration=20.0)
    np.testing.assert_allclose(run.energy(), G, rtol=1e-11)


@pytest.mark.parametrize("h", [1e-2, 0.1, 0.5])
@pytest.mark.parametrize("make", [reference.rod, reference.rocking_block, reference.chain, reference.impact_oscillator])
def test_bounces_are_never_lifted(make, h):
    """At e = 1 the option changes no bit."""
    problem = make(1.0).problem
    for scheme in LIFTING:
        plain = type(scheme)()
        a, b = (mbvi.simulate(problem, s, step=h, duration=20 * h) for s in (plain, scheme))
        np.testing.assert_array_equal(a.q, b.q)


@lifting
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("h", [3e-3, 1e-2])
def test_a_box_comes_to_rest_and_sinks_no_further(scheme, e, h):
    """Lifting only what penetrates rocks it from edge to edge with period 2 for ever."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    c, s = np.cos(0.2), np.sin(0.2)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    scene.add_box((0.4, 0.3, 0.2), position=(0, 0, 0.35), rotation=turn)
    run = mbvi.simulate(scene.build(), scheme, step=h, duration=2.5)
    late = run.t > 2.3
    assert np.abs(run.v[late][:, [2, 3, 4]]).max() < 1e-8
    assert np.abs(run.q[late, 2] - 0.1).max() < 2e-8
    assert all(i.time < 2.3 for i in run.impacts)


@lifting
def test_a_box_that_spins_about_the_vertical_comes_to_rest_too(scheme):
    """Lifting turns contacts against the velocity, and leaves edges a little above the floor: it hopped for ever."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    scene.add_box((0.4, 0.3, 0.2), position=(0, 0, 0.35), rotation=turn, angular_velocity=(1.0, -1.5, 2.0))
    run = mbvi.simulate(scene.build(), scheme, step=3e-3, duration=3.0)
    late = run.t > 2.8
    assert np.abs(run.v[late, 2]).max() < 1e-8
    assert run.penetration()[late].max() < 2e-8
    assert np.abs(run.v[-1, 3:]).max() > 0.1


@lifting
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_sliding_in_a_disc_for_50_seconds_keeps_the_radius(scheme, e):
    case = reference.sliding_in_disc(e, duration=50.0)
    run = mbvi.simulate(case.problem, scheme, step=1e-2, duration=50.0)
    assert np.abs(np.linalg.norm(run.q, axis=1) - 1.0).max() < 1e-6


def test_schatzman_paoli_neither_drifts_nor_sinks():
    case = reference.sliding_in_disc(0.0, duration=50.0)
    run = mbvi.simulate(case.problem, mbvi.SchatzmanPaoli(), step=1e-2, duration=50.0)
    assert np.abs(np.linalg.norm(run.q, axis=1) - 1.0).max() < 1e-6


def test_each_constraint_has_its_own_restitution():
    gaps = [mbvi.GapFunction(lambda q, k=k: q[k], lambda q, k=k: np.eye(2)[k]) for k in range(2)]
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.zeros(2), 2)
    problem = mbvi.Problem(system, gaps, [0.503, 0.705], [-1.0, -1.0], restitution=[0.3, 0.9])
    for scheme in SCHEMES:
        run = mbvi.simulate(problem, scheme, step=1e-2, duration=1.2)
        np.testing.assert_allclose(run.v[-1], [0.3, 0.9], atol=1e-12)
