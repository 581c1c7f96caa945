"""A turning drum of twelve plates and four vanes tumbles boxes: its work becomes energy of the boxes, or is lost.

`python examples/box_drum.py drum.html 60` runs it with 60 boxes and writes the replay too. The drum is made of fixed
boxes, which have a thickness.
"""

import sys
from itertools import islice

import numpy as np
from scipy.spatial.transform import Rotation

import mbvi

RADIUS, LENGTH, THICK, SIDES = 0.2, 0.16, 0.02, 12
EDGE, STEP = 0.03, 1e-3


def filled_drum(count: int) -> mbvi.Problem:
    """Return a drum and so many boxes in it."""
    scene = mbvi.Scene()
    turning = mbvi.motion.Rotation(axis=(0, 1, 0), rate=3.0)
    width = 2.0 * (RADIUS + THICK) * np.tan(np.pi / SIDES)
    for k in range(SIDES):
        turn = Rotation.from_euler("y", 2.0 * np.pi * k / SIDES)
        plate = turn.apply([0.0, 0.0, RADIUS + 0.5 * THICK])
        scene.add_box((width, LENGTH, THICK), position=plate, rotation=turn.as_matrix(), motion=turning)
        if k % 3 == 0:
            vane = turn.apply([0.0, 0.0, RADIUS - 0.04])
            scene.add_box((0.01, LENGTH, 0.08), position=vane, rotation=turn.as_matrix(), motion=turning)
    for side in (1.0, -1.0):
        scene.add_halfspace((0, side, 0), -0.5 * LENGTH)
    places = 0.054 * (np.indices((4, 3, 5)).reshape(3, -1).T[:count] - [1.5, 1.0, 2.0])
    turns = Rotation.random(len(places), random_state=1).as_matrix()
    scene.add_boxes(places, (EDGE, EDGE, EDGE), density=800.0, rotations=turns)
    return scene.build()


def main(page: str | None = None, count: int = 20, duration: float = 0.8) -> float:
    """Return (gain of the boxes + losses) / work of the drum, which is 1 to the order of the step."""
    problem = filled_drum(count)
    work = lost = 0.0
    end = None
    for step in islice(mbvi.steps(problem, mbvi.StewartTrinkle(), step=STEP), round(duration / STEP)):
        end = step
        if step.percussion.any():
            # the wall moves along the normal at -df/dt, so its work is minus the percussion times df/dt
            moving = 0.0 if step.active.rate is None else step.active.rate
            work -= float((step.percussion * moving).sum())
            lost -= 0.5 * float(step.percussion @ (step.before + step.after))
    gain = energy(problem, end.q, end.v) - energy(problem, problem.q0, problem.v0)
    print(f"the work of the drum is {work:.3f} J, impacts lose {lost:.3f} J, the boxes gain {gain:.3f} J")
    if page:
        mbvi.simulate(problem, mbvi.StewartTrinkle(), step=STEP, duration=duration, every=10).replay_html(page)
    return (gain + lost) / work


def energy(problem: mbvi.Problem, q: np.ndarray, v: np.ndarray) -> float:
    """Return the energy in the middle of the motion along v, where position and velocity belong together [J]."""
    system = problem.system
    return system.kinetic_energy(q, v) + system.potential_energy(0.0, system.integrate(q, 0.5 * STEP * v))


if __name__ == "__main__":
    print(f"gain and losses are {main(*sys.argv[1:2], *map(int, sys.argv[2:3])):.4f} of the work")
