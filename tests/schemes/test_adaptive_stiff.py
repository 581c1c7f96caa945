"""Forces that are stiff, and that jump, under `Adaptive`."""

import numpy as np
import pytest

import mbvi


@pytest.mark.parametrize(("rate", "tolerance"), [(1e3, 1e-2), (1e3, 1e-3), (2e4, 1e-3)])
def test_a_stiff_damper_leads_to_a_moving_target(rate, tolerance):
    """v' = rate (cos 5 t - v) from v = 3 has a closed form; its start needs steps of a part of 1 / rate."""
    frequency, begin = 5.0, 3.0
    system = mbvi.LagrangianSystem(
        lambda q: np.eye(1), lambda t, q, v: rate * (np.cos(frequency * t) * np.ones(1) - v), 1
    )
    run = mbvi.simulate(mbvi.Problem(system, [], [0.0], [begin]), mbvi.Adaptive(tolerance), duration=0.1)
    scale = rate / (rate**2 + frequency**2)
    fades, t = np.exp(-rate * run.t), run.t
    left = begin - scale * rate
    v = left * fades + scale * (rate * np.cos(frequency * t) + frequency * np.sin(frequency * t))
    q = left * (1.0 - fades) / rate + scale * (rate / frequency * np.sin(frequency * t) + 1.0 - np.cos(frequency * t))
    assert np.abs(run.q[:, 0] - q).max() < tolerance
    assert np.abs(run.v[:, 0] - v).max() < 5.0 * tolerance
    assert not any("shortest length" in note for note in run.notes)


def test_an_arm_under_a_strong_control_moves_as_located_at_order_eight():
    """Damping turns the last joint at a rate of 3e4 1/s: its wrist has an inertia of 1.2e-4 kg m^2."""
    joints = {f"joint{k}": 0.1 * (-1) ** k for k in range(1, 7)}
    scene = mbvi.Scene()
    drive = mbvi.PDControl(dict.fromkeys(joints, 0.0), stiffness=40.0, damping=3.0, limit=dict.fromkeys(joints, 40.0))
    scene.add_urdf(
        "robot:arm", base="fixed", joints=joints, control=drive, velocity=dict.fromkeys(joints, 0.5),
        locked=("left_finger_joint", "right_finger_joint"),
    )  # fmt: skip
    problem = scene.build()
    exact = mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=0.1).q[-1]
    run = mbvi.simulate(problem, mbvi.Adaptive(1e-2), duration=0.1)
    assert np.abs(run.q[-1] - exact).max() < 1e-2


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
@pytest.mark.parametrize("start", np.linspace(0.31, 0.36, 6))
def test_a_force_that_jumps_is_noticed_anywhere_in_a_step(start, tolerance):
    """A pulse changes the momentum by its force times its duration, whichever parts of steps it begins and ends in."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_sphere(0.1, mass=1.0, position=(0, 0, 1), name="ball")
    scene.add_force("ball", lambda t, q, v: [10.0 if start <= t < start + 0.2 else 0.0, 0.0, 0.0])
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=1.0)
    # relative to the largest velocity, which is the last
    assert abs(run.v[-1, 0] - 2.0) < 2.0 * tolerance
