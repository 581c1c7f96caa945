"""A turning drum with vanes: its work equals the energy that grains gain plus the energy that impacts lose.

The vanes lift the grains; without friction a smooth drum would not move them. `python examples/drum.py drum.html`
writes the replay too.
"""

import sys
from itertools import islice

import numpy as np

import mbvi
from mbvi import packing, surfaces

STEP, STEPS = 1e-3, 1500


def filled_drum() -> mbvi.Problem:
    """Return a drum of six vanes and 70 grains."""
    scene = mbvi.Scene(restitution=0.2)
    turning = mbvi.motion.Rotation(axis=(0, 1, 0), rate=3.0)
    scene.add_surface(*surfaces.drum(radius=0.2, length=0.12, vanes=6, depth=0.07), name="drum", motion=turning)
    grains = packing.random_loose(
        (-0.1, -0.06, -0.1), (0.1, 0.06, 0.1), packing.uniform(0.008, 0.012), count=70, seed=4
    )
    scene.add_spheres(*grains, density=2500.0, name="grains")
    return scene.build()


def main(page: str | None = None) -> float:
    """Return (gain of the grains + losses) / work of the drum, which is 1."""
    problem = filled_drum()
    work = lost = 0.0
    highest, end = -np.inf, None
    for step in islice(mbvi.steps(problem, mbvi.Paoli(), step=STEP), STEPS):
        end = step
        if step.percussion.any():
            # the wall moves along the normal at -df/dt, so its work is minus the percussion times df/dt
            moving = 0.0 if step.active.rate is None else step.active.rate
            work -= float((step.percussion * moving).sum())
            lost -= 0.5 * float(step.percussion @ (step.before + step.after))
        highest = max(highest, step.q[2::3].max())
    gain = energy(problem, end.q, end.v) - energy(problem, problem.q0, problem.v0)
    print(f"the work of the drum is {work:.3f} J, impacts lose {lost:.3f} J, the grains gain {gain:.3f} J")
    print(f"the highest grain rose to {highest:.3f} m above the axis")
    if page:
        mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=STEP * STEPS).replay_html(page)
    return (gain + lost) / work


def energy(problem: mbvi.Problem, q: np.ndarray, v: np.ndarray) -> float:
    """Return the energy in the middle of the motion along v, where position and velocity belong together [J]."""
    system = problem.system
    return system.kinetic_energy(q, v) + system.potential_energy(0.0, system.integrate(q, 0.5 * STEP * v))


if __name__ == "__main__":
    print(f"gain and losses are {main(*sys.argv[1:]):.12f} of the work")
