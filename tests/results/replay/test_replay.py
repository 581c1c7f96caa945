"""The replay: what is drawn, placed and refused, and that a real browser plays the page alone."""

import base64
import dataclasses
import re
import sys
import zlib

import numpy as np
import pytest

import mbvi
from mbvi.results.replay.browser import Browser
from mbvi.results.replay.encoding import decode, encode
from mbvi.results.replay.marks import ARROW, arrows, marks, strikes
from mbvi.results.replay.meshes import plate_mesh
from mbvi.results.replay.motion import bounds, motion
from mbvi.results.replay.replay import page_of
from support.browser import HEIGHT, WIDTH, click, distinct_colors, look, needs_browser, shown
from support.paths import ROBOTS
from support.programs import run as run_program

ARROW_COLOR = (0xD8, 0x1B, 0x4A)


@pytest.fixture(scope="module")
def browser():
    with Browser(WIDTH, HEIGHT) as found:
        yield found


@pytest.fixture(scope="module")
def run():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.8), joints={"knee": 0.4})
    scene.add_sphere(0.08, 1.0, position=(0.4, 0.1, 0.5))
    scene.add_box((0.2, 0.15, 0.1), 1.0, position=(-0.4, 0, 0.5), angular_velocity=(1, 2, 0.5))
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.6, progress=False)


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "run.html"
    run.replay_html(path)
    return path


def unpacked(text, kind):
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), kind)


def test_frames_come_at_60_hz_and_impacts_that_bend_a_path_have_keys(run):
    moves = motion(run)
    assert moves.times[0] == 0.0 and moves.times[-1] == pytest.approx(0.6)
    np.testing.assert_allclose(np.diff(moves.times), 1 / 60, rtol=1e-9)
    column = moves.driven + moves.bodies.index(run.problem.system.bodies.index("sphere"))
    bounces = [i.time for i in run.impacts if any(c.startswith("sphere") for c in i.constraints)]
    keys = moves.key_times[moves.key_columns == column]
    assert len(keys) and set(keys) <= set(bounces)
    # the first bounce is fast: without a key it would be lost between two frames
    assert bounces[0] in keys


def test_lines_between_keys_follow_the_path(run):
    """A replay does not smooth an impact: between frames no body is farther from its path than gravity bends it."""
    moves = motion(run)
    body = run.problem.system.bodies.index("sphere")
    column = moves.driven + moves.bodies.index(body)
    mine = moves.key_columns == column
    times = np.concatenate([moves.times, moves.key_times[mine]])
    places = np.concatenate([moves.position[:, column], moves.key_position[mine]])
    order = np.argsort(times)
    for t in np.linspace(0.0, 0.6, 500):
        q, _ = run.at(float(t))
        exact = run.problem.system.placements(q, np.array([body]))[0, 3]
        line = [np.interp(t, times[order], places[order, k]) for k in range(3)]
        np.testing.assert_allclose(line, exact, rtol=0, atol=2e-3)


def test_frames_and_keys_pass_through_the_states_of_the_run(run):
    moves = motion(run)
    bodies = np.array(moves.bodies)
    for f in (0, 7, -1):
        places = run.problem.system.placements(run.at(float(moves.times[f]))[0], bodies)
        np.testing.assert_array_equal(moves.position[f], places[:, 3])
    for t, column, place in zip(moves.key_times, moves.key_columns, moves.key_position, strict=True):
        exact = run.problem.system.placements(run.at(float(t))[0], bodies[column : column + 1])[0, 3]
        np.testing.assert_array_equal(place, exact)


def test_neighbouring_quaternions_have_the_same_sign(run):
    turns = motion(run).quaternion
    assert ((turns[1:] * turns[:-1]).sum(axis=2) > 0.0).all()


def test_a_page_holds_the_poses(run):
    data = page_of(run).data
    moves = motion(run, run.problem.scene.shapes)
    assert data["names"] and data["frames"] == len(moves.times)
    code = encode(moves.position, moves.quaternion, moves.key_position)
    np.testing.assert_array_equal(unpacked(data["first"], np.uint16), code.first)
    np.testing.assert_allclose(decode(code)[0], moves.position, rtol=0, atol=1e-4 * np.ptp(moves.position))


def test_arrows_stand_at_contact_points_and_grow_with_the_percussion(run):
    shown = arrows(run)
    points = {
        (i.time, *x): p for i in run.impacts for p, x in zip(i.percussion, i.point, strict=True) if np.isfinite(x).all()
    }
    assert len(shown) == len(points)
    assert any(np.isnan(i.point).any() for i in run.impacts), "a joint limit has no arrow"
    percussion = np.array([points[(a.time, *a.point)] for a in shown])
    length = np.array([a.length for a in shown])
    assert np.all(np.diff(length[np.argsort(percussion)]) >= 0.0)
    wanted = 0.1 + 0.5 * np.sqrt(np.minimum(percussion / (4.0 * np.median(percussion)), 1.0))
    np.testing.assert_allclose(length, wanted)


def test_every_percussion_is_marked_at_its_instant(run):
    rows = marks(run, motion(run), 1.0)
    assert (np.diff(rows[:, 0]) >= 0.0).all()
    found = rows[rows[:, 2] == ARROW]
    shown = arrows(run)
    np.testing.assert_array_equal(found[:, 0], [a.time for a in shown])
    np.testing.assert_array_equal(found[:, 4:7], [a.point for a in shown])
    np.testing.assert_array_equal(found[:, 11], [a.length for a in shown])


def test_struck_bodies_are_those_of_the_impacts(run):
    moves = motion(run)
    rows = strikes(run, moves)
    column = moves.driven + moves.bodies.index(run.problem.system.bodies.index("sphere"))
    wanted = [
        (i.time, p)
        for i in run.impacts
        for name, p in zip(i.constraints, i.percussion, strict=True)
        if "sphere" in name.split(" | ") and p > 0.0
    ]
    mine = rows[rows[:, 1] == column]
    np.testing.assert_array_equal(mine[:, [0, 2]], np.reshape(wanted, (-1, 2)))


def test_of_many_percussions_the_strongest_have_arrows(run):
    n = 1000
    percussion = np.random.default_rng(5).permutation(np.arange(1.0, n + 1))
    rows = np.zeros((n, 3))
    impact = mbvi.Impact(0.3, ("a | b",) * n, percussion, -np.ones(n), np.ones(n), rows, rows, 0.0)
    shown = arrows(dataclasses.replace(run, impacts=(impact,)))
    assert len(shown) == 30
    assert min(a.length for a in shown) == pytest.approx(0.1 + 0.5 * np.sqrt(971 / (4 * 985.5)))


def test_all_motion_is_inside_the_frame(run):
    moves = motion(run)
    lower, upper = bounds(run.problem.scene, moves)
    assert np.all(moves.position >= lower)
    assert np.all(moves.position <= upper)
    assert -0.1 < lower[2] <= 0.0
    assert upper[2] - lower[2] < 1.1


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, np.inf])
def test_a_speed_must_be_positive(run, speed):
    with pytest.raises(mbvi.InputError, match="speed"):
        run.replay(speed=speed)


def test_runs_without_a_scene_are_refused(run, tmp_path):
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=lambda t, q, v: -np.ones(1), dim=1)
    problem = mbvi.Problem(system, [mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1))], [1.0], [0.0])
    bare = mbvi.simulate(problem, mbvi.Paoli(), step=1e-2, duration=0.1, progress=False)
    for unseen in (bare, dataclasses.replace(run, problem=None)):
        with pytest.raises(mbvi.InputError, match="scene"):
            unseen.replay_html(tmp_path / "run.html")
        with pytest.raises(mbvi.InputError, match="scene"):
            unseen.replay()
    assert not list(tmp_path.iterdir())


def test_a_page_that_cannot_be_written(run, tmp_path):
    for path in (tmp_path, tmp_path / "missing" / "run.html"):
        with pytest.raises(mbvi.TrajectoryFileError, match="cannot be written"):
            run.replay_html(path)


def test_the_page_is_the_same_every_time_and_asks_for_nothing(run, tmp_path):
    for name in ("a.html", "b.html"):
        run.replay_html(tmp_path / name)
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page == (tmp_path / "b.html").read_text(encoding="utf-8")
    assert not re.search(r"<(script|img|iframe)[^>]+src|<link|@import|new WebSocket\(\"", page)
    assert not [url for url in re.findall(r"https?://[\w.-]+", page) if not url.endswith("www.w3.org")]
    assert len(page) < 3e6


def test_a_page_of_shortened_steps_is_written(tmp_path):
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((1.0, 1.0, 0.01), fixed=True)
    scene.add_sphere(0.01, position=(0, 0, 0.5), velocity=(0, 0, -1e3))
    struck = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.02)
    assert "steps were shortened" in struck.notes[-1]
    assert [type(impact.time) for impact in struck.impacts] == [float]
    struck.replay_html(tmp_path / "run.html")


def test_importing_mbvi_brings_no_viewer():
    code = "import sys, mbvi; sys.exit('meshcat' in sys.modules)"
    assert run_program([sys.executable, "-c", code]).returncode == 0


def test_walls_are_cut_where_others_begin():
    scene = every_shape_scene(None)
    walls = list(scene.build().scene.walls.values())
    for wall in walls:
        others = [w for w in walls if w is not wall]
        points = plate_mesh(wall, others, np.array([-1.0, -0.5, 0]), np.array([1.0, 0.5, 1.0])).geometry.vertices
        np.testing.assert_allclose(points @ np.array(wall.normal), wall.offset, atol=1e-6)
        for other in others:
            assert (points @ np.array(other.normal)).min() >= other.offset - 1e-6


@pytest.fixture(scope="module")
def driven():
    """A crate, a mesh and a paddle that move on their own, and grains among them."""
    scene = mbvi.Scene(restitution=0.3)
    shaking = mbvi.motion.Oscillation((0, 0, 0.1), 1.0)
    scene.add_container((-1, -1, 0), (1, 1), motion=shaking)
    scene.add_box((0.8, 0.1, 0.2), position=(0, 0, 0.4), name="paddle", motion=mbvi.motion.Rotation((0, 0, 1), 4.0))
    scene.add_surface(*mbvi.surfaces.funnel(0.5, 0.15, 0.3), position=(0, 0, 0.8), name="funnel")
    scene.add_halfspace((0, 0, 1), offset=-0.5, name="ground")
    scene.add_spheres(np.array([[0.3, 0, 1.2], [-0.3, 0.1, 1.3]]), 0.1, mass=1.0)
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=2e-3, duration=0.5)


def test_what_moves_on_its_own_moves_in_the_replay(driven):
    moves, page = motion(driven), page_of(driven)
    crate, paddle = 0, 1
    assert moves.driven == 2
    np.testing.assert_allclose(moves.position[:, crate, 2], 0.1 * np.sin(2 * np.pi * moves.times), rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.abs(moves.quaternion[:, paddle, 2]), np.abs(np.sin(2 * moves.times)), atol=1e-12)
    drawn = {c["path"] for c in page.commands if c["type"] == "set_object"}
    assert sum("driven/0/walls" in path for path in drawn) == 5
    columns = np.concatenate([unpacked(group["columns"], np.int32) for group in page.data["groups"]])
    assert sorted(columns) == [paddle, 2, 3]
    assert {"0 funnel", "5 ground"} <= {path.split("/")[-1] for path in drawn if "driven" not in path}


def test_meshes_and_what_moves_are_inside_the_frame(driven):
    lower, upper = bounds(driven.problem.scene, motion(driven))
    assert upper[2] >= 1.3 and (lower[:2] <= -0.5).all() and (upper[:2] >= 0.5).all()


def every_shape_scene(mesh):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((1, 0, 0), -0.9, name="left wall")
    scene.add_halfspace((0, -1, 0.3), -0.6, name="slope")
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    scene.add_sphere(0.12, position=(-0.6, 0, 0.5), velocity=(-2, 0, 0))
    scene.add_box((0.2, 0.3, 0.15), position=(-0.2, 0, 0.6), rotation=turn, angular_velocity=(1, 2, 3))
    scene.add_ellipsoid((0.1, 0.2, 0.07), position=(0.25, 0, 0.45), rotation=turn)
    scene.add_capsule(0.06, 0.2, position=(0.6, 0, 0.5), rotation=turn)
    scene.add_cylinder(0.1, 0.25, position=(-0.4, -0.5, 0.4), rotation=turn)
    scene.add_box((0.3, 0.3, 0.2), position=(1.0, 0.1, 0.1), fixed=True)
    if mesh is not None:
        scene.add_mesh(mesh, position=(0.2, -0.6, 0.5))
    return scene


def test_every_kind_of_shape_is_drawn(tmp_path):
    corners = 0.3 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    part = tmp_path / "part.obj"
    faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    part.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + faces)
    run = mbvi.simulate(every_shape_scene(part).build(), mbvi.Paoli(), step=2e-3, duration=0.4, progress=False)
    page = page_of(run)
    counts = [len(unpacked(group["columns"], np.int32)) for group in page.data["groups"]]
    drawn = [c for c in page.commands if c["type"] == "set_object"]
    types = [c["object"]["geometries"][0]["type"] for c in drawn if "/instances/" in c["path"]]
    # sphere and ellipsoid share a mesh, and the boxes do; capsule and hull have vertices
    assert sorted(zip(types, counts, strict=True)) == [
        ("BoxGeometry", 2), ("BufferGeometry", 1), ("BufferGeometry", 1), ("CylinderGeometry", 1), ("SphereGeometry", 2)
    ]  # fmt: skip
    assert sum("/walls/" in c["path"] for c in drawn) == 3


@needs_browser
def test_a_browser_shows_every_kind_of_shape_where_it_is(tmp_path, browser):
    run = mbvi.simulate(every_shape_scene(None).build(), mbvi.Paoli(), step=2e-3, duration=0.4, progress=False)
    run.replay_html(tmp_path / "run.html")
    assert distinct_colors(look(shown(browser, tmp_path / "run.html"), 0.35)) > 500
    ask = """replay.groups.flatMap(group => group.shown.map((k, n) => {
        const matrix = new THREE.Matrix4(); group.mesh.getMatrixAt(n, matrix);
        return [group.columns[k], ...matrix.elements]; }))"""
    found = {int(row[0]): np.reshape(row[1:], (4, 4)).T for row in browser.evaluate(ask) if row[0] >= 0}
    moves = motion(run)
    for column, body in enumerate(moves.bodies):
        place = run.problem.system.placements(run.at(0.35)[0], np.array([body]))[0]
        (shape,) = (s for s in run.problem.scene.shapes if s.body == body)
        wanted = place[:3].T @ shape.position + place[3]
        np.testing.assert_allclose(found[column][:3, 3], wanted, rtol=0, atol=1e-4)
        turn = found[column][:3, :3] / np.linalg.norm(found[column][:3, :3], axis=0)
        wanted = place[:3].T @ shape.rotation
        # the cylinder's mesh lies along y
        same = min(np.abs(turn - wanted).max(), np.abs(turn[:, [0, 2, 1]] * [1, -1, 1] - wanted).max())
        assert same < 1e-3


def test_marks_of_more_than_30_contacts_are_off_at_first(run):
    def struck(count):
        rows = np.zeros((count, 3))
        names = tuple(f"a | b[{k}]" for k in range(count))
        impact = mbvi.Impact(0.3, names, np.ones(count), -np.ones(count), np.ones(count), rows, rows, 0.0)
        return dataclasses.replace(run, impacts=(impact,))

    assert [page_of(struck(count)).data["crowded"] for count in (30, 31)] == [False, True]


@needs_browser
def test_keys_play_step_and_lead_to_impacts(run, page, browser):
    def press(key, shift=False):
        for kind in ("rawKeyDown", "keyUp"):
            browser.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 * shift)
        return browser.evaluate("replay.time")

    shown(browser, page)
    browser.evaluate("replay.seek(0.1)")
    assert press("ArrowRight") == pytest.approx(7 / 60) and press("ArrowRight") == pytest.approx(8 / 60)
    assert press("ArrowLeft") == pytest.approx(7 / 60)
    times = sorted({impact.time for impact in run.impacts})
    assert press("Home") == 0.0
    assert [press("ArrowRight", shift=True) for _ in times] == pytest.approx(times)
    assert press("ArrowRight", shift=True) == press("End") == pytest.approx(0.6)
    assert press("ArrowLeft", shift=True) == pytest.approx(times[-1])
    press(" ")
    assert browser.evaluate("replay.playing")
    press(" ")
    assert not browser.evaluate("replay.playing")
    click(browser, "#loop")
    browser.evaluate("replay.seek(0.55); replay.play()")
    browser.wait("replay.time < 0.5 && replay.playing")
    assert browser.evaluate("document.title") == "hopper, 1 body, 1 sphere by Paoli, h = 0.001 s"


@needs_browser
def test_the_page_is_dark_where_the_system_is(page, browser):
    shown(browser, page)
    light = look(browser, 0.0)
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    dark = look(browser, 0.0)
    browser.call("Emulation.setEmulatedMedia", features=[])
    # the sky, and the panel of the controls
    for row, column in ((100, 20), (HEIGHT - 26, 20)):
        assert light[row, column].mean() > 150 and dark[row, column].mean() < 90


@needs_browser
def test_a_browser_shows_the_run(run, page, browser):
    blow = max((i for i in run.impacts if np.isfinite(i.point).all()), key=lambda i: i.percussion.max())
    shown(browser, page)
    before, hit = (look(browser, t) for t in (0.1, blow.time + 0.01))
    for picture in (before, hit):
        assert picture.shape == (HEIGHT, WIDTH, 3)
        assert distinct_colors(picture) > 500
    assert (before != hit).any(axis=2).mean() > 0.005
    assert browser.evaluate("replay.marks.meshes[0].count") > 0
    browser.evaluate("replay.seek(0.1)")
    assert browser.evaluate("replay.marks.meshes[0].count") == 0


@needs_browser
@pytest.mark.parametrize("size", [(1000, 640), (420, 300)])
def test_controls_obey_the_mouse_at_every_size_of_the_window(page, browser, size):
    shown(browser, page)
    browser.resize(*size)
    browser.open(browser.evaluate("location.href"), "replay.ready")
    browser.evaluate("replay.autoplay = false; replay.pause(); replay.seek(0)")
    small = browser.evaluate("$('options').hidden")
    assert small == (size[0] < 560)
    if small:
        click(browser, "#more")
    inside = browser.evaluate(
        "[...document.querySelectorAll('.panel')].map(p => p.getBoundingClientRect())"
        ".every(b => b.left >= 0 && b.top >= 0 && b.right <= innerWidth && b.bottom <= innerHeight)"
    )
    assert inside
    first = look(browser, 0.0)
    assert first.shape == (size[1], size[0], 3) and distinct_colors(first) > 300
    click(browser, "#time", 0.7)
    assert browser.evaluate("replay.time") == pytest.approx(0.42, abs=0.05)
    click(browser, "#play")
    browser.wait("replay.time === replay.duration && !replay.playing")
    assert browser.evaluate("$('play').textContent") == "Play"
    assert "collision" in browser.evaluate("$('shapes').textContent")
    count = "replay.groups.map(group => group.shown)"
    visual = browser.evaluate(count)
    click(browser, "#shapes")
    assert "visual" in browser.evaluate("$('shapes').textContent") and browser.evaluate(count) != visual
    assert browser.evaluate("$('follow').disabled && $('trail').disabled")
    browser.evaluate("$('body').value = DATA.driven; $('body').onchange()")
    for button, says in (("#trail", "Trails.lines.size"), ("#follow", "Camera.followed + 1")):
        click(browser, button)
        assert browser.evaluate(says) == 1
        click(browser, button)
        assert browser.evaluate(says) == 0
    views = set()
    for view in ("fit", "front", "side", "top"):
        click(browser, f"[data-view={view}]")
        views.add(tuple(np.round(browser.evaluate("viewer.camera.position.toArray()"), 3)))
    assert len(views) == 4
    pictures = []
    for mode in ("speed", "body", "percussion", "own"):
        browser.evaluate(f"$('color').value = '{mode}'; $('color').dispatchEvent(new Event('change'))")
        pictures.append(look(browser, 0.35))
    assert len({picture.tobytes() for picture in pictures}) == 4
    assert not browser.errors


@needs_browser
def test_a_followed_body_stays_where_it_is_in_the_picture(page, browser):
    shown(browser, page)
    browser.evaluate("replay.seek(0); $('body').value = DATA.driven + DATA.names.indexOf('sphere')")
    browser.evaluate("$('body').dispatchEvent(new Event('change'))")
    click(browser, "#follow")
    apart = "Camera.place().sub(viewer.camera.position).toArray()"
    before = browser.evaluate(apart)
    browser.evaluate("replay.seek(0.3)")
    np.testing.assert_allclose(browser.evaluate(apart), before, atol=1e-9)


@needs_browser
def test_a_browser_plays_the_page_by_itself_at_true_speed(run, page, browser):
    browser.open(page.as_uri(), "replay.playing")
    browser.wait("!replay.playing")
    assert browser.evaluate("replay.time") == pytest.approx(0.6)
    # again, with the time of each picture on the screen: software may draw few of them
    browser.evaluate(
        "frames = []; requestAnimationFrame(function see(now) {"
        " frames.push([now / 1000, replay.time]); requestAnimationFrame(see); }); replay.play()"
    )
    browser.wait("!replay.playing")
    now, time = np.transpose(browser.evaluate("frames"))
    playing = (time > 0) & (time < 0.6)
    assert playing.sum() > 2
    np.testing.assert_allclose(np.diff(time[playing]), np.diff(now[playing]), atol=1e-9)


@needs_browser
@pytest.mark.parametrize("duration", [0.0, 1e-4])
def test_a_browser_shows_a_run_of_one_step_or_none(duration, tmp_path, browser):
    scene = mbvi.Scene()
    scene.add_sphere(0.1, position=(0, 0, 1))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-4, duration=1e-4, progress=False)
    if not duration:
        run = dataclasses.replace(run, t=run.t[:1], q=run.q[:1], v=run.v[:1])
    run.replay_html(tmp_path / "run.html")
    assert distinct_colors(look(shown(browser, tmp_path / "run.html"), 0.0)) > 100
