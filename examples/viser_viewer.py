"""Show a run of a quadruped in viser through Pinocchio's ViserVisualizer, with a slider for the time.

It needs viser: pip install 'mbvi[viser]'. As a program it serves the page until it is stopped.
"""

import time

import numpy as np
import pinocchio as pin
import viser
from pinocchio.visualize import ViserVisualizer

import mbvi

URDF = str(mbvi.robot("quadruped"))


def main(serve: bool = False) -> float:
    """Return how far from their places in the run the viewer shows the links at its end [m]."""
    scene = mbvi.Scene(restitution=0.2, friction=0.6)
    scene.add_halfspace(normal=(0, 0, 1), name="floor")
    scene.add_urdf(URDF, position=(0, 0, 0.6), name="quadruped")
    problem = scene.build()
    run = mbvi.simulate(problem, step=1e-3, duration=1.0)

    # the model as it is simulated, whose joints have the order of q
    model = problem.model("quadruped")
    kinds = (pin.GeometryType.COLLISION, pin.GeometryType.VISUAL)
    viewer = ViserVisualizer(model, *(pin.buildGeomFromUrdf(model, URDF, kind) for kind in kinds))
    server = viser.ViserServer(host="127.0.0.1", port=8080 if serve else 0, verbose=serve)
    viewer.initViewer(server, loadModel=True)
    server.scene.add_grid("floor", width=4.0, height=4.0, cell_size=0.25)

    slider = server.gui.add_slider("time [s]", 0.0, float(run.t[-1]), 0.01, 0.0)
    slider.on_update(lambda _: viewer.display(run.at(slider.value)[0]))
    viewer.display(run.q[-1])
    shapes = viewer.visual_model.geometryObjects
    places = problem.system.placements(run.q[-1], np.array([shape.parentJoint for shape in shapes]))
    errors = [
        viewer.frames[f"pinocchio/visual/{shape.name}"].position - np.append(shape.placement.translation, 1.0) @ place
        for shape, place in zip(shapes, places, strict=True)
    ]
    while serve:
        slider.value = (slider.value + 0.02) % float(run.t[-1])
        time.sleep(0.02)
    server.stop()
    return float(np.abs(errors).max())


if __name__ == "__main__":
    main(serve=True)
