"""Where several constraints close at once, each order of single impacts has its derivative, exact and against runs."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import mbvi
from support.derivatives import agrees, beads, block, slopes

G = 9.81
SCHEME = mbvi.EventDriven(1e-11)


def points(masses, gaps, start, velocity, e, gravity=None):
    """Points with given masses and linear gaps, rows of an array."""
    force = np.zeros(len(masses)) if gravity is None else masses * np.asarray(gravity)
    system = mbvi.LagrangianSystem(lambda q: np.diag(masses), lambda t, q, v: force, len(masses))
    rows = [mbvi.GapFunction(lambda q, n=n: n @ q, lambda q, n=n: n, name=f"{k}") for k, n in enumerate(gaps)]
    return mbvi.Problem(system, rows, start, velocity, restitution=e)


def wedge(angle):
    """The inner normals of two walls at an angle [degrees]."""
    angle = np.radians(angle)
    return np.array([[0.0, 1.0], [np.sin(angle), -np.cos(angle)]])


def in_wedges(normals, e, velocity, times=(1.0,)):
    """Points that are in the corner of their walls at some times."""
    count, gaps = len(times), np.kron(np.eye(len(times)), normals)
    start = np.concatenate([-t * np.asarray(velocity) for t in times])
    return points(np.ones(2 * count), gaps, start, np.tile(velocity, count), e)


def reflected(normals, order, e, duration):
    """The derivative of the end of straight lines that are reflected in some order."""
    n = len(normals[0])
    R = np.eye(n)
    for k in order:
        R = (np.eye(n) - (1 + e) * np.outer(normals[k], normals[k])) @ R
    return np.block([[R, duration * R], [np.zeros((n, n)), R]])


def first_walls(normals, x, velocity, e):
    """The walls that a point meets, one after the other, that passes the corner at a small distance: plain numpy."""
    n, walls = len(velocity), []
    place, v = x[:n] + x[n:], np.array(velocity)
    while (normals @ v < -1e-12).any():
        rates = normals @ v
        times = np.where(rates < -1e-12, -(normals @ place) / np.where(rates < -1e-12, rates, 1.0), np.inf)
        k = int(times.argmin())
        place = place + times[k] * v
        v = v - (1 + e) * rates[k] * normals[k]
        walls.append(k)
    return walls


def limit(problem, x, duration, length=1e-4):
    """The velocity at the end, and the derivative of the end along x, from runs that start on that side only."""
    n, nodes = problem.system.nv, np.arange(1.0, 6.0)
    polynomials = np.linalg.inv(np.vander(nodes, increasing=True))
    ends = []
    for node in nodes:
        dx = length * node * x
        start = problem.at(problem.system.integrate(problem.q0, dx[:n]), problem.v0 + dx[n:])
        ends.append(mbvi.simulate(start, mbvi.EventDriven(1e-12), duration=duration, progress=False))
    first = ends[0]
    off = [np.concatenate([problem.system.difference(first.q[-1], r.q[-1]), r.v[-1] - first.v[-1]]) for r in ends]
    return first.v[-1] + polynomials[0] @ np.array(off)[:, n:], polynomials[1] @ np.array(off) / length


def compared(problem, duration, directions, count, tolerance=1e-6, length=1e-4):
    """Compare each branch with differences along some directions; all have to be met."""
    found = mbvi.sensitivity(problem, SCHEME, duration=duration, one_sided=True)
    assert len(found.branches) == count
    met = set()
    for x in directions:
        branch = found.branch(x)
        met.add(found.branches.index(branch))
        (v, by_runs), size = limit(problem, x, duration, length), np.abs(x).max()
        assert np.abs(branch.run.v[-1] - v).max() < tolerance * np.abs(v).max() + 1e-12
        assert np.abs(branch.matrix @ x - by_runs).max() < tolerance * max(np.abs(by_runs).max(), size)
    assert len(met) == count
    return found


@pytest.mark.slow(seconds=8)
@given(
    st.floats(35.0, 170.0), st.floats(0.1, 0.9), st.floats(0.3, 1.0), st.integers(0, 2**32 - 1)
)  # fmt: skip
@settings(max_examples=10, deadline=None)
def test_a_corner_of_any_angle(angle, share, e, seed):
    """Straight lines and reflections: each order is a product of them, and the line decides on the order."""
    normals = wedge(angle)
    velocity = -np.linalg.solve(normals, [share, 1 - share])
    problem = in_wedges(normals, e, velocity)
    try:
        found = mbvi.sensitivity(problem, SCHEME, duration=2.0, one_sided=True)
    except mbvi.SensitivityError as error:
        # nearly along a wall after some impact, or without end
        assert "grazes" in error.reason or "more than 20" in error.reason
        assume(False)
    branches = found.branches
    if len(branches) == 1:
        # a right angle, or nearly
        assert abs(angle - 90) < 1e-6
        return
    one, two = branches
    assert np.allclose(one.conditions, -two.conditions)
    forks = mbvi.forks(np.eye(2), normals, velocity, e)
    for branch in branches:
        walls = [int(name) for (name,) in branch.order]
        agrees(branch.matrix, reflected(normals, walls, e, 2.0))
        assert np.linalg.norm(forks.outcomes - branch.run.v[-1], axis=1).min() < 1e-9
        assert branch.times == pytest.approx([1.0] * len(walls))
    for x in np.random.default_rng(seed).normal(size=(5, 4)):
        walls = [int(name) for (name,) in found.branch(x).order]
        assert walls == first_walls(normals, x, velocity, e)


def test_three_beads_that_meet():
    """Newton's cradle with beads of any mass, by the complex derivative of exact motions beside the meeting."""
    rng = np.random.default_rng(5)
    gaps = np.diff(np.eye(3), axis=0)
    for masses, e in ((np.ones(3), 1.0), (np.array([1.0, 2.0, 1.0]), 0.8), (np.array([1.0, 2.0, 3.0]), 0.3)):
        v = np.array([1.0, 0.1, -0.5])
        problem = points(masses, gaps, -v, v, e)
        found = mbvi.sensitivity(problem, SCHEME, duration=2.0, wrt=["state", "restitution"], one_sided=True)
        met = set()
        for x in np.column_stack([rng.normal(size=(6, 6)), np.zeros(6)]):
            branch = found.branch(x)
            met.add(found.branches.index(branch))
            start = np.concatenate([-v, v, [e]]) + 1e-10 * x
            assert np.abs(branch.run.v[-1] - beads(start, 2.0, masses)[3:]).max() < 1e-8
            agrees(branch.matrix, slopes(lambda y, masses=masses: beads(y, 2.0, masses), start)[:6])
        assert met == {0, 1}


def test_four_beads_that_meet_in_any_order_of_pairs():
    rng = np.random.default_rng(2)
    masses, v = np.array([1.0, 2.0, 1.5, 1.0]), np.array([1.0, 0.3, -0.2, -0.9])
    problem = points(masses, np.diff(np.eye(4), axis=0), -v, v, 0.9)
    found = mbvi.sensitivity(problem, SCHEME, duration=2.0, one_sided=True)
    met = set()
    for x in rng.normal(size=(1000, 8)):
        # one branch and no other
        assert sum((one.conditions @ x > 0).all() for one in found.branches) == 1
        branch = found.branch(x)
        if found.branches.index(branch) in met:
            continue
        met.add(found.branches.index(branch))
        start = np.concatenate([-v, v, [0.9]]) + 1e-10 * np.append(x, 0.0)
        agrees(branch.matrix, slopes(lambda y: beads(y, 2.0, masses), start)[:8, :8])
    assert len(met) == len(found.branches) > 6


def test_two_corners_one_after_the_other():
    """Each corner has two orders, so that the run has four branches, and conditions of both corners."""
    normals, velocity, e = wedge(110.0), np.array([-0.4, -1.0]), 0.5
    found = mbvi.sensitivity(in_wedges(normals, e, velocity, (1.0, 1.5)), SCHEME, duration=2.0, one_sided=True)
    assert len(found.branches) == 4
    both = np.kron(np.eye(2), normals)
    for branch in found.branches:
        assert branch.conditions.shape == (2, 8)
        agrees(branch.matrix, reflected(both, [int(name) for (name,) in branch.order], e, 2.0))
        assert branch.run.t[0] == pytest.approx(1.5) and set(branch.times.round(6)) == {1.0, 1.5}


def test_walls_that_move():
    """The wall that comes nearer is struck first; reflections at moved walls move the end."""
    normals, e = wedge(75.0), 0.8
    problem = in_wedges(normals, e, [-1.0, -0.2])
    wrt = ["offset of 0", "offset of 1", "restitution of 0"]
    found = mbvi.sensitivity(problem, SCHEME, duration=2.0, wrt=wrt, one_sided=True)
    assert len(found.branches) == 2
    for near in range(2):
        branch = found.branch(np.eye(3)[near] * 0.01)
        walls = [int(name) for (name,) in branch.order]
        assert walls[0] == near
        moved = np.zeros((2, 2))
        for k in walls:
            n = normals[k]
            moved = moved + (1 + e) * np.outer(n, np.eye(2)[k] - n @ moved)
        agrees(branch.matrix[:2, :2], moved)
        assert np.abs(branch.matrix[2:, :2]).max() < 1e-9
        # no change of restitution makes either wall the first
        assert (branch.conditions[:, 2] == 0.0).all()


@pytest.mark.parametrize(("width", "e", "impacts"), [(0.5, 0.5, 3), (0.2, 0.5, 2), (0.2, 0.0, 2), (0.5, 0.0, 2)])
def test_two_feet_of_a_block(width, e, impacts):
    """Wide blocks strike the first foot again; at e = 0 wide ones come to rest, narrow ones leave the first foot."""
    x = np.array([0.3, 1.0, -0.4, 0.2])
    found = compared(block(width, 0.0, 0.1, e), 0.3, [x, -x], 2)
    assert [len(branch.order) for branch in found.branches] == [impacts] * 2
    first = found.branch(x).order[0]
    # turned up on the side of the foot +1
    assert first == ("foot -1 | floor",)


@pytest.mark.parametrize("lean", [-0.3, 0.3])
def test_a_point_that_slides_into_a_corner(lean):
    """A closed contact stays so where walls lean over it, and opens where they lean back."""
    normals = np.column_stack([wedge(110.0), [-lean, -lean]])
    gaps = np.vstack([[0.0, 0.0, 1.0], normals])
    velocity = np.array([-0.4, -1.0, 0.0])
    problem = points(np.ones(3), gaps, -velocity, velocity, [0.0, 0.5, 0.5], [0.0, 0.0, -G])
    x = np.array([1.0, 0.2, 0.0, 0.5, -0.3, 0.0])
    found = compared(problem, 1.02, [x, -x], 2, length=1e-5)
    assert all((branch.run.q[-1][2] > 1e-4) == (lean < 0) for branch in found.branches)


def test_an_edge_of_a_box():
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.3, 0.1), mass=1.0, position=(0, 0, 0.4), angular_velocity=(0, 2, 0), name="box")
    x = np.random.default_rng(0).normal(size=12)
    compared(scene.build(), 0.28, [x, -x], 2)


@pytest.mark.slow(seconds=9)
def test_hind_feet_of_a_quadruped():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    hold = mbvi.PDControl(np.tile([0.0, 0.6, -1.2], 4), 60.0, 2.0)
    scene.add_urdf(mbvi.robot("quadruped"), position=(0, 0, 0.45), control=hold, name="robot")
    x = np.random.default_rng(3).normal(size=36)
    found = compared(scene.build(), 0.1355, [x, -x], 2, length=1e-5)
    names = {branch.order[0] for branch in found.branches}
    assert names == {("robot/RL_foot | floor",), ("robot/RR_foot | floor",)}


def test_orthogonal_rows_that_turn():
    """Both orders leave the same velocity, and other variations of it."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([0.0, -G]), 2)
    feet = [
        mbvi.GapFunction(lambda q: q[0], lambda q: np.eye(2)[0]),
        mbvi.GapFunction(lambda q: q[1] + q[0] ** 2, lambda q: np.array([2 * q[0], 1.0])),
    ]
    x = np.array([1.0, -0.2, 0.3, 0.1])
    problem = mbvi.Problem(system, feet, [0.5, G * 0.125], [-1.0, 0.0], restitution=0.7)
    found = compared(problem, 0.7, [x, -x], 2)
    one, two = found.branches
    assert np.abs(one.run.v[0] - two.run.v[0]).max() < 1e-9 < np.abs(one.matrix - two.matrix).max()


def test_a_run_that_has_a_derivative_has_one_branch():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 1), name="ball")
    given = {"duration": 0.8, "wrt": ["state", "mass of ball", "offset of floor"]}
    found = mbvi.sensitivity(scene.build(), one_sided=True, **given)
    whole = mbvi.sensitivity(scene.build(), **given)
    (branch,) = found.branches
    assert branch.order == () and branch.conditions.shape == (0, 8) and found.columns == whole.columns
    assert np.array_equal(branch.matrix, whole.matrix) and found.branch(np.ones(8)) is branch


def refused(problem, reason, **given):
    with pytest.raises(mbvi.SensitivityError, match=reason) as caught:
        mbvi.sensitivity(problem, SCHEME, one_sided=True, **{"duration": 2.0, **given})
    assert caught.value.run.t[-1] > 0.0
    return caught.value


def test_what_has_no_derivative_on_any_side_is_refused():
    # after the first wall the point flies along the second
    graze = np.radians(100.0)
    refused(in_wedges(wedge(100.0), 1.0, [np.cos(graze), -np.sin(graze)]), "in some order one of them grazes")
    # 180 / 8 impacts
    error = refused(in_wedges(wedge(8.0), 1.0, [-1.0, -0.05]), "more than 20 single impacts")
    assert error.time == pytest.approx(1.0) and error.bodies == ("0", "1")
    refused(block(0.5, 0.0, 0.1, 0.5), "no variation makes one of them close first", duration=0.3, wrt=["restitution"])
    refused(block(0.2, 0.0, 0.1, 0.0), "by e = 0 it has none", duration=0.3, wrt=["state", "restitution"])
    scene = mbvi.Scene(restitution=0.0, gravity=(0, 0, 0))
    for name, x in (("a", -0.13), ("b", 0.13)):
        scene.add_sphere(0.1, mass=1.0, position=(x, 0, 0), name=name)
    scene.add_sphere(0.1, mass=2.0, position=(0, 0, 0.5), velocity=(0, 0, -2), name="c")
    refused(scene.build(), "lifts off between impacts", duration=0.35)


def test_an_order_that_rounding_decides_is_refused():
    """One wall is nearer by less than what tells two impacts from one: a run takes them one after the other."""
    normals, velocity = wedge(110.0), np.array([-0.4, -1.0])
    near, apart = (points(np.ones(2), normals, -velocity - d * normals[1], velocity, 0.5) for d in (3e-13, 1e-11))
    for one_sided in (False, True):
        with pytest.raises(mbvi.SensitivityError, match="two impacts at one instant"):
            mbvi.sensitivity(near, SCHEME, duration=2.0, one_sided=one_sided)
    agrees(mbvi.sensitivity(apart, SCHEME, duration=2.0).matrix, reflected(normals, [1, 0], 0.5, 2.0))


@pytest.mark.slow(seconds=6)
def test_more_than_64_orders_are_refused():
    v = np.array([1.0, 0.5, 0.1, -0.3, -0.9])
    refused(points(np.ones(5), np.diff(np.eye(5), axis=0), -v, v, 1.0), "more than 64 orders")


def test_wrong_arguments():
    problem = in_wedges(wedge(110.0), 0.5, [-0.4, -1.0])
    with pytest.raises(mbvi.InputError, match="one_sided takes EventDriven"):
        mbvi.sensitivity(problem, mbvi.Paoli(), duration=2.0, step=1e-3, one_sided=True)
    found = mbvi.sensitivity(problem, SCHEME, duration=2.0, one_sided=True)
    with pytest.raises(mbvi.InputError, match="between the branches"):
        found.branch(np.zeros(4))
    with pytest.raises(mbvi.InputError, match="x has shape"):
        found.branch(np.zeros(3))
