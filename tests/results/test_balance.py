"""Contact forces of runs with projected positions are the whole change of the momentum of free bodies beside gravity.

The oracle adds up masses, velocities, arms and spins of the recorded states in numpy.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.run.fixed_steps import taking
from support.momentum import momenta
from support.paths import DATA, ROBOTS

H, G = 2e-3, np.array([0.0, 0.0, -9.81])
SCHEMES = [scheme(project_positions=True) for scheme in (mbvi.Centered, mbvi.Paoli, mbvi.MoreauJean)]


def unbalanced(problem, scheme=SCHEMES[0], steps=120, gravity=G, names=None, **options):
    """Return by how much forces and moments are off, as a part of the largest change, and the run."""
    run = mbvi.simulate(problem, scheme, step=H, duration=steps * H, record="contacts", progress=False, **options)
    found = np.array([momenta(problem, q, v) for q, v in zip(run.q, run.v, strict=True)])
    dt, worst, sizes = np.diff(run.t), np.zeros(2), np.zeros(2)
    bodies = [name.split("/")[0] for name in problem.system.bodies[1:]]
    for name in bodies if names is None else names:
        # the links of a robot are one entry
        k = list(dict.fromkeys(bodies)).index(name)
        mass, p, arm, spin = np.split(found[:, k], [1, 4, 7], axis=1)
        whole = np.concatenate([p, np.cross(arm, p) + spin], axis=1)
        # gravity acts in the middle of a step
        weight = mass[:-1] * gravity * dt[:, None]
        middle = arm[:-1] + 0.5 * dt[:, None] * p[:-1] / mass[:-1]
        change = np.diff(whole, axis=0) - np.concatenate([weight, np.cross(middle, weight)], axis=1)
        recorded = dt[:, None] * run.contact_forces(name)[1:]
        for c, part in enumerate((slice(0, 3), slice(3, 6))):
            worst[c] = np.maximum(worst[c], np.abs(change[:, part] - recorded[:, part]).max())
            sizes[c] = np.maximum(sizes[c], np.abs(change[:, part]).max())
    return worst / sizes, run


def add_ball(scene, **body):
    turn = body.pop("rotation"), body.pop("angular_velocity")
    assert len(turn) == 2
    scene.add_sphere(0.15, **body)


def add_box(scene, **body):
    scene.add_box((0.3, 0.2, 0.1), **body)


def add_cube(scene, **body):
    scene.add_box((0.2, 0.2, 0.2), **body)


def add_oval(scene, **body):
    scene.add_ellipsoid((0.08, 0.12, 0.16), **body)


def add_brick(scene, **body):
    """A robot of one link, whose velocity is in its axes."""
    velocity, spin = body.pop("velocity"), body.pop("angular_velocity")
    assert body.pop("mass") > 0.0
    scene.add_urdf(DATA / "brick.urdf", base="free", base_velocity=(*velocity, *spin), name="brick", **body)


def meeting(kinds, e, mu, seed, gravity=(0, 0, 0), floor=False):
    """Bodies that meet obliquely, each turned and spinning."""
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene(gravity=gravity, restitution=e, friction=mu)
    if floor:
        scene.add_halfspace((0, 0, 1), name="floor")
    for k, add in enumerate(kinds):
        n = Rotation.from_rotvec([0.0, 0.0, 2.0 * np.pi * k / len(kinds)]).apply((1.0, 0.0, 0.0))
        place = 0.25 * n + 0.04 * rng.normal(size=3) + (0.0, 0.0, 0.3 if floor else 0.0)
        add(
            scene, mass=rng.uniform(0.5, 3.0), position=place, rotation=Rotation.random(rng=rng).as_matrix(),
            velocity=-2.0 * n + 0.4 * rng.normal(size=3), angular_velocity=4.0 * rng.normal(size=3),
        )  # fmt: skip
    return scene.build()


@pytest.fixture(params=[False, True], ids=["python", "kernels"])
def compiled(request, monkeypatch):
    if not request.param:
        monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)


NOTHING = np.zeros(3)
PAIRS = [(add_ball, add_ball), (add_box, add_ball), (add_box, add_oval), (add_brick, add_ball)]


@pytest.mark.filterwarnings("ignore:.*raised the energy")
@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("kinds", PAIRS, ids=lambda kinds: "-".join(add.__name__[4:] for add in kinds))
def test_two_bodies_alone(kinds, e, mu, compiled):
    for seed in range(3):
        off, run = unbalanced(meeting(kinds, e, mu, seed), gravity=NOTHING)
        assert run.impacts
        np.testing.assert_array_less(off, 1e-12)


@pytest.mark.filterwarnings("ignore:.*raised the energy")
@pytest.mark.parametrize("mu", [0.0, 0.5, (0.5, 0.01, 0.002)])
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("floor", [False, True])
def test_several_bodies(floor, e, mu, compiled):
    gravity = G if floor else NOTHING
    problem = meeting((add_box, add_ball, add_oval), e, mu, 4, gravity, floor)
    off, run = unbalanced(problem, gravity=gravity, steps=150)
    assert len(run.impacts) > 1
    np.testing.assert_array_less(off, 1e-11)


@pytest.mark.parametrize("scheme", SCHEMES[1:], ids=repr)
def test_other_schemes(scheme):
    """In flight they keep the angular momentum of bodies of equal moments of inertia only."""
    for seed in range(3):
        off, run = unbalanced(meeting((add_cube, add_ball), 0.0, 0.5, seed), scheme, gravity=NOTHING)
        assert run.impacts
        np.testing.assert_array_less(off, 1e-12)


def test_bodies_in_a_plane(compiled):
    scene = mbvi.Scene(gravity=(0, 0, 0), plane="xz")
    scene.add_box((0.3, 0.2, 0.1), 1.0, position=(0, 0.1, 0), angular_velocity=(0, 2, 0), name="box")
    scene.add_sphere(0.1, 2.0, position=(0.5, 0.1, 0.1), velocity=(-2, 0, -0.3), name="ball")
    off, run = unbalanced(scene.build(), gravity=NOTHING)
    assert run.impacts
    np.testing.assert_array_less(off, 1e-12)


def of_adaptive(tolerance):
    """Runs of a ball that slides over another, and of a box that falls back from its edge."""
    dome = mbvi.Scene()
    dome.add_sphere(1.0, position=(0, 0, 0), fixed=True, name="dome")
    dome.add_sphere(0.1, 2.0, (1.1 * np.sin(0.2), 0, 1.1 * np.cos(0.2)), (0, 0.5, 0), name="ball")
    yield "ball", mbvi.simulate(dome.build(), mbvi.Adaptive(tolerance), duration=0.5, record="contacts")
    tips, turn = mbvi.Scene(friction=0.8), Rotation.from_rotvec([0, 0.15, 0])
    tips.add_halfspace((0, 0, 1), name="floor")
    high = 0.1 * np.sin(0.15) + 0.3 * np.cos(0.15)
    tips.add_box((0.2, 0.2, 0.6), 2.0, position=(0, 0, high), rotation=turn.as_matrix(), name="box")
    yield "box", mbvi.simulate(tips.build(), mbvi.Adaptive(tolerance), duration=0.3, record="contacts")


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_error_control(tolerance):
    """States are extrapolated from steps and their halves, and so are forces; impacts take no time."""
    for name, run in of_adaptive(tolerance):
        dt = np.diff(run.t)
        change = 2.0 * (np.diff(run.v[:, :3], axis=0) - G * dt[:, None])
        recorded = dt[:, None] * run.contact_forces(name)[1:, :3]
        flight = dt > 0.0
        np.testing.assert_allclose(recorded[flight], change[flight], rtol=0, atol=1e-12)
        assert np.abs(run.record.contacts.corrections.wrench).max() > 1e-5


def test_impacts_of_error_control_have_all_that_strikes():
    """A ball slides below an overhang: the floor bears a part of the impact that is less than its load in a step."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, -0.003), -0.1, name="overhang")
    scene.add_sphere(0.1, 2.0, (-1.0, 0, 0.1), (2.0, 0, 0), name="ball")
    run = mbvi.simulate(scene.build(), mbvi.Adaptive(1e-2), duration=0.6)
    (impact,) = run.impacts
    assert sorted(impact.constraints) == ["ball | floor", "ball | overhang"]
    np.testing.assert_allclose(impact.percussion @ impact.normal, [-4.0, 0.0, 0.0], atol=1e-4)


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_means_over_several_steps(e, compiled):
    """Without friction moments are those of several percussions at the mean of their points."""
    problem = meeting(PAIRS[0], e, 0.0, 1)
    off, run = unbalanced(problem, gravity=NOTHING, every=4)
    assert run.impacts and len(run.t) < 40
    assert off[0] < 1e-12


def test_files_hold_what_percussions_leave_out(tmp_path):
    problem = meeting(PAIRS[1], 0.0, 0.5, 2)
    _, run = unbalanced(problem, gravity=NOTHING, out=tmp_path / "run.h5")
    run.save(tmp_path / "again.h5")
    assert np.abs(run.record.contacts.corrections.wrench).max() > 1e-3
    for name in ("run.h5", "again.h5"):
        loaded = mbvi.load(tmp_path / name)
        for body in problem.system.bodies[1:]:
            np.testing.assert_array_equal(loaded.contact_forces(body), run.contact_forces(body))
        pairs = run.contact_forces()
        for pair, forces in loaded.contact_forces().items():
            np.testing.assert_array_equal(forces, pairs[pair])


def test_action_is_reaction(compiled):
    """Between two bodies, and of each body by all others."""
    problem = meeting((add_box, add_ball, add_oval), 0.0, 0.5, 4, G, True)
    _, run = unbalanced(problem)
    pairs, names = run.contact_forces(), problem.system.bodies[1:]
    for name in names:
        total = sum((forces if pair[0] == name else -forces) for pair, forces in pairs.items() if name in pair)
        np.testing.assert_allclose(total, run.contact_forces(name), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_a_body_that_strikes_a_robot(mu, compiled):
    scene = mbvi.Scene(friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.44), name="robot")
    turned = {"rotation": (0.2, 0.3, 0.1), "angular_velocity": (3.0, 2.0, 1.0)}
    scene.add_box((0.1, 0.2, 0.15), 1.5, position=(-0.5, 0.03, 0.5), velocity=(4.0, 0.0, 0.2), name="box", **turned)
    problem = scene.build()
    off, run = unbalanced(problem, names=("box",))
    assert any("box | robot" in name or "robot" in name.split(" | ")[0] for i in run.impacts for name in i.constraints)
    np.testing.assert_array_less(off, 1e-12)


def test_contacts_that_stay_in_steps_of_the_fallback_are_no_impacts():
    """Two bodies that meet in space roll on each other: both surfaces are curved, and the gap falls in each step."""
    scene = mbvi.Scene(gravity=NOTHING, friction=0.8)
    rng = np.random.default_rng(4)
    bodies = []
    for k, x in enumerate((-0.4, 0.4)):
        turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        velocity = np.array([-2.0 * np.sign(x), *0.1 * rng.normal(size=2)])
        place = {"position": (x, 0.03 * k, 0.02), "rotation": turn}
        bodies.append(place | {"velocity": velocity, "angular_velocity": 2.0 * rng.normal(size=3), "name": "ab"[k]})
    scene.add_ellipsoid((0.2, 0.12, 0.15), 1.0, **bodies[0])
    scene.add_capsule(0.1, 0.2, 2.0, **bodies[1])
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-8), duration=0.5, record="contacts")
    assert any("paper's scheme" in note for note in run.notes)
    # after the second impact they stay together, but for moments at which the smooth motion is tried
    begin = np.searchsorted(run.t, run.impacts[1].time, side="right") - 1
    change = run.v[-1, :3] - run.v[begin, :3]
    force = np.diff(run.t[begin:]) @ run.contact_forces("a")[begin + 1 :, :3]
    assert np.linalg.norm(change) > 0.3
    assert np.linalg.norm(force - change) < 0.03 * np.linalg.norm(change)
    struck = sum(-i.percussion @ i.normal - i.tangential.sum(axis=0) for i in run.impacts[2:])
    np.testing.assert_allclose(force + struck, change, atol=1e-9)
