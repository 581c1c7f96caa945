"""`mbvi chart friction`: the scenes are the same in all engines, and the command writes what it measured."""

import dataclasses

import numpy as np
import pytest

import mbvi
from mbvi_studies.chart import piles
from mbvi_studies.chart.friction import ROUGH
from mbvi_studies.chart.friction_picture import draw_friction, friction_summary, friction_table
from mbvi_studies.chart.friction_runs import FrictionRecord, problem_of, run_other, run_ours, sweep_other, sweep_ours
from mbvi_studies.chart.records import read_table, write_table
from mbvi_studies.engines import PEERS
from mbvi_studies.engines.friction_in_mujoco import VARIANTS
from support.paths import DOCS

SHORT = ("launched-block", "spinning-tripod", "painleve-rod")
MODULES = [peer.friction for peer in PEERS if peer.friction and peer.installed]


@pytest.fixture(scope="module")
def records():
    return [
        *sweep_ours("launched-block", (4e-3, 2e-3), 60.0),
        *sweep_other("friction_in_mujoco", "launched-block", (4e-3,), 60.0),
    ]


@pytest.mark.parametrize("name", ROUGH)
def test_the_start_of_a_scene_is_that_of_its_problem(name):
    rough, problem = ROUGH[name](), problem_of(ROUGH[name]())
    np.testing.assert_allclose(problem.q0[:3], rough.start.position, atol=1e-15)
    np.testing.assert_allclose(np.abs(problem.q0[3:7] @ rough.start.quaternion), 1.0, atol=1e-15)
    np.testing.assert_allclose(problem.q0[7:], rough.start.angles, atol=1e-15)
    assert np.linalg.norm(rough.gravity) == pytest.approx(9.81)
    assert rough.what.endswith("]") and rough.sampled[-1] == rough.duration


@pytest.mark.parametrize("module", MODULES)
@pytest.mark.parametrize("name", ROUGH)
def test_other_engines_start_where_the_scene_does(module, name):
    engine = pytest.importorskip(f"mbvi_studies.engines.{module}")
    rough = ROUGH[name]()
    made = engine.VARIANTS[0].make(rough, 1e-3)
    state = made.read()
    np.testing.assert_allclose(state.position, rough.start.position, atol=1e-7)
    np.testing.assert_allclose(np.abs(state.quaternion @ rough.start.quaternion), 1.0, atol=1e-7)
    np.testing.assert_allclose(state.angles, rough.start.angles, atol=1e-7)
    np.testing.assert_allclose(state.linear, rough.start.linear, atol=1e-7)
    made.advance()
    # nothing is thrown about
    np.testing.assert_allclose(made.read().position, rough.start.position, atol=5e-3)


@pytest.mark.parametrize("module", MODULES)
@pytest.mark.parametrize("name", SHORT)
def test_other_engines_come_near_the_exact_solution(module, name):
    """All have the same mass, coefficient and shape: a wrong one is off by more than this."""
    engine = pytest.importorskip(f"mbvi_studies.engines.{module}")
    best = min(run_other(ROUGH[name](), variant, 1e-3)[1] for variant in engine.VARIANTS)
    assert best < 0.01


@pytest.mark.parametrize("name", SHORT)
def test_ours_converges_to_the_exact_solution(name):
    found = [run_ours(ROUGH[name](), mbvi.Paoli(), h)[1] for h in (4e-3, 1e-3)]
    assert found[0] < 0.03 and found[1] < 0.4 * found[0]


def test_records_come_back_as_they_were_written(records, tmp_path):
    write_table(records, tmp_path / "friction.csv", FrictionRecord)
    assert list(read_table(tmp_path / "friction.csv", FrictionRecord)) == records


def test_steps_beyond_the_budget_are_left_out():
    found = sweep_other("friction_in_mujoco", "launched-block", (4e-3, 1e-6), 1.0)
    assert [r.step for r in found] == [4e-3] * len(VARIANTS)


def test_the_picture_has_a_panel_for_each_scene_and_one_legend(records):
    figure = draw_friction(records)
    assert [axes.get_ylabel() for axes in figure.axes] == ["error of the stop [m]"]
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} == {r.line for r in records}
    assert friction_table(records).count("\n") == len(records) + 1


def test_the_table_of_the_page_is_that_of_its_file():
    records = read_table(DOCS / "benchmarks/friction.csv", FrictionRecord)
    assert friction_summary(records, 1e-3) in (DOCS / "benchmarks/friction.md").read_text()


def test_piles_with_friction_turn_their_spheres():
    made = {name: make() for name, make in piles.PICTURES["rough-piles"].scenes.items()}
    assert {pile.mu for pile in made.values()} == {0.5}
    for pile in made.values():
        few = dataclasses.replace(
            pile, shapes=pile.shapes[-6:], centres=pile.centres[-6:], turns=pile.turns[-6:], duration=0.05
        )
        problem = few.problem()
        assert few.turning == 6 and problem.system.nv == 36
        # how a sphere is turned at the start does not matter
        found = few.configuration(few.centres, few.turns).reshape(6, 7)
        np.testing.assert_allclose(problem.q0.reshape(6, 7)[:, :3], found[:, :3], atol=1e-15)
