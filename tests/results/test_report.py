"""The report of a run: what its page holds, how large it is, and what a browser draws of it."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import mbvi
from mbvi.results.replay.browser import Browser, page_address
from support.browser import distinct_colors, needs_browser, read_png
from support.paths import ROBOTS


@pytest.fixture(scope="module")
def run():
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.55), joints={"knee": 0.4})
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.5)


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    run.report(path)
    return path


def outside_the_replay(page):
    """Return the text of a report without the page of its replay."""
    return re.sub(r'srcdoc="[^"]*"', "", page.read_text(encoding="utf-8"))


def test_the_page_says_what_the_run_says(run, page):
    text = outside_the_replay(page)
    for line in [
        *repr(run).splitlines()[:-1],
        *str(run.diagnosis()).splitlines()[:3],
        *run.problem.report().splitlines(),
    ]:
        assert line.replace("&", "&amp;").replace(">", "&gt;").replace("<", "&lt;").replace("'", "&#x27;") in text
    assert text.count("<tr data-time") == sum(len(i.constraints) for i in strongest(run))
    assert f"The 30 strongest of {len(run.impacts)} impacts" in text or len(run.impacts) <= 30
    assert all(title in text for title in ("Energy", "Percussions of impacts", "Gaps", "Penetration", "Kinetic angles"))
    assert f"mbvi {mbvi.__version__}" in text and f"numpy {np.__version__}" in text


def strongest(run):
    return sorted(run.impacts, key=lambda i: -i.percussion.max())[:30]


def made_again(page, tmp_path, monkeypatch):
    """Return the run that the lines of a page make, and these lines."""
    text = outside_the_replay(page)
    data = re.search(r'download="start.h5" href="data:application/x-hdf5;base64,([^"]*)"', text)[1]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "start.h5").write_bytes(base64.b64decode(data))
    code = next(block for block in re.findall(r"<pre>(.*?)</pre>", text, re.S) if "import mbvi" in block)
    names = {}
    code = code.replace("&quot;", '"').replace("&#x27;", "'")
    exec(code, names)
    return names["run"], code


def test_the_run_can_be_made_again_from_the_page(run, page, tmp_path, monkeypatch):
    again, _ = made_again(page, tmp_path, monkeypatch)
    np.testing.assert_array_equal(again.q, run.q)
    np.testing.assert_array_equal(again.v, run.v)


MOTOR = """<mujoco model="arm"><worldbody><body><joint name="j" axis="0 1 0"/>
  <geom size=".1" pos=".3 0 0"/></body></worldbody>
  <actuator><motor name="push" joint="j"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("scheme", "t0", "options"),
    [
        (None, 0.0, {"step": 1 / 240, "duration": 0.123456789}),
        (mbvi.Paoli(), 2.7, {"step": 1e-3, "duration": 0.3, "every": 7, "record": "contacts"}),
        (None, 0.0, {"step": 2e-3, "duration": 0.1, "solver": mbvi.ProxQP()}),
        (mbvi.StewartTrinkle(), 0.0, {"step": 2e-3, "duration": 0.2, "depth": 0.05}),
        (mbvi.EventDriven(1e-9), 1 / 3, {"duration": 0.2}),
    ],
    ids=["step", "every", "solver", "depth", "event-driven"],
)
def test_the_page_has_all_that_made_the_run(scheme, t0, options, tmp_path, monkeypatch):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(3):
        scene.add_sphere(0.1, position=(0.02 * k, 0.01 * k, 0.15 + 0.21 * k))
    problem = scene.build()
    run = mbvi.simulate(problem.at(problem.q0, problem.v0, t0), scheme, **options)
    run.report(tmp_path / "report.html")
    again, _ = made_again(tmp_path / "report.html", tmp_path, monkeypatch)
    for name in ("t", "q", "v", "residual"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert (again.record.contacts is None) == (run.record.contacts is None)


def test_the_page_asks_for_functions_alone(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    (tmp_path / "arm.xml").write_text(MOTOR)
    scene = mbvi.Scene()
    scene.add_mjcf(tmp_path / "arm.xml", ctrl={"push": 0.3})
    run = mbvi.simulate(scene.build(), step=1e-3, duration=0.1)
    run.report(tmp_path / "report.html")
    again, _ = made_again(tmp_path / "report.html", tmp_path, monkeypatch)
    np.testing.assert_array_equal(again.q, run.q)
    scene = mbvi.Scene()
    scene.add_urdf("robot:hopper", position=(0, 0, 1), name="hopper", control=lambda t, q, v: np.zeros(8))
    scene.add_force("hopper/foot", lambda t, q, v: np.zeros(6))
    mbvi.simulate(scene.build(), step=1e-3, duration=0.01).report(tmp_path / "report.html")
    with pytest.raises(mbvi.InputError, match="must be a function"):
        made_again(tmp_path / "report.html", tmp_path, monkeypatch)
    text = outside_the_replay(tmp_path / "report.html").replace("&#x27;", "'")
    assert "control={'hopper': ...}, force={'hopper/foot': ...}" in text


def test_the_page_asks_for_nothing_from_elsewhere(page):
    text = outside_the_replay(page)
    assert not re.search(r'(src|href)="(?!data:)', text) and "http" not in text.replace(
        "http://www.w3.org/2000/svg", ""
    )


def test_names_cannot_end_what_they_stand_in(tmp_path):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="<script><b>floor")
    scene.add_sphere(0.1, position=(0, 0, 0.11), name='"ball" & <i>')
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.3)
    run.report(tmp_path / "report.html")
    text = outside_the_replay(tmp_path / "report.html")
    assert "<b>floor" not in text and "<i>" not in text
    assert len(re.findall("</script>", text)) == 2
    assert "<i>" not in run._repr_html_() and "&lt;i&gt;" in run._repr_html_()
    assert "<i>" not in scene._repr_html_() and "&lt;i&gt;" in scene._repr_html_()
    assert "<b>floor" not in run.problem._repr_html_()
    data = re.search(r'<script type="application/json" id="plots">(.*?)</script>', text, re.S)[1]
    names = [curve["name"] for panel in json.loads(data)["panels"] for curve in panel["curves"]]
    assert '"ball" & <i> | <script><b>floor' in names


def test_a_hundred_thousand_states_make_a_small_page(tmp_path):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, 0, 0.3))
    short = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0)
    count = 100_000
    t = np.linspace(0.0, 1.0, count)
    at = np.minimum(np.searchsorted(short.t, t), len(short.t) - 1)
    record = replace(short.record, penetration=np.abs(np.sin(37.0 * t)) * 1e-5)
    long = replace(short, t=t, q=short.q[at], v=short.v[at], residual=short.residual[at], record=record)
    long.report(tmp_path / "report.html", diagnosis=short.diagnosis())
    # the plots; the replay has its own frames
    assert len(outside_the_replay(tmp_path / "report.html")) < 1.5e6


def test_what_has_no_replay_or_no_impact_is_said(tmp_path):
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=lambda t, q, v: np.zeros(1), dim=1)
    run = mbvi.simulate(mbvi.Problem(system, [], [0.0], [1.0]), mbvi.Paoli(), step=0.1, duration=0.3)
    run.report(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "No replay: this run has no scene" in text and "<iframe" not in text
    assert "Gaps: there are no constraints" in text and "<h2>Impacts</h2><p>None.</p>" in text
    replace(run, problem=None).report(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert text.count("could not bring its problem back") >= 2
    with pytest.raises(mbvi.TrajectoryFileError, match=r"missing.*cannot be written"):
        run.report(tmp_path / "missing" / "report.html")


def test_a_notebook_shows_run_problem_and_scene(run):
    html = run._repr_html_()
    assert html.startswith("<div><b>Run of hopper") and "strongest impacts" in html
    assert "no impacts" not in html.lower()
    assert run.problem.report().splitlines()[1].strip() in run.problem._repr_html_()
    scene = mbvi.Scene(friction=0.4, plane="xz")
    assert repr(scene) == "Scene(empty)"
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_spheres([[k, 0, 1] for k in range(3)], radius=0.1, mass=1.0, name="grains")
    scene.add_box((1, 1, 1), position=(9, 0, 1), name="box")
    scene.set_friction("box", "floor", 0.2)
    assert repr(scene) == "Scene(bodies box, spheres grains (3), walls floor)"
    for cell in ("<th>walls</th><td>floor</td>", "<td>0.4; of some pairs 0.2</td>", "<th>plane</th><td>xz</td>"):
        assert cell in scene._repr_html_()
    scene.add_sphere(0.1, position=(0, 0, 1), name="overlaps")
    assert "<svg" not in scene._repr_html_() and "overlaps" in scene._repr_html_()


def test_the_picture_of_a_scene_shows_each_shape_where_it_is():
    """A sphere is a circle of 40 points about its centre, a box has three faces, a floor lies below both."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.2, 1.0, position=(0, 0, 0.5), name="ball")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(1, 0, 0.5), name="box")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1)
    for html in (scene._repr_html_(), run._repr_html_()):
        drawn = [
            np.array(re.findall(r"[-\d.]+", text), float).reshape(-1, 2) for text in re.findall('points="(.*?)"', html)
        ]
        assert sorted(map(len, drawn)) == [4, 4, 4, 4, 40]
        ball = next(points for points in drawn if len(points) == 40)
        radius = np.linalg.norm(ball - ball.mean(axis=0), axis=1)
        np.testing.assert_allclose(radius, radius.mean(), atol=0.1)
        floor, *faces = [points for points in drawn if len(points) == 4]
        assert floor[:, 1].max() > max(face[:, 1].max() for face in faces)
        assert min(face[:, 0].min() for face in faces) > ball[:, 0].max()


def browse(page, script, width):
    """Run a script in a page when its replay is there; return what it returns and the picture [pixels]."""
    with Browser(width, 600) as browser:
        browser.open(page_address(page), "frame.contentWindow.eval('replay.ready')")
        # clicks in plots show instants: the replay must not go on by itself
        browser.evaluate("frame.contentWindow.eval('replay.autoplay = false; replay.pause()')")
        said, picture = browser.evaluate(f"(() => {{ {script} }})()"), read_png(browser.picture())
        assert not browser.errors
    return said, picture


ASK = """
    const charts_ = document.querySelectorAll(".chart svg"), box = charts_[0].getBoundingClientRect();
    const event = (kind, x) => charts_[0].dispatchEvent(new PointerEvent(kind, {
        clientX: box.left + x, clientY: box.top + 50, pointerId: 1, bubbles: true}));
    SVGElement.prototype.setPointerCapture = () => 0;
    const middle = (62 + box.width - 12) / 2;
    event("pointermove", middle);
    const read = document.querySelector(".tip").children[3].textContent;
    event("pointerdown", middle); event("pointerup", middle);
    const shown = frame.contentDocument.querySelector("input[type=range]").value;
    event("pointerdown", middle); event("pointermove", box.width - 12); event("pointerup", box.width - 12);
    const zoomed = view.slice();
    charts_[0].dispatchEvent(new MouseEvent("dblclick"));
    const requests = [performance, frame.contentWindow.performance].flatMap(p => p.getEntriesByType("resource"))
        .filter(r => !r.name.startsWith("data:") && !r.name.startsWith("blob:")).length;
    return JSON.stringify({
        charts: charts_.length, paths: document.querySelectorAll(".chart path").length, read, shown, zoomed, view,
        requests, wide: document.documentElement.scrollWidth - innerWidth});
"""


@needs_browser
@pytest.mark.parametrize("width", [500, pytest.param(1100, marks=pytest.mark.slow)])
def test_a_browser_draws_reads_seeks_and_enlarges(run, page, width):
    said, picture = browse(page, ASK, width)
    found = json.loads(said)
    assert found["charts"] == 8 and found["paths"] > 12 and found["requests"] == 0 and found["wide"] <= 0
    # the total energy at the middle of the run, in four digits
    assert float(found["read"]) == pytest.approx(run.energy()[250], rel=2e-2)
    assert float(found["shown"]) == pytest.approx(0.25, abs=2e-3)
    assert found["zoomed"] == pytest.approx([0.25, 0.5], abs=2e-3) and found["view"] == [0.0, 0.5]
    assert picture.shape == (600, width, 3) and distinct_colors(picture) > 500


@needs_browser
def test_the_page_is_dark_where_the_system_is(page):
    with Browser(900, 600) as browser:
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        browser.open(page_address(page), "frame.contentWindow.eval('replay.ready')")
        dark = read_png(browser.picture())
        # the mark of the total energy, which is black on a light page
        total = browser.evaluate("getComputedStyle(document.querySelectorAll('.entry i')[2]).backgroundColor")
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "light"}])
        light = read_png(browser.picture())
        assert not browser.errors
    # the margin
    assert light[5, 5].mean() > 240 and dark[5, 5].mean() < 60
    assert min(map(int, re.findall(r"\d+", total)[:3])) > 180
