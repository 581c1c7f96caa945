"""Up to some thirty free bodies in the compiled loop: exact motions, rest, and what wakes those that rest."""

import numpy as np
import pytest

import mbvi
from mbvi.run.loop.loop_scope import is_compiled

STEP, G = 1e-3, 9.81


def pushed_tray(push, where=0.0):
    """A box of 4 kg that a force pushes over a rough floor, and 25 balls of 0.5 kg that roll on it."""
    scene = mbvi.Scene(gravity=(0, 0, -G))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((20, 20, 1), mass=4.0, position=(where, 0, 0.5), name="tray")
    scene.set_friction("tray", "floor", 0.3)
    for k in range(25):
        ball = scene.add_sphere(0.4, mass=0.5, position=(where + 2.0 * (k % 5) - 4.0, 2.0 * (k // 5) - 4.0, 1.4))
        scene.set_friction(ball, "tray", 0.7)
    scene.add_force("tray", lambda t, q, v: np.concatenate([push, np.zeros(3)]))
    return scene.build()


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5])
def test_balls_roll_on_a_tray_that_is_pushed(angle, loops):
    """While all balls roll, m a = f and (2/5) m r alpha = f give each 2/7 of the acceleration of the tray."""
    direction, push, time = np.array([np.cos(angle), np.sin(angle), 0.0]), 80.0, 0.1
    run = mbvi.simulate(pushed_tray(push * direction), step=STEP, duration=time, progress=False)
    assert loops[0].codes.tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    tray = (push - 0.3 * (4.0 + 25 * 0.5) * G) / (4.0 + 25 * 0.5 * 2.0 / 7.0)
    v = run.v[-1].reshape(26, 6)
    np.testing.assert_allclose(v[0], [*(tray * time * direction), 0, 0, 0], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(v[1:, :3], np.tile(2.0 / 7.0 * tray * time * direction, (25, 1)), rtol=0.0, atol=1e-10)
    across = np.array([-direction[1], direction[0], 0.0])
    spin = -5.0 / 7.0 * tray * time / 0.4 * across
    np.testing.assert_allclose(v[1:, 3:], np.tile(spin, (25, 1)), rtol=0.0, atol=1e-10)


def test_which_bodies_with_friction_the_loop_takes():
    """Bodies that could stand on 48 points at most, and few bodies of any shape."""

    def built(boxes, balls, friction):
        scene = mbvi.Scene(friction=friction)
        scene.add_halfspace((0, 0, 1))
        for k in range(boxes):
            scene.add_box((0.1, 0.1, 0.1), mass=1.0, position=(0.2 * k, 0, 0.05))
        for k in range(balls):
            scene.add_sphere(0.05, mass=1.0, position=(0.2 * k, 1, 0.05))
        return scene.build()

    scheme = mbvi.StewartTrinkle()
    assert is_compiled(built(12, 0, 0.5), scheme) and not is_compiled(built(13, 0, 0.5), scheme)
    assert is_compiled(built(11, 4, 0.5), scheme) and not is_compiled(built(11, 5, 0.5), scheme)
    assert is_compiled(built(16, 0, 0.0), scheme) and not is_compiled(built(17, 0, 0.0), scheme)


def dropped_boxes(count=5, force=None, scene=None):
    scene = mbvi.Scene(friction=0.5, gravity=(0, 0, -G)) if scene is None else scene
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(count):
        scene.add_box((0.1, 0.1, 0.1), mass=1.0 + k, position=(0.3 * k, 0, 0.05 + 0.002 * k), name=f"box {k}")
    if force is not None:
        scene.add_force("box 0", force)
    return scene.build()


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle()])
def test_boxes_at_rest_bear_their_weight_at_every_step(scheme, monkeypatch):
    """Where all rest no step is computed; states, contacts and their forces go on."""
    problem, taken, step = dropped_boxes(), [], type(scheme).step
    monkeypatch.setattr(type(scheme), "step", lambda *given: taken.append(1) or step(*given))
    run = mbvi.simulate(problem, scheme, step=STEP, duration=1.0, record="contacts", progress=False)
    assert len(taken) < 60
    assert (run.v[-300:] == 0.0).all() and (run.q[-300:] == run.q[-1]).all()
    np.testing.assert_allclose(run.t, STEP * np.arange(1001), rtol=0.0, atol=1e-12)
    for k in range(5):
        np.testing.assert_allclose(run.contact_forces(f"box {k}")[-300:, 2], (1.0 + k) * G, rtol=1e-9)


def test_a_run_at_rest_begins_as_a_shorter_one():
    runs = [
        mbvi.simulate(dropped_boxes(), step=STEP, duration=duration, progress=False) for duration in (0.35, 0.9, 0.9005)
    ]
    for run in runs[:2]:
        n = len(run.t)
        assert run.q.tobytes() == runs[2].q[:n].tobytes() and run.v.tobytes() == runs[2].v[:n].tobytes()


@pytest.mark.parametrize("threads", [1, 2])
def test_a_rollout_that_comes_to_rest_is_a_run(threads):
    """The boxes of the first come to rest within it, those of the others do not."""
    problem, scheme = dropped_boxes(), mbvi.Centered(project_positions=True)
    v0 = np.zeros((3, 30))
    v0[1:, 2] = 3.0
    rollouts = mbvi.rollout(
        problem, np.tile(problem.q0, (3, 1)), v0, steps=400, step=STEP, scheme=scheme, threads=threads
    )
    assert (rollouts.v[0, -50:] == 0.0).all() and (rollouts.v[1, -1] != 0.0).any()
    for i in range(3):
        run = mbvi.simulate(problem.at(problem.q0, v0[i]), scheme, step=STEP, duration=400 * STEP, progress=False)
        assert rollouts.q[i].tobytes() == run.q.tobytes() and rollouts.v[i].tobytes() == run.v.tobytes()


def test_a_force_that_begins_late_moves_a_box_that_rests():
    def force(t, q, v):
        return np.array([8.0 if t >= 0.7 else 0.0, 0, 0, 0, 0, 0])

    run = mbvi.simulate(dropped_boxes(3, force), step=STEP, duration=1.0, progress=False)
    # 1 kg, of which friction takes 0.5 G
    np.testing.assert_allclose(run.v[-1, 0], (8.0 - 0.5 * G) * 0.3, rtol=1e-9)
    np.testing.assert_allclose(run.v[-1, 6:], 0.0, rtol=0.0, atol=1e-14)


class Piston:
    """A wall that rests, and then moves at 0.5 m/s."""

    def pose(self, t):
        return np.eye(3), np.array([0.5 * max(t - 0.6, 0.0), 0.0, 0.0])

    def twist(self, t):
        return np.array([0.5 * (t >= 0.6), 0.0, 0.0]), np.zeros(3)


def test_a_wall_that_begins_to_move_late_strikes_a_box_that_rests():
    scene = mbvi.Scene(gravity=(0, 0, -G))
    scene.add_halfspace((1, 0, 0), -0.2, motion=Piston(), name="piston")
    built = dropped_boxes(3, scene=scene)
    run = mbvi.simulate(built, mbvi.Centered(project_positions=True), step=STEP, duration=1.0, progress=False)
    # it has gone from -0.2 m to 0, and pushes the box by a face 0.05 m from its centre, since some time in a step
    np.testing.assert_allclose(run.q[-1, 0], 0.05, rtol=0.0, atol=0.5 * STEP)
    np.testing.assert_allclose(run.v[-1, 0], 0.5, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run.q[-1].reshape(3, 7)[1:, 0], [0.3, 0.6], rtol=0.0, atol=1e-9)
