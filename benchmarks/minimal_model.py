"""Time that each reduction of a model saves: on and off alternate; prints a Markdown table."""

from __future__ import annotations

import argparse
import sysconfig
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np

import mbvi
from mbvi.compiled import compile_all
from mbvi.constraints import HalfSpaceContacts
from mbvi.geometry.shapes.shapes import HalfSpace, Hull, PlacedShape, Sphere
from mbvi.system import FreeBodies

ROBOTS = Path(__file__).parents[1] / "robots"
DESCRIPTIONS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
STEP = 1e-3
Build = Callable[[], mbvi.Problem]


def turned_spheres() -> tuple[Build, Build]:
    """Return spheres that bounce on a floor, with their rotations and without."""
    places = [(0.3 * (k % 5), 0.3 * (k // 5), 0.2 + 0.01 * k) for k in range(20)]

    def full() -> mbvi.Problem:
        n, ball = len(places), Sphere(0.1)
        names = tuple(f"sphere {k}" for k in range(n))
        inertias = np.tile(ball.inertia(1.0), (n, 1, 1))
        system = FreeBodies(np.ones(n), inertias, np.array([0.0, 0.0, -9.81]), names)
        shapes = [PlacedShape(name, ball, k + 1, np.eye(3), np.zeros(3)) for k, name in enumerate(names)]
        floor = HalfSpaceContacts(system, [HalfSpace((0.0, 0.0, 1.0), 0.0)] * n, shapes, names, np.full(n, 0.5))
        q0 = np.concatenate([[*place, 0.0, 0.0, 0.0, 1.0] for place in places])
        return mbvi.Problem(system, [floor], q0, np.zeros(6 * n), length=0.1)

    def reduced() -> mbvi.Problem:
        # the spheres are too far apart to touch
        scene = floor()
        for place in places:
            scene.add_sphere(0.1, 1.0, place)
        return scene.build()

    return full, reduced


def floor(**options: str) -> mbvi.Scene:
    """Return a scene with a floor."""
    scene = mbvi.Scene(restitution=0.5, **options)
    scene.add_halfspace((0, 0, 1))
    return scene


def of(scene: mbvi.Scene, reduction: str) -> tuple[Build, Build]:
    """Return a scene without a reduction and with it, all others left off."""
    return lambda: scene.build(()), lambda: scene.build([reduction])


def still_hips(folder: Path) -> tuple[Build, Build]:
    """Return a quadruped whose hips have no range, dropped."""
    text = (ROBOTS / "quadruped/quadruped.urdf").read_text()
    for start in [k for k in range(len(text)) if text.startswith("_hip_joint", k)][::-1]:
        at = text.index("<limit", start)
        end = text.index("/>", at)
        text = text[:at] + '<limit lower="0" upper="0" effort="1" velocity="1"' + text[end:]
    (folder / "quadruped.urdf").write_text(text)
    scene = floor()
    scene.add_urdf(folder / "quadruped.urdf", position=(0, 0, 0.55))
    return of(scene, "joints")


def flailing_quadruped() -> mbvi.Scene:
    """Return a quadruped in the air whose legs swing from limit to limit."""
    scene = floor()
    joints = {f"{leg}_{joint}_joint": 6.0 for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")}
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 3), velocity=joints)
    return scene


def swinging_biped() -> mbvi.Scene:
    """Return a biped that falls over."""
    scene = floor()
    swing = {"left_hip_pitch": 2.0, "right_hip_pitch": -2.0}
    scene.add_urdf(ROBOTS / "biped/biped.urdf", position=(0, 0, 1.2), velocity=swing)
    return scene


def swinging_panda(tolerance: float | None = None) -> mbvi.Scene:
    """Return a Panda that swings freely."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), -0.01)
    swing = {f"panda_joint{k}": 1.0 for k in (1, 3, 5)}
    path = DESCRIPTIONS / "panda_description/urdf/panda.urdf"
    scene.add_urdf(path, base="fixed", velocity=swing, tolerance=tolerance, mimic=False)
    return scene


def blocks(folder: Path) -> mbvi.Scene:
    """Return six blocks that are meshes, falling on each other."""
    hull = Hull(np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.15, 0.15) for z in (-0.05, 0.05)]))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in hull.vertices.tolist()]
    lines += ["f " + " ".join(str(k + 1) for k in triangle) for triangle in hull.triangles.tolist()]
    (folder / "block.obj").write_text("\n".join(lines) + "\n")
    scene = floor()
    for k in range(6):
        scene.add_mesh(folder / "block.obj", position=(0.02 * k, 0.01 * k, 0.1 + 0.15 * k))
    return scene


def stones() -> mbvi.Scene:
    """Return six stones of 400 vertices each, which fewer vertices approximate to a millimetre."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(400, 3))
    points *= np.array([0.1, 0.12, 0.08]) / np.linalg.norm(points, axis=1)[:, None]
    scene = floor()
    places = [(0.02 * k, 0.01 * k, 0.12 + 0.25 * k) for k in range(6)]
    scene.add_convex(points, places, density=2500.0, tolerance=1e-3)
    return scene


def planar_boxes() -> mbvi.Scene:
    """Return twelve boxes that tumble in a plane."""
    scene = floor(plane="xz")
    for k in range(12):
        c, s = np.cos(0.1 * k), np.sin(0.1 * k)
        turn = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        scene.add_box((0.2, 0.2, 0.1), position=(0.5 * k, 0, 0.2 + 0.02 * k), rotation=turn)
    return scene


def planar_tower() -> mbvi.Scene:
    """Return four boxes on each other."""
    scene = floor(plane="xz")
    for k in range(4):
        scene.add_box((0.2, 0.2, 0.1), position=(0.01 * (k % 2), 0, 0.06 + 0.11 * k))
    return scene


def planar_hopper() -> mbvi.Scene:
    """Return a hopper dropped."""
    scene = floor(plane="xz")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.7), joints={"knee": 0.4}, velocity={"hip": 2.0})
    return scene


def planar_discs() -> mbvi.Scene:
    """Return a hundred spheres that fall between walls."""
    scene = floor(plane="xz")
    scene.add_container((-0.5, -1, 0), (0.5, 1))
    places = [(-0.44 + 0.11 * (k % 9) + 0.005 * (k // 9 % 2), 0, 0.06 + 0.11 * (k // 9)) for k in range(100)]
    scene.add_spheres(places, 0.05, 1.0)
    return scene


def resting_tower() -> mbvi.Scene:
    """Return four boxes that rest on each other."""
    scene = floor()
    for k in range(4):
        scene.add_box((0.2, 0.2, 0.1), position=(0.01 * (k % 2), 0, 0.05 + 0.1 * k))
    return scene


def resting_field() -> mbvi.Scene:
    """Return six towers of two boxes at rest, one of which a ball hits half way through the run."""
    scene = floor()
    for k in range(12):
        scene.add_box((0.2, 0.2, 0.1), position=(0.5 * (k // 2), 0.02 * (k % 2), 0.05 + 0.1 * (k % 2)))
    scene.add_sphere(0.05, 1.0, (0.5, 0, 1.0), (0, 0, -1.75))
    return scene


def cases(folder: Path) -> dict[str, tuple[Build, Build]]:
    """Return the full and the reduced model of each case."""
    return {
        "rotations: 20 spheres on a floor": turned_spheres(),
        "joints: quadruped, four hips without range": still_hips(folder),
        "pairs: quadruped, legs flailing": of(flailing_quadruped(), "pairs"),
        "pairs: biped falling": of(swinging_biped(), "pairs"),
        "pairs: Panda swinging": of(swinging_panda(), "pairs"),
        "shapes: six meshes that are boxes": of(blocks(folder), "shapes"),
        "shapes: six stones, tolerance 1 mm": of(stones(), "shapes"),
        "shapes: Panda, tolerance 1 mm": of(swinging_panda(1e-3), "shapes"),
        "plane: 12 boxes tumbling": of(planar_boxes(), "plane"),
        "plane: four boxes on each other": of(planar_tower(), "plane"),
        "plane: hopper": of(planar_hopper(), "plane"),
        "plane: 100 spheres between walls": of(planar_discs(), "plane"),
        "rest: tower of four boxes": of(resting_tower(), "rest"),
        "rest: six towers of two, a ball hits one": of(resting_field(), "rest"),
        "rest: 12 boxes that never rest": of(planar_boxes(), "rest"),
    }


def measured(build: tuple[Build, Build], count: int, repeats: int) -> str:
    """Return a line of the table: degrees of freedom, constraints, times of a step and of `build`."""
    built = np.empty((repeats, 2))
    took = np.empty((repeats, 2))
    for k in range(repeats):
        for side in (0, 1):
            begin = process_time()
            problem = build[side]()
            built[k, side] = 1e3 * (process_time() - begin)
            begin = process_time()
            mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=count * STEP, progress=False)
            took[k, side] = 1e6 * (process_time() - begin) / count
    sizes = [(p.system.nv, len(p.constraints)) for p in (build[0](), build[1]())]
    dofs, rows = (f"{a} -> {b}" if a != b else f"{a}" for a, b in zip(*sizes, strict=True))
    before, after = np.median(took, axis=0)
    ratio = np.median(took[:, 0] / took[:, 1])
    first, then = np.median(built, axis=0)
    return f"{dofs} | {rows} | {before:.0f} | {after:.0f} | {ratio:.2f} | {first:.0f} -> {then:.0f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Time a step with each reduction off and on.")
    parser.add_argument("--steps", type=int, default=500, help="steps per run")
    parser.add_argument("--repeats", type=int, default=15, help="alternating runs of each model")
    arguments = parser.parse_args()
    compile_all()
    # loaders of some descriptions warn about what they leave out
    warnings.simplefilter("ignore")
    head = ("reduction: case", "dofs", "constraints", "off [us per step]", "on [us per step]", "off / on")
    print(f"| {' | '.join(head)} | build, off -> on [ms] |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, build in cases(Path(folder)).items():
            print(f"| {name} | {measured(build, arguments.steps, arguments.repeats)} |", flush=True)


if __name__ == "__main__":
    main()
