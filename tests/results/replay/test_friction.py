"""Friction in a replay: cones, arrows in the colors of stick and slip, stripes on spheres that roll."""

import dataclasses

import meshcat
import numpy as np
import pytest

import mbvi
from mbvi.results.replay.friction import contact_cones
from mbvi.results.replay.keyframes import arrows, motion
from mbvi.results.replay.page import Page
from mbvi.results.replay.replay import stage
from support.browser import look, needs_browser

SLIP, STICK = (0xD8, 0x1B, 0x4A), (0x15, 0x65, 0xC0)


def thrown(friction):
    scene = mbvi.Scene(friction=friction, restitution=0.2)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.3), velocity=(1.6, 0.2, 0), name="brick")
    scene.add_sphere(0.1, 1.0, position=(0.2, -0.4, 0.3), velocity=(1, 0, -1), name="ball")
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.8, record="contacts", progress=False)


@pytest.fixture(scope="module")
def run():
    return thrown(0.3)


def drawn(run):
    page = Page()
    vis = meshcat.Visualizer(window=page)
    vis.set_animation(stage(vis, run))
    return page


def colour(command):
    found = command["object"]["materials"][0]["color"]
    return found >> 16, found >> 8 & 255, found & 255


def objects(page, part):
    return {c["path"]: c for c in page.commands if c["type"] == "set_object" and part in c["path"]}


def test_arrows_have_the_direction_of_the_percussion_and_the_colour_of_its_regime(run):
    rows = {
        (i.time, *i.point[k]): (i.percussion[k] * i.normal[k] + i.tangential[k], i.regime[k])
        for i in run.impacts
        for k in range(len(i.percussion))
    }
    shown, meshes = arrows(run), objects(drawn(run), "/percussions/")
    assert len(shown) == len(rows) and {regime for _, regime in rows.values()} == {"stick", "slip"}
    for k, arrow in enumerate(shown):
        percussion, regime = rows[(arrow.time, *arrow.point)]
        np.testing.assert_allclose(arrow.direction, percussion / np.linalg.norm(percussion), rtol=0, atol=1e-14)
        assert colour(meshes[f"/meshcat/percussions/{k}"]) == (STICK if regime == "stick" else SLIP)


def test_every_percussion_lies_in_its_cone(run):
    page = drawn(run)
    cones = {c["path"]: np.reshape(c["matrix"], (4, 4)).T for c in page.commands if "/friction/impact" in c["path"]
             and c["type"] == "set_transform"}  # fmt: skip
    shown = arrows(run)
    assert len(cones) == len(shown)
    for k, arrow in enumerate(shown):
        axes = cones[f"/meshcat/friction/impact {k}"]
        np.testing.assert_allclose(axes[:3, 3], arrow.point)
        radius, height = np.linalg.norm(axes[:3, 0]), np.linalg.norm(axes[:3, 2])
        np.testing.assert_allclose(axes[:3, 2] / height, arrow.normal, rtol=0, atol=1e-14)
        assert radius / height == pytest.approx(0.3)
        along = arrow.direction @ arrow.normal
        assert np.sqrt(max(1.0 - along**2, 0.0)) <= 0.3 * along + 1e-12


def test_recorded_contacts_have_cones_where_and_while_they_are_closed(run):
    moves = motion(run)
    cones = contact_cones(run, moves)
    # four corners of the brick, and the ball
    assert len(cones) == 5 and all(cone.friction == 0.3 for cone in cones)
    for cone in cones:
        for frame, sticks, point in zip(cone.frame, cone.sticks, cone.point, strict=True):
            contacts = run.contacts(moves.instants[frame])
            (same,) = [c for c in contacts if np.array_equal(c.point, point)]
            assert same.regime == ("stick" if sticks else "slip")
        normal = np.vecdot(cone.percussion, cone.normal)
        across = np.linalg.norm(cone.percussion - normal[:, None] * cone.normal, axis=1)
        assert (across <= 0.3 * normal * (1 + 1e-9)).all()
    closed = sum(len(run.contacts(t)) for t in moves.instants[moves.frame])
    assert closed == sum(len(cone.frame) for cone in cones)
    assert any(cone.sticks.any() and not cone.sticks.all() for cone in cones)
    bare = dataclasses.replace(run, record=dataclasses.replace(run.record, contacts=None))
    assert contact_cones(bare, moves) == []


@pytest.mark.parametrize("part", ["friction", "percussions"])
def test_one_cone_and_one_arrow_of_a_contact_are_seen_at_a_time(part, run):
    page, moves = drawn(run), motion(run)
    clips = {a["path"]: a["clip"] for a in page.commands[-1]["animations"] if f"/{part}/contact" in a["path"]}
    for k, cone in enumerate(contact_cones(run, moves)):
        for word, wanted in (("slip", False), ("stick", True)):
            clip = clips.get(f"/meshcat/{part}/contact {k} {word}")
            seen = np.zeros(len(moves.times), bool)
            if clip is not None:
                (visible,) = [t for t in clip["tracks"] if t["type"] == "boolean"]
                times, values = zip(*((key["time"], key["value"]) for key in visible["keys"]), strict=True)
                assert times[0] == 0.0 and times[-1] == moves.times[-1]
                seen = np.array(values)[np.searchsorted(times, moves.times, side="right") - 1]
            expected = np.isin(np.arange(len(moves.times)), cone.frame[cone.sticks == wanted])
            np.testing.assert_array_equal(seen[moves.frame], expected[moves.frame])


def test_only_scenes_with_friction_have_cones_stripes_and_a_toggle(run, tmp_path):
    smooth = thrown(0.0)
    assert not objects(drawn(smooth), "/friction/") and 'id="cones"' not in drawn(smooth).html()
    assert 'id="cones"' in drawn(run).html()
    (ball,) = [c for path, c in objects(drawn(run), "/bodies/").items() if "ball" in path]
    assert ball["object"]["materials"][0]["vertexColors"]
    (ball,) = [c for path, c in objects(drawn(smooth), "/bodies/").items() if "ball" in path]
    assert not ball["object"]["materials"][0]["vertexColors"]


@needs_browser
def test_a_browser_shows_and_hides_the_cones(run, tmp_path):
    page = tmp_path / "run.html"
    run.replay_html(page)
    late = look(page, 0.75)
    page.write_text(with_toggle_off(page), encoding="utf-8")
    hidden = look(page, 0.75)
    # the bar at the bottom differs by its check mark only
    differs = (late != hidden).any(axis=2)
    assert 50 < differs[:250].sum() < 0.2 * differs.size
    bluer = late[:250][differs[:250]].astype(int) - hidden[:250][differs[:250]]
    assert (bluer[:, 0] < 0).mean() > 0.9


def with_toggle_off(page):
    """Return the text of a page on which the box is unchecked as a user would."""
    return page.read_text(encoding="utf-8").replace("</body>", "<script>cones.click();</script></body>")
