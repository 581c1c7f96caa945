"""The replay: what is keyed, drawn and refused, and that a real browser plays the page alone."""

import asyncio
import dataclasses
import re
import subprocess
import sys
import threading
import time
import webbrowser

import meshcat
import numpy as np
import pytest
import umsgpack
import zmq
from meshcat.visualizer import ViewerWindow
from tornado.websocket import websocket_connect

import mbvi
from mbvi.results.replay.keyframes import arrows, bounds, motion
from mbvi.results.replay.meshes import plate_mesh
from mbvi.results.replay.page import Page
from mbvi.results.replay.replay import stage
from support.browser import BROWSER, HEIGHT, WIDTH, chromium, distinct_colors, look, needs_browser, with_script
from support.paths import ROBOTS

ARROW = (0xD8, 0x1B, 0x4A)


@pytest.fixture(scope="module")
def run():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.8), joints={"knee": 0.4})
    scene.add_sphere(0.08, 1.0, position=(0.4, 0.1, 0.5))
    scene.add_box((0.2, 0.15, 0.1), 1.0, position=(-0.4, 0, 0.5), angular_velocity=(1, 2, 0.5))
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.6, progress=False)


@pytest.fixture(scope="module")
def commands(run):
    page = Page()
    vis = meshcat.Visualizer(window=page)
    vis.set_animation(stage(vis, run))
    return page.commands


def numbers(packed):
    return np.frombuffer(packed.data, np.float32)


def body_tracks(commands, name):
    (clip,) = (a["clip"] for a in commands[-1]["animations"] if re.search(f"bodies/\\d+ {name}", a["path"]))
    return {t["name"]: (numbers(t["times"]), numbers(t["values"])) for t in clip["tracks"]}


def test_frames_come_at_60_hz_and_every_impact_has_a_key(run):
    moves = motion(run)
    assert moves.times[0] == 0.0
    assert moves.times[-1] == pytest.approx(0.6)
    assert np.diff(moves.times[moves.frame]).min() >= 1 / 60 - 1e-6
    assert len(run.impacts) > 10
    for impact in run.impacts:
        assert np.abs(moves.times - impact.time).min() < 1e-6


def test_slow_motion_keeps_the_frame_rate(run):
    moves = motion(run, speed=0.25)
    assert moves.times[-1] == pytest.approx(2.4)
    assert moves.frame.sum() == 145


def test_tracks_pass_through_the_states_of_the_run(run, commands):
    times, values = body_tracks(commands, "sphere")[".position"]
    body = run.problem.system.bodies.index("sphere")
    for t, x in zip(times, values.reshape(-1, 3), strict=True):
        q, _ = run.at(min(float(t), 0.6))
        np.testing.assert_allclose(x, run.problem.system.placements(q, np.array([body]))[0, 3], atol=1e-6)


def test_a_body_has_keys_at_its_own_impacts_and_no_rotation_it_never_made(run, commands):
    track = body_tracks(commands, "sphere")
    assert set(track) == {".position"}
    bounces = [i.time for i in run.impacts if any(c.startswith("sphere") for c in i.constraints)]
    assert bounces
    for t in bounces:
        assert np.abs(track[".position"][0] - t).min() < 1e-6
    assert set(body_tracks(commands, "box")) == {".position", ".quaternion"}


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
    assert length.max() == pytest.approx(0.6)
    assert length.min() >= 0.1


def test_an_arrow_appears_at_its_impact_and_vanishes(run, commands):
    clips = {a["path"]: a["clip"] for a in commands[-1]["animations"]}
    first = {t["name"]: t for t in clips["/meshcat/percussions/0"]["tracks"]}
    (visible,) = [t for t in first.values() if t["type"] == "boolean"]
    keys = {round(k["time"], 6): k["value"] for k in visible["keys"]}
    start = arrows(run)[0].time
    assert keys == {0.0: False, round(start, 6): True, round(start + 0.3, 6): False, 0.6: False}
    thickness = numbers(first[".scale"]["values"]).reshape(-1, 3)[:, 0]
    assert thickness[0] > 0.0
    assert thickness[-1] == 0.0


def test_of_many_percussions_the_strongest_have_arrows(run):
    n = 1000
    percussion = np.random.default_rng(5).permutation(np.arange(1.0, n + 1))
    rows = np.zeros((n, 3))
    impact = mbvi.Impact(0.3, ("a | b",) * n, percussion, -np.ones(n), np.ones(n), rows, rows, 0.0)
    shown = arrows(dataclasses.replace(run, impacts=(impact,)))
    assert len(shown) == 300
    assert min(a.length for a in shown) == pytest.approx(0.1 + 0.5 * np.sqrt(701 / n))


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
    subprocess.run([sys.executable, "-c", code], check=True)


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
    page = Page()
    vis = meshcat.Visualizer(window=page)
    vis.set_animation(stage(vis, driven))
    animation = next(c for c in page.commands if c["type"] == "set_animation")
    clips = {clip["path"]: clip["clip"] for clip in animation["animations"]}
    tracks = {path: {t["name"]: t for t in clip["tracks"]} for path, clip in clips.items() if "driven" in path}
    crate, paddle = (next(p for p in sorted(tracks) if p.endswith(end)) for end in ("driven/0", "driven/1"))
    times, places = (numbers(tracks[crate][".position"][part]) for part in ("times", "values"))
    np.testing.assert_allclose(places.reshape(-1, 3)[:, 2], 0.1 * np.sin(2 * np.pi * times), atol=2e-3)
    times, turns = (numbers(tracks[paddle][".quaternion"][part]) for part in ("times", "values"))
    np.testing.assert_allclose(turns.reshape(-1, 4)[:, 2], np.sin(2.0 * times), atol=2e-3)
    drawn = {c["path"] for c in page.commands if c["type"] == "set_object"}
    assert sum(path.startswith(f"{crate}/walls") for path in drawn) == 5
    assert sum(path.startswith(f"{paddle}/fixed") for path in drawn) == 1
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
    page = Page()
    stage(meshcat.Visualizer(window=page), run)
    drawn = [c for c in page.commands if c["type"] == "set_object"]
    bodies = [c for c in drawn if "/bodies/" in c["path"]]
    kinds = sorted(c["object"]["geometries"][0]["type"] for c in bodies)
    assert kinds == sorted(
        ["SphereGeometry", "BoxGeometry", "SphereGeometry", "BufferGeometry", "CylinderGeometry", "BufferGeometry"]
    )
    assert sum("/walls/" in c["path"] for c in drawn) == 3
    assert sum("/fixed/" in c["path"] for c in drawn) == 1
    if BROWSER:
        run.replay_html(tmp_path / "run.html")
        picture = look(tmp_path / "run.html", 0.35)
        assert distinct_colors(picture) > 500


@needs_browser
def test_a_browser_shows_the_run(run, tmp_path):
    page = tmp_path / "run.html"
    run.replay_html(page)
    blow = max((i for i in run.impacts if np.isfinite(i.point).all()), key=lambda i: i.percussion.max())
    before, hit = (look(page, t) for t in (0.1, blow.time + 0.01))
    for picture in (before, hit):
        assert picture.shape == (HEIGHT, WIDTH, 3)
        assert distinct_colors(picture) > 500
    assert (before != hit).any(axis=2).mean() > 0.02
    assert not (before == ARROW).all(axis=2).any()
    assert (hit == ARROW).all(axis=2).sum() > 100


@needs_browser
def test_a_browser_plays_the_page_by_itself_at_true_speed(run, tmp_path):
    run.replay_html(tmp_path / "run.html")
    watch = """let since; (function watch() {
        if (animator.playing) since ??= performance.now();
        else if (since) return console.log(`played ${animator.time} in ${performance.now() - since} ms`);
        requestAnimationFrame(watch); })();"""
    # virtual time would not draw every frame: this one plays in real time until it says so
    command = [*chromium(tmp_path), "--remote-debugging-port=0", with_script(tmp_path / "run.html", watch)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as browser:
        limit = threading.Timer(60, browser.kill)
        limit.start()
        told = next((found for line in browser.stderr if (found := re.search(r"played (\S+) in (\S+) ms", line))), None)
        limit.cancel()
        browser.terminate()
    assert told is not None
    assert float(told[1]) == pytest.approx(0.6)
    # the end is seen with the first picture after it, which software may draw late
    assert 550 < float(told[2]) < 2000


def test_live_replay_sends_scene_and_animation_to_the_browser(run, monkeypatch, capsys):
    received, threads = [], []

    async def listen(url):
        connection = await websocket_connect(re.sub("^http(.*)static/$", r"ws\1", url))
        while not received or received[-1]["type"] != "set_animation":
            received.append(umsgpack.unpackb(await connection.read_message()))
        connection.close()

    def browser(url, new=0):
        threads.append(threading.Thread(target=lambda: asyncio.run(listen(url))))
        threads[0].start()

    monkeypatch.setattr(webbrowser, "open", browser)
    # a server that does not answer must fail the test, not hang it
    monkeypatch.setitem(ViewerWindow.context.sockopts, zmq.RCVTIMEO, 20_000)
    start = time.monotonic()
    run.replay(speed=2.0)
    assert time.monotonic() - start >= 0.3
    threads[0].join(timeout=10)
    assert "http://127.0.0.1:" in capsys.readouterr().out
    assert {"set_object", "set_transform", "set_property", "set_animation"} == {c["type"] for c in received}
    assert received[-1]["options"] == {"play": True, "repetitions": 1}
    assert body_tracks(received, "box")[".position"][0][-1] == pytest.approx(0.3)
