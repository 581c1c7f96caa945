"""Plots: thinned curves keep their envelopes, and every panel has labels, units and the values of the run."""

import pickle
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from IPython.core.formatters import DisplayFormatter
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

import mbvi
from mbvi.results.diagnosis.diagnose import given_or_computed
from mbvi.results.plots.panel import BINS, Curve, thinned
from mbvi.results.plots.quantities import panels
from mbvi.shipped import demo_problem
from support.paths import ROBOTS


def hopper(friction=0.0, **options):
    scene = mbvi.Scene(restitution=0.3, friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.55), joints={"knee": 0.4})
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.5, **options)


@pytest.fixture(scope="module")
def run():
    return hopper()


@pytest.fixture(scope="module")
def sliding():
    return hopper(0.4, record="contacts")


def drawn(run, diagnosis=None):
    shown, omitted = panels(run, *given_or_computed(run, diagnosis))
    return {panel.title: panel for panel in shown}, {one.title: one.reason for one in omitted}


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2 * BINS + 1, 9000), holes=st.sampled_from([0.0, 0.01, 0.9]))
def test_a_thinned_curve_has_the_envelope_of_the_curve(seed, count, holes):
    rng = np.random.default_rng(seed)
    t, y = np.sort(rng.uniform(1.0, 3.0, count)), rng.normal(size=count)
    y[rng.random(count) < holes] = np.nan
    start, end = float(t[0]), float(t[-1])
    curve = thinned(Curve("", t, y), start, end)
    # its points are points of the curve, in order
    kept = np.searchsorted(t, curve.t)
    assert (np.diff(kept) > 0).all()
    np.testing.assert_array_equal(y[kept], curve.y)
    assert len(kept) <= 3 * BINS + 2
    place, place_kept = (np.minimum((BINS * (s - start) / (end - start)).astype(int), BINS - 1) for s in (t, curve.t))
    for extreme, worst in ((np.fmax, -np.inf), (np.fmin, np.inf)):
        whole, part = np.full(BINS, worst), np.full(BINS, worst)
        extreme.at(whole, place, y)
        extreme.at(part, place_kept, curve.y)
        np.testing.assert_array_equal(whole, part)


@given(seed=st.integers(0, 2**32 - 1), log=st.booleans())
def test_thinned_dots_leave_no_empty_place(seed, log):
    rng = np.random.default_rng(seed)
    t, y = np.sort(rng.uniform(0.0, 1.0, 5000)), np.exp(rng.normal(size=5000))
    curve = thinned(Curve("", t, y, "dots"), 0.0, 1.0, log=log)
    kept = np.searchsorted(t, curve.t)
    np.testing.assert_array_equal(y[kept], curve.y)
    assert curve.y.min() == y.min() and curve.y.max() == y.max()
    # every dot has one that is drawn within a cell of it
    place = np.log(y) if log else y
    size = np.array([1 / 400, np.ptp(place) / 120])
    dots = np.stack([t, place], axis=1) / size
    distance = cKDTree(dots[kept]).query(dots, p=np.inf)[0]
    assert distance.max() <= 1.0


def test_curves_of_few_points_are_whole():
    curve = Curve("", np.arange(2.0 * BINS), np.arange(2.0 * BINS))
    assert thinned(curve, 0.0, 2.0 * BINS) is curve


def test_the_panels_hold_the_numbers_of_the_run(run):
    found, omitted = drawn(run)
    kinetic, potential, total, impacts = found["Energy"].curves
    np.testing.assert_array_equal(total.y, run.energy())
    np.testing.assert_array_equal([kinetic.y, potential.y], run.energies())
    np.testing.assert_array_equal(impacts.t, [impact.time for impact in run.impacts])
    percussions = np.sort(np.concatenate([curve.y for curve in found["Percussions of impacts"].curves]))
    expected = np.sort(np.concatenate([impact.percussion for impact in run.impacts]))
    np.testing.assert_array_equal(percussions, expected[expected > 0.0])
    np.testing.assert_array_equal(found["Penetration"].curves[0].y, run.penetration())
    np.testing.assert_array_equal(found["Violation of joint limits"].curves[0].y, run.limit_violation())
    limits = run.problem.constraints.limits
    for title, part in (("Gaps", slice(limits, None)), ("Joint limits", slice(0, limits))):
        curves = {curve.name: curve for curve in found[title].curves}
        t = next(iter(curves.values())).t
        gaps = np.array([run.problem.constraints.gap(time, run.at(time)[0])[part] for time in t])
        least = np.min([curve.y for curve in curves.values()], axis=0)
        np.testing.assert_allclose(least, gaps.min(axis=1), atol=1e-12)
    assert found["Gaps"].axis == "gap [m]" and found["Joint limits"].axis == "distance [rad]"
    strongest = max(run.impacts, key=lambda impact: impact.percussion.max()).constraints[0]
    assert strongest in [curve.name for curve in found["Gaps"].curves]
    # plots of friction are not mentioned where there is none
    assert not {"Friction", "Slip"} & {*found, *omitted}


def test_angles_are_those_of_the_diagnosis(run):
    diagnosis = run.diagnosis()
    found, _ = drawn(run, diagnosis)
    shown = {float(y) for curve in found["Kinetic angles"].curves for y in curve.y}
    for instant in diagnosis.instants:
        pairs = instant.angles[np.triu_indices(len(instant.constraints), 1)]
        np.testing.assert_allclose(instant.extreme_angles, (pairs.min(), pairs.max()), atol=1e-12)
        assert set(np.degrees(instant.extreme_angles)) <= shown
    # a stretch without impacts is a line
    lines = [curve for curve in found["Kinetic angles"].curves if curve.style == "line"]
    stretches = [i for i in diagnosis.instants if i.until > i.time]
    assert stretches and [len(curve.t) for curve in lines] == [3 * len(stretches)] * 2


def test_friction_is_drawn_against_its_coefficient(sliding):
    found, _ = drawn(sliding)
    panel = found["Friction in impacts"]
    assert [level.y for level in panel.levels] == [0.4]
    curves = {curve.name: curve for curve in panel.curves}
    np.testing.assert_allclose(curves["slip"].y, 0.4, rtol=1e-6)
    assert "stick" not in curves or curves["stick"].y.max() <= 0.4 * (1 + 1e-6)
    table = sliding.record.contacts
    closed, sticking = found["Closed contacts"].curves
    np.testing.assert_array_equal(closed.y, np.diff(table.starts))
    assert sticking.y.sum() == table.sticks.sum()
    assert (
        np.nanmax(found["Slip"].curves[0].y)
        == np.linalg.norm(table.slip[np.isfinite(table.normal[:, 0])], axis=1).max()
    )


def test_closed_contacts_are_counted_where_they_were_not_recorded(run):
    found, _ = drawn(run)
    (curve,) = found["Closed contacts"].curves
    problem = run.problem
    counts = [len(problem.constraints.active(t, run.at(t)[0], 1e-3 * problem.length).gap) for t in curve.t]
    assert curve.y.tolist() == counts and "gap <" in found["Closed contacts"].note


def test_dense_output_is_drawn_between_its_states():
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=lambda t, q, v: np.array([-9.81]), dim=1)
    problem = mbvi.Problem(
        system, [mbvi.GapFunction(lambda q: q[0], lambda q: np.eye(1)[0])], [1.0], [0.0], restitution=0.8
    )
    run = mbvi.simulate(problem, mbvi.EventDriven(), duration=1.0)
    found, omitted = drawn(run)
    (gap,) = found["Gaps"].curves
    assert len(gap.t) > 300 > len(run.t)
    before = gap.t <= run.impacts[0].time
    np.testing.assert_allclose(gap.y[before], 1.0 - 0.5 * 9.81 * gap.t[before] ** 2, atol=1e-6)
    assert omitted["Penetration"] == "nothing penetrates"


def test_many_constraints_at_once_are_not_diagnosed_unasked(run):
    impact = run.impacts[0]
    crowded = replace(run, impacts=(replace(impact, constraints=impact.constraints * 40),))
    diagnosis, reason = given_or_computed(crowded, None)
    assert diagnosis is None and "40 constraints" in reason
    known = run.diagnosis()
    assert given_or_computed(crowded, known) == (known, "")


def test_the_figure_has_labels_and_units_on_every_axis(sliding):
    figure = sliding.plot()
    axes = [axis for axis in figure.axes if axis.axison]
    assert len(axes) == 10
    for axis in axes:
        assert axis.get_title(loc="left") and axis.get_ylabel()
        assert "[" in axis.get_ylabel() or axis.get_ylabel() == "contacts"
    assert sum(axis.get_xlabel() == "time [s]" for axis in axes) == 2
    figure.canvas.draw()
    # no legend covers a plot
    for axis in axes:
        if axis.get_legend() is not None:
            assert axis.get_legend().get_window_extent().y0 >= axis.get_window_extent().y1 - 1.0


def test_legends_are_not_cut_and_axes_begin_near_what_they_show():
    figure = mbvi.simulate(demo_problem(), mbvi.Paoli(), step=2e-3, duration=0.5, progress=False).plot()
    figure.canvas.draw()
    axes = {axis.get_title(loc="left"): axis for axis in figure.axes}
    names = [text.get_text() for text in axes["Joint limits"].get_legend().get_texts()]
    assert max(map(len, names)) == 34
    for axis in axes.values():
        if axis.get_legend() is not None:
            assert axis.get_legend().get_window_extent().x1 <= figure.bbox.x1
    # right angles, and some near them
    angles = np.concatenate([line.get_ydata() for line in axes["Kinetic angles"].get_lines()])
    low, high = axes["Kinetic angles"].get_ylim()
    assert np.nanmin(angles) > 80.0 and np.nanmin(angles) - low < 0.5 * (high - low)
    assert axes["Energy"].get_ylim()[0] == 0.0


def test_a_notebook_shows_the_figure_as_a_picture(run):
    """In a process without pyplot, as IPython asks for it; matplotlib's own figure is shown as text only."""
    figure = run.plot()
    shown, _ = DisplayFormatter().format(figure)
    width, height = np.frombuffer(shown["image/png"][16:24], ">u4")
    np.testing.assert_array_equal([width, height], figure.bbox.size.astype(int))
    assert isinstance(figure, Figure) and pickle.loads(pickle.dumps(figure)).axes


def test_what_cannot_be_plotted_is_said(run, monkeypatch):
    one = {name: getattr(run, name)[:1].copy() for name in ("t", "q", "v", "residual")}
    with pytest.raises(mbvi.InputError, match="nothing to plot: the run has one state"):
        replace(run, impacts=(), **one).plot()
    with pytest.raises(mbvi.InputError, match=r"what run\.diagnosis\(\) returned"):
        run.plot(diagnosis=1.0)
    monkeypatch.delitem(sys.modules, "mbvi.results.plots.notebook", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(mbvi.InputError, match=r"pip install 'mbvi\[charts\]'"):
        run.plot()
