"""`mbvi chart gradients`: the derivative of a bounce, by runs of steps, by `mbvi.sensitivity` and by MuJoCo."""

import numpy as np
import pytest
from matplotlib.image import imread

from mbvi_studies.chart.gradient_picture import gradient_table
from mbvi_studies.chart.gradients import (
    DURATION,
    GRAVITY,
    HEIGHT,
    RADIUS,
    GradientRecord,
    exact,
    measure_ours,
    steps_of,
)
from mbvi_studies.chart.records import read_table
from support.paths import DOCS


def end(z):
    """The height at the end, as a function of that at the start."""
    fall = np.sqrt(2 * (z - RADIUS) / GRAVITY)
    left = DURATION - fall
    return RADIUS + GRAVITY * fall * left - 0.5 * GRAVITY * left**2


def lines(records):
    return {name: [r for r in records if r.line == name] for name in dict.fromkeys(r.line for r in records)}


def test_the_exact_derivative_is_that_of_the_motion():
    height, slope = exact()
    assert height == pytest.approx(end(HEIGHT), rel=1e-14)
    assert slope == pytest.approx(np.imag(end(HEIGHT + 1e-30j)) / 1e-30, rel=1e-14)
    assert round(slope, 4) == 0.7352


def test_steps_divide_the_duration():
    for h in steps_of(13):
        assert DURATION / h == pytest.approx(round(DURATION / h), abs=1e-9)
    assert len(set(steps_of(13))) == 13


def test_heights_converge_and_derivatives_of_steps_do_not():
    height, slope = exact()
    steps, located, events = lines(measure_ours(steps_of(4))).values()
    assert [r.slope for r in steps] == pytest.approx([1.0] * 4, abs=1e-6)
    assert abs(steps[-1].height - height) < 1e-3
    assert [r.slope for r in located] == pytest.approx([slope] * 4, abs=1e-6)
    assert events[0].slope == pytest.approx(slope, rel=1e-9)


def test_mujocos_derivatives_do_not_converge_while_its_height_does():
    engine = pytest.importorskip("mbvi_studies.engines.gradient_in_mujoco")
    height, slope = exact()
    found = engine.measure(steps_of(5))
    errors = [abs(r.height - height) for r in found]
    assert errors[-1] < 1e-2 < 0.1 < errors[0]
    assert max(abs(r.slope - slope) for r in found[-2:]) > 1.0


@pytest.mark.slow(seconds=10)
def test_the_command_writes_picture_and_table(command, tmp_path):
    pytest.importorskip("mujoco")
    code, out, _ = command("chart", "gradients", "--out", "made/gradients")
    assert code == 0 and "| exact | | 0.7352 | |" in out
    found = read_table(tmp_path / "made/gradients.csv", GradientRecord)
    assert len(lines(found)) == 4 and gradient_table(found) in out
    assert imread(tmp_path / "made/gradients.png").shape[0] > 300
    assert "<svg" in (tmp_path / "made/gradients.svg").read_text()[:1000]


@pytest.mark.parametrize("more", [("ball",), ("--peers",), ("--schemes", "paoli"), ("--budget", "1")])
def test_what_does_not_go_with_it_is_said_in_a_line(command, more):
    code, _, err = command("chart", "gradients", *more)
    assert code == 2 and "give it alone" in err and err.count("\n") == 1


def test_the_page_has_the_numbers_of_its_file():
    records = read_table(DOCS / "howto/gradients.csv", GradientRecord)
    assert gradient_table(records) in (DOCS / "howto/derivatives.md").read_text()
