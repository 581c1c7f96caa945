"""A four-bar linkage of three rods and four hinges falls, and its coupler strikes a floor: a closed loop with impacts.

`python examples/four_bar.py linkage.html` writes the replay too.
"""

import sys

import numpy as np

import mbvi

CRANK, COUPLER, ROCKER, GROUND, WIDTH = 0.4, 0.9, 0.7, 1.0, 0.04
# angle of the crank at the start [rad], and height of the floor [m]
START, FLOOR = 1.0, -0.3


def pins() -> list[np.ndarray]:
    """Return where the four hinges are, with the coupler above the line between the outer ones."""
    first, last = CRANK * np.array([np.cos(START), 0.0, np.sin(START)]), np.array([GROUND, 0.0, 0.0])
    apart = np.linalg.norm(last - first)
    along = (last - first) / apart
    part = (apart**2 + COUPLER**2 - ROCKER**2) / (2.0 * apart)
    above = np.array([-along[2], 0.0, along[0]])
    return [np.zeros(3), first, first + part * along + np.sqrt(COUPLER**2 - part**2) * above, last]


def scene() -> mbvi.Scene:
    """Return the linkage at rest above the floor."""
    made, places = mbvi.Scene(restitution=0.5), pins()
    made.add_halfspace((0, 0, 1), FLOOR, name="floor")
    names = ["world", "crank", "coupler", "rocker", "world"]
    for name, mass, begin, end in zip(names[1:4], (1.0, 2.0, 1.5), places, places[1:], strict=False):
        x = (end - begin) / np.linalg.norm(end - begin)
        axes = np.column_stack([x, (0, 1, 0), np.cross(x, (0, 1, 0))])
        size = (np.linalg.norm(end - begin), WIDTH, WIDTH)
        made.add_box(size, mass, position=0.5 * (begin + end), rotation=axes, name=name)
    for before, after, place in zip(names, names[1:], places, strict=False):
        made.hinge(before, after, at=place, axis=(0, 1, 0))
    return made


def main(page: str | None = None) -> float:
    """Return the time of the first impact [s]."""
    run = mbvi.simulate(scene().build(), mbvi.EventDriven(1e-9), duration=1.2, progress=False)
    print(f"{len(run.impacts)} impacts, the loop never more than {run.loop_gap().max():.0e} m open")
    if page:
        run.replay_html(page)
    return run.impacts[0].time


if __name__ == "__main__":
    print(f"the linkage strikes the floor first at {main(*sys.argv[1:]):.9f} s")
