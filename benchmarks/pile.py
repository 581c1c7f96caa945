"""Spheres poured into a box, beside MuJoCo: time, residual and penetration by number; boxes; an elastic gas.

python benchmarks/pile.py [--sizes 216 1000] [--duration 1.5] [--residuals 1e-5 1e-8] [--boxes 100]
    [--no-gas] [--no-peer]

The pile: spheres of 0.02 m and 1 kg on a lattice of spacing 0.044 m with a jitter of 1e-3 m, the lowest 0.1 m above the
floor of an open box as wide as the lattice; e = 0, no friction, h = 2e-3 s. Times are of the thread, whole steps of
`mbvi.simulate` with all it records. Penetration is that of the configurations, in radii, at every step.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.studies.shipped import cube_of_spheres

RADIUS, STEP = 0.02, 2e-3


def lattice(count: int) -> tuple[np.ndarray, float]:
    """Return centres, shape (count, 3), and the width of the box [m]."""
    n = int(np.ceil(count ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    grid = grid[np.argsort(grid[:, 2], kind="stable")][:count]
    spacing = 2.2 * RADIUS
    centres = spacing * (grid + 0.5) + 1e-3 * (2.0 * np.random.default_rng(0).random((count, 3)) - 1.0)
    centres[:, 2] += 0.1
    return centres, n * spacing


def depth(centres: np.ndarray, width: float) -> float:
    """Return the deepest penetration of spheres in their box, in radii."""
    near = cKDTree(centres).query_pairs(2.0 * RADIUS, output_type="ndarray")
    apart = np.linalg.norm(centres[near[:, 0]] - centres[near[:, 1]], axis=1)
    gaps = [
        apart.min(initial=2.0 * RADIUS) - 2.0 * RADIUS,
        centres.min() - RADIUS,
        width - RADIUS - centres[:, :2].max(),
    ]
    return max(0.0, -float(min(gaps))) / RADIUS


def ours(count: int, residual: float, duration: float) -> dict[str, float]:
    """Run the pile; return milliseconds per step, penetration in radii, and the residual reached."""
    centres, width = lattice(count)
    scene = mbvi.Scene()
    scene.add_container((0, 0, 0), (width, width))
    scene.add_spheres(centres, RADIUS, 1.0, name="grain")
    problem = scene.build()
    start = time.thread_time()
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=STEP, duration=duration, residual=residual, progress=False)
    spent = time.thread_time() - start
    worst = max(depth(q.reshape(-1, 3), width) for q in run.q)
    return {
        "ms": 1e3 * spent / (len(run.t) - 1),
        "depth": worst,
        "end": depth(run.q[-1].reshape(-1, 3), width),
        "residual": float(run.residual.max()),
    }


def mujoco_cg(count: int, duration: float) -> dict[str, float]:
    """Run the same pile in MuJoCo: three slide joints per sphere, no friction, CG solver with default options."""
    import mujoco

    from mbvi.studies.engines.spheres_in_mujoco import spheres_in_box

    centres, width = lattice(count)
    model = spheres_in_box(centres, RADIUS, width, STEP)
    data, spent, worst = mujoco.MjData(model), 0.0, 0.0
    steps = round(duration / STEP)
    for _ in range(steps):
        start = time.thread_time()
        mujoco.mj_step(model, data)
        spent += time.thread_time() - start
        worst = max(worst, depth(centres + data.qpos.reshape(-1, 3), width))
    end = depth(centres + data.qpos.reshape(-1, 3), width)
    return {"ms": 1e3 * spent / steps, "depth": worst, "end": end, "residual": float("nan")}


def gas(duration: float = 10.0) -> tuple[float, float, int]:
    """Run 216 elastic spheres in a box; return the relative drift of energy, microseconds per step, and impacts."""
    problem = cube_of_spheres(1.0)
    start = time.thread_time()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=duration, progress=False)
    spent = time.thread_time() - start
    energy = run.energy()
    return float(np.abs(energy / energy[0] - 1.0).max()), 1e6 * spent / (len(run.t) - 1), len(run.impacts)


def boxes(count: int, duration: float = 1.0) -> tuple[float, float, float]:
    """Pour boxes of 4 cm in random poses into a box; return milliseconds per step, worst and median depth [m]."""
    scene = mbvi.Scene()
    scene.add_container((-0.2, -0.2, 0.0), (0.2, 0.2))
    layer, row, column = np.unravel_index(np.arange(count), (-(-count // 25), 5, 5))
    places = 0.075 * np.stack([row - 2, column - 2, layer], axis=1) + [0.0, 0.0, 0.05]
    turns = Rotation.random(count, random_state=0).as_matrix()
    scene.add_boxes(places, (0.04, 0.04, 0.04), 1.0, rotations=turns)
    problem = scene.build()
    spent, depths, walk = 0.0, [], mbvi.steps(problem, step=STEP)
    for _ in range(round(duration / STEP)):
        start = time.thread_time()
        step = next(walk)
        spent += time.thread_time() - start
        depths.append(max(0.0, -float(problem.constraints.active(step.t, step.q, 0.0).gap.min(initial=0.0))))
    return 1e3 * spent / len(depths), max(depths), float(np.median(depths))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", type=int, nargs="*", default=[216, 1000, 3375])
    parser.add_argument("--duration", type=float, default=1.5)
    parser.add_argument("--residuals", type=float, nargs="*", default=[1e-5, 1e-8])
    parser.add_argument("--boxes", type=int, nargs="*", default=[100])
    parser.add_argument("--no-gas", action="store_true")
    parser.add_argument("--no-peer", action="store_true")
    asked = parser.parse_args()
    ours(27, 1e-5, 0.02)
    print(
        "| spheres | solver | residual reached | ms a step | over MuJoCo's | worst depth [radii] | depth at the end |"
    )
    print("|---|---|---|---|---|---|---|")
    for count in asked.sizes:
        peer = None if asked.no_peer else mujoco_cg(count, asked.duration)
        rows = [] if peer is None else [("MuJoCo CG", peer)]
        rows += [(f"StewartTrinkle, {r:g}", ours(count, r, asked.duration)) for r in asked.residuals]
        for name, row in rows:
            over = "not run" if peer is None else f"{row['ms'] / peer['ms']:.2f}"
            print(
                f"| {count} | {name} | {row['residual']:.1e} | {row['ms']:.2f} | {over} "
                f"| {row['depth']:.1e} | {row['end']:.1e} |",
                flush=True,
            )
    for count in asked.boxes:
        spent, worst, median = boxes(count)
        print(
            f"\n{count} tumbling boxes: {spent:.1f} ms a step, {worst:.1e} m deep at worst, {median:.1e} in the median"
        )
    print(f"\nlargest memory of the process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
    if not asked.no_gas:
        drift, spent, impacts = gas()
        print(f"elastic gas of 216: energy drift {drift:.1e}, {spent:.0f} us per step, {impacts} impacts")


if __name__ == "__main__":
    main()
