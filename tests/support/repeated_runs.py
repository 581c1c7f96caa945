"""Short runs that are compared to the byte, here and in other processes."""

import numpy as np

import mbvi

# steps of each example that a copy takes
FEW = 40


def bytes_of(run):
    """All numbers of a run."""
    impacts = [
        (i.time, i.constraints, *(x.tobytes() for x in (i.percussion, i.before, i.after, i.point, i.normal)))
        for i in run.impacts
    ]
    return run.t.tobytes(), run.q.tobytes(), run.v.tobytes(), run.residual.tobytes(), impacts, run.notes


def short_run(problem, scheme=None, step=None, **_):
    """A few steps, from the start."""
    if scheme is not None and scheme.timing.own_steps:
        return mbvi.simulate(problem, scheme, duration=0.02, progress=False)
    step = step or 1e-3
    return mbvi.simulate(problem, scheme, step=step, duration=FEW * step, progress=False)


def hold(t, q, v):
    """A control that a pickle finds by its name."""
    return -0.1 * v


def every_shape():
    """One of all that can be added, of the kinds of constraints there are."""
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((1, 0, 0), offset=-4.0, motion=mbvi.motion.Oscillation((0.05, 0, 0), 3.0), name="shaker")
    scene.add_box((1, 1, 0.1), position=(0, 0, 0.05), fixed=True, name="table")
    scene.add_box((0.2, 0.1, 0.1), position=(-0.3, 0, 0.17), angular_velocity=(1, 2, 3))
    scene.add_ellipsoid((0.1, 0.07, 0.05), position=(0, 0, 0.2))
    scene.add_capsule(0.05, 0.2, position=(0.3, 0, 0.3))
    scene.add_cylinder(0.05, 0.2, position=(0.3, 0.3, 0.3))
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1], [0.1, 0.1, 0.1]])
    scene.add_convex(corners, [(-0.3, 0.3, 0.2)], mass=1.0)
    scene.add_sphere(0.05, position=(-0.3, -0.3, 0.2))
    scene.add_urdf(mbvi.robot("hopper"), position=(2, 0, 0.8), joints={"hip": -0.2, "knee": 0.4}, control=hold)
    scene.add_urdf(mbvi.robot("arm"), base="fixed", position=(-2, 0, 0.1))
    scene.set_restitution("hopper", "floor", 0.7)
    return scene.build()


def simulate_elsewhere(problem):
    return bytes_of(short_run(problem, mbvi.Centered(), step=2e-3))
