"""A step of a mechanism or a body is the same whatever moves far away: margins, searches and impacts elsewhere."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.projection import Projector
from mbvi.run.fixed_steps import taking
from mbvi.system import located_parts
from support.paths import ROBOTS

H, EDGE = 2e-3, 0.2
SCHEMES = [
    mbvi.Centered(project_positions=True), mbvi.Centered(), mbvi.MoreauJean(), mbvi.Paoli(project_positions=True),
    mbvi.StewartTrinkle(),
]  # fmt: skip


def quadruped(scene, rng, at):
    height, velocity = 0.55 + 0.1 * rng.random(), rng.normal(size=6)
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf", position=(at, 0, height), base_velocity=velocity, name="quadruped"
    )


def box(scene, rng, at):
    turned = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    scene.add_box(
        (0.3, 0.2, 0.1), mass=2.0, position=(at, 0, 0.3), rotation=turned, velocity=rng.normal(size=3),
        angular_velocity=5.0 * rng.normal(size=3), name="box",
    )  # fmt: skip


def stack(scene, rng, at):
    for k in range(3):
        place = (at + 0.02 * k * rng.random(), 0, 0.05 + 0.101 * k)
        scene.add_box((0.3, 0.3, 0.1), mass=1.0, position=place, velocity=(0.15 * k, 0, -0.5 * k), name=f"stack {k}")


def balls(scene, rng, at):
    for k in range(3):
        velocity = (0, 0, -2.0) if k == 2 else (0, 0, 0)
        scene.add_sphere(0.1, mass=1.0, position=(at, 0, 0.1 + 0.2 * k), velocity=velocity, name=f"ball {k}")


PARTS = {"quadruped": quadruped, "box": box, "stack": stack, "balls": balls}


def build(names, e, friction, seed):
    scene = mbvi.Scene(restitution=e, friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k, name in enumerate(PARTS):
        if name in names:
            PARTS[name](scene, np.random.default_rng([seed, k]), 10.0 * k)
    return scene.build()


def own_places(problem, bodies):
    """Where the coordinates and the velocities of some bodies are."""
    q, v = [], []
    for part in located_parts(problem.system):
        names, count = part.system.bodies[1:], part.system.independent_bodies
        nq, nv = part.system.nq // count, part.system.nv // count
        for k in range(count):
            if names[k] in bodies:
                q += range(part.q + k * nq, part.q + (k + 1) * nq)
                v += range(part.v + k * nv, part.v + (k + 1) * nv)
    return q, v


@pytest.fixture(autouse=True)
def one_length(monkeypatch):
    """Tolerances are parts of the length of the scene, which is a median of what it holds."""
    monkeypatch.setattr("mbvi.scene.blocks.Blocks.length", EDGE)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_each_step_is_that_of_each_part_alone(scheme, e, friction):
    together = build(PARTS, e, friction, seed=1)
    alone = [build([name], e, friction, seed=1) for name in PARTS]
    places = [own_places(together, problem.system.bodies[1:]) for problem in alone]
    assert sum(len(v) for _, v in places) == together.system.nv
    t, q, v, impacts = 0.0, together.q0, together.v0, 0
    for _ in range(120):
        # projectors of their own: a start changes rounding
        step = scheme.step(together, t, q, v, H, Projector(1e-9))
        for problem, (own_q, own_v) in zip(alone, places, strict=True):
            one = scheme.step(problem, t, q[own_q], v[own_v], H, Projector(1e-9))
            np.testing.assert_allclose(step.q[own_q], one.q, rtol=0, atol=1e-11)
            np.testing.assert_allclose(step.v[own_v], one.v, rtol=0, atol=1e-10)
        t, q, v, impacts = t + H, step.q, step.v, impacts + (step.percussion > 0.0).sum()
    assert impacts > 100


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("scheme", [*SCHEMES[:2], SCHEMES[-1]], ids=str)
def test_a_run_in_kernels_is_that_of_each_part_alone(scheme, e):
    """As far as rounding has not grown."""
    together = mbvi.simulate(build(PARTS, e, 0.5, seed=2), scheme, step=H, duration=20 * H)
    for name in PARTS:
        alone = mbvi.simulate(build([name], e, 0.5, seed=2), scheme, step=H, duration=20 * H)
        q, v = own_places(together.problem, alone.problem.system.bodies[1:])
        np.testing.assert_allclose(together.q[:, q], alone.q, rtol=0, atol=1e-11)
        np.testing.assert_allclose(together.v[:, v], alone.v, rtol=0, atol=1e-9)


BALLS = {
    "struck": ((0.0, 0.0, 0.101), (0.0, 0.0, -3.0)),
    "rising": ((2.0, 0.0, 0.1), (0.0, 0.0, 0.005)),
    "left": ((4.0, 0.0, 0.1), (0.0, 0.0, 0.0)),
    "right": ((4.21, 0.0, 0.1), (0.0, 0.0, 0.0)),
    "bullet": ((6.0, 0.0, 9.0), (100.0, 0.0, 0.0)),
}
GROUPS = [["struck"], ["rising"], ["left", "right"], ["bullet"]]


def on_a_floor(names):
    """Balls, of which one strikes, one rises and is pulled back, two rest with a gap, and one is fast."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for name in names:
        scene.add_sphere(0.1, mass=1.0, position=BALLS[name][0], velocity=BALLS[name][1], name=name)
    return scene.build()


@pytest.mark.parametrize("compiled", [False, True])
def test_impacts_and_speed_elsewhere_do_not_change_a_step_of_piles(compiled, monkeypatch):
    """Bounds beside an impact have its e, and contacts of slow bodies far apart get no rows."""
    if not compiled:
        monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    scheme = mbvi.StewartTrinkle()
    together = mbvi.simulate(on_a_floor(BALLS), scheme, step=H, duration=H, progress=False)
    for names in GROUPS:
        alone = mbvi.simulate(on_a_floor(names), scheme, step=H, duration=H, progress=False)
        q, v = own_places(together.problem, alone.problem.system.bodies[1:])
        np.testing.assert_allclose(together.q[:, q], alone.q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(together.v[:, v], alone.v, rtol=0, atol=1e-13)
    # the one that rises is caught by the floor, by hand: its gap is zero and may not fall
    _, v = own_places(together.problem, ["rising"])
    np.testing.assert_allclose(together.v[-1, v], 0.0, rtol=0, atol=1e-13)


def test_depth_and_speed_elsewhere_do_not_change_a_step_of_piles():
    """A depth that is left is not removed because another one is, and both have the same rows as alone."""
    scheme, together = mbvi.StewartTrinkle(), on_a_floor(BALLS)
    q0, v0 = together.q0.copy(), together.v0.copy()
    for name, depth in (("struck", 1e-5), ("left", 0.5 * together.tolerance)):
        q, v = own_places(together, [name])
        q0[q[2]], v0[v] = 0.1 - depth, 0.0
    step, rows = scheme.step(together, 0.0, q0, v0, H, Projector(1e-9)), 0
    for names in GROUPS:
        problem = on_a_floor(names)
        q, v = own_places(together, problem.system.bodies[1:])
        one = scheme.step(problem, 0.0, q0[q], v0[v], H, Projector(1e-9))
        np.testing.assert_allclose(step.q[q], one.q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(step.v[v], one.v, rtol=0, atol=1e-13)
        rows += len(one.active.gap)
    assert len(step.active.gap) == rows
