"""Friction in a replay: cones, arrows in the colors of stick and slip, stripes on spheres that roll."""

import base64
import dataclasses
import zlib

import numpy as np
import pytest

import mbvi
from mbvi.results.replay.browser import Browser
from mbvi.results.replay.marks import ARROW, CONE, NORMAL, SLIPS, SMOOTH, STICKS, arrows, marks
from mbvi.results.replay.motion import motion
from mbvi.results.replay.replay import page_of
from support.browser import HEIGHT, WIDTH, click, look, needs_browser, shown


def thrown(friction):
    scene = mbvi.Scene(friction=friction, restitution=0.2)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.3), velocity=(1.6, 0.2, 0), name="brick")
    scene.add_sphere(0.1, 1.0, position=(0.2, -0.4, 0.3), velocity=(1, 0, -1), name="ball")
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.8, record="contacts", progress=False)


@pytest.fixture(scope="module")
def run():
    return thrown(0.3)


def bare(run):
    return dataclasses.replace(run, record=dataclasses.replace(run.record, contacts=None))


def test_arrows_have_the_direction_of_the_percussion_and_its_regime(run):
    rows = {
        (i.time, *i.point[k]): (i.percussion[k] * i.normal[k] + i.tangential[k], i.regime[k])
        for i in run.impacts
        for k in range(len(i.percussion))
    }
    shown, drawn = arrows(run), marks(bare(run), motion(run), 1.0)
    drawn = drawn[drawn[:, 2] == ARROW]
    assert len(shown) == len(rows) == len(drawn) and {regime for _, regime in rows.values()} == {"stick", "slip"}
    for arrow, row in zip(shown, drawn, strict=True):
        percussion, regime = rows[(arrow.time, *arrow.point)]
        np.testing.assert_allclose(row[7:10], percussion / np.linalg.norm(percussion), rtol=0, atol=1e-14)
        assert row[3] == (STICKS if regime == "stick" else SLIPS)


def test_every_percussion_lies_in_its_cone(run):
    rows = marks(bare(run), motion(run), 1.0)
    cones, found = rows[rows[:, 2] == CONE], rows[rows[:, 2] == ARROW]
    assert len(cones) == len(found)
    np.testing.assert_allclose(cones[:, 10] / cones[:, 11], 0.3)
    np.testing.assert_array_equal(cones[:, 3:7], found[:, 3:7])
    along = (cones[:, 7:10] * found[:, 7:10]).sum(axis=1)
    assert (np.sqrt(np.maximum(1.0 - along**2, 0.0)) <= 0.3 * along + 1e-12).all()


@pytest.mark.parametrize("kind", [ARROW, CONE, NORMAL])
def test_recorded_contacts_have_marks_where_and_while_they_are_closed(run, kind):
    moves = motion(run)
    rows = marks(run, moves, 1.0)
    rows = rows[(rows[:, 2] == kind) & (rows[:, 1] > rows[:, 0])]
    for begin, end in zip(moves.times, np.append(moves.times[1:], np.inf), strict=True):
        mine = rows[rows[:, 0] == begin]
        contacts = {tuple(c.point): c for c in run.contacts(begin)}
        assert (mine[:, 1] == end).all() and {tuple(row[4:7]) for row in mine} == set(contacts)
        for row in mine:
            contact = contacts[tuple(row[4:7])]
            assert row[3] == (STICKS if contact.regime == "stick" else SLIPS)
            if kind != ARROW:
                np.testing.assert_allclose(row[7:10], contact.normal, rtol=0, atol=1e-14)
    assert len(rows) > 50 and set(rows[:, 3]) == {STICKS, SLIPS}


def test_only_scenes_with_friction_have_cones_and_stripes(run):
    smooth = thrown(0.0)
    for each, rough in ((run, True), (smooth, False)):
        data = page_of(each).data
        assert data["frictional"] == rough
        assert any(group["striped"] for group in data["groups"]) == rough
        rows = np.frombuffer(zlib.decompress(base64.b64decode(data["marks"])), np.float32).reshape(-1, 14)
        assert (CONE in rows[:, 2]) == rough
        assert (SMOOTH in rows[rows[:, 2] == NORMAL, 3]) != rough


def test_marks_know_the_bodies_that_touch(run):
    moves = motion(run)
    names = {moves.driven + k: run.problem.system.bodies[body] for k, body in enumerate(moves.bodies)}
    rows = marks(run, moves, 1.0)
    assert set(rows[:, 13]) == {-1.0}
    brick = {name for column, name in names.items() if column in set(rows[rows[:, 0] > 0.7, 12])}
    assert brick == {"brick", "ball"}


@needs_browser
def test_a_browser_shows_and_hides_the_cones_of_a_chosen_body(run, tmp_path):
    run.replay_html(tmp_path / "run.html")
    with Browser(WIDTH, HEIGHT) as browser:
        shown(browser, tmp_path / "run.html")
        look(browser, 0.75)
        assert browser.evaluate("replay.marks.meshes[1].count") == 0
        browser.evaluate("$('body').value = DATA.driven + DATA.names.indexOf('brick'); $('body').onchange()")
        late = look(browser, 0.75)
        # the cones of the chosen body only
        assert browser.evaluate("replay.marks.meshes[1].count") == 4
        click(browser, "#cones")
        hidden = look(browser, 0.75)
    # beside the controls
    differs = (late != hidden).any(axis=2)[:, : WIDTH - 270]
    assert 50 < differs.sum() < 0.2 * differs.size
