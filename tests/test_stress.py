"""The stress scenes: that they start, that verdicts follow from numbers, and what the command writes."""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import mbvi
from mbvi.cli import app
from mbvi.stress.scene import StressScene
from mbvi.stress.scenes import SCENES
from mbvi.stress.sweep import SCHEMES, cell

NAMES = {scene.name: scene for scene in SCENES}


def test_names_and_bounds_are_in_order():
    assert len(NAMES) == len(SCENES)
    assert all(0.0 <= scene.held < scene.failed for scene in SCENES)


@pytest.mark.parametrize("scene", SCENES, ids=NAMES)
def test_every_scene_starts_well(scene):
    """Its number is a finite one that holds right after the start."""
    run = mbvi.simulate(scene.make(1e-3), mbvi.Centered(), duration=2e-4, step=1e-4)
    assert scene.verdict(scene.measure(run)) == "held"


def test_verdicts_follow_from_the_number():
    scene = NAMES["rocking block"]
    found = [scene.verdict(x) for x in (0.0, scene.held, 2 * scene.held, 2 * scene.failed, np.inf, np.nan)]
    assert found == ["held", "held", "degraded", "failed", "failed", "failed"]


def test_a_cell_says_what_went_wrong_or_that_it_took_too_long():
    scene = NAMES["rocking block"]
    good = cell(scene, "Centered", mbvi.Centered(), 1.03e-3, 60.0)
    assert (good.verdict, good.said) == ("held", "")
    assert 0.0 < good.value < scene.held

    def explode(run):
        raise mbvi.MbviError("no number")

    bad = StressScene("bad", scene.make, 1e-2, explode, "nothing", 0.0, 1.0)
    assert cell(bad, "Paoli", mbvi.Paoli(), 1e-3, 60.0).said == "MbviError: no number"
    elastic = cell(scene, "StewartTrinkle", mbvi.StewartTrinkle(), 1e-3, 60.0)
    assert elastic.verdict == "refused" and "StewartTrinkle is for e = 0" in elastic.said

    def mistaken(h):
        raise mbvi.InputError("no scene")

    wrong = cell(dataclasses.replace(scene, make=mistaken), "Paoli", mbvi.Paoli(), 1e-3, 60.0)
    assert (wrong.verdict, wrong.said) == ("failed", "InputError: no scene")
    slow = cell(scene, "Centered", mbvi.Centered(), 1e-6, 0.05)
    assert (slow.verdict, slow.value) == ("too slow", np.inf)


def test_the_command_writes_numbers_and_a_picture(tmp_path):
    asked = ["stress", "rocking", "stretch", "--step", "0.01", "--tolerance", "1e-6", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, asked, catch_exceptions=False)
    assert result.exit_code == 0
    assert "EventDriven: 2 held" in result.stdout
    told = json.loads((tmp_path / "stress.json").read_text())
    assert [scene["name"] for scene in told["scenes"]] == ["rocking block", "arm at full stretch"]
    assert len(told["cells"]) == 2 * (len(SCHEMES) + 1)
    assert {c["step"] for c in told["cells"]} == {0.0103, 1e-6}
    from matplotlib.image import imread

    picture = imread(tmp_path / "stress.png")[..., :3]
    # held is green, and there is text
    assert np.isclose(picture, np.array([0xB7, 0xDF, 0xB0]) / 255, atol=0.01).all(axis=-1).mean() > 0.1
    assert picture.min() < 0.1
    assert "<svg" in (tmp_path / "stress.svg").read_text()


def test_what_the_picture_needs_is_asked_before_the_sweep(tmp_path, monkeypatch):
    def start(*arguments):
        raise AssertionError("the sweep has begun")

    monkeypatch.setattr("mbvi.stress.sweep.sweep", start)
    (tmp_path / "file").touch()
    found = CliRunner().invoke(app, ["stress", "rocking", "--out", str(tmp_path / "file/out")])
    assert isinstance(found.exception, mbvi.TrajectoryFileError)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    found = CliRunner().invoke(app, ["stress", "rocking", "--out", str(tmp_path)])
    assert isinstance(found.exception, mbvi.InputError) and "pip install matplotlib" in str(found.exception)


def test_scenes_are_listed_and_unknown_ones_refused():
    listed = CliRunner().invoke(app, ["stress", "--list"]).stdout
    assert all(scene.name in listed for scene in SCENES)
    result = CliRunner().invoke(app, ["stress", "no such scene"])
    assert isinstance(result.exception, mbvi.InputError)


def test_the_page_says_what_the_file_holds():
    """docs/stability.md: the table's numbers are those of docs/stress.json, and every scene's cause is told."""
    docs = Path(__file__).parents[1] / "docs"
    told, page = json.loads((docs / "stress.json").read_text()), (docs / "stability.md").read_text()
    assert {scene["name"] for scene in told["scenes"]} == {scene.name for scene in SCENES if not scene.long}
    table = {line.split(" | ")[0].strip("| "): line for line in page.splitlines() if line.startswith("| ")}
    causes = page.split("## Causes")[1]
    for scene in told["scenes"]:
        name = scene["name"]
        assert name.split(",")[0].rsplit(" 1e", 1)[0] in causes
        for scheme, step in (("Centered, positions projected", 1.03e-3), ("EventDriven", 1e-8)):
            found = [c for c in told["cells"] if (c["scene"], c["scheme"]) == (name, scheme)]
            own = next(c for c in found if c["step"] == pytest.approx(step))
            assert (f"{own['value']:.0e}" if own["value"] is not None else own["verdict"]) in table[name]
