"""Bodies that loops hold and that spin, with a contact that stays closed: two welded halves are one body."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.run.fixed_steps import taking

SIZE, MASS, DURATION = np.array([0.2, 0.3, 0.4]), 2.0, 0.03
TURN, SPIN = Rotation.from_rotvec([0.5, 0.4, 0.2]), np.array([2.0, -3.0, 2.0])


def on_a_corner(halves, friction):
    """A box that spins with its lowest corner on the floor, whole or as two halves that are welded."""
    scene = mbvi.Scene(friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    corners = TURN.apply(0.5 * SIZE * np.array(np.meshgrid(*[(-1, 1)] * 3)).T.reshape(-1, 3))
    low, spin = corners[corners[:, 2].argmin()], TURN.apply(SPIN)
    centre, velocity = np.array([0, 0, -low[2]]), np.array([0.3, 0.2, 0]) - np.cross(spin, low)
    for name, side in (("left", -0.25), ("right", 0.25)) if halves else (("whole", 0.0),):
        arm = TURN.apply(side * SIZE * (0, 0, 1))
        scene.add_box(
            SIZE * (1, 1, 0.5 if halves else 1), MASS / (2 if halves else 1), position=centre + arm,
            rotation=TURN.as_matrix(), velocity=velocity + np.cross(spin, arm), angular_velocity=spin, name=name,
        )  # fmt: skip
    if halves:
        scene.weld("left", "right")
    return scene.build()


def error(run, exact):
    """Return the largest differences of the centre and of velocities from those of the whole box, at the end."""
    v = run.v[-1]
    centre, speed = 0.5 * (run.q[-1, :3] + run.q[-1, 7:10]), 0.5 * (v[:3] + v[6:9])
    off = [centre - exact.q[-1, :3], speed - exact.v[-1, :3], v[3:6] - exact.v[-1, 3:], v[9:] - exact.v[-1, 3:]]
    return np.abs(off).max()


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("compiled", [False, True], ids=["python", "kernels"])
def test_two_welded_halves_that_spin_on_a_corner_move_as_one_box(compiled, friction, monkeypatch):
    if not compiled:
        monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    exact = mbvi.simulate(on_a_corner(False, friction), mbvi.EventDriven(1e-10), duration=DURATION)
    assert not exact.impacts
    scheme, found = mbvi.Centered(project_positions=True), []
    for h in (1e-3, 2.5e-4):
        found.append(error(mbvi.simulate(on_a_corner(True, friction), scheme, step=h, duration=DURATION), exact))
    assert found[0] < 5e-3
    assert found[1] < 0.4 * found[0]


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_the_same_with_error_control(tolerance, friction):
    exact = mbvi.simulate(on_a_corner(False, friction), mbvi.EventDriven(1e-10), duration=DURATION)
    run = mbvi.simulate(on_a_corner(True, friction), mbvi.Adaptive(tolerance), duration=DURATION)
    # relative to the largest speed
    assert error(run, exact) < 10 * tolerance * np.abs(SPIN).max()
