"""Four-bars pass dead centres, where their loops lose rank, along the branch on which they come.

The oracle has the crank angle as its only unknown. Where a + d = b + c the angle of the rocker is a smooth function of
it through the dead centre: the root of the discriminant is sin or cos of half the crank angle times a positive root.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbvi
from mbvi.projection import Projector
from mbvi.schemes.event_driven.integrator import EventDrivenIntegrator

WIDTH, MASSES, GRAVITY = 0.02, (1.0, 1.5, 0.8), 9.81
# differences of order 8
SPACING = 2e-3
NODES = np.arange(-4, 5)
SLOPE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])


class FourBar:
    """Crank a, coupler b, rocker c, ground d; its dead centre is at the crank angle 0 or pi."""

    def __init__(self, lengths, centre, sign):
        self.lengths, self.centre, self.sign = lengths, centre, sign

    def joints(self, angle):
        """Return the four joints at crank angles, each of shape (2, ...)."""
        a, b, c, d = self.lengths
        P, Q = 2 * d * c - 2 * a * c * np.cos(angle), -2 * a * c * np.sin(angle)
        square = a * a + d * d - 2 * a * d * np.cos(angle)
        R, N = square + c * c - b * b, P * P + Q * Q
        if self.centre == 0.0:
            root = np.sin(angle / 2) * np.sqrt((b + c) ** 2 - square)
        else:
            root = np.cos(angle / 2) * np.sqrt(square - (b - c) ** 2)
        S, zero = 2 * self.sign * np.sqrt(a * d) * root, np.zeros_like(angle)
        tip = np.array([d + c * (-P * R - Q * S) / N, c * (-Q * R + P * S) / N])
        crank = np.array([a * np.cos(angle), a * np.sin(angle)])
        return np.array([zero, zero]), crank, tip, np.array([zero + d, zero])

    def bars(self, angle):
        """Return of each bar its ends at crank angles."""
        A, B, C, D = self.joints(angle)
        return (A, B), (B, C), (D, C)

    def rates(self, angle):
        """Return of each bar the centre, its direction, and both per crank angle, of angles of shape (n,)."""
        for (p, q), length in zip(self.bars(angle[:, None] + SPACING * NODES), self.lengths, strict=False):
            slope_p, slope_q = p @ SLOPE / SPACING, q @ SLOPE / SPACING
            along, change = (q - p)[..., 4], slope_q - slope_p
            turn = (along[0] * change[1] - along[1] * change[0]) / length**2
            yield (p + q)[..., 4] / 2, along / length, (slope_p + slope_q) / 2, turn

    def inertia_and_height(self, angle):
        """Return m(angle) and V(angle) of the energy m w^2 / 2 + V."""
        m = V = 0.0
        for mass, length, (centre, _, slope, turn) in zip(MASSES, self.lengths, self.rates(angle), strict=False):
            m = m + mass * ((slope**2).sum(axis=0) + (length**2 + WIDTH**2) / 12 * turn**2)
            V = V + mass * GRAVITY * centre[1]
        return m, V

    def exact(self, angle, speed, duration):
        """Return the crank angle at the end."""

        def rate(_, y):
            m, V = self.inertia_and_height(y[0] + 2 * SPACING * NODES)
            dm, dV = (x @ SLOPE / (2 * SPACING) for x in (m, V))
            return y[1], -(0.5 * dm * y[1] ** 2 + dV) / m[4]

        run = solve_ivp(rate, (0, duration), (angle, speed), method="DOP853", rtol=1e-12, atol=1e-13)
        return run.y[0, -1]

    def build(self, angle, speed):
        scene = mbvi.Scene(gravity=(0, 0, -GRAVITY))
        at = np.array([angle])
        for name, mass, length, bar in zip(
            ("crank", "coupler", "rocker"), MASSES, self.lengths, self.rates(at), strict=False
        ):
            (x, z), (u, w), (dx, dz), turn = (part[..., 0] for part in bar)
            half = np.arctan2(w, u) / 2
            scene.add_box(
                (length, WIDTH, WIDTH), mass, position=(x, 0, z), rotation=(np.cos(half), 0, -np.sin(half), 0),
                name=name, velocity=(speed * dx, 0, speed * dz), angular_velocity=(0, -speed * turn, 0),
            )  # fmt: skip
        pairs = ("world", "crank"), ("crank", "coupler"), ("coupler", "rocker"), ("world", "rocker")
        for pair, joint in zip(pairs, self.joints(at), strict=True):
            scene.hinge(*pair, at=(joint[0, 0], 0, joint[1, 0]), axis=(0, 1, 0))
        return scene.build()


def drawn(seed):
    """Return a four-bar that reaches its dead centre, and the angle and the speed of its crank at the start."""
    rng = np.random.default_rng(seed)
    a, d, c, part = rng.uniform((0.15, 0.35, 0.2, 0.3), (0.3, 0.6, 0.4, 0.6))
    sign, way, speed, back = rng.choice([-1, 1]), rng.choice([-1, 1]), rng.uniform(8, 11), rng.uniform(0.3, 0.8)
    kind = seed % 3
    lengths = ((a, d, a, d), (a, part * (a + d), (1 - part) * (a + d), d), (a, c + d - a, c, d))[kind]
    bar = FourBar(lengths, np.pi if kind == 1 else 0.0, sign)
    return bar, bar.centre - way * back, way * speed


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
@pytest.mark.parametrize("seed", range(12))
def test_event_driven_follows_the_branch_through_a_dead_centre(seed, tolerance):
    bar, angle, speed = drawn(seed)
    run = mbvi.simulate(bar.build(angle, speed), mbvi.EventDriven(tolerance), duration=0.15, progress=False)
    end = bar.exact(angle, speed, 0.15)
    assert (end - bar.centre) * np.sign(speed) > 0.0
    x, _, z = run.q[-1, :3]
    turn = np.arctan2(z, x) - end
    assert abs(np.arctan2(np.sin(turn), np.cos(turn))) < tolerance


@pytest.mark.parametrize("seed", range(12))
def test_adaptive_follows_the_branch_through_a_dead_centre(seed):
    bar, angle, speed = drawn(seed)
    run = mbvi.simulate(bar.build(angle, speed), mbvi.Adaptive(1e-3), duration=0.15, progress=False)
    x, _, z = run.q[-1, :3]
    turn = np.arctan2(z, x) - bar.exact(angle, speed, 0.15)
    assert abs(np.arctan2(np.sin(turn), np.cos(turn))) < 1e-3


@pytest.mark.parametrize("scheme", [mbvi.EventDriven(1e-6), mbvi.Adaptive(1e-3)])
@pytest.mark.parametrize("seed", range(6))
def test_the_diagnosis_names_the_dead_centre_that_a_long_step_passes(seed, scheme):
    bar, angle, speed = drawn(seed)
    run = mbvi.simulate(bar.build(angle, speed), scheme, duration=0.15, progress=False)
    (time,) = run.diagnosis().dead_centres
    x, _, z = run.at(time)[0][:3]
    turn = np.arctan2(z, x) - bar.centre
    assert abs(np.arctan2(np.sin(turn), np.cos(turn))) < 0.03


def test_a_step_that_shrinks_beside_a_dead_centre_names_the_loop_and_the_time():
    problem = FourBar((0.25, 0.5, 0.25, 0.5), 0.0, 1).build(1e-5, 5.0)
    integrator = EventDrivenIntegrator(problem, 1e-9, Projector(1e-10))
    with pytest.raises(mbvi.DivergedError, match=r"hinge_4 closes is at a dead centre at t = 0 s.* lose rank"):
        integrator._shorter(1e-13, 0.2)


def test_a_loop_that_cannot_be_closed_is_named():
    scene = mbvi.Scene()
    for name, x in (("near", 0.0), ("far", 0.3)):
        scene.add_box((0.1, 0.1, 0.1), 1.0, position=(x, 0, 1), name=name)
    scene.connect("near", "far", at=(0.15, 0, 1), name="link")
    problem = scene.build()
    with pytest.raises(mbvi.ProjectionError, match="link cannot be closed after this step"):
        problem.system.integrate(problem.q0, np.full(problem.system.nv, np.inf))
