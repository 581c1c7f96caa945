"""Of many points of a shape that touch a half-space few take part in an event, and none that they hold closes."""

import warnings

import numpy as np
import pytest

import mbvi
from mbvi.geometry.narrow.spread import FEW_POINTS
from mbvi.projection.projector import Projector
from mbvi.schemes.event_driven.integrator import EventDrivenIntegrator
from mbvi_studies.published_robots import published_robot


def largest(monkeypatch):
    """The most rows of any projection."""
    most = [0]

    def counted(method):
        def inner(self, *given):
            most[0] = max(most[0], *(len(x) for x in given if isinstance(x, np.ndarray) and x.ndim == 2))
            return method(self, *given)

        return inner

    for name in ("law", "project"):
        monkeypatch.setattr(Projector, name, counted(getattr(Projector, name)))
    return most


def puck(corners, height=0.0, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), e=0.0):
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    rim = 0.1 * np.column_stack([np.cos(angle), np.sin(angle)])
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0.0, 0.0, 1.0))
    points = np.concatenate([np.column_stack([rim, np.full(corners, z)]) for z in (-0.02, 0.02)])
    scene.add_convex(points, [(0, 0, 0.02 + height)], 1.0, velocities=[velocity], angular_velocities=[spin])
    return scene.build()


@pytest.mark.parametrize("corners", [20, 128])
def test_a_puck_slides_and_turns_on_its_face(corners, monkeypatch):
    most = largest(monkeypatch)
    problem = puck(corners, velocity=(0.3, 0.1, 0.0), spin=(0.0, 0.0, 2.0))
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=1.0)
    np.testing.assert_allclose(run.q[-1, :3], [0.3, 0.1, 0.02], atol=1e-9)
    np.testing.assert_allclose(run.v[-1], [0.3, 0.1, 0.0, 0.0, 0.0, 2.0], atol=1e-9)
    assert not run.impacts and most[0] <= FEW_POINTS
    # it is not stopped by points that only touch
    assert len(run.t) < 100


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_puck_of_many_corners_that_falls_flat_moves_as_one_of_eight(e, monkeypatch):
    most, ends = largest(monkeypatch), []
    for corners in (8, 128):
        run = mbvi.simulate(puck(corners, 0.1, e=e), mbvi.EventDriven(1e-8), duration=1.5)
        ends.append(run.q[-1, 2])
    assert ends[1] == pytest.approx(ends[0], abs=1e-7) and most[0] <= FEW_POINTS


def test_a_puck_that_is_pushed_over_tips_about_a_corner_that_was_no_row():
    """Its centre rises as that of a body which turns about its true rim."""
    run = mbvi.simulate(puck(100, velocity=(0, 0, 0.0), spin=(0.0, 1.0, 0.0), height=1e-9), mbvi.EventDriven(1e-8),
                        duration=0.05)  # fmt: skip
    floor = puck(100).constraints
    assert min(float(floor.gap(0.0, q).min()) for q in run.q) >= -1e-7
    assert run.energy().max() <= run.energy()[0] * (1.0 + 1e-9)


@pytest.mark.slow(seconds=60)
@pytest.mark.parametrize("name", ["go2", "g1", "solo12"])
def test_no_projection_of_a_published_robot_has_many_rows(name, monkeypatch):
    most = largest(monkeypatch)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        problem = published_robot(name, 0.02)
        motion = EventDrivenIntegrator(problem, 1e-6, Projector())
        for _ in motion.run(0.12):
            assert most[0] <= 40
    assert motion.t == pytest.approx(0.12)
