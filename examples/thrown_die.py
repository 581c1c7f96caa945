"""Throws of a die whose start, restitution and friction are random: how often each face is up.

`python examples/thrown_die.py 4096 die.png` makes 4096 throws on all cores and draws them.
Called again, it makes the runs that are missing.
"""

import sys

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest, qmc

import mbvi

EDGE = 0.02
# the faces in the directions x, y, z and against them; opposite faces add up to seven
FACES = np.array([[1, 2, 3], [6, 5, 4]])


def make(e: float, mu: float, rng: np.random.Generator) -> mbvi.Scene:
    """Return a die in the air, turned and thrown at random."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="table")
    scene.add_box(
        (EDGE, EDGE, EDGE), mass=0.01, position=(0, 0, 0.1), rotation=Rotation.random(rng=rng).as_matrix(),
        velocity=(*rng.normal(0.0, 0.3, 2), -0.5), angular_velocity=rng.normal(0.0, 20.0, 3), name="die",
    )  # fmt: skip
    return scene


def measure(run: mbvi.Trajectory) -> dict[str, float]:
    """Return the face that is up, how far it is from level, how far the die went, and its impacts."""
    up = Rotation.from_quat(run.q[-1, 3:]).as_matrix()[2]
    axis = int(np.argmax(np.abs(up)))
    return {
        "face": int(FACES[int(up[axis] < 0.0), axis]),
        "tilt": float(np.degrees(np.arccos(min(abs(up[axis]), 1.0)))),
        "distance": float(np.hypot(*run.q[-1, :2])),
        "impacts": len(run.impacts),
    }


def main(count: int = 8, picture: str | None = None) -> float:
    """Return the largest distance of a face's frequency from 1/6, in standard deviations."""
    # e and mu fill their rectangle evenly
    samples = qmc.scale(qmc.Sobol(2, rng=1).random(count), [0.1, 0.1], [0.7, 0.6])
    ds = mbvi.sweep(
        make, samples, measure=measure, out=f"thrown_die_{count}", scheme=mbvi.Paoli(), step=1e-3, duration=1.2,
        every=1000,
    )  # fmt: skip
    settled = ds["tilt"] < 5.0
    faces = ds["face"].values[settled]
    for face in range(1, 7):
        test = binomtest(int((faces == face).sum()), len(faces))
        low, high = test.proportion_ci(0.95, method="wilson")
        print(f"face {face}: {test.statistic:.3f} of the throws, 95 % within {low:.3f} to {high:.3f}")
    print(f"{len(faces)} of {count} throws lie flat")
    if picture:
        mbvi.plot_sweep(ds, ["face", "distance", "impacts"]).savefig(picture, dpi=110)
    found = np.bincount(faces, minlength=7)[1:] / len(faces)
    return float(np.abs(found - 1 / 6).max() / np.sqrt(5 / 36 / len(faces)))


if __name__ == "__main__":
    print(f"the largest distance from 1/6 is {main(*map(int, sys.argv[1:2]), *sys.argv[2:]):.1f} standard deviations")
