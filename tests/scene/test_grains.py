"""Many bodies under one name, and containers around them."""

import sys

import numpy as np
import pytest

import mbvi
from mbvi import packing
from support.programs import run

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])


def test_spheres_take_what_packing_returns_and_weigh_their_density():
    scene = mbvi.Scene()
    pack = packing.random_loose((0, 0, 0), (1, 1, 1), packing.uniform(0.02, 0.1), count=20)
    assert scene.add_spheres(*pack, density=2500.0) == "spheres"
    problem = scene.build()
    np.testing.assert_allclose(problem.q0.reshape(-1, 3), pack.positions)
    mass = np.diag(problem.system.metric(problem.q0).dense())
    np.testing.assert_allclose(mass, np.repeat(2500 * 4 / 3 * np.pi * pack.radii**3, 3))


def test_many_boxes_are_as_many_single_ones():
    rng = np.random.default_rng(1)
    places, sizes, speeds, spins = rng.uniform(0.1, 0.4, (4, 5, 3))
    places += np.arange(5)[:, None]
    many, single = mbvi.Scene(restitution=0.5), mbvi.Scene(restitution=0.5)
    many.add_boxes(
        places, sizes, density=300.0, rotations=TURN, velocities=speeds, angular_velocities=spins, name="brick"
    )
    for k in range(5):
        mass = 300 * float(sizes[k].prod())
        single.add_box(sizes[k], mass, position=places[k], rotation=TURN, velocity=speeds[k], angular_velocity=spins[k])
    for scene in (many, single):
        scene.add_halfspace((0, 0, 1), offset=-0.5)
    one, other = many.build(), single.build()
    assert one.q0.tobytes() == other.q0.tobytes() and one.v0.tobytes() == other.v0.tobytes()
    a, b = (mbvi.simulate(p, mbvi.Paoli(), step=2e-3, duration=0.5) for p in (one, other))
    assert a.q.tobytes() == b.q.tobytes() and len(a.impacts) > 0
    assert a.impacts[0].constraints[0].startswith("brick[")


def test_grains_of_one_shape_share_it_and_weigh_their_density(tmp_path):
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1))
    places = np.array([[0, 0, 0.1], [2, 0, 0.1], [4, 0, 0.1]])
    scene.add_convex(TETRAHEDRON, places, density=np.array([6.0, 12.0, 6.0]), scale=0.5)
    problem = scene.build()
    # volume 1 / 48, the centre a quarter up
    mass = np.diag(problem.system.metric(problem.q0).dense()).reshape(-1, 6)[:, 0]
    np.testing.assert_allclose(mass, np.array([6, 12, 6]) / 48)
    np.testing.assert_allclose(problem.q0.reshape(-1, 7)[:, :3], places + 0.125)
    shapes = [s.shape for s in problem.scene.shapes]
    assert shapes[0] is shapes[1] is shapes[2]
    run = mbvi.simulate(problem, mbvi.Paoli(), step=2e-3, duration=0.3)
    run.save(tmp_path / "run.h5")
    back = mbvi.load(tmp_path / "run.h5").problem
    shapes = [s.shape for s in back.scene.shapes]
    assert shapes[0] is shapes[1] is shapes[2]
    assert mbvi.simulate(back, mbvi.Paoli(), step=2e-3, duration=0.3).q.tobytes() == run.q.tobytes()
    # q follows the centre of mass, which falls alike for all
    np.testing.assert_allclose(run.q[:50, 2], run.q[:50, 9], atol=1e-12)


def test_a_thousand_boxes_are_added_by_one_call_with_one_name():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    pack = packing.lattice((10, 10, 10), 0.1)
    assert scene.add_boxes(pack.positions + np.array([0, 0, 1]), (0.1, 0.1, 0.1), mass=1.0) == "boxes"
    scene.set_restitution("boxes", "floor", 0.5)
    scene.set_restitution("boxes[7]", "floor", 0.9)
    with pytest.raises(mbvi.InputError, match="the name 'boxes' is taken"):
        scene.add_spheres(pack.positions, 0.1, mass=1.0, name="boxes")
    with pytest.raises(mbvi.InputError, match="unknown name 'boxes\\[1000\\]'"):
        scene.set_restitution("boxes[1000]", "floor", 0.5)


def test_ten_thousand_spheres_are_built_without_a_list_of_their_pairs():
    """In a process of its own; compiling kernels, which takes memory too, comes first."""
    code = """
import resource, mbvi
from mbvi.compiled import compile_all
compile_all()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
scene = mbvi.Scene()
scene.add_container((0, 0, 0), (1, 1))
scene.add_spheres(*mbvi.packing.layers((0, 0, 0), (1, 1), 0.01, count=10_000), density=1000.0)
scene.build()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    done = run([sys.executable, "-c", code])
    # [kB]; three numbers for each pair would be 1.2 GB
    assert int(done.stdout) < 300_000, done.stderr


def test_a_container_is_a_floor_and_four_walls():
    scene = mbvi.Scene(restitution=1.0)
    assert scene.add_container((-1, -2, 0.5), (1, 2)) == "container"
    scene.add_sphere(0.1, position=(0, 0, 1), velocity=(0, 0, -1), name="ball")
    scene.add_sphere(0.1, position=(0, 0, 3), velocity=(-5, 0, 0))
    scene.add_sphere(0.1, position=(0, 0, 5), velocity=(0, 7, 0))
    scene.set_restitution("container", "ball", 0.5)
    scene.set_restitution("container/floor", "ball", 0.25)
    problem = scene.build()
    np.testing.assert_allclose(problem.constraints.gap(0.0, problem.q0)[:15:3], [0.4, 0.9, 0.9, 1.9, 1.9])
    names = [problem.constraints.name(k) for k in range(0, 15, 3)]
    assert names == [f"ball | container/{side}" for side in ("floor", "left", "right", "front", "back")]
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=0.35)
    first = {i.constraints[0]: i.after[0] / -i.before[0] for i in reversed(run.impacts)}
    assert first["ball | container/floor"] == pytest.approx(0.25)
    assert first["sphere | container/left"] == pytest.approx(1.0)


PLACES = [[0, 0, 0], [1, 0, 0]]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.add_spheres(PLACES, 0.1), "either mass or density"),
        (lambda s: s.add_spheres(PLACES, 0.1, mass=1.0, density=1.0), "either mass or density"),
        (lambda s: s.add_spheres(PLACES, 0.1, density=-1.0), "every density must be positive"),
        (lambda s: s.add_boxes([[0, 0]], (1, 1, 1), mass=1.0), r"positions has shape \(1, 2\)"),
        (lambda s: s.add_boxes(PLACES, (1, 1), mass=1.0), "size has shape"),
        (lambda s: s.add_boxes(PLACES, np.ones((3, 3)), mass=1.0), "size has shape"),
        (lambda s: s.add_boxes(PLACES, (1, 1, 0), mass=1.0), "every size must be positive"),
        (lambda s: s.add_boxes(PLACES, (1, 1, 1), mass=[1.0, 2.0, 3.0]), "mass has shape"),
        (
            lambda s: s.add_boxes(PLACES, (1, 1, 1), mass=1.0, rotations=np.ones((3, 3))),
            "rotations holds no rotation matrix",
        ),
        (lambda s: s.add_boxes(PLACES, (1, 1, 1), mass=1.0, rotations=np.ones((5, 3, 3))), "rotations has shape"),
        (lambda s: s.add_boxes(PLACES, (1, 1, 1), mass=1.0, velocities=[[0, 0, np.nan]] * 2), "must be finite"),
        (lambda s: s.add_boxes("here", (1, 1, 1), mass=1.0), "positions must be numbers"),
        (lambda s: s.add_convex(np.eye(3), PLACES, mass=1.0), "no volume"),
        (lambda s: s.add_convex("nowhere.stl", PLACES, mass=1.0), "no such file"),
        (lambda s: s.add_convex(TETRAHEDRON, PLACES, mass=1.0, scale=0.0), "scale must be positive"),
        (lambda s: s.add_container((0, 0, 0), (0, 1)), "must lie below"),
        (lambda s: s.add_container((0, 0, 0), 1.0), "upper"),
    ],
)
def test_wrong_input_says_what_is_wrong(call, message):
    with pytest.raises(mbvi.InputError, match=message):
        call(mbvi.Scene())
