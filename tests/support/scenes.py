"""Scenes that a test and a program that it starts both simulate."""

import mbvi
from mbvi import reference
from support.paths import ROBOTS


def robot_and_bodies():
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.5), joints={"knee": 0.4})
    scene.add_spheres([[1, 0, 0.3], [1.05, 0, 0.55]], radius=0.1, mass=[1.0, 2.0])
    return scene


def robot_bodies_and_post():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.6), joints={"knee": 0.4}, velocity={"hip": -1.0})
    scene.add_box((0.2, 0.1, 0.1), position=(0.6, 0, 0.3), angular_velocity=(0, 1, 0), name="brick")
    scene.add_spheres([[1, 0, 0.3], [1.05, 0, 0.55]], radius=0.1, mass=[1.0, 2.0])
    scene.add_cylinder(0.1, 0.2, position=(-1, 0, 0.1), fixed=True, name="post")
    scene.set_restitution("hopper/foot", "floor", 0.8)
    return scene


def hopper_and_brick(control=None, **more):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.55), joints={"knee": 0.4}, control=control, **more)
    scene.add_box((0.2, 0.1, 0.1), position=(0.6, 0, 0.3), angular_velocity=(0, 1, 0), name="brick")
    return scene.build()


def swinging():
    return reference.double_pendulum(1.0).problem
