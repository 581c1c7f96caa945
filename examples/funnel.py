"""A thousand grains run through a funnel that is read from an STL file into a bucket.

`python examples/funnel.py funnel.html` writes the replay too.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import mbvi
from mbvi import packing, surfaces

GRAINS, NECK, DURATION = 1000, 0.06, 2.0


def write_stl(file: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Write a binary STL, as a CAD program would."""
    facets = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = vertices[triangles]
    file.write_bytes(bytes(80) + np.uint32(len(facets)).tobytes() + facets.tobytes())


def main(page: str | None = None) -> float:
    """Return the number of grains, of 1000, in the bucket at the end."""
    scene = mbvi.Scene()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "funnel.stl")
        write_stl(file, *surfaces.funnel(top=0.3, neck=NECK, height=0.25, pipe=0.05, segments=64))
        scene.add_mesh(file, convex=False, name="funnel")
    scene.add_surface(*surfaces.revolved([(0, -0.5), (0.2, -0.5), (0.25, -0.15)]), name="bucket")
    grains = packing.layers((-0.12, -0.12, 0.15), (0.12, 0.12), packing.uniform(0.008, 0.011), count=GRAINS, seed=4)
    scene.add_spheres(*grains, density=2500.0, name="grains")
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=2e-3, duration=DURATION, every=10)
    heights = run.q.reshape(len(run.t), -1, 3)[:, :, 2]
    passed = (heights < -0.05).sum(axis=1)
    print(f"half of the grains have passed after {run.t[np.argmax(passed >= GRAINS // 2)]:.2f} s")
    if page:
        run.replay_html(page)
    return float((heights[-1] < -0.15).sum())


if __name__ == "__main__":
    print(f"{main(*sys.argv[1:]):.0f} of {GRAINS} grains are in the bucket")
