"""Pinocchio by address: the bits of its bindings, for any robot, in any thread, for as long as it is kept."""

import gc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from mbvi.system import ArticulatedSystem
from mbvi.system.free.spinning import free_links
from mbvi.system.mechanisms import articulated
from mbvi.system.mechanisms.by_address import pinocchio_address
from mbvi.system.mechanisms.by_address.pinocchio_check import reason_for_bindings
from mbvi.system.mechanisms.joint_tree import joint_tree
from mbvi.system.mechanisms.mechanism import mechanism
from support.paths import ROBOTS, real_robot

pytestmark = pytest.mark.skipif(reason_for_bindings() is not None, reason=f"{reason_for_bindings()}")

PATHS = {
    "quadruped": (ROBOTS / "quadruped/quadruped.urdf", True),
    "pendulum": (ROBOTS / "double_pendulum/double_pendulum.urdf", False),
    "panda": (real_robot("panda_description/urdf/panda.urdf"), False),
    "talos": (real_robot("talos_data/robots/talos_reduced.urdf"), True),
}


def model_of(name):
    path, free = PATHS[name]
    return pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if free else []))


def record_of(model):
    # kernels compute nothing for a model without joints
    tree = joint_tree(pin.Model(), np.zeros(model.nv, np.int64))
    return mechanism(model, model.createData(), np.zeros((model.njoints, model.nv)), tree, free_links(model))


def states(model, rng, count):
    for _ in range(count):
        q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        yield q, rng.normal(size=model.nv)


def computed(record, model, q, v):
    """All results of one state, by address."""
    calls, new, dv = record.calls, np.empty(model.nq), np.empty(model.nv)
    pinocchio_address.retract(calls, q, v, new)
    pinocchio_address.tangent(calls, q, new, dv)
    found = [new, dv]
    pinocchio_address.crba(calls, q)
    found += [np.tril(record.mass), record.columns.copy(), record.poses.copy()]
    pinocchio_address.nonlinear_effects(calls, q, v)
    return [*found, record.effects.copy()]


def expected(model, data, q, v):
    """The same by the bindings."""
    new, nv = pin.integrate(model, q, v), model.nv
    found = [new, pin.difference(model, q, new)]
    pin.crba(model, data, q, pin.Convention.WORLD)
    found += [np.triu(np.reshape(data.M, (nv, nv))).T, np.reshape(data.J, (6, nv)).T.copy()]
    found.append(np.array([[*pose.rotation.T, pose.translation] for pose in data.oMi]))
    return [*found, np.array(pin.nonLinearEffects(model, data, q, v))]


def bits(arrays):
    return [np.ascontiguousarray(array).tobytes() for array in arrays]


@pytest.mark.parametrize("name", PATHS)
def test_every_function_gives_the_bits_of_the_bindings(name, rng):
    model = model_of(name)
    record, data = record_of(model), model.createData()
    for state in states(model, rng, 5):
        assert bits(computed(record, model, *state)) == bits(expected(model, data, *state))


@pytest.mark.parametrize("name", PATHS)
def test_the_record_keeps_the_model_and_the_data(name, rng):
    model = model_of(name)
    state = next(states(model, rng, 1))
    wanted = bits(expected(model, model.createData(), *state))
    record, sizes = record_of(model), model
    calls = record.calls
    del model
    gc.collect()
    kept = [model_of(other).createData() for other in PATHS for _ in range(20)]
    assert bits(computed(record, sizes, *state)) == wanted
    # the array of calls alone keeps them too
    del record, sizes, kept
    gc.collect()
    others = [model_of(other) for other in PATHS]
    new = np.empty(len(state[0]))
    pinocchio_address.retract(calls, state[0], state[1], new)
    pinocchio_address.crba(calls, state[0])
    assert new.tobytes() == wanted[0]
    assert len(others) == len(PATHS)


def test_threads_with_a_record_each_give_the_bits_of_one(rng):
    model = model_of("talos")
    all_states = list(states(model, rng, 40))
    wanted = [bits(computed(record_of(model), model, *state)) for state in all_states]

    def run(part):
        record = record_of(model)
        return [bits(computed(record, model, *state)) for state in part]

    with ThreadPoolExecutor(4) as pool:
        found = [each for part in pool.map(run, [all_states[k::4] for k in range(4)]) for each in part]
    assert found == [wanted[i] for k in range(4) for i in range(k, 40, 4)]


def test_arrays_of_another_size_are_refused(rng):
    model = model_of("quadruped")
    calls, q, v = record_of(model).calls, pin.neutral(model), np.zeros(model.nv)
    for wrong in (q[:-1].copy(), np.append(q, 0.0), v, np.empty(0)):
        with pytest.raises(ValueError, match="another size than the model"):
            pinocchio_address.crba(calls, wrong)
        with pytest.raises(ValueError, match="another size than the model"):
            pinocchio_address.retract(calls, q, v, wrong)
    with pytest.raises(ValueError, match="another size than the model"):
        pinocchio_address.nonlinear_effects(calls, q, q)


def test_an_instance_of_another_class_has_no_address():
    model = model_of("pendulum")
    with pytest.raises(OSError, match="SE3 holds no N9pinocchio8ModelTpl"):
        pinocchio_address._pointer(pin.SE3.Identity(), pinocchio_address.MODEL)
    with pytest.raises(OSError, match="Model holds no N9pinocchio7DataTpl"):
        pinocchio_address.array_of_calls(model, model)


def test_a_library_that_is_not_loaded_is_not_opened():
    with pytest.raises(OSError, match="the library boost_wave is not loaded"):
        pinocchio_address.loaded_library("boost_wave")


@pytest.mark.parametrize("convert", [np.float32, lambda q: np.repeat(q, 2)[::2], np.asfortranarray])
def test_a_system_takes_any_array_of_numbers(convert, rng):
    system, plain = (ArticulatedSystem(model_of("quadruped")) for _ in range(2))
    q = convert(pin.neutral(system.model))
    assert bits(system.kinematics(q)) == bits(plain.kinematics(np.array(q, float)))
    assert system.metric(q).dense().tobytes() == plain.metric(np.array(q, float)).dense().tobytes()


def landing():
    """Two robots that fall to the floor, by a scheme whose steps are those of Python."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    for k, name in enumerate(("quadruped", "hopper")):
        scene.add_urdf(ROBOTS / f"{name}/{name}.urdf", position=(k, 0, 0.6), name=name)
    return mbvi.simulate(scene.build(), mbvi.Paoli(project_positions=True), step=1e-3, duration=0.4, progress=False)


def test_a_run_by_the_bindings_is_the_same_and_says_so_once(monkeypatch):
    by_address = landing()
    assert by_address.impacts
    assert by_address.notes == ()
    monkeypatch.setattr(articulated, "reason_for_bindings", lambda: "the moon is full")
    by_bindings = landing()
    assert by_bindings.notes == ("Pinocchio was called through its Python bindings: the moon is full",)
    assert bits([by_bindings.q, by_bindings.v, by_bindings.residual]) == bits(
        [by_address.q, by_address.v, by_address.residual]
    )


def test_there_is_no_record_where_the_bindings_are_used(monkeypatch):
    system = ArticulatedSystem(model_of("quadruped"))
    assert system.mechanism() is not None
    monkeypatch.setattr(articulated, "reason_for_bindings", lambda: "the moon is full")
    assert system.mechanism() is None
