"""Balls on polyhedra under error control: vertices, edges and faces are rows of their own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbvi

G, RADIUS, SPEED, EDGE = 9.81, 0.1, 0.5, 0.4


def ball_on_box(friction):
    scene = mbvi.Scene(restitution=0.0, friction=friction)
    scene.add_box((1.0, 1.0, 0.4), position=(-0.5, 0.0, -0.2), fixed=True)
    scene.add_sphere(RADIUS, 1.0, position=(-SPEED * EDGE, 0.03, RADIUS), velocity=(SPEED, 0.0, 0.0))
    problem = scene.build()
    if not friction:
        return problem
    v = problem.v0.copy()
    v[4] = SPEED / RADIUS
    return problem.at(problem.q0, v)


def over_the_edge(share, ends):
    """The angle about the edge, from the vertical, of a ball that takes part of gravity; `ends` says until when."""
    ends.terminal = True
    fall = solve_ivp(
        lambda t, y: [y[1], share * G * np.sin(y[0]) / RADIUS], [EDGE, 2.0], [0.0, SPEED / RADIUS],
        method="DOP853", rtol=1e-13, atol=1e-14, events=ends, dense_output=True,
    )  # fmt: skip
    return fall.t_events[0][0], fall.sol


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_a_ball_that_slides_over_an_edge_flies_off_it(tolerance):
    """It turns about the edge until g cos a = r (da/dt)^2, then it flies."""
    leaves, fall = over_the_edge(1.0, lambda t, y: G * np.cos(y[0]) - RADIUS * y[1] ** 2)
    a, rate = fall(leaves)
    flies, end = 0.2, leaves + 0.2
    x = RADIUS * np.array([np.sin(a), np.cos(a)]) + flies * RADIUS * rate * np.array([np.cos(a), -np.sin(a)])
    run = mbvi.simulate(ball_on_box(0.0), mbvi.EventDriven(tolerance), duration=end)
    assert run.notes == ()
    np.testing.assert_allclose(run.q[-1, [0, 2]], x - [0.0, 0.5 * G * flies**2], atol=tolerance)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_a_ball_that_rolls_over_an_edge_turns_about_it(tolerance):
    """Rolling takes 5/7 of gravity; it ends where the friction 2/7 g sin a exceeds mu (g cos a - r (da/dt)^2)."""
    mu = 0.9
    slips, fall = over_the_edge(
        5 / 7, lambda t, y: mu * (G * np.cos(y[0]) - RADIUS * y[1] ** 2) - 2 / 7 * G * np.sin(y[0])
    )
    end = slips - 0.005
    a, _ = fall(end)
    run = mbvi.simulate(ball_on_box(mu), mbvi.EventDriven(tolerance), duration=end)
    assert run.notes == ()
    np.testing.assert_allclose(run.q[-1, [0, 2]], RADIUS * np.array([np.sin(a), np.cos(a)]), atol=tolerance)


def test_a_ball_slides_down_a_hull_of_many_faces():
    """Over faces and edges without an impact: the energy stays, and smaller tolerances change little."""
    force, angles = 10.0, np.deg2rad(np.arange(5.0, 360.0, 10.0))
    corners = [[np.sin(a), y, np.cos(a)] for a in angles for y in (-1.0, 1.0)]
    scene = mbvi.Scene(restitution=0.0, gravity=(0.0, 0.0, 0.0))
    scene.add_convex(np.array(corners), [np.zeros(3)], 20.0, name="hull")
    top = np.cos(angles[0])
    scene.add_sphere(0.5, 1.0, position=(0.01, 0.0, top + 0.5), velocity=(0.3, 0.0, 0.0), name="ball")
    scene.add_force("ball", lambda t, q, v: [0.0, 0.0, -force, 0.0, 0.0, 0.0])
    problem = scene.build()
    run, finer = (mbvi.simulate(problem, mbvi.EventDriven(t), duration=1.1, record="contacts") for t in (1e-6, 1e-8))
    assert run.notes == finer.notes == ()
    assert not run.impacts and np.ptp(run.energy() + force * run.q[:, 9]) < 1e-8
    np.testing.assert_allclose(run.q[-1], finer.q[-1], atol=1e-6)
    # the fourth face, at 30 degrees
    assert max(c.normal[0] for t in run.t[1:] for c in run.contacts(t)) > np.sin(np.deg2rad(30.0))


def test_equal_feet_on_a_large_box_move_as_on_a_plane():
    """Each foot is the same ball in the frame of its own shank: rows of features must not be taken for each other's."""
    runs = []
    for floor in ("box", "plane"):
        scene = mbvi.Scene(restitution=0.0)
        if floor == "box":
            scene.add_box((9.0, 9.0, 0.4), position=(0.0, 0.0, -0.2), fixed=True)
        else:
            scene.add_halfspace((0, 0, 1))
        scene.add_urdf(mbvi.robot("quadruped"), position=(0.0, 0.0, 0.5), rotation=(0.05, -0.1, 0.02))
        runs.append(mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.25))
    on_box, on_plane = runs
    assert on_box.notes == on_plane.notes == () and len(on_plane.impacts) > 3
    np.testing.assert_allclose(on_box.q[-1], on_plane.q[-1], atol=1e-5)
