"""The default scheme: its choice, cost and error, and the measurements behind the rule.

Prints four Markdown tables; with --piles only the last.

1. Balls falling into a funnel: CPU time per simulated second of EventDriven and of steps of 1e-3 s.
2. Problems with exact solutions: the default scheme, its CPU time per simulated second and its largest error of q, and
   the same for fixed steps from the problem's time scales.
3. Typical scenes: the choice, its reason, CPU time per simulated second, and the deepest penetration.
4. Cubes of balls that fall on a floor, at several e, by the schemes that the rule chooses from: CPU time per simulated
   second, deepest penetration, that at the end, and at e = 1 the change of the energy.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from time import process_time

import numpy as np

import mbvi
from mbvi import reference
from mbvi.compiled import compile_all
from mbvi.run.default_scheme import time_step

ROBOTS = Path(__file__).parents[1] / "robots"
COUNTS = (1, 2, 5, 10, 12, 15)
TIMES = 301
REPEATS = 3
# piles: numbers of balls, restitutions, time step and simulated time [s]
NUMBERS, RESTITUTIONS, PILE_STEP, PILE_TIME = (8, 64, 216, 1000), (0.0, 0.2, 0.5, 0.8, 1.0), 2e-3, 1.5
RADIUS = 0.1


def funnel(count: int, e: float = 0.5) -> mbvi.Problem:
    """Return balls above four slanted walls and a floor."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    side = int(np.ceil(count ** (1 / 3) - 1e-9))
    for normal in ((1, 0, 0.1), (-1, 0, 0.1), (0, 1, 0.1), (0, -1, 0.1)):
        scene.add_halfspace(normal, -1.5 * RADIUS * side)
    centres = np.indices((side, side, side)).reshape(3, -1).T[:, [1, 2, 0]] - [(side - 1) / 2, (side - 1) / 2, 0]
    jitter = np.random.default_rng(0).uniform(-0.2, 0.2, (count, 3))
    scene.add_spheres(RADIUS * (2.5 * centres[:count] + jitter + [0, 0, 4]), radius=RADIUS, mass=1.0)
    return scene.build()


def bodies(count: int) -> mbvi.Problem:
    """Return tumbling boxes side by side over a floor."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    rng = np.random.default_rng(1)
    for k in range(count):
        spin = rng.uniform(-2, 2, 3)
        scene.add_box((0.2, 0.3, 0.15), position=(0.25 * k, 0, 0.6), angular_velocity=spin)
    return scene.build()


def robot(name: str, base: str, height: float, control: Callable[..., np.ndarray] | None = None) -> mbvi.Problem:
    """Return a robot over a floor."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(ROBOTS / f"{name}/{name}.urdf", base=base, position=(0, 0, height), control=control)
    return scene.build()


def springs() -> mbvi.Problem:
    """Return five masses on a line, stiff springs between them, over a stop."""
    k = 1e5 * (2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1))
    k[0, 0] = k[4, 4] = 1e5
    system = mbvi.LagrangianSystem(lambda q: np.eye(5), lambda t, q, v: -9.81 - k @ q, 5, lambda q: q @ k @ q / 2)
    stop = mbvi.GapFunction(lambda q: q[0] + 1.0, lambda q: np.eye(5)[0])
    return mbvi.Problem(system, [stop], np.zeros(5), np.zeros(5), restitution=0.5)


def scenes() -> Iterator[tuple[str, mbvi.Problem, float]]:
    """Yield typical scenes: name, problem, simulated time [s]."""
    yield "a ball", funnel(1), 1.0
    yield "a box", bodies(1), 1.0
    yield "five masses on stiff springs", springs(), 1.0
    yield "ten boxes", bodies(10), 1.0
    yield "ten balls", funnel(10), 1.0
    yield "500 balls, e = 0", funnel(500, 0.0), 1.0
    yield "double pendulum, URDF", robot("double_pendulum", "fixed", 1.0), 1.0
    yield "hopper", robot("hopper", "free", 1.0), 1.0
    yield "quadruped", robot("quadruped", "free", 0.6), 1.0
    yield "biped", robot("biped", "free", 1.2), 1.0
    yield "arm", robot("arm", "fixed", 0.0), 1.0


def seconds(problem: mbvi.Problem, duration: float, scheme: object, **more: float) -> tuple[float, mbvi.Trajectory]:
    """Return the CPU time of a simulated second [ms], the median of some runs, and the last run."""
    times = []
    for _ in range(REPEATS):
        begin = process_time()
        run = mbvi.simulate(problem, scheme, duration=duration, progress=False, **more)
        times.append(1e3 * (process_time() - begin) / duration)
        if times[0] * duration > 1e3:
            break
    return float(np.median(times)), run


def pile(count: int, e: float) -> mbvi.Problem:
    """Return a cube of balls that is disturbed by a hundredth of a radius, 1 m over a floor."""
    side = round(count ** (1 / 3))
    grid = np.indices((side, side, side)).reshape(3, -1).T
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    centres = 0.21 * grid + 1e-3 * np.random.default_rng(42).random(grid.shape)
    scene.add_spheres(centres + np.array([0.0, 0.0, 1.0 + RADIUS]), radius=RADIUS, mass=10.0)
    return scene.build()


def print_piles() -> None:
    """Print the table of piles."""
    print("\n| e | balls | scheme | [ms/s] | deepest [radii] | at the end [radii] | change of energy |")
    print("|---|---|---|---|---|---|---|")
    schemes = {"Centered": mbvi.Centered(), "Centered, projected": mbvi.Centered(project_positions=True)}
    for e in RESTITUTIONS:
        for count in NUMBERS:
            problem, own = pile(count, e), schemes | {"StewartTrinkle": mbvi.StewartTrinkle()}
            for name, scheme in own.items():
                mbvi.simulate(problem, scheme, duration=2 * PILE_STEP, step=PILE_STEP, progress=False)
                begin = process_time()
                run = mbvi.simulate(problem, scheme, duration=PILE_TIME, step=PILE_STEP, progress=False)
                time, depth = 1e3 * (process_time() - begin) / PILE_TIME, run.penetration() / RADIUS
                energy = run.energy()
                change = f"{np.abs(energy / energy[0] - 1.0).max():.0e}" if e == 1.0 else "-"
                print(
                    f"| {e:g} | {count} | {name} | {time:.0f} | {depth.max():.0e} | {depth[-1]:.0e} | {change} |",
                    flush=True,
                )


def error(case: reference.Reference, run: mbvi.Trajectory) -> float:
    """Return the largest error of q at some instants."""
    difference, instants = case.problem.system.difference, np.linspace(0, case.duration, TIMES)
    return max(float(np.abs(difference(case.at(t)[0], run.at(t)[0])).max()) for t in instants)


def chosen(run: mbvi.Trajectory) -> str:
    """Return the choice and its reason from the notes of a run."""
    return run.notes[0].replace(" was chosen", "").replace(" | ", " and ")


def main() -> None:
    """Print the tables."""
    warnings.simplefilter("ignore", mbvi.MbviWarning)
    if "--piles" in sys.argv:
        print_piles()
        return
    compile_all()
    print("| balls | constraints | EventDriven(1e-6) [ms/s] | impacts | Centered, h = 1e-3 s [ms/s] |")
    print("|---|---|---|---|---|")
    for count in COUNTS:
        problem = funnel(count)
        located, run = seconds(problem, 2.0, mbvi.EventDriven(1e-6))
        stepped, _ = seconds(problem, 2.0, mbvi.Centered(project_positions=True), step=1e-3)
        rows = 5 * count + count * (count - 1) // 2
        print(f"| {count} | {rows} | {located:.0f} | {len(run.impacts)} | {stepped:.0f} |", flush=True)
    head = ("problem", "default", "default [ms/s]", "default, error of q", "h of Centered [s]", "Centered [ms/s]")
    print(f"\n| {' | '.join(head)} | Centered, error of q |")
    print("|---|---|---|---|---|---|---|")
    for case in reference.references(0.5):
        time, run = seconds(case.problem, case.duration, None)
        h, _ = time_step(case.problem, case.duration)
        slow, steps = seconds(case.problem, case.duration, mbvi.Centered(project_positions=True), step=h)
        cells = f"{run.scheme} | {time:.1f} | {error(case, run):.0e} | {h:g} | {slow:.1f} | {error(case, steps):.0e}"
        print(f"| {case.name} | {cells} |", flush=True)
    print("\n| scene | choice and reason | [ms/s] | deepest penetration [m] |")
    print("|---|---|---|---|")
    for name, problem, duration in scenes():
        time, run = seconds(problem, duration, None)
        print(f"| {name} | {chosen(run)} | {time:.0f} | {run.penetration().max():.1e} |", flush=True)
    print_piles()


if __name__ == "__main__":
    main()
