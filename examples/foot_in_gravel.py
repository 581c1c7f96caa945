"""A one-legged hopper with springs in its joints lands in a box of gravel.

`python examples/foot_in_gravel.py foot.html` writes the replay too.
"""

import sys
from pathlib import Path

import numpy as np

import mbvi
from mbvi import packing

robots = Path(__file__).parents[1] / "robots"
CROUCH = np.array([-0.5, 1.0])


def hold(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return torques of springs at hip and knee; the first six entries belong to the free base and are zero."""
    torque = np.zeros(8)
    torque[6:] = 60.0 * (CROUCH - q[7:]) - 1.5 * v[6:]
    return torque


def main(page: str | None = None) -> float:
    """Return the speed at which the foot strikes its first stone [m/s]."""
    scene = mbvi.Scene(restitution=0.1)
    scene.add_container((-0.2, -0.2, 0.0), (0.2, 0.2), name="box")
    bed = packing.lattice((5, 5, 3), 0.036, spacing=0.076, corner=(-0.152, -0.152, 0.04), jitter=1.5e-3, seed=1)
    scene.add_spheres(*bed, density=2500.0, name="gravel")
    joints = {"hip": CROUCH[0], "knee": CROUCH[1]}
    scene.add_urdf(robots / "hopper/hopper.urdf", position=(0, 0.01, 0.85), joints=joints, control=hold)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=5e-4, duration=0.5, every=2)
    first = next(i for i in run.impacts if any("foot" in name for name in i.constraints))
    row = next(k for k, name in enumerate(first.constraints) if "foot" in name)
    print(f"{first.constraints[row]} at {first.time:.3f} s; {len(run.impacts)} impacts in all")
    print(f"the trunk sinks to {run.q[:, 2].min():.3f} m; deepest penetration {run.penetration().max():.1e} m")
    if page:
        run.replay_html(page)
    return -float(first.before[row])


if __name__ == "__main__":
    print(f"the foot strikes its first stone at {main(*sys.argv[1:]):.4f} m/s")
