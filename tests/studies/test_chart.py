"""`mbvi chart`: the points it measures, the table and picture it writes, the engines beside it."""

import dataclasses
import math
import re
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest

import mbvi
from mbvi import reference
from mbvi.cli.names.schemes import SchemeName
from mbvi_studies.chart.cases import CASES, DEFAULT_CASES, MANY_CONSTRAINTS
from mbvi_studies.chart.costs import ROUNDING, cost, slope, table
from mbvi_studies.chart.errors import errors, fitted_order, sampled_errors
from mbvi_studies.chart.picture import draw
from mbvi_studies.chart.records import read_csv, write_csv
from mbvi_studies.chart.sweep import Case, sweep
from mbvi_studies.chart.workers import worker
from mbvi_studies.commands.chart import _tasks
from mbvi_studies.engines import PEERS
from mbvi_studies.engines.bodies import NoModelError, rotated
from mbvi_studies.engines.free_body import alone, placed, points, posed
from mbvi_studies.engines.measure import ModelError, check_free_motion, sweep_peer
from mbvi_studies.engines.rig import RIGS, rig
from support.paths import DOCS

STEPS = 1e-2 * 10.0 ** -np.linspace(0.03, 0.93, 8)


@pytest.fixture(scope="module")
def pendulum():
    return Case.of(reference.double_pendulum(0.5, duration=1.0))


@pytest.fixture(scope="module")
def records(pendulum):
    return (*sweep(pendulum, mbvi.Paoli(), STEPS), *sweep(pendulum, mbvi.EventDriven(1e-6), (1e-4, 1e-6, 1e-8)))


def test_a_sweep_finds_order_one_of_paolis_scheme(records):
    points = [r for r in records if r.scheme == "Paoli"]
    assert [r.step for r in points] == list(STEPS)
    for name in ("q", "v", "graph"):
        order = fitted_order(STEPS, [getattr(r, name) for r in points])
        assert order == pytest.approx(1.0, abs=0.2), (name, order)
    assert points[-1].energy < 0.2 * points[0].energy
    assert all(r.cpu > 0 and r.repeats == 3 and math.isnan(r.tolerance) for r in points)


def test_a_sweep_of_error_control_keeps_its_tolerances(records):
    points = [r for r in records if r.scheme == "EventDriven"]
    assert [r.tolerance for r in points] == [1e-4, 1e-6, 1e-8]
    for r in points:
        assert max(r.q, r.v, r.energy) < 10 * r.tolerance
        assert r.step > 1e-2


def test_errors_of_a_sampled_motion_are_those_of_the_steps(pendulum):
    """The two ways to compare a run agree on one that both take: v constant between steps."""
    run = mbvi.simulate(pendulum.problem, mbvi.Paoli(), step=2e-3, duration=1.0)
    expected = errors(run, pendulum.solution)
    found = sampled_errors(run.at, run.t, pendulum.solution, samples=4000)
    np.testing.assert_allclose(found, expected, rtol=0.02)


def test_the_energy_at_a_consistent_time_is_kept_in_a_constant_field():
    """At e = 1 the stagger m g h v / 2 is none of the scheme's errors: what is left is the one of late impacts, 0."""
    case = dataclasses.replace(Case.of(reference.bouncing_ball(1.0)), solution=None, plotted="energy")
    for scheme in (mbvi.Paoli(), mbvi.Centered()):
        (found,) = sweep(case, scheme, (3.1e-3,), repeats=1)
        assert found.error == found.energy < 1e-11 and math.isnan(found.q)


def test_a_table_comes_back_as_it_was_written(records, tmp_path):
    write_csv(records, tmp_path / "chart.csv")
    back = read_csv(tmp_path / "chart.csv")
    assert [repr(r) for r in back] == [repr(r) for r in records]
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(mbvi.InputError, match="is not a table of `mbvi chart`"):
        read_csv(tmp_path / "other.csv")


def test_the_picture_shows_every_point_on_two_labelled_panels(records):
    exact = dataclasses.replace(records[-1], q=1e-16)
    figure = draw((*records, exact), "a note")
    left, right = figure.axes
    assert "CPU time" in left.get_xlabel() and "step" in right.get_xlabel() and "error of q" in left.get_ylabel()
    assert left.get_title() == "double pendulum, e = 0.5, 1 s"
    for axes, abscissa in ((left, "cpu"), (right, "step")):
        assert axes.get_xscale() == axes.get_yscale() == "log"
        points = np.concatenate([line.get_xydata() for line in axes.lines])
        wanted = [(getattr(r, abscissa), max(r.q, ROUNDING)) for r in (*records, exact)]
        np.testing.assert_array_equal(sorted(map(tuple, points)), sorted(wanted))
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        assert ((points > (x0, y0)) & (points < (x1, y1))).all()
    labels = {text.get_text(): text.xy for text in right.texts}
    ours, events = sorted(labels, key=lambda text: not text.startswith("Paoli"))
    assert ours == f"Paoli: {slope(records[:8])}" and ours.startswith("Paoli: order 1.0")
    assert events.startswith("EventDriven: tolerance^")
    # names stand where the lines end
    assert labels[ours] == max((r.step, r.q) for r in records[:8])


def test_the_best_eight_lines_have_colors_and_no_two_names_overlap(records):
    paoli = records[:8]
    made = [dataclasses.replace(r, scheme=f"{k}", cpu=r.cpu * (1 + k)) for k in range(12) for r in paoli]
    left, right = draw(made).axes
    colors = {text.get_text().partition(":")[0]: text.get_color() for text in right.texts}
    assert [name for name, color in colors.items() if color == "0.55"] == ["8", "9", "10", "11"]
    assert [line.get_color() for axes in (left, right) for line in axes.lines].count("0.78") == 8
    # what leads to a name ends at its left end, beside other names
    assert {text.arrowprops["relpos"] for text in right.texts} == {(0.0, 0.5)}
    heights = sorted(text.xyann[1] for text in right.texts)
    assert len(heights) == 12 and np.diff(heights).min() > 0.03 and heights[-1] <= 1.0


def test_a_slope_is_that_of_the_points_above_rounding(records):
    made = [dataclasses.replace(records[0], step=h, q=3 * h**2) for h in (1e-2, 1e-3, 1e-4, 1e-9)]
    assert slope(made) == "order 2.00"
    assert slope([dataclasses.replace(r, q=1e-15) for r in made]) == "to rounding"


def test_every_reference_can_be_charted_under_its_name():
    assert all(make(1.0).name == name for name, make in reference.MAKERS.items())
    assert {*reference.MAKERS} <= set(CASES)
    assert {*DEFAULT_CASES, *MANY_CONSTRAINTS} <= set(CASES)


def test_many_spheres_are_what_they_say():
    case = CASES["elastic 666"](1.0)
    centres = case.problem.q0.reshape(-1, 3)
    assert len(centres) == 216 and centres[:, 2].min() == pytest.approx(1.101)
    assert case.problem.system.kinetic_energy(case.problem.q0, np.ones(648)) == pytest.approx(5 * 648)
    (found,) = sweep(dataclasses.replace(case, duration=0.05), mbvi.Paoli(), (1e-2,), repeats=1)
    # in flight
    assert found.error < 1e-8 * 216 * 98.1 and math.isnan(found.q)


def test_a_falling_robot_is_charted_by_its_penetration():
    case = CASES["anymal falling"](0.0)
    assert case.problem.system.nv == 18 and case.restitution == 0.0
    coarse, fine = sweep(dataclasses.replace(case, duration=0.1), mbvi.Paoli(), (4e-3, 1e-3), repeats=1)
    # feet land at the speed of a fall of 2 cm, and sink in by what a step takes them at most
    for found in (coarse, fine):
        assert 0.0 < found.error < found.step * np.sqrt(2 * 9.81 * 0.02)
        assert found.error == found.penetration and math.isnan(found.q)


def test_the_command_names_what_it_can_chart(command):
    code, out, err = command("chart", "--list")
    assert (code, err) == (0, "")
    lines = [line.strip() for line in out.splitlines()]
    assert {*CASES, "paoli", "event-driven"} <= set(lines)
    assert {f"{peer.name}: {'installed' if peer.installed else peer.install}" for peer in PEERS} <= set(lines)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("unicycle",), "no problem 'unicycle'; known are bouncing ball; "),
        (("rod", "--schemes", "paoli,euler"), "no scheme 'euler'; known are paoli; "),
        (("rod", "--e", "1.5"), "restitution e must lie in [0, 1]"),
        (("pile", "--schemes", "event-driven"), "nothing to chart"),
    ],
)
def test_what_cannot_be_charted_is_said_in_a_line(command, arguments, said):
    code, _, err = command("chart", *arguments)
    assert code == 2 and said in err and err.startswith("mbvi: ") and err.count("\n") == 1


def test_the_command_writes_picture_and_table(command, tmp_path):
    code, out, _ = command("chart", "corner-of-90-degrees", "--schemes", "paoli,event-driven", "--out", "made/corner")
    assert code == 0 and "Paoli" in out and "errors against" in out
    found = read_csv(tmp_path / "made/corner.csv")
    assert {r.scheme for r in found} == {"Paoli", "EventDriven"} and {r.problem for r in found} == {
        "corner of 90 degrees"
    }
    from matplotlib.image import imread

    pixels = imread(tmp_path / "made/corner.png")
    assert pixels.shape[0] > 300 and (pixels[..., :3].min(axis=2) < 0.9).mean() > 0.01
    assert "<svg" in (tmp_path / "made/corner.svg").read_text()[:1000]


def test_every_scheme_is_charted_by_default_but_event_driven_among_many_constraints():
    words = {name.value for name in SchemeName}
    tasks = [(problem, type(scheme).__name__) for problem, scheme in _tasks(["rod", "pile"], [])]
    assert len(tasks) == 2 * len(words) - 1
    assert ("rod", "EventDriven") in tasks and ("pile", "EventDriven") not in tasks
    assert {("rod", "StewartTrinkle"), ("pile", "StewartTrinkle")} <= set(tasks)


def test_the_cost_of_an_error_is_measured_or_carried_on_at_the_fitted_order(records):
    made = [dataclasses.replace(records[0], step=h, q=2 * h, cpu=1e-3 + 1e-5 / h) for h in (1e-2, 3e-3, 1e-3)]
    assert cost(made, 6e-3) == (made[1].cpu, False)
    time, carried = cost(made, 2e-5)
    assert carried and time == pytest.approx(1e-3 + 1.0)
    # what coarse steps cost is not carried on
    coarse = [dataclasses.replace(made[0], step=h, q=2 * h, cpu=0.5) for h in (4e-2, 2e-2)]
    assert cost([*coarse, *made], 2e-5)[0] == pytest.approx(time)
    assert cost([dataclasses.replace(r, q=0.1) for r in made], 1e-4) is None
    # more than a thousand times finer
    assert cost(made, 1e-6) is None


def told(name, e=0.5):
    case = CASES[name](e)
    return case, rig(case)


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_has_the_coordinates_of_its_case(name, rng):
    """To an engine's state and back; the speed and place of what touches are those of our constraints."""
    case, model = told(name)
    problem = case.problem
    for t in rng.uniform(0, case.duration, 5):
        q, v = case.solution.at(t)
        again, rate = model.coordinates(model.state(q, v))
        np.testing.assert_allclose(problem.system.difference(q, again), 0, atol=1e-12)
        np.testing.assert_allclose(rate, v, atol=1e-11)
    assert model.closing > 0.5 and model.mass > 0.5


@pytest.mark.slow
def test_mujoco_moves_as_we_do_in_free_flight():
    for name in RIGS:
        case, model = told(name)
        coarse, fine = check_free_motion(case, model, import_module("mbvi_studies.engines.in_mujoco"))
        # Euler's method, and no more
        assert fine == pytest.approx(0.1 * coarse, rel=0.05)


@pytest.mark.slow
def test_another_model_is_refused():
    """One moment of inertia a fiftieth too large: no smaller step brings that nearer."""
    case, model = told("tumbling body")
    other = dataclasses.replace(model, urdf=re.sub('iyy="(.*?)"', lambda m: f'iyy="{1.02 * float(m[1])}"', model.urdf))
    with pytest.raises(ModelError, match="not charted on tumbling body"):
        check_free_motion(case, other, import_module("mbvi_studies.engines.in_mujoco"))


@pytest.mark.slow
@pytest.mark.parametrize(("e", "told"), [(0.0, "omega h = 0.02"), (1.0, "omega h = 1 ")])
def test_mujoco_on_the_ball(e, told):
    """In a process of its own: at order one where its spring throws back exactly, or its damping takes all speed."""
    with worker() as call:
        found = call(sweep_peer, "in_mujoco", CASES["bouncing ball"], e, (3.1e-3, 1.1e-3, 4.3e-4))
    assert all(r.scheme.startswith("MuJoCo") and told in r.setting and r.cpu > 0 for r in found)
    errors = [r.q for r in found]
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.05, errors
    assert 0.7 < fitted_order([r.step for r in found], errors) < 1.4


def test_a_rig_without_joints_is_one_body(rng):
    """For engines that know no URDF: as heavy, of the same shape, and in the same coordinates."""
    for name, mass in (("bouncing ball", 1.0), ("tumbling body", 2.0)):
        case, rig_of = told(name)
        model = alone(rig_of, case.restitution)
        (body,) = model.bodies
        assert body.mass == mass and model.e == case.restitution and model.planes == rig_of.planes
        for t in rng.uniform(0, case.duration, 3):
            q, v = case.solution.at(t)
            again, rate = model.coordinates(model.state(q, v))
            np.testing.assert_allclose(case.problem.system.difference(q, again), 0, atol=1e-12)
            np.testing.assert_allclose(rate, v, atol=1e-11)
            poses = posed(rig_of.state(q, v))
            assert all((a == b).all() for a, b in zip(poses, posed(placed(poses)), strict=True))
            spin = rotated(poses.quaternion, poses.angular, -1.0)[0]
            energy = 0.5 * (mass * (poses.linear**2).sum() + body.inertia @ spin**2)
            assert energy == pytest.approx(case.problem.system.kinetic_energy(q, v), rel=1e-12)
        places, radius = points(body)
        # what touches a plane is as far off it as our constraints say
        q = case.problem.q0
        gap = posed(rig_of.state(q, case.problem.v0)).position[0, 2] + places[:, 2].min() - radius
        assert gap == pytest.approx(case.problem.constraints.active(0.0, q, 10.0).gap.min())
    for name in ("double pendulum", "quadruped landing"):
        with pytest.raises(NoModelError, match="joints"):
            alone(told(name)[1], 0.5)


SICONOS = next(peer for peer in PEERS if peer.name == "Siconos")
needs_siconos = pytest.mark.skipif(not SICONOS.installed, reason=SICONOS.install)


def test_an_engine_is_looked_for_in_the_python_that_it_is_for():
    assert not SICONOS._replace(python="/no/such/python").installed
    assert not SICONOS._replace(imported="no_such_package").installed
    assert not PEERS[0]._replace(imported="no_such_package").installed


@needs_siconos
def test_siconos_moves_as_we_do_in_free_flight():
    engine = import_module("mbvi_studies.engines.in_siconos")
    coarse, fine = check_free_motion(*told("bouncing ball"), engine)
    assert max(coarse, fine) < 1e-12
    coarse, fine = check_free_motion(*told("tumbling body"), engine)
    # the trapezoidal rule
    assert fine < 0.1 * coarse < 1e-7


@needs_siconos
@pytest.mark.parametrize("name", ["bouncing ball", "tumbling body"])
def test_siconos_is_as_near_as_our_scheme_of_the_same_name(name):
    """Moreau and Jean's, in other hands: of order one, with errors of the same size."""
    steps = (3.1e-3, 1.1e-3, 4.3e-4)
    theirs = sweep_peer("in_siconos", CASES[name], 0.5, steps)
    ours = sweep(CASES[name](0.5), mbvi.MoreauJean(0.5), steps)
    assert all(r.scheme.startswith("Siconos") and "theta = 0.5" in r.setting and r.cpu > 0 for r in theirs)
    assert 0.7 < fitted_order(steps, [r.q for r in theirs]) < 1.4
    assert all(0.4 < a.q / b.q < 2.5 for a, b in zip(theirs, ours, strict=True))


@needs_siconos
def test_a_mechanism_is_not_run_in_siconos_and_said_to_be(command, monkeypatch):
    monkeypatch.setattr("mbvi_studies.engines.PEERS", (SICONOS,))
    code, out, _ = command("chart", "double-pendulum", "--schemes", "event-driven", "--peers", "--out", "chart")
    assert code == 0 and "Siconos is not run on double pendulum: mechanisms with joints" in out
    assert {r.scheme for r in read_csv("chart.csv")} == {"EventDriven"}


@pytest.mark.slow
@pytest.mark.skipif(find_spec("jiminy_py") is None, reason="jiminy is not installed")
@pytest.mark.parametrize("e", [0.2, 0.5, 1.0])
def test_jiminys_contacts_throw_back_at_e(e):
    """In two processes of its own; its steps are none of ours, and it comes nearer with stiffness at order one."""
    with worker() as call:
        found = call(sweep_peer, "in_jiminy", CASES["double pendulum"], e, (8e-3, 4e-3, 2e-3))
    assert all(r.scheme.startswith("jiminy") and "throws back at e" in r.setting and r.cpu > 0 for r in found)
    errors = [r.q for r in found]
    assert errors[2] < 1e-3 and 0.7 < fitted_order([r.step for r in found], errors) < 1.4, errors


@pytest.mark.parametrize("name", ["charts", "charts_elastic"])
def test_the_numbers_of_the_page_are_those_of_its_tables(name):
    docs = DOCS / "benchmarks"
    assert table(read_csv(docs / f"{name}.csv"), 1e-4) in (docs / "charts.md").read_text()


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_the_quadruped_strikes_with_its_feet_only(e):
    """Joint limits and links are others in other engines."""
    case = CASES["quadruped landing"](e)
    run = mbvi.simulate(case.problem, mbvi.EventDriven(1e-8), duration=case.duration)
    names = {name for impact in run.impacts for name in impact.constraints}
    assert names == {f"quadruped/{leg}_foot | floor" for leg in ("FL", "FR", "RL", "RR")}
    assert len(run.impacts) == len(case.solution.impacts)
