"""`mbvi chart piles` and `mbvi chart friction`: errors, the list of scenes, and the files that are written."""

import math

import pytest
from matplotlib.image import imread

from mbvi_studies.chart.friction_runs import FrictionRecord
from mbvi_studies.chart.pile_runs import PileRecord
from mbvi_studies.chart.records import read_table


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("piles", "cones"), "no scene 'cones' of piles; known are spheres; boxes; mixed"),
        (("friction", "ice"), "no scene 'ice' of friction; known are incline; steeper-incline"),
        *(((name, "--schemes", "paoli"), "leave out --schemes") for name in ("piles", "friction")),
        *(((name, "--budget", "0"), "budget must be") for name in ("piles", "friction")),
        (("rod", "--budget", "1"), "--budget is an option of piles"),
    ],
)
def test_what_cannot_be_charted_is_said_in_a_line(command, arguments, said):
    code, _, err = command("chart", *arguments)
    assert code == 2 and said in err and err.count("\n") == 1


def test_the_command_lists_the_scenes(command):
    code, out, _ = command("chart", "--list")
    assert code == 0
    assert "scenes of piles: spheres; boxes; mixed" in out
    assert "scenes of friction: incline; steeper-incline" in out


@pytest.mark.slow(seconds=12)
@pytest.mark.parametrize(
    ("name", "scene", "record", "row"),
    [
        ("piles", "boxes", PileRecord, "| 200 boxes | mbvi | 4 | 0.01 |"),
        ("friction", "launched-block", FrictionRecord, "| block launched along a floor | mbvi, Paoli | 4 |"),
    ],
)
def test_the_command_writes_picture_and_table(command, tmp_path, name, scene, record, row):
    code, out, _ = command("chart", name, scene, "--peers", "--budget", "0.5", "--out", "made/chart")
    assert code == 0 and row in out
    found = read_table(tmp_path / "made/chart.csv", record)
    assert {r.scene for r in found} == {scene} and any(r.line.startswith("MuJoCo") for r in found)
    if record is FrictionRecord:
        assert not any(math.isnan(r.error) for r in found)
    else:
        # depths are given relative to half an edge, and drawn relative to an edge
        assert all(r.depth <= 0.5 * r.accuracy for r in found if not math.isnan(r.accuracy))
    assert imread(tmp_path / "made/chart.png").shape[0] > 300
    assert "<svg" in (tmp_path / "made/chart.svg").read_text()[:1000]
