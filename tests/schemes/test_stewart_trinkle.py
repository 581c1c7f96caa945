"""The scheme for piles: nothing lands inside anything, momentum is accounted for, and heaps come to rest."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.linalg import norm
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.projection import Projector
from mbvi_studies.spheres import cube_of_spheres

H = 2e-3


def pile(count, radius=0.02, drop=0.02, density=None, seed=0):
    """Spheres of a lattice over an open box; of one kilogram each, or of one density and radii within 1 : 3."""
    n = int(np.ceil(count ** (1 / 3)))
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    grid = grid[np.argsort(grid[:, 2], kind="stable")][:count]
    centres = 2.2 * radius * (grid + 0.5) + 0.05 * radius * (2.0 * rng.random((count, 3)) - 1.0)
    centres[:, 2] += drop
    radii = radius * (np.ones(count) if density is None else 3.0 ** -rng.random(count))
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    for axis in range(2):
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            scene.add_halfspace(normal, 0.0 if sign > 0 else -2.2 * radius * n, name=f"wall {axis} {sign:g}")
    scene.add_spheres(centres, radii, 1.0 if density is None else density * 4.19 * radii**3, name="grain")
    return scene.build(), radii


def deepest(problem, radii, q):
    """What the spheres penetrate each other and their box, from the configuration alone [m]."""
    centres = q.reshape(-1, 3)
    i, j = np.triu_indices(len(radii), 1)
    between = np.linalg.norm(centres[i] - centres[j], axis=1) - radii[i] - radii[j]
    walls = problem.scene.walls.values()
    outside = [(centres @ np.array(w.normal) - w.offset - radii).min() for w in walls]
    return max(0.0, -float(between.min()), -float(min(outside)))


@pytest.mark.parametrize("density", [None, 1000.0])
def test_a_pile_comes_to_rest_without_ever_penetrating(density):
    problem, radii = pile(64, density=density)
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.7, residual=1e-6, progress=False)
    worst = max(deepest(problem, radii, q) for q in run.q)
    assert worst < 1e-4 * radii.min()
    # the record says so too
    assert run.penetration().max() == pytest.approx(worst, abs=1e-5 * radii.min())
    speed = np.abs(run.v).max(axis=1)
    assert speed.max() > 0.4
    assert run.residual.max() <= 1e-6
    energy = run.energy()
    assert (np.diff(energy) <= 1e-6 * energy.max()).all()
    assert np.sqrt((run.v[-1] ** 2).mean()) < 0.03


def test_percussions_balance_momentum_and_carry_the_weight():
    problem, _ = pile(64)
    before, pressed = problem.v0, 0
    for k, step in enumerate(mbvi.steps(problem, mbvi.StewartTrinkle(), step=H, residual=1e-9)):
        J = step.active.jacobian
        gained = (step.v - before).reshape(-1, 3) - H * np.array([0.0, 0.0, -9.81])
        np.testing.assert_allclose(gained.ravel(), J.T @ step.percussion, atol=1e-12)
        assert (step.percussion >= 0.0).all()
        lower = np.minimum(0.0, -(step.active.gap - H * step.after) / H)
        # to the residual, which is relative to the largest speed of rows of unit length in the metric: masses are 1
        unit = norm(csr_array(J), axis=1)
        off = 1e-9 * unit * float(((np.abs(step.free) + np.abs(lower)) / unit).max(initial=0.0))
        assert (step.after >= lower - off).all()
        before, pressed = step.v, pressed + (step.percussion > 0.0).any()
        if k == 120:
            break
    assert pressed > 50


def test_the_same_pile_twice_is_the_same_to_the_last_bit():
    first, second = (
        mbvi.simulate(pile(64)[0], mbvi.StewartTrinkle(), step=H, duration=0.2, progress=False) for _ in range(2)
    )
    assert first.q.tobytes() == second.q.tobytes()
    assert first.v.tobytes() == second.v.tobytes()
    assert [i.constraints for i in first.impacts] == [i.constraints for i in second.impacts]


def test_a_ball_stops_on_the_floor_and_not_below():
    """Which `Paoli` enters by up to h |v|."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, 0, 0.537))
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.6, progress=False)
    assert (run.q[:, 2] >= 0.1 - 1e-15).all()
    assert run.q[-1, 2] == pytest.approx(0.1, abs=1e-15)
    assert mbvi.simulate(problem, mbvi.Paoli(), step=H, duration=0.6, progress=False).penetration().max() > 1e-4
    # two steps take the velocity, and the record holds the first of them
    landing = int(np.argmin(run.v[:, 2]))
    assert -run.v[landing, 2] == pytest.approx(np.sqrt(2 * 9.81 * 0.437), rel=1e-2)
    assert run.v[landing + 2 :, 2] == pytest.approx(0.0, abs=1e-12)
    assert len(run.impacts) == 1
    assert run.impacts[0].percussion == pytest.approx(run.v[landing + 1, 2] - run.v[landing, 2] + 9.81 * H)


def test_what_is_struck_within_the_step_is_seen():
    """The last of a row of balls is out of reach until the first strikes: the step is taken anew."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    masses = [100.0, 1.0, 0.01]
    for k, x in enumerate([0.0, 0.2, 0.4]):
        speed = (20.0 if k == 0 else 0.0, 0, 0)
        scene.add_sphere(0.1, mass=masses[k], position=(x + 1e-4 * k, 0, 0), velocity=speed, name=f"ball {k}")
    scene.add_sphere(0.1, position=(0.7, 0, 0), mass=1e-4, name="far")
    problem = scene.build()
    for k, step in enumerate(mbvi.steps(problem, mbvi.StewartTrinkle(), step=H)):
        gaps = np.diff(step.q.reshape(-1, 3)[:, 0]) - 0.2
        assert (gaps > -1e-9).all()
        if k == 20:
            break
    assert step.v[9] > 10.0


LEVER = """<robot name="lever"><link name="base"/><link name="beam">
<inertial><origin xyz="0.5 0 0"/><mass value="0.01"/>
<inertia ixx="1e-4" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.02 0.02"/></geometry></collision></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="beam"/><axis xyz="0 -1 0"/></joint></robot>"""


def test_what_a_lever_strikes_by_a_hair_is_seen_too(tmp_path):
    """A ball strikes it near its hinge, and its tip goes ten times as far: out of reach, and by a thousandth less deep
    than counts where gradients turn."""
    path = tmp_path / "lever.urdf"
    path.write_text(LEVER)

    def struck(*targets):
        scene = mbvi.Scene(gravity=(0, 0, 0))
        scene.add_urdf(path, base="fixed")
        scene.add_sphere(0.05, mass=100.0, position=(0.1, 0, -0.0601), velocity=(0, 0, 2.0))
        for z in targets:
            scene.add_sphere(0.05, mass=1e-4, position=(0.97, 0, z), name="target")
        problem = scene.build()
        return problem, next(mbvi.steps(problem, mbvi.StewartTrinkle(), step=H))

    _, step = struck()
    angle = np.arctan2(step.q[1], step.q[0])
    assert angle * 0.97 > 5.0 * H * 2.0
    # where it would touch the beam's upper face there
    above = 0.97 * np.tan(angle) + 0.06 / np.cos(angle)
    problem, step = struck(above - 1e-5)
    rows = problem.constraints.active(step.t, step.q, 1e-6)
    (gap,) = (f for a, f in zip(rows.constraint, rows.gap, strict=True) if "target" in problem.constraints.name(a))
    assert gap == pytest.approx(0.0, abs=1e-9)
    assert step.v[-1] > 1e-3


def tumbling(count, seed=0):
    """Boxes in random poses over a box: corners, edges and faces turn into each other by several degrees a step."""
    scene = mbvi.Scene()
    scene.add_container((-0.1, -0.1, 0.0), (0.1, 0.1))
    for k, turn in enumerate(Rotation.random(count, random_state=seed).as_matrix()):
        i, j, layer = k % 2, k // 2 % 2, k // 4
        place = (0.08 * i - 0.04, 0.08 * j - 0.04, 0.05 + 0.075 * layer)
        scene.add_box((0.04, 0.04, 0.04), position=place, rotation=turn)
    return scene.build()


@pytest.mark.parametrize("seed", [0, 1, 4])
def test_boxes_that_tumble_onto_each_other_stay_out_of_each_other(seed):
    problem = tumbling(24, seed)
    allowed, found = 1e-3 * problem.length, []
    for step in mbvi.steps(problem, mbvi.StewartTrinkle(), step=H, residual=1e-6):
        gap = problem.constraints.active(step.t, step.q, 0.0).gap
        depth = max(0.0, -float(gap.min(initial=0.0)))
        # and the record says how deep they are, to what the projection's residual leaves
        assert max(0.0, -float(step.active.gap.min(initial=0.0))) == pytest.approx(depth, abs=1e-3 * allowed)
        found.append(depth)
        if step.t > 0.5:
            break
    assert max(found) < 1.01 * allowed
    assert np.abs(step.v).max() > 0.01


def test_what_pushes_out_is_no_velocity():
    """A box that stands a little in the floor, but not in what the problem is made of: it rises, and rests."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.1))
    problem = scene.build()
    q = problem.q0.copy()
    q[2] -= 1e-3
    step = mbvi.StewartTrinkle().step(problem, 0.0, q, np.zeros(6), H, Projector(1e-6))
    np.testing.assert_allclose(step.q, problem.q0, atol=1e-15)
    np.testing.assert_allclose(step.v, 0.0, atol=1e-15)


def test_what_is_jammed_stays_as_deep_as_it_is():
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(2), force=lambda t, q, v: np.zeros(2), dim=2)
    left = mbvi.GapFunction(lambda q: q[0], lambda q: np.array([1.0, 0.0]))
    right = mbvi.GapFunction(
        lambda q: 1.0 - 1.01 * min(q[1], 1.0) - q[0], lambda q: np.array([-1.0, -1.01 * (q[1] < 1.0)])
    )
    problem = mbvi.Problem(system, [left, right], [0.5, 0.0], [0.0, 0.0])
    step = mbvi.StewartTrinkle().step(problem, 0.0, np.array([-0.005, 2.0]), np.zeros(2), H, Projector(1e-6))
    np.testing.assert_allclose(step.q, [-0.005, 2.0], atol=1e-15)
    np.testing.assert_allclose(step.active.gap, -0.005, atol=1e-15)


def falling(*heights):
    """A scene of spheres over a floor, e = 0.5."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_spheres([(0.0, k, z) for k, z in enumerate(heights)], 0.1, 1.0, name="balls")
    return scene


@pytest.mark.parametrize("count", [2, 40])
def test_only_pairs_that_there_are_count(count):
    """The scene's own e is no pair's where each has one of its own; a sphere meets itself nowhere."""
    scene = falling(*[0.1] * count)
    scene.add_sphere(0.1, 1.0, position=(2, 0, 0.1), name="alone")
    for pair in (("balls", "balls"), ("balls", "floor"), ("alone", "floor"), ("alone", "balls")):
        scene.set_restitution(*pair, 0.0)
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=H, duration=0.01, progress=False)
    np.testing.assert_allclose(run.v, 0.0, atol=1e-9)


def test_it_takes_systems_without_bodies():
    """The paper's own setting: all given constraints are looked at."""
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=lambda t, q, v: np.array([-9.81]), dim=1)
    floor = mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1))
    problem = mbvi.Problem(system, [floor], [1.0], [0.0])
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=1.0, progress=False)
    assert run.q.min() >= -1e-15
    assert run.q[-1, 0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(), mbvi.MoreauJean()])
def test_other_schemes_take_many_bodies(scheme):
    problem, radii = pile(64)
    run = mbvi.simulate(problem, scheme, step=H, duration=0.3, progress=False)
    assert run.residual.max() <= 1e-6
    assert deepest(problem, radii, run.q[-1]) < 0.2 * radii.min()
    assert len(run.impacts) > 10


def test_the_default_scheme_and_the_diagnosis_take_many_bodies():
    problem, radii = pile(64)
    run = mbvi.simulate(problem, step=H, duration=0.1, residual=1e-6, progress=False)
    assert run.scheme == "StewartTrinkle"
    assert run.residual.max() <= 1e-6
    assert deepest(problem, radii, run.q[-1]) < 1e-4 * radii.min()
    diagnosis = run.diagnosis()
    assert diagnosis.largest_percussion == max(i.percussion.max() for i in run.impacts)


@pytest.mark.parametrize("ratio", [1.0, 1e6, 1e8])
def test_a_box_under_a_heavier_one_stays(ratio):
    """Beside enough spheres that rows are sparse."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    for k, mass in enumerate((1.0, ratio)):
        scene.add_box((0.2, 0.2, 0.2), mass, position=(0, 0, 0.1 + 0.2 * k))
    scene.add_spheres(np.array([[2.0 + 0.1 * k, 0, 0.02] for k in range(40)]), 0.02, 1.0)
    problem = scene.build()
    assert problem.system.sparse
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.2, progress=False)
    assert run.penetration().max() < 1e-8
    # heights and tilts; along the faces nothing holds them, and the heavy one's rounding moves the light one
    moved = np.abs(run.q[-1] - problem.q0)[:14].reshape(2, 7)
    assert moved[:, 2:5].max() < 1e-9


@pytest.mark.slow
def test_a_pile_of_the_cube_of_spheres_is_solved_to_the_end():
    """Rows that depend on each other by symmetry: percussions carried from step to step stress them more and more."""
    run = mbvi.simulate(
        cube_of_spheres(0.0), mbvi.StewartTrinkle(), step=1.03e-3, duration=2.0, residual=1e-6, progress=False
    )
    assert run.residual.max() <= 1e-6
    assert run.penetration().max() < 1e-6 * 0.1


@pytest.mark.slow
def test_a_thousand_boxes_poured_stay_out_of_each_other():
    """Islands of hundreds of rows, many of them dependent: they are solved, and no box is deep in another."""
    scene = mbvi.Scene()
    scene.add_container((-0.2, -0.2, 0.0), (0.2, 0.2))
    layer, row, column = np.unravel_index(np.arange(1000), (40, 5, 5))
    places = 0.075 * np.stack([row - 2, column - 2, layer], axis=1) + [0.0, 0.0, 0.05]
    scene.add_boxes(places, (0.04, 0.04, 0.04), 1.0, rotations=Rotation.random(1000, random_state=0).as_matrix())
    problem = scene.build()
    for step in mbvi.steps(problem, step=H):
        assert step.active.gap.min(initial=0.0) > -5e-3 * problem.length
        if step.t > 0.25:
            break
    assert len(step.active.gap) > 1000


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_percussions_are_the_gain_of_momentum_of_a_robot(e):
    """M (w - v_free) = J^T p with the mass matrix of the beginning of the step, also after searches at its end."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(mbvi.robot("quadruped"), position=(0, 0, 0.5))
    problem, h, struck = scene.build(), 1e-3, 0
    q, v, projector = problem.q0, problem.v0.copy(), Projector()
    v[6:] = 5.0 * np.sin(np.arange(12.0))
    for k in range(400):
        step = mbvi.StewartTrinkle().step(problem, k * h, q, v, h, projector)
        motion = problem.system.free_motion(k * h, q, v, h)
        gain, impulse = motion.metric.apply(step.v - motion.free), step.active.jacobian.T @ step.percussion
        np.testing.assert_allclose(gain, impulse, rtol=0.0, atol=1e-10 * max(1.0, np.abs(impulse).max(initial=0.0)))
        struck += step.percussion.any()
        q, v = step.q, step.v
    assert struck > 20
