"""A ball that rolls without slip in bowls of triangles: against the exact motion over their planes, and smooth bowls.

Both are written here in numpy. Over planes the centre has 5/7 of gravity's part along the plane; where it meets the
next one, a percussion within Coulomb's cone stops the point that touches there.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import mbvi

BALL, MU, GRAVITY = 0.1, 0.5, np.array([0.0, 0.0, -9.81])
# of a unit mass
INERTIA = 0.4 * BALL**2
SPHERE, PARABOLOID = "mesh of a sphere", "field of a paraboloid"


def normal_at(bowl, p):
    """The unit normal over a place, shape (2,); both bowls have the curvature 1 at 0."""
    raw = np.array([*(-p if bowl == PARABOLOID else -p / np.sqrt(1.0 - p @ p)), 1.0])
    return raw / np.linalg.norm(raw)


def centre_at(bowl, p):
    height = 0.5 * (p @ p) if bowl == PARABOLOID else 1.0 - np.sqrt(1.0 - p @ p)
    return np.array([*p, height]) + BALL * normal_at(bowl, p)


def crossed_with(r):
    """The matrix of x -> r cross x."""
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


def stops(arm):
    """The matrix that leads from a percussion at an arm from the centre to the velocity that it gives this point."""
    return np.eye(3) - crossed_with(arm) @ crossed_with(arm) / INERTIA


def motion_over_planes(mesh, c, v, spin, duration):
    """The same over the planes of a convex bowl of triangles."""
    vertices, triangles = mesh
    a, b, d = vertices[triangles].transpose(1, 0, 2)
    normals = np.cross(b - a, d - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    offsets = (normals * a).sum(axis=1) + BALL
    i = int(np.argmin(normals @ c - offsets))
    c = c - (normals[i] @ c - offsets[i]) * normals[i]
    v = v - (v @ normals[i]) * normals[i]
    spin = np.cross(normals[i], v) / BALL + (spin @ normals[i]) * normals[i]
    left = duration
    while True:
        n = normals[i]
        force = 5 / 7 * (GRAVITY - (GRAVITY @ n) * n)
        # 0 = bend t^2 + rate t + gap of all other planes, towards them
        bend, rate, gap = 0.5 * normals @ force, normals @ v, np.maximum(normals @ c - offsets, 0.0)
        square = rate**2 - 4 * bend * gap
        with np.errstate(invalid="ignore", divide="ignore"):
            time = 2 * gap / (np.sqrt(np.maximum(square, 0.0)) - rate)
        meets = (square >= 0.0) & (time >= 0.0) & (rate + 2 * bend * np.where(np.isfinite(time), time, 0.0) < -1e-12)
        meets[i] = False
        time[~meets] = np.inf
        j = int(np.argmin(time))
        passed = min(time[j], left)
        c, v = c + passed * v + 0.5 * passed**2 * force, v + passed * force
        spin = np.cross(n, v) / BALL + (spin @ n) * n
        left -= passed
        if left <= 0.0:
            return c, v, spin
        i, arm = j, -BALL * normals[j]
        percussion = np.linalg.solve(stops(arm), -v - np.cross(spin, arm))
        up = percussion @ normals[j]
        assert 0.0 <= np.linalg.norm(percussion - up * normals[j]) <= MU * up
        v, spin = v + percussion, spin + np.cross(arm, percussion) / INERTIA


def bowl_of(bowl, width):
    """What adds a bowl with triangles of about a width to a scene, and its triangles; all inner edges are valleys."""
    if bowl == PARABOLOID:
        count = 1 + 2 * round(0.7 / width)
        x = np.linspace(-0.7, 0.7, count)
        heights = 0.5 * np.add.outer(x**2, x**2)
        places = np.column_stack([np.tile(x, count), np.repeat(x, count), heights.ravel()])
        number = np.arange(count**2).reshape(count, count)
        a, b, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:]))
        mesh = places, np.column_stack([a, b, d])
        return lambda scene: scene.add_heightfield(heights, size=(1.4, 1.4), name="bowl"), mesh
    # points in a spiral on the sphere, of which the convex hull is the bowl
    count = round(8 * np.pi / (np.sqrt(3.0) * width**2))
    z = 1.0 - (2 * np.arange(count) + 1.0) / count
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(count)
    points = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    triangles = ConvexHull(points).simplices
    triangles = triangles[(points[triangles, 2] < -0.6).all(axis=1)]
    inward = np.linalg.det(points[triangles]) < 0.0
    triangles = np.where(inward[:, None], triangles, triangles[:, ::-1])
    mesh = points + np.array([0.0, 0.0, 1.0]), triangles
    return lambda scene: scene.add_surface(*mesh, one_sided=True, name="bowl"), mesh


def start_of(bowl, turn, across):
    """Centre, velocity and angular velocity of a ball that rolls across the way to the lowest point."""
    p, v = 0.45 * np.array([np.cos(turn), np.sin(turn)]), across * np.array([-np.sin(turn), np.cos(turn), 0.0])
    return centre_at(bowl, p), v, np.cross(normal_at(bowl, p), v) / BALL


def run_in(add, start, scheme, step, duration, **options):
    c, v, spin = start
    scene = mbvi.Scene(friction=MU)
    add(scene)
    scene.add_sphere(BALL, mass=1.0, position=c)
    # faces cut into the round bowl
    problem = scene.build(resolve=True)
    problem = problem.at(problem.q0, np.concatenate([v, spin]))
    return mbvi.simulate(problem, scheme, step=step, duration=duration, progress=False, **options)


def energies(run):
    """Energies of a run of one ball of unit mass."""
    squares = (run.v[:, :3] ** 2).sum(axis=1) + INERTIA * (run.v[:, 3:] ** 2).sum(axis=1)
    return 0.5 * squares - run.q[:, :3] @ GRAVITY


def within_the_cone(run):
    """Whether friction is within Coulomb's cone, at impacts and where contacts are recorded."""
    for impact in run.impacts:
        if (np.linalg.norm(impact.tangential, axis=1) > MU * impact.percussion + 1e-9).any():
            return False
    for t in run.t[1::20] if run.record.contacts else ():
        for contact in run.contacts(t):
            if np.linalg.norm(contact.tangential) > MU * contact.percussion + 1e-9:
                return False
    return True


SCHEMES = [mbvi.Paoli(), mbvi.Centered(), mbvi.MoreauJean(), mbvi.StewartTrinkle()]


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("across", [0.0, 1.0])
@pytest.mark.parametrize("bowl", [SPHERE, PARABOLOID])
def test_a_ball_rolls_over_triangles_as_over_their_planes(bowl, across, scheme):
    """Down to the lowest point, and across the way to it; times of impacts at inner edges are known to a step."""
    (add, mesh), start, off = bowl_of(bowl, 0.05), start_of(bowl, 0.3, across), []
    for step in (1e-3, 2.5e-4):
        run = run_in(add, start, scheme, step, 0.6, record="contacts")
        c, v, spin = motion_over_planes(mesh, run.q[0, :3], *start[1:], 0.6)
        turned = Rotation.from_quat(np.array(run.q[-1, 3:])).apply(np.array(run.v[-1, 3:]))
        apart = run.q[-1, :3] - c, run.v[-1, :3] - v, BALL * (turned - spin)
        off.append([np.linalg.norm(one) for one in apart])
        energy = energies(run)
        assert energy.max() < energy[0] + 10 * step
        assert within_the_cone(run)
    assert (np.array(off[0]) < 4e-3).all() and (np.array(off[1]) < 1e-3).all()


def centre_in_sphere(start, duration):
    """The centre of a ball that rolls without slip in the sphere of radius 1 about (0, 0, 1), by DOP853."""
    middle, rho = np.array([0.0, 0.0, 1.0]), 1.0 - BALL

    def rates(_, y):
        c, v, spin = y.reshape(3, 3)
        arm, turns = -BALL * (middle - c) / rho, -v / rho
        # the force that keeps the point of contact from slipping
        force = np.linalg.solve(stops(arm), np.cross(spin, BALL * turns) - GRAVITY)
        return np.concatenate([v, GRAVITY + force, np.cross(arm, force) / INERTIA])

    found = solve_ivp(rates, (0.0, duration), np.concatenate(start), method="DOP853", rtol=1e-12, atol=1e-13)
    c, v, spin = found.y[:, -1].reshape(3, 3)
    # invariants: energy, the spin along the normal, no slip
    energies = [0.5 * (one[1] @ one[1] + INERTIA * one[2] @ one[2]) - one[0] @ GRAVITY for one in (start, (c, v, spin))]
    normal = (middle - c) / rho
    assert abs(energies[1] - energies[0]) < 1e-10 and abs(spin @ normal) < 1e-9
    np.testing.assert_allclose(v, np.cross(spin, BALL * normal), atol=1e-9)
    return c


@pytest.mark.slow(seconds=10)
@pytest.mark.parametrize("across", [0.0, 1.0])
def test_a_ball_that_rolls_over_a_mesh_of_a_sphere_nears_the_motion_in_the_sphere(across):
    """The mean over starts all around; at order 1, that of the losses at inner edges."""
    widths, off = np.array([0.1, 0.05, 0.025]), []
    starts = [start_of(SPHERE, turn, across) for turn in 0.3 + 2.4 * np.arange(8)]
    exact = np.array([centre_in_sphere(start, 0.6) for start in starts])
    for width in widths:
        add, _ = bowl_of(SPHERE, width)
        ends = np.array([run_in(add, start, mbvi.MoreauJean(), 2e-4, 0.6).q[-1, :3] for start in starts])
        off.append(np.sqrt(np.mean((ends - exact) ** 2)))
    assert 0.9 < np.polyfit(np.log(widths), np.log(off), 1)[0] < 1.5 and off[-1] < 1e-3


# inner edges of the trough are along y


def trough_of(kind, count):
    """What adds a round trough of `count` points across it, and the angle between the faces at an angle of it."""
    if kind == "field":
        x = np.linspace(-0.7, 0.7, count)
        heights = np.tile(1.0 - np.sqrt(1.0 - x**2), (3, 1))
        return lambda scene: scene.add_heightfield(
            heights, size=(1.4, 1.0)
        ), lambda angle: 1.4 / (count - 1) / np.cos(angle)
    angle, places = np.linspace(-0.75, 0.75, count), np.arange(3 * count).reshape(3, count)
    vertices = np.array([(np.sin(a), y, 1.0 - np.cos(a)) for y in (-0.5, 0.1, 0.5) for a in angle])
    a, b, c, d = (part.ravel() for part in (places[:-1, :-1], places[:-1, 1:], places[1:, 1:], places[1:, :-1]))
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return lambda scene: scene.add_surface(vertices, triangles, one_sided=True), lambda _: angle[1] - angle[0]


def angle_in_trough(start, speed, duration, bend):
    """The angle of a ball after a duration: (7 / 5) rho theta'' = -g sin theta, less what inner edges stop.

    An inner edge whose faces differ by an angle b leaves 1 - (5 / 14) b^2 of the speed, to the second order.
    """
    rho = 1.0 - BALL

    def rates(_, y):
        return y[1], 5 / 7 * GRAVITY[2] / rho * np.sin(y[0]) - 5 / 14 * bend(y[0]) * abs(y[1]) * y[1]

    return solve_ivp(rates, (0.0, duration), [start, speed / rho], method="DOP853", rtol=1e-12, atol=1e-13).y[0, -1]


@pytest.mark.slow(seconds=10)
@pytest.mark.parametrize("scheme", [mbvi.Centered(), mbvi.MoreauJean()], ids=repr)
@pytest.mark.parametrize("kind", ["field", "mesh"])
def test_a_ball_that_rolls_through_a_trough_nears_the_pendulum_at_order_2_but_for_inner_edges(kind, scheme):
    """The mean over starts at other places of the faces; inner edges stop it at order 1, as their law says."""
    rho, counts, off = 1.0 - BALL, np.array([15, 29, 57]), []
    for count in counts:
        (add, bend), errors = trough_of(kind, count), []
        for start in np.linspace(0.43, 0.514, 8):
            place = np.array([rho * np.sin(start), 0.03, 1.0 - rho * np.cos(start)])
            v, spin = -1.5 * np.array([np.cos(start), 0, np.sin(start)]), np.array([0, -1.5 / BALL, 0])
            run = run_in(add, (place, v, spin), scheme, 4e-5, 0.4)
            assert within_the_cone(run) and abs(run.q[-1, 1] - 0.03) < 1e-9
            exact = [rho * np.sin(angle_in_trough(start, -1.5, 0.4, one)) for one in (bend, lambda _: 0.0)]
            errors.append(run.q[-1, 0] - exact)
        off.append(np.sqrt(np.mean(np.square(errors), axis=0)))
    stopped, smooth = (-np.polyfit(np.log(counts - 1), np.log(one), 1)[0] for one in np.transpose(off))
    assert 1.8 < stopped < 2.4 and 0.9 < smooth < 1.1
    assert off[-1][0] < 8e-5
