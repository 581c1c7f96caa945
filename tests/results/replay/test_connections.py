"""Connections in a replay: their marks move with both bodies, and can be hidden."""

import base64
import zlib

import numpy as np
import pytest

import mbvi
from mbvi.results.replay.browser import Browser
from mbvi.results.replay.marks import connection_marks
from mbvi.results.replay.motion import motion
from mbvi.results.replay.replay import page_of
from support.browser import HEIGHT, WIDTH, click, look, needs_browser, shown

COLOR = (0x8E, 0x24, 0xAA)


def chain(connected=True):
    """Two rods that hang on each other and on the world, and a box welded to the last one."""
    scene = mbvi.Scene()
    for k, name in enumerate(("upper", "lower")):
        scene.add_box((0.3, 0.04, 0.04), 1.0, position=(0.15 + 0.3 * k, 0, 1), name=name)
    scene.add_box((0.1, 0.1, 0.1), 0.5, position=(0.7, 0, 1), name="weight")
    if connected:
        scene.hinge("world", "upper", at=(0, 0, 1), axis=(0, 1, 0))
        scene.connect("upper", "lower", at=(0.3, 0, 1))
        scene.weld("lower", "weight")
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=2e-3, duration=0.5, progress=False)


@pytest.fixture(scope="module")
def run():
    return chain()


def test_a_mark_is_the_common_point_of_both_bodies(run):
    """The world's point stays, that of the rods is at both ends, and a weld is marked on its second body."""
    moves, placed = motion(run), connection_marks(run)
    names = [run.problem.system.bodies[one.body] for one in placed]
    assert names == ["upper", "lower", "weight"]
    for f in (0, 11, -1):
        q, _ = run.at(float(moves.times[f]))
        poses = dict(zip(names, run.problem.system.placements(q, np.array([one.body for one in placed])), strict=True))
        at = [one.position @ poses[name][:3] + poses[name][3] for name, one in zip(names, placed, strict=True)]
        end = np.array([0.15, 0, 0]) @ poses["upper"][:3] + poses["upper"][3]
        np.testing.assert_allclose(at, [(0, 0, 1), end, poses["weight"][3]], rtol=0, atol=1e-11)


def test_the_mark_of_a_loop_of_the_second_robot_is_on_its_link():
    scene = mbvi.Scene()
    for k in range(2):
        place = (0, 2.0 * k, 1)
        scene.add_urdf("robot:double_pendulum", base="fixed", position=place, name=f"p{k}")
    problem = scene.build()
    last = len(problem.system.bodies) - 1
    point = problem.system.placements(problem.q0, np.array([last]))[0, 3]
    scene.connect("world", "p1/lower_link", at=point)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.01, progress=False)
    (one,) = connection_marks(run)
    # numbered as in the whole scene, though the loop is one of the second robot alone
    assert one.body == last
    np.testing.assert_allclose(one.position, 0.0, atol=1e-12)


def test_only_scenes_with_connections_have_a_group_of_marks(run):
    groups = page_of(run).data["groups"]
    assert [group["connections"] for group in groups].count(True) == 1 and groups[-1]["connections"]
    columns = np.frombuffer(zlib.decompress(base64.b64decode(groups[-1]["columns"])), np.int32)
    assert columns.tolist() == [0, 1, 2]
    assert not any(group["connections"] for group in page_of(chain(connected=False)).data["groups"])


@needs_browser
def test_a_browser_lists_coupled_joints(run, tmp_path):
    scene = mbvi.Scene()
    for k in range(2):
        scene.add_urdf("robot:double_pendulum", base="fixed", position=(0, 2.0 * k, 1), name=f"p{k}")
    scene.couple("p0/shoulder", "p1/shoulder", ratio=2, name="belt <i>")
    pendulums = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.01, progress=False)
    pendulums.replay_html(tmp_path / "coupled.html")
    run.replay_html(tmp_path / "run.html")
    with Browser(WIDTH, HEIGHT) as browser:
        shown(browser, tmp_path / "coupled.html")
        listed = "[...document.querySelectorAll('#couplings div')].map(one => one.textContent)"
        assert browser.evaluate(listed) == ["belt <i>: p0/shoulder = 2 p1/shoulder + 0"]
        visible = "document.querySelector('#couplings div').checkVisibility()"
        assert not browser.evaluate(visible)
        click(browser, "#couplings summary")
        assert browser.evaluate(visible)
        shown(browser, tmp_path / "run.html")
        assert browser.evaluate("$('couplings').hidden")


@needs_browser
def test_a_browser_shows_and_hides_the_marks(run, tmp_path):
    run.replay_html(tmp_path / "run.html")
    chain(connected=False).replay_html(tmp_path / "free.html")

    def marked(picture):
        # beside the controls
        return int((np.abs(picture[:, : WIDTH - 270].astype(int) - COLOR).max(axis=2) < 25).sum())

    with Browser(WIDTH, HEIGHT) as browser:
        shown(browser, tmp_path / "run.html")
        assert marked(look(browser, 0.2)) > 20
        click(browser, "#connections")
        assert marked(look(browser, 0.2)) == 0
        click(browser, "#connections")
        # no color of bodies is theirs
        browser.evaluate("$('color').value = 'speed'; $('color').onchange()")
        assert marked(look(browser, 0.2)) > 20
        shown(browser, tmp_path / "free.html")
        assert browser.evaluate("$('with-connections').hidden") and marked(look(browser, 0.2)) == 0
