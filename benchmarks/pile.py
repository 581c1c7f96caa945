"""Spheres and boxes poured into a box, beside MuJoCo: time, residual and penetration by number; an elastic gas.

python benchmarks/pile.py [--spheres 216 1000] [--boxes 200] [--depths 1e-2 1e-3] [--residuals 1e-5] [--step 2e-3]
    [--duration 1.5] [--meshes 20000 1000000] [--no-gas] [--no-peer]

The piles are those of `mbvi chart piles` (mbvi_studies/chart/piles.py); e = 0, no friction. Times are CPU times of the
process: whole steps of `mbvi.simulate` with all it records, and the steps of MuJoCo alone. Depths are relative to the
radius of spheres and the edge of boxes. MuJoCo runs with contacts as delivered and as stiff as its step permits.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

import mbvi
from mbvi_studies.chart.pile_runs import Cost, run_ours, run_peer
from mbvi_studies.chart.piles import Pile, boxes, spheres
from mbvi_studies.spheres import cube_of_spheres


def rows(pile: Pile, asked: argparse.Namespace) -> Iterator[tuple[str, Cost]]:
    """Yield name and cost of each setting on a pile, those of MuJoCo first."""
    if not asked.no_peer:
        from mbvi_studies.engines.piles_in_mujoco import variants

        for variant in variants(pile):
            yield variant.line, run_peer(pile, variant, asked.step)
    for depth in asked.depths:
        yield f"StewartTrinkle, depth {depth:g}", run_ours(pile, asked.step, depth=depth)
    for residual in asked.residuals:
        yield f"StewartTrinkle, residual {residual:g}", run_ours(pile, asked.step, residual=residual)


def gas(duration: float = 10.0) -> tuple[float, float, int]:
    """Run 216 elastic spheres in a box; return the relative drift of energy, microseconds per step, and impacts."""
    problem = cube_of_spheres(1.0)
    start = time.thread_time()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=duration, progress=False)
    spent = time.thread_time() - start
    energy = run.energy()
    return float(np.abs(energy / energy[0] - 1.0).max()), 1e6 * spent / (len(run.t) - 1), len(run.impacts)


def on_mesh(triangles: int, duration: float = 0.6) -> tuple[int, float, float]:
    """Drop a sphere on a terrain; return its triangles, seconds to prepare the mesh, and microseconds per step."""
    x = np.linspace(-5.0, 5.0, round((triangles / 2) ** 0.5) + 1)
    mesh = mbvi.surfaces.terrain(x, x, 0.1 * np.sin(2.0 * x)[:, None] * np.cos(3.0 * x))
    scene = mbvi.Scene(restitution=0.5)
    start = time.thread_time()
    scene.add_surface(*mesh)
    prepared = time.thread_time() - start
    scene.add_sphere(0.05, position=(0.3, 0.2, 0.6))
    problem, step = scene.build(), 1e-3
    for length in (0.4, duration):
        # the first run loads the kernels
        start = time.thread_time()
        mbvi.simulate(problem, step=step, duration=length, progress=False)
    return len(mesh[1]), prepared, 1e6 * (time.thread_time() - start) / (duration / step)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--spheres", type=int, nargs="*", default=[216, 1000])
    parser.add_argument("--boxes", type=int, nargs="*", default=[200])
    parser.add_argument("--depths", type=float, nargs="*", default=[1e-2, 1e-3])
    parser.add_argument("--residuals", type=float, nargs="*", default=[])
    parser.add_argument("--step", type=float, default=2e-3)
    parser.add_argument("--duration", type=float, help="by default 1 s for spheres, 0.6 s for boxes")
    parser.add_argument("--meshes", type=int, nargs="*", default=[], help="a sphere on a mesh of so many triangles")
    parser.add_argument("--no-gas", action="store_true")
    parser.add_argument("--no-peer", action="store_true")
    asked = parser.parse_args()
    print("| pile | setting | residual reached | ms per step | over the first | worst depth | depth at the end |")
    print("|---|---|---|---|---|---|---|")
    makers: list[tuple[Callable[[int], Pile], list[int]]] = [(spheres, asked.spheres), (boxes, asked.boxes)]
    for pile in (make(count) for make, counts in makers for count in counts):
        if asked.duration is not None:
            pile = replace(pile, duration=asked.duration)
        first = None
        for name, cost in rows(pile, asked):
            each = 1e3 * cost.cpu * asked.step
            first = first or each
            print(
                f"| {pile.name} | {name} | {cost.residual:.1e} | {each:.2f} | {each / first:.2f} "
                f"| {cost.depth:.1e} {pile.unit[0]} | {cost.end:.1e} |",
                flush=True,
            )
    print(f"\nlargest memory of the process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
    for number in asked.meshes:
        count, prepared, each = on_mesh(number)
        print(f"a sphere on {count} triangles: mesh prepared in {prepared:.2f} s, {each:.0f} us per step", flush=True)
    if not asked.no_gas:
        drift, spent, impacts = gas()
        print(f"elastic gas of 216: energy drift {drift:.1e}, {spent:.0f} us per step, {impacts} impacts")


if __name__ == "__main__":
    main()
