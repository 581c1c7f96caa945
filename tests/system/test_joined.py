"""Several mechanisms and free bodies as one mechanism: it moves as they do."""

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from mbvi.system import ArticulatedSystem, BlockSystem, FreeBodies, PlanarSpheres, Spheres
from mbvi.system.mechanisms.joined import can_be_joined, joined
from support.paths import ROBOTS

GRAVITY = np.array([0.3, -0.2, -9.81])
INERTIAS = np.array([np.diag([0.02, 0.012, 0.028]), [[0.3, 0.05, 0], [0.05, 0.2, 0.02], [0, 0.02, 0.25]]])


def robot(name, gravity=GRAVITY):
    base = [] if name == "double_pendulum" else [pin.JointModelFreeFlyer()]
    model = pin.buildModelFromUrdf(str(ROBOTS / f"{name}/{name}.urdf"), *base)
    model.gravity.linear = gravity
    model.damping[-2:], model.armature[-2:] = (0.1, 0.2), (0.03, 0.04)
    return ArticulatedSystem(model, name)


def bodies():
    return FreeBodies(np.array([2.0, 3.0]), INERTIAS, GRAVITY, ("a", "b"))


def spheres():
    return Spheres(np.array([1.0, 2.0]), GRAVITY, ("c", "d"))


SYSTEMS = {
    "one body": lambda: FreeBodies(np.ones(1), INERTIAS[:1], GRAVITY, ("a",)),
    "bodies": bodies,
    "spheres": spheres,
    "two robots": lambda: BlockSystem([robot("hopper"), robot("double_pendulum")]),
    "all": lambda: BlockSystem([robot("quadruped"), robot("double_pendulum"), bodies(), spheres()]),
}


def states(system, rng):
    """Yield configurations and velocities, the former after turns of some radians."""
    q = np.concatenate([np.zeros(0), *(neutral(part) for part in mbvi.system.parts_of(system))])
    for _ in range(4):
        q = system.integrate(q, 2.0 * rng.normal(size=system.nv))
        yield q, rng.normal(size=system.nv)


def neutral(part):
    if isinstance(part, ArticulatedSystem):
        return pin.neutral(part.model)
    return np.tile([0, 0, 0, 0, 0, 0, 1.0], part.nq // 7) if isinstance(part, FreeBodies) else np.zeros(part.nq)


@pytest.mark.parametrize("name", SYSTEMS)
def test_it_has_the_places_and_the_retraction_of_the_system(name, rng):
    system = SYSTEMS[name]()
    one = joined(system)
    assert (one.nq, one.nv, len(one.bodies)) == (system.nq, system.nv, len(system.bodies))
    every = np.arange(1, len(system.bodies))
    for q, dv in states(system, rng):
        np.testing.assert_allclose(one.placements(q, every), system.placements(q, every), rtol=0, atol=1e-14)
        np.testing.assert_allclose(one.integrate(q, dv), system.integrate(q, dv), rtol=0, atol=1e-14)
        new = system.integrate(q, dv)
        np.testing.assert_allclose(one.difference(q, new), system.difference(q, new), rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", SYSTEMS)
def test_it_falls_and_spins_as_the_system(name, rng):
    system = SYSTEMS[name]()
    one = joined(system)
    for q, v in states(system, rng):
        own, other = one.free_motion(0.0, q, v, 1e-2), system.free_motion(0.0, q, v, 1e-2)
        np.testing.assert_allclose(own.free, other.free, rtol=0, atol=1e-13)
        np.testing.assert_allclose(own.metric.dense(), other.metric.dense(), rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", SYSTEMS)
def test_its_gradients_are_those_of_the_system(name, rng):
    system = SYSTEMS[name]()
    one = joined(system)
    for q, _ in states(system, rng):
        first, second = rng.integers(0, len(system.bodies), (2, 12))
        rows = q, first, second, *rng.normal(size=(2, 12, 3))
        np.testing.assert_allclose(one.separation_rows(*rows), system.separation_rows(*rows), rtol=0, atol=1e-13)


def test_a_mechanism_alone_is_its_own():
    alone = robot("hopper")
    assert can_be_joined(alone)
    assert joined(alone) is alone


class Heavier(FreeBodies):
    """A user's own bodies."""


def pushed():
    system = BlockSystem([robot("hopper"), bodies()])
    system.parts[0].applied = np.ones(8)
    return system


REFUSED = {
    "planar bodies": lambda: PlanarSpheres(np.ones(2), GRAVITY, ("a", "b"), np.eye(3)),
    "a part of a user's class": lambda: BlockSystem([bodies(), Heavier(np.ones(1), INERTIAS[:1], GRAVITY, ("e",))]),
    "a user's class": lambda: Heavier(np.ones(1), INERTIAS[:1], GRAVITY, ("e",)),
    "another gravity": lambda: BlockSystem([robot("hopper", np.zeros(3)), bodies()]),
    "a force from outside": pushed,
    "coordinates": lambda: mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.zeros(2), 2),
}


@pytest.mark.parametrize("case", REFUSED)
def test_other_systems_are_not_joined(case):
    assert not can_be_joined(REFUSED[case]())


def test_a_scene_on_which_forces_act_is_joined_without_them():
    scene = mbvi.Scene()
    scene.add_box((1, 1, 1), 1.0, name="box")
    alone = scene.build().system
    scene.add_force("box", lambda t, q, v: np.ones(6))
    loaded = scene.build()
    assert can_be_joined(loaded.system)
    t, q, v = 0.0, loaded.q0, np.arange(6.0)
    np.testing.assert_allclose(
        joined(loaded.system).free_velocity(t, q, v, 0.1), alone.free_velocity(t, q, v, 0.1), atol=1e-14
    )
    assert np.abs(loaded.system.free_velocity(t, q, v, 0.1) - alone.free_velocity(t, q, v, 0.1)).max() > 0.05
