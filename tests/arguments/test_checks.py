"""Wrong arguments: every public function refuses them by an `MbviError`, in time and without a foreign warning."""

from __future__ import annotations

from fractions import Fraction
from functools import partial
from pathlib import Path

import numba
import numpy as np
import pytest

import mbvi
from mbvi import arguments
from support.faults import wrong_arguments as faults
from support.paths import ROBOTS

CALLABLES = faults.public_callables()


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """Words are taken for paths: files are written where they do no harm."""
    monkeypatch.chdir(tmp_path)


def test_every_public_callable_and_parameter_has_a_right_call():
    assert {name: set(given) for name, given in CALLABLES.items()} == {
        name: set(call.arguments()) for name, call in faults.CALLS.items()
    }
    assert len(CALLABLES) > 50


@pytest.mark.parametrize("name", CALLABLES)
def test_right_calls_are_taken(name):
    assert faults.check(name, {}) == "taken"


@pytest.mark.parametrize("name", [name for name, given in CALLABLES.items() if given])
def test_wrong_arguments(name):
    """Each of all bad values in place of each parameter."""
    for parameter in CALLABLES[name]:
        taken = {bad for bad, make in faults.BAD.items() if faults.check(name, {parameter: make()}) == "taken"}
        assert taken <= faults.RIGHT_SOMEWHERE, parameter
        # no parameter takes everything
        assert len(taken) < 0.2 * len(faults.BAD), parameter


def test_several_wrong_arguments_at_once(rng):
    for _ in range(300):
        faults.check(*faults.random_fault(rng))


@pytest.mark.slow
def test_many_wrong_arguments_at_once(rng):
    for _ in range(4_000):
        faults.check(*faults.random_fault(rng))


NUMBERS = [0.5, np.float64(0.5), np.float32(0.5), np.array(0.5), np.longdouble(0.5), Fraction(1, 2)]


@pytest.mark.parametrize("half", NUMBERS, ids=[type(x).__name__ for x in NUMBERS])
def test_every_kind_of_real_number_is_a_number(half):
    scene = mbvi.Scene(restitution=half)
    scene.add_sphere(half, mass=half, position=[half, half, np.float64(2.0)], name="ball")
    scene.add_spheres([[5, 0, 1], [9, 0, 1]], half, density=half)
    problem = scene.build()
    np.testing.assert_array_equal(problem.q0[:3], [0.5, 0.5, 2.0])
    assert problem.system.metric(problem.q0).dense()[0, 0] == 0.5
    run = mbvi.simulate(problem, mbvi.Paoli(), step=half, duration=half, every=np.int64(1))
    assert run.at(half)[0][0] == 0.5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: mbvi.simulate(s, duration=1.0), r"not a Scene: call scene.build\(\)"),
        (lambda s: mbvi.simulate(None, duration=1.0), "problem must be a Problem.*got None"),
        (lambda s: s.add_sphere(True), "radius must be a number; got True"),
        (lambda s: s.add_sphere("1"), "radius must be a number; got '1'"),
        (lambda s: s.add_sphere(0.1, mass=10**400), "mass must be positive and finite.*1000"),
        (lambda s: s.add_sphere(0.1, position=(True, 0, 0)), r"position must be numbers of shape \(3,\)"),
        (lambda s: s.add_sphere(0.1, name="a\0b"), "name must be 1 to 200 characters"),
        (lambda s: s.add_sphere(0.1, name="a\ud800b"), "name must be 1 to 200 characters"),
        (lambda s: s.add_sphere(0.1, name=5), "name must be text; got 5"),
        (lambda s: s.add_box((1, 1, 1), fixed="no"), "fixed must be True or False; got 'no'"),
        (lambda s: s.add_urdf(faults.HOPPER, locked="knee"), r"locked must be a list of names.*locked=\['knee'\]"),
        (lambda s: s.add_urdf(faults.HOPPER, joints=[0.4]), "joints must be a mapping of names to numbers"),
        (lambda s: s.add_urdf(faults.HOPPER, joints={"knee": "a"}), r"joints\['knee'\] must be a number; got 'a'"),
        (lambda s: s.add_urdf(faults.HOPPER, velocity=(1, 0, 0)), "velocity must be a mapping"),
        (lambda s: s.add_urdf(faults.HOPPER, control=lambda t: 0.0), "takes other arguments"),
        (lambda s: mbvi.simulate(s.build(), duration=1.0, out=3), "out must be a path"),
        (lambda s: mbvi.simulate(s.build(), duration=1.0, every="a"), "every must be a number; got 'a'"),
    ],
)
def test_messages_name_the_parameter_and_what_was_given(call, message):
    with pytest.raises(mbvi.InputError, match=message):
        call(faults.scene())


def test_values_are_shown_in_one_short_line():
    for make in faults.BAD.values():
        text = arguments.shown(make())
        assert 0 < len(text) <= 80 and text.isprintable()
    assert "_Raises" in arguments.shown(faults.BAD["raises"]())


class _Spring:
    def __call__(self, t, q, v):
        return -q

    def torque(self, t, q, v, stiffness=1.0):
        return -stiffness * q


FUNCTIONS = {
    "function": lambda t, q, v: -q,
    "with a default": lambda t, q, v, stiffness=1.0: -q,
    "with any": lambda *state: -state[1],
    "object": _Spring(),
    "method": _Spring().torque,
    "partial": partial(lambda stiffness, t, q, v: -stiffness * q, 1.0),
    "compiled": numba.njit(lambda t, q, v: -q),
}


@pytest.mark.parametrize("control", FUNCTIONS.values(), ids=FUNCTIONS)
def test_every_kind_of_function_is_a_function(control):
    scene = mbvi.Scene()
    robot = ROBOTS / "double_pendulum/double_pendulum.urdf"
    scene.add_urdf(robot, base="fixed", control=control, joints={"shoulder": 0.5})
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=2e-3)
    assert run.v[-1].any()


WRONG_TORQUES = {
    "words": ("push", "must return real numbers; it returned 'push'"),
    "nothing": (None, "must return real numbers; it returned None"),
    "shape": (np.zeros(3), r"returned shape \(3,\)"),
    "a number": (1.0, r"returned shape \(\)"),
    "nan": (np.full(2, np.nan), "is not finite"),
    "inf among numbers": ([np.inf, 0.0], "is not finite"),
    "complex": (np.ones(2) * 1j, "must return real numbers"),
    "bools": ([True, False], "must return real numbers"),
}


@pytest.mark.parametrize(
    "scheme", [mbvi.Paoli(), mbvi.Centered(), mbvi.EventDriven(1e-6)], ids=lambda s: type(s).__name__
)
@pytest.mark.parametrize(("torque", "message"), WRONG_TORQUES.values(), ids=WRONG_TORQUES)
def test_a_wrong_torque_is_an_error_at_its_step(scheme, torque, message):
    """The robot is named, and the control is not called again."""
    times = []

    def control(t, q, v):
        times.append(t)
        return np.zeros(2) if t < 5e-3 else torque

    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", control=control, name="arm")
    problem = scene.build()
    options = {} if isinstance(scheme, mbvi.EventDriven) else {"step": 1e-3}
    with pytest.raises((mbvi.InputError, mbvi.DivergedError), match=f"the control.* arm.*{message}|{message}.*arm has"):
        mbvi.simulate(problem, scheme, duration=0.1, **options)
    assert 5e-3 <= times[-1] < 0.1 and times[-2] < 5e-3


def test_a_large_torque_is_no_wrong_one():
    """The sum of two overflows, but each is finite."""
    scene = mbvi.Scene()
    robot = ROBOTS / "double_pendulum/double_pendulum.urdf"
    scene.add_urdf(robot, base="fixed", control=lambda t, q, v: np.full(2, 1e308))
    system = scene.build().system
    assert system.force(0.0, np.zeros(2), np.zeros(2))[0] == pytest.approx(1e308)


@pytest.mark.parametrize("stem", ["part[1]", "a | b", "tab\tand\nline"])
def test_files_give_names_that_can_be_named_again(tmp_path, stem):
    """A file's name may hold what parts a thing from its pieces."""
    mesh = tmp_path / f"{stem}.obj"
    mesh.write_text(Path(faults.mesh()).read_text())
    robot = tmp_path / f"{stem}.urdf"
    text = faults.HOPPER.read_text()
    robot.write_text(text.replace('name="hopper"', f'name="{stem}"').replace("\n", " "))
    scene = mbvi.Scene()
    names = [scene.add_mesh(mesh, scale=0.1), scene.add_urdf(robot, position=(0, 0, 2)), scene.add_surface(mesh)]
    assert len(set(names)) == 3
    for name in names:
        assert arguments.label(name) == name
        scene.set_restitution(name, names[0] if name != names[0] else names[1], 0.5)
