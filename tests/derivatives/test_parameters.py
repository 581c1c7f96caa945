"""`mbvi.sensitivity` by masses, inertias, torques, gravity and places of walls: closed forms, laws, differences."""

import numpy as np
import pytest

import mbvi
from support.derivatives import agrees, beads, slopes

G = 9.81
OF_LINKS = ("mass of ", "centre of mass of ", "inertia of ", "torque of ")


def differentiated(scene, duration, wrt, tolerance=1e-12):
    problem = scene.build() if isinstance(scene, mbvi.Scene) else scene
    return mbvi.sensitivity(problem, mbvi.EventDriven(tolerance), duration=duration, wrt=wrt)


def ball(x, duration):
    """Height and speed of a ball above a floor, from (height of the floor, gravity)."""
    floor, g = x
    z, w, left = 0.9 - floor, 0.0 * floor, duration
    while True:
        t = (w + np.sqrt(w * w + 2 * g * z)) / g
        if t.real >= np.real(left):
            return np.array([floor + z + w * left - 0.5 * g * left**2, w - g * left])
        z, w, left = 0.0, -0.8 * (w - g * t), left - t


@pytest.mark.parametrize("plane", [None, "xz"])
def test_a_ball_by_its_mass_its_floor_and_gravity(plane):
    scene = mbvi.Scene(restitution=0.8, plane=plane)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=2.0, position=(0, 0, 1), name="ball")
    found = differentiated(scene, 1.2, ["mass of ball", "offset of floor", "gravity"])
    assert len(found.run.impacts) == 2
    # exactly: no rounding enters
    assert not found.matrices[:, :, 0].any()
    n = found.matrix.shape[0] // 2
    exact = slopes(lambda x: ball(x, 1.2), np.array([0.0, G]))
    agrees(found.matrix[[n - 1, 2 * n - 1]][:, [1, 4]], exact * [1, -1])


def test_the_floor_of_a_given_gap():
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-G]), 1)
    floor = mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1), name="floor")
    found = differentiated(mbvi.Problem(system, [floor], [0.9], [0.0], restitution=0.8), 1.0, ["offset of floor"])
    agrees(found.matrix, slopes(lambda x: ball(x, 1.0), np.array([0.0, G]))[:, :1])
    assert found.check().error.max() < 1e-8


@pytest.mark.parametrize("seed", range(3))
def test_beads_by_their_masses(seed):
    rng = np.random.default_rng(seed)
    masses, e = rng.uniform(0.5, 2, 3), rng.uniform(0.5, 1)
    x = np.array([0, 0.5, 1.1, *sorted(rng.normal(size=3))[::-1], e])
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e)
    for k in range(3):
        place, speed = (x[k] + 0.2 * k, 0, 0), (x[3 + k], 0, 0)
        scene.add_sphere(radius=0.1, mass=masses[k], position=place, velocity=speed, name=f"bead {k}")
    found = differentiated(scene, 2.0, [f"mass of bead {k}" for k in range(3)])
    agrees(found.matrix[0::3], slopes(lambda m: beads(x, 2.0, m), masses))
    assert len(found.run.impacts) > 0


def oscillator(p, duration):
    """m q'' = f - 3 q above a wall, from (m, f, its place)."""
    mass, force, wall = p
    w, q, v, left = np.sqrt(3.0 / mass), 0.8 - force / 3.0, 0.5 + 0.0 * mass, duration
    wall = wall - force / 3.0
    while True:
        grid = np.linspace(1e-6, np.real(left), 4000)

        def at(t, q=q, v=v):
            return q * np.cos(w * t) + v / w * np.sin(w * t), v * np.cos(w * t) - q * w * np.sin(w * t)

        below = np.flatnonzero(at(grid)[0].real < wall.real)
        if not below.size:
            q, v = at(left)
            return np.array([q + force / 3.0, v])
        t = grid[below[0]] + 0j
        for _ in range(8):
            t = t - (at(t)[0] - wall) / at(t)[1]
        q, v, left = wall, -0.7 * at(t)[1], left - t


def test_an_oscillator_by_its_mass_a_force_and_its_wall(tmp_path):
    model = """<mujoco><option gravity="0 0 0"/><worldbody><body name="cart">
    <joint name="slide" type="slide" axis="1 0 0" stiffness="3"/><inertial pos="0 0 0" mass="1.3" diaginertia="1 1 1"/>
    <geom type="sphere" size="0.1"/></body></worldbody></mujoco>"""
    (tmp_path / "cart.xml").write_text(model)
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.7)
    scene.add_halfspace((1, 0, 0), offset=-0.6, name="wall")
    scene.add_mjcf(tmp_path / "cart.xml", name="cart", joints={"slide": 0.8}, velocity={"slide": 0.5})
    found = differentiated(scene, 6.0, ["mass of cart/slide", "torque of cart/slide", "offset of wall"])
    agrees(found.matrix, slopes(lambda p: oscillator(p, 6.0), np.array([1.3, 0.0, -0.5])))
    assert len(found.run.impacts) > 1


def rotor(p, duration):
    """A rotor that strikes a limit at 1 rad, from (m, centre, inertia, torque)."""
    mass, x, y, z, inertia, torque = p[0], *p[1:4], p[4:10], p[10]
    angle, w, left, bend = 0.2, 2.0, duration, torque / (mass * (x * x + y * y) + inertia[2] + 0.0 * z)
    t = (-w + np.sqrt(w * w + 2 * bend * (1.0 - angle))) / bend
    w, left = -0.7 * (w + bend * t), left - t
    return np.array([1.0 + w * left + 0.5 * bend * left**2, w + bend * left])


def test_a_rotor_by_mass_centre_inertia_and_torque(tmp_path):
    model = """<mujoco><option gravity="0 0 0"/><compiler angle="radian"/><worldbody><body name="rotor">
    <joint name="turn" type="hinge" axis="0 0 1" range="-1 1" limited="true"/>
    <inertial pos="0.3 -0.2 0.1" mass="1.3" fullinertia="0.1 0.2 0.15 0.01 0.02 0.03"/>
    <geom type="sphere" size="0.1"/></body></worldbody></mujoco>"""
    (tmp_path / "rotor.xml").write_text(model)
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.7)
    control = mbvi.ConstantTorque([-0.4])
    start = {"joints": {"turn": 0.2}, "velocity": {"turn": 2.0}}
    scene.add_mjcf(tmp_path / "rotor.xml", name="rotor", control=control, **start)
    found = differentiated(scene, 0.9, [one + "rotor/turn" for one in OF_LINKS])
    x = np.array([1.3, 0.3, -0.2, 0.1, 0.1, 0.2, 0.15, 0.01, 0.02, 0.03, -0.4])
    agrees(found.matrix, slopes(lambda p: rotor(p, 0.9), x))
    assert len(found.run.impacts) == 1


def double_pendulum():
    scene = mbvi.Scene(restitution=0.4)
    scene.add_halfspace((-1, 0, 0), offset=-0.2, name="wall")
    start = {"joints": {"shoulder": 0.3}, "velocity": {"shoulder": 2.0, "elbow": 1.0}}
    scene.add_urdf("robot:double_pendulum", base="fixed", name="arm", **start)
    return scene


def test_all_masses_and_inertias_together_change_nothing():
    """M and the weights are multiplied by one factor: nothing moves in another way, through all impacts."""
    problem, joints = double_pendulum().build(), ("arm/shoulder", "arm/elbow")
    found = differentiated(problem, 1.5, [kind + joint for joint in joints for kind in ("mass of ", "inertia of ")])
    scaled = []
    for inertia in list(problem.system.model.inertias)[1:]:
        scaled += [inertia.mass, *inertia.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]]
    assert len(found.run.impacts) > 0
    assert np.abs(found.matrix @ scaled).max() < 1e-9 * np.abs(found.matrix * scaled).max()


def test_a_double_pendulum_against_differences():
    names = [kind + "arm/" + joint for joint in ("shoulder", "elbow") for kind in OF_LINKS]
    found = differentiated(double_pendulum(), 1.5, ["state", *names, "gravity", "offset of wall"], 1e-10)
    assert found.matrix.shape == (4, 4 + 2 * 11 + 3 + 1) and len(found.run.impacts) > 1
    check = found.check(2)
    assert check.error.max() < 1e-6, check


def test_free_bodies_against_differences():
    """A turning box on a floor and two balls, with a force from outside."""
    scene = mbvi.Scene(restitution=0.6)
    scene.add_halfspace((0, 0.1, 1), name="floor")
    scene.add_box((0.3, 0.5, 0.7), mass=2.0, position=(0, 0, 0.6), angular_velocity=(1.2, 3.0, 2.4), name="box")
    scene.add_sphere(radius=0.2, mass=1.0, position=(2, 0, 0.6), name="lower")
    scene.add_sphere(radius=0.1, mass=0.5, position=(2.1, 0.02, 1.2), velocity=(0, 0, -4), name="upper")
    scene.add_force("box", lambda t, q, v: np.array([np.sin(3 * q[0]), -0.3 * v[1], 0.0, 0.0, 0.1 * v[3], 0.0]))
    names = ["mass of box", "inertia of box", "mass of lower", "mass of upper", "offset of floor", "gravity"]
    found = differentiated(scene, 0.3, names, 1e-10)
    assert {name for impact in found.run.impacts for name in impact.constraints} >= {"box | floor", "lower | upper"}
    assert found.check(2).error.max() < 1e-7
    # the balls do not feel the box
    assert np.abs(found.matrix.reshape(2, 12, -1)[:, 6:, :7]).max() < 1e-11


def test_a_box_in_a_plane_against_differences():
    scene = mbvi.Scene(restitution=0.6, plane="xz")
    scene.add_halfspace((0.1, 0, 1), name="floor")
    scene.add_box((0.3, 0.5, 0.7), mass=2.0, position=(0, 0, 0.6), rotation=(0, 0.3, 0), name="box")
    found = differentiated(scene, 0.4, ["mass of box", "inertia of box", "offset of floor", "gravity"], 1e-10)
    assert found.run.impacts and found.check(2).error.max() < 1e-7


def test_a_floor_under_a_body_that_rests_carries_it():
    """And what lies on it slides as before: the floor does not turn."""
    scene = mbvi.Scene(gravity=(1.0, 0, -G))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 0.1), name="ball")
    found = differentiated(scene, 0.5, ["offset of floor", "mass of ball", "gravity"])
    agrees(found.matrix[:, 0], np.array([0, 0, 1.0, 0, 0, 0]))
    assert np.abs(found.matrix[:, 1]).max() < 1e-12
    along = np.zeros((6, 3))
    along[[0, 1], [0, 1]], along[[3, 4], [0, 1]] = 0.125, 0.5
    agrees(found.matrix[:, 2:], along)
    assert found.check(2).error.max() < 1e-8


def test_a_floor_under_many_spheres():
    """These are of one family of constraints, which keeps numbers of its walls and not the walls."""
    scene = mbvi.Scene(restitution=0.6)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(34):
        scene.add_sphere(radius=0.1, mass=1.0, position=(0.5 * k, 0, 3.0 if k else 0.3), name=f"ball {k}")
    problem = scene.build()
    assert "SphereWalls" in {type(family).__name__ for family in problem.constraints.families}
    found = differentiated(problem, 0.25, ["offset of floor"], 1e-10)
    assert found.run.impacts and found.check(1).error.max() < 1e-7


def refused(scene, reason, wrt, duration=0.5):
    with pytest.raises(mbvi.SensitivityError, match=reason):
        differentiated(scene, duration, wrt)


def test_where_none_is():
    # a ball whose contact carries no force: pushed it stays, pulled it leaves
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 0.1), name="ball")
    refused(scene, "no force keeps|about to open", ["gravity"])
    # one that strikes at the start: another floor would be struck earlier, or later
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 0.1), velocity=(0, 0, -1), name="ball")
    refused(scene, "starts with an impact", ["offset of floor"], 0.1)
    assert not differentiated(scene, 0.1, ["mass of ball"]).matrix.any()
    # two floors at one place, one of which moves
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-G]), 1)
    both = [mbvi.GapFunction(lambda q, f=f: f * q[0], lambda q, f=f: np.array([f]), f"floor {f}") for f in (1, 2)]
    refused(mbvi.Problem(system, both, [1.0], [0.0], restitution=0.5), "takes them apart", ["offset of floor 1"])
    # a ball that rests in a slot, one side of which moves
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([1.0, -1.0]), 2)
    slot = [mbvi.GapFunction(lambda q, s=s: s * q[1], lambda q, s=s: np.array([0.0, s]), f"side {s}") for s in (1, -1)]
    refused(mbvi.Problem(system, slot, [0.0, 0.0], [0.0, 0.0]), "room|no force", ["offset of side 1"])


def test_wrong_names():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 1), name="ball")
    scene.add_urdf("robot:hopper", position=(3, 0, 1))
    problem = scene.build()
    names = "mass of cube", "inertia of ball", "centre of mass of ball", "torque of ball", "offset of ball", "weight"
    for name in (*names, "mass of hopper", "torque of hopper/foot"):
        with pytest.raises(mbvi.InputError, match="wrt"):
            mbvi.sensitivity(problem, duration=0.1, wrt=[name])
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-G]), 1)
    with pytest.raises(mbvi.InputError, match="LagrangianSystem"):
        mbvi.sensitivity(mbvi.Problem(system, [], [1.0], [0.0]), duration=0.1, wrt=["gravity"])
