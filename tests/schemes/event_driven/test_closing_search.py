"""The first gap that closes, found by kernels and by Python, row by row."""

import numpy as np
import pytest

import mbvi
from mbvi.projection import Projector
from mbvi.schemes.event_driven.impact_event import ImpactEvent
from mbvi_studies.published_robots import published_robot
from support.robot_problems import problem_of

TOLERANCE = 1e-6
# of the runs [s]: later a start that differs by 1e-14 has grown to 1e-8, and so has the rounding of both
DURATION = {"quadruped": 0.2, "biped": 0.2, "panda": 0.4}


def impacts(name, kind, e, by_kernels):
    """The impacts of a run, and how many of its steps kernels searched."""
    # its links meet each other, in closed form and by search
    problem = published_robot(name, 0.0, e) if name == "panda" else problem_of(name, kind, e)
    integrator = mbvi.EventDriven(TOLERANCE).integrator(problem, Projector())
    closing, searched = integrator.closing, []
    search = closing._search
    assert search is not None

    def counted(step, closed):
        found = search(step, closed)
        searched.append(found[1] >= -1)
        return found

    closing._search = counted if by_kernels else None
    if not by_kernels:
        closing.crossing = lambda *_: None
    found = [part for part in integrator.run(DURATION[name]) if isinstance(part, ImpactEvent)]
    return found, sum(searched)


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize(("name", "kind"), [("quadruped", "limits"), ("biped", "limits"), ("panda", "falling arm")])
def test_kernels_find_the_impacts_that_python_finds(name, kind, e):
    (found, searched), (expected, none) = (impacts(name, kind, e, by_kernels) for by_kernels in (True, False))
    assert searched and not none
    assert len(found) == len(expected) > 2
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.number, other.number)
        np.testing.assert_allclose(one.t, other.t, rtol=0, atol=1e-3 * TOLERANCE)
        np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-3 * TOLERANCE)
