"""Contacts between free bodies keep momentum and angular momentum, wherever positions are projected or not.

Bodies of unequal moments of inertia that spin do so under `Centered`, in flight and while they are struck.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.run.fixed_steps import taking
from mbvi.system.free.free_momentum import keep_momentum
from support.momentum import momentum

PROJECTING = [scheme(project_positions=True) for scheme in (mbvi.Centered, mbvi.Paoli, mbvi.MoreauJean)]
SCHEMES = [*PROJECTING, mbvi.Centered(), mbvi.Paoli()]
OCTAHEDRON = "".join(f"v {x} {y} {z}\n" for x, y, z in 0.15 * np.concatenate([np.eye(3), -np.eye(3)]))
OCTAHEDRON += "f 1 2 3\nf 2 4 3\nf 4 5 3\nf 5 1 3\nf 2 1 6\nf 4 2 6\nf 5 4 6\nf 1 5 6\n"


@pytest.fixture(scope="module", autouse=True)
def octahedron(tmp_path_factory):
    (tmp_path_factory.getbasetemp() / "octahedron.obj").write_text(OCTAHEDRON)


def add_even(scene, kind, folder, **body):
    """Add a body of equal moments of inertia: in flight it keeps its angular velocity."""
    turn = {name: body.pop(name) for name in ("rotation", "angular_velocity")}
    if kind == "ball":
        scene.add_sphere(0.15, **body)
    elif kind == "round":
        scene.add_ellipsoid((0.12, 0.12, 0.12), **body, **turn)
    elif kind == "cube":
        scene.add_box((0.2, 0.2, 0.2), **body, **turn)
    else:
        scene.add_mesh(folder / "octahedron.obj", **body, **turn)


LINK = """<robot name="link"><link name="link"><inertial><origin xyz="0.03 -0.02 0.05"/><mass value="{mass}"/>
  <inertia ixx="{I[0]}" ixy="0.002" ixz="-0.001" iyy="{I[1]}" iyz="0.0015" izz="{I[2]}"/></inertial>
  <collision><geometry><box size="0.3 0.2 0.1"/></geometry></collision></link></robot>"""


def add_uneven(scene, kind, folder, **body):
    """Add a body whose angular velocity changes in flight; a link is a robot of one link, its centre of mass aside."""
    if kind == "ball":
        add_even(scene, kind, folder, **body)
    elif kind == "box":
        scene.add_box((0.3, 0.2, 0.1), **body)
    elif kind == "oval":
        scene.add_ellipsoid((0.08, 0.12, 0.16), **body)
    elif kind == "hull":
        lines = OCTAHEDRON.replace("0.15", "0.25", 1).replace("-0.15", "-0.08", 1)
        (folder / "long.obj").write_text(lines)
        scene.add_mesh(folder / "long.obj", **body)
    else:
        name = f"link{len(list(folder.glob('link*.urdf')))}"
        mass = body.pop("mass")
        (folder / f"{name}.urdf").write_text(LINK.format(mass=mass, I=mass * np.array([0.005, 0.009, 0.011])))
        base = [*body.pop("velocity"), *body.pop("angular_velocity")]
        scene.add_urdf(folder / f"{name}.urdf", base="free", base_velocity=base, name=name, **body)


def meeting(kinds, e, mu, rng, folder, add=add_even):
    """Two bodies alone in space that meet obliquely, each turned and spinning."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e, friction=mu)
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    for kind, side in zip(kinds, (-1.0, 1.0), strict=True):
        add(
            scene, kind, folder, mass=rng.uniform(0.5, 3.0), position=0.25 * side * n + 0.04 * rng.normal(size=3),
            rotation=Rotation.random(rng=rng).as_matrix(), velocity=-2.0 * side * n + 0.4 * rng.normal(size=3),
            angular_velocity=4.0 * rng.normal(size=3),
        )  # fmt: skip
    return scene.build()


def largest_changes(problem, states):
    """Return the largest relative changes of both momenta from one state to the next."""
    found, before = np.zeros(2), momentum(problem, problem.q0, problem.v0)
    for q, v in states:
        after = momentum(problem, q, v)
        changes = [np.linalg.norm(a - b) for a, b in zip(after[:2], before[:2], strict=True)]
        found, before = np.maximum(found, np.array(changes) / before[2:]), after
    return found


EVEN = [("ball", "ball"), ("round", "ball"), ("cube", "ball"), ("cube", "cube"), ("hull", "cube"), ("hull", "hull")]


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("kinds", EVEN, ids="-".join)
def test_two_bodies_that_meet_keep_both_momenta_in_every_step(kinds, e, mu, tmp_path_factory):
    struck = 0
    for seed in range(3):
        problem = meeting(kinds, e, mu, np.random.default_rng([seed, 7]), tmp_path_factory.getbasetemp())
        for scheme, h in [(SCHEMES[0], 1e-3), (SCHEMES[0], 6e-3), *((scheme, 4e-3) for scheme in SCHEMES[1:])]:
            steps = [step for _, step in zip(range(int(0.25 / h)), mbvi.steps(problem, scheme, step=h), strict=False)]
            struck += any(step.percussion.any() for step in steps)
            assert largest_changes(problem, [(step.q, step.v) for step in steps]).max() < 1e-13
    assert struck > 12


UNEVEN = [("box", "ball"), ("box", "box"), ("oval", "box"), ("hull", "box"), ("link", "ball"), ("link", "link")]


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("kinds", UNEVEN, ids="-".join)
def test_two_bodies_of_unequal_moments_keep_both_momenta(kinds, e, mu, tmp_path):
    struck = 0
    for seed in range(2):
        problem = meeting(kinds, e, mu, np.random.default_rng([seed, 9]), tmp_path, add_uneven)
        for scheme, h in [(SCHEMES[0], 2e-3), (SCHEMES[0], 1e-2), (mbvi.Centered(), 1e-2)]:
            steps = [step for _, step in zip(range(int(0.25 / h)), mbvi.steps(problem, scheme, step=h), strict=False)]
            struck += any(step.percussion.any() for step in steps)
            assert largest_changes(problem, [(step.q, step.v) for step in steps]).max() < 1e-13
    assert struck > 2


PLANES = {"xy": [0, 1], "xz": [0, 2], "yz": [1, 2]}


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("kinds", [("ball", "ball"), ("box", "ball"), ("box", "box")], ids="-".join)
def test_two_bodies_in_a_plane_keep_both_momenta(kinds, plane, mu):
    struck, along = 0, PLANES[plane]
    across = np.cross(*np.eye(3)[along])
    for seed in range(3):
        rng = np.random.default_rng([seed, 11])
        scene = mbvi.Scene(gravity=(0, 0, 0), restitution=[0.0, 0.4, 1.0][seed], friction=mu, plane=plane)
        n = np.zeros(3)
        n[along] = rng.normal(size=2)
        n /= np.linalg.norm(n)
        for kind, side in zip(kinds, (-1.0, 1.0), strict=True):
            aside, drift = np.zeros((2, 3))
            aside[along], drift[along] = 0.04 * rng.normal(size=2), 0.4 * rng.normal(size=2)
            place = {"position": 0.25 * side * n + aside + 0.3 * across, "velocity": -2.0 * side * n + drift}
            turn = Rotation.from_rotvec(rng.uniform(0.0, 6.0) * across).as_matrix()
            spin = 4.0 * rng.normal() * across
            if kind == "ball":
                scene.add_sphere(0.15, mass=rng.uniform(0.5, 3.0), **place)
            else:
                scene.add_box(
                    (0.3, 0.2, 0.25), mass=rng.uniform(0.5, 3.0), **place, rotation=turn, angular_velocity=spin
                )
        problem = scene.build()
        for scheme in SCHEMES:
            steps = [step for _, step in zip(range(60), mbvi.steps(problem, scheme, step=4e-3), strict=False)]
            struck += any(step.percussion.any() for step in steps)
            assert largest_changes(problem, [(step.q, step.v) for step in steps]).max() < 1e-13
    assert struck > 6


@pytest.mark.parametrize("kind", ["box", "link"])
@pytest.mark.parametrize("scheme", [mbvi.Centered(), PROJECTING[0]], ids=repr)
def test_elastic_bodies_that_spin_keep_their_energy(scheme, kind, tmp_path):
    for seed in range(3):
        problem = meeting((kind, "box"), 1.0, 0.0, np.random.default_rng([seed, 12]), tmp_path, add_uneven)
        steps = [step for _, step in zip(range(40), mbvi.steps(problem, scheme, step=6e-3), strict=False)]
        energies = [problem.system.kinetic_energy(step.q, step.v) for step in steps]
        np.testing.assert_allclose(energies, problem.system.kinetic_energy(problem.q0, problem.v0), rtol=1e-12)


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize(
    "kinds", [("ball", "ball"), ("cube", "ball"), ("cube", "cube"), ("box", "box"), ("link", "box")], ids="-".join
)
def test_two_bodies_keep_both_momenta_in_the_compiled_loop(kinds, mu, monkeypatch, tmp_path):
    made, build = [], taking.compiled_loop
    monkeypatch.setattr(taking, "compiled_loop", lambda *args: made.append(build(*args)) or made[-1])
    for seed in range(4):
        add = add_uneven if {"box", "link"} & set(kinds) else add_even
        problem = meeting(kinds, [0.0, 0.4][seed % 2], mu, np.random.default_rng([seed, 8]), tmp_path, add)
        run = mbvi.simulate(problem, PROJECTING[0], step=2e-3, duration=0.3, progress=False)
        assert run.impacts
        assert largest_changes(problem, zip(run.q[1:], run.v[1:], strict=True)).max() < 1e-13
    # nearly all steps are the loop's
    assert all(loop.codes.sum() < 20 for loop in made)


@pytest.mark.parametrize("scheme", PROJECTING, ids=repr)
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize(("e", "tilt"), [(0.0, 0.0), (0.0, 0.3), (0.4, 0.2)])
def test_a_ball_that_slides_keeps_its_spin(e, tilt, mu, compiled, scheme, monkeypatch):
    """About the normal of the floor, and without friction as a whole: a contact at a point has no other torque."""
    if not compiled:
        monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    n = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace(n)
    body = {"mass": 2.0, "position": 0.12 * n}
    if mu:
        scene.add_sphere(0.1, **body)
    else:
        scene.add_ellipsoid((0.1, 0.1, 0.1), **body)
    problem = scene.build()
    problem = problem.at(problem.q0, np.array([1.0, 0.3, -0.5, 2.0, 3.0, 7.0]))
    run = mbvi.simulate(problem, scheme, step=2e-3, duration=0.4, progress=False)
    spin = Rotation.from_quat(run.q[:, 3:7].copy()).apply(run.v[:, 3:6].copy())
    assert run.impacts
    np.testing.assert_allclose(spin @ n, spin[0] @ n, rtol=0.0, atol=1e-12)
    if mu:
        assert np.abs(spin - spin[0]).max() > 1.0
    else:
        np.testing.assert_allclose(spin, np.broadcast_to(spin[0], spin.shape), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("depth", [1e-3, 1e-5])
def test_what_a_displacement_changes_of_the_momentum_is_given_back(depth, rng, tmp_path):
    """Bodies of unequal moments: rates of the gap and energy change by no more than the depth over the size."""

    def add(scene, kind, folder, **body):
        scene.add_box((0.2, 0.3, 0.25), **body)

    for _ in range(20):
        problem = meeting(("box", "box"), 0.0, 0.0, rng, tmp_path, add)
        system, start, w = problem.system, problem.q0.copy(), rng.normal(size=12)
        between, n = 0.5 * (start[:3] + start[7:10]), start[7:10] - start[:3]
        row = system.separation_rows(start, np.array([1]), np.array([2]), between[None], n[None] / np.linalg.norm(n))
        moved = system.metric(start).solve_rows(row)[0]
        q, v = system.integrate(start, depth * moved / (row[0] @ moved)), w.copy()
        columns, starts = np.arange(12, dtype=np.int32), np.array([0, 12], np.int32)
        keep_momentum(problem.free_bodies, row[0], columns, starts, start, w, start, q, v)
        before, after = momentum(problem, start, w), momentum(problem, q, v)
        np.testing.assert_allclose(after[0], before[0], rtol=0.0, atol=1e-14 * before[2])
        np.testing.assert_allclose(after[1], before[1], rtol=0.0, atol=1e-14 * before[3])
        assert np.abs(row[0] @ (v - w)) < 20.0 * depth * np.abs(w).max()
        energies = [system.kinetic_energy(*state) for state in ((start, w), (q, v))]
        assert abs(energies[1] - energies[0]) < 20.0 * depth * energies[0]
