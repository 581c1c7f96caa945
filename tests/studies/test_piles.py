"""`mbvi chart piles`: the scenes are the same in all engines, and the command writes what it measured."""

import dataclasses
import math

import numpy as np
import pytest

import mbvi
from mbvi_studies.chart import piles
from mbvi_studies.chart.pile_picture import draw_piles, pile_table
from mbvi_studies.chart.pile_runs import PileRecord, run_ours, run_peer, sweep_ours, sweep_peer_piles
from mbvi_studies.chart.records import read_table, write_table
from mbvi_studies.engines import PEERS
from mbvi_studies.engines.piles_in_mujoco import PileInMuJoCo, variants
from support.paths import DOCS

MAKERS = {"spheres": piles.spheres, "boxes": piles.boxes, "mixed": piles.mixed}
H = 2e-3


@pytest.fixture
def few(monkeypatch):
    """A picture of small piles."""
    scenes = {name: lambda make=make: dataclasses.replace(make(9), duration=0.1) for name, make in MAKERS.items()}
    monkeypatch.setitem(piles.PICTURES, "few", piles.Scenes("A few bodies", scenes))
    return "few"


@pytest.fixture
def records(few):
    found = []
    for scene in ("spheres", "boxes"):
        found += sweep_ours(few, scene, (H,), (1e-2, 1e-3), 60.0)
        found += sweep_peer_piles("piles_in_mujoco", few, scene, (H, 1e-3), 60.0)
    return found


@pytest.mark.parametrize("name", MAKERS)
def test_poses_of_a_pile_are_its_configuration(name):
    pile = MAKERS[name](50)
    problem = pile.problem()
    q = pile.configuration(pile.centres, pile.turns)
    # a quaternion and its negative are one rotation
    assert np.abs(problem.system.difference(problem.q0, q)).max() < 1e-12
    assert len(pile.shapes) == 50 and len(pile.planes) == 5
    assert all((pile.centres @ normal > offset).all() for normal, offset in pile.planes)


def test_piles_of_the_picture_are_as_large_as_they_say():
    made = {name: make() for name, make in piles.PICTURES["piles"].scenes.items()}
    assert {name: len(pile.shapes) for name, pile in made.items()} == {"spheres": 1000, "boxes": 200, "mixed": 200}
    assert {type(shape).__name__ for shape in made["mixed"].shapes} == {"Box", "Capsule", "Sphere"}


@pytest.mark.parametrize("module", [peer.piles for peer in PEERS if peer.piles and peer.installed])
@pytest.mark.parametrize("name", MAKERS)
def test_other_engines_run_the_same_pile(module, name):
    engine = pytest.importorskip(f"mbvi_studies.engines.{module}")
    pile = MAKERS[name](12)
    made = engine.variants(pile)[0].make(pile, 1e-3)
    centres, turns = made.read()
    assert np.allclose(centres, pile.centres, atol=1e-9)
    assert np.allclose(np.abs((turns * pile.turns).sum(axis=1)), 1.0, atol=1e-9)
    for _ in range(20):
        made.advance()
    centres, turns = made.read()
    # all in free fall from rest, to the order of the engine
    fallen = 0.5 * 9.81 * 0.02**2
    assert np.allclose(centres - pile.centres, [0.0, 0.0, -fallen], atol=0.1 * fallen)
    assert np.allclose(np.abs((turns * pile.turns).sum(axis=1)), 1.0, atol=1e-6)


def test_the_depth_of_another_engine_is_that_of_its_configurations():
    """A ball resting on the floor of MuJoCo's own soft contacts is as deep as its height says."""
    pile = dataclasses.replace(piles.spheres(1), duration=0.5)
    engine = PileInMuJoCo(pile, H, 2 * H)
    lowest = np.inf
    for _ in range(250):
        engine.advance()
        lowest = min(lowest, engine.read()[0][0, 2])
    found = run_peer(pile, variants(pile)[0], H)
    assert found.depth == pytest.approx((0.02 - lowest) / 0.02, rel=1e-6) and 0.0 < found.end <= found.depth
    assert found.cpu > 0.0 and math.isnan(found.residual)


def test_ours_stays_within_the_depth_that_the_record_gives():
    pile = dataclasses.replace(piles.spheres(40), duration=0.3)
    found = run_ours(pile, H, 1e-3)
    assert 0.0 < found.depth <= 1e-3 and 0.0 < found.residual <= 1e-3
    assert run_ours(pile, H, residual=1e-8).residual <= 1e-8


def test_records_come_back_as_they_were_written(records, tmp_path):
    write_table(records, tmp_path / "piles.csv", PileRecord)
    back = read_table(tmp_path / "piles.csv", PileRecord)
    assert repr(list(back)) == repr(records)
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(mbvi.InputError, match="its columns differ"):
        read_table(tmp_path / "other.csv", PileRecord)


def test_steps_beyond_the_budget_are_left_out(few):
    every = sweep_peer_piles("piles_in_mujoco", few, "spheres", (H, 1e-3), 60.0)
    assert [r.step for r in every] == [H, 1e-3] * 2
    # two runs of the first step: one of the second would cost a hundred times as much
    two = 2.0 * max(r.cpu * r.duration for r in every if r.step == H)
    first = sweep_peer_piles("piles_in_mujoco", few, "spheres", (H, 1e-5), two)
    assert [r.step for r in first] == [H] * 2
    with pytest.raises(mbvi.MbviError, match="needs over 2e-09 s of CPU time for 9 spheres at h"):
        sweep_peer_piles("piles_in_mujoco", few, "spheres", (H, 1e-3), 1e-9)


def test_the_picture_has_a_panel_for_each_scene_and_one_legend(records):
    figure = draw_piles(records)
    assert [axes.get_ylabel() for axes in figure.axes] == ["worst depth [radii]", "worst depth [edges]"]
    assert all(axes.get_xlabel() == "CPU time per simulated second [s / s]" for axes in figure.axes)
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} == {r.line for r in records}
    assert sum(len(axes.texts) for axes in figure.axes) == len(records)
    assert pile_table(records).count("\n") == len(records) + 1


def test_the_table_of_the_page_is_that_of_its_file():
    records = read_table(DOCS / "benchmarks/piles.csv", PileRecord)
    assert pile_table(records) in (DOCS / "benchmarks/piles.md").read_text()
