"""The stress scenes: that they start, that verdicts follow from numbers, and what the command writes."""

import dataclasses
import json
import sys
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from importlib import import_module
from itertools import pairwise, product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import mbvi
from mbvi.cli.main import app
from mbvi.geometry.shapes.shapes import Sphere
from mbvi_studies.engines import PEERS
from mbvi_studies.engines.bodies import Bodies, Body, NoModelError, Poses
from mbvi_studies.engines.free_body import refuse
from mbvi_studies.stress.files import replaced
from mbvi_studies.stress.friction import FRICTION
from mbvi_studies.stress.models import model_of
from mbvi_studies.stress.peers import peer_cell, sweep_peer
from mbvi_studies.stress.scene import StressScene
from mbvi_studies.stress.scenes import SCENES
from mbvi_studies.stress.sweep import SCHEMES, Cell, cell
from support.paths import DOCS

NAMES = {scene.name: scene for scene in SCENES}


def test_names_and_bounds_are_in_order():
    assert len(NAMES) == len(SCENES)
    assert all(0.0 <= scene.held < scene.failed for scene in SCENES)


@pytest.mark.parametrize("scene", SCENES, ids=NAMES)
def test_every_scene_starts_well(scene):
    """Its number is a finite one that holds right after the start."""
    run = mbvi.simulate(scene.make(1e-3), mbvi.Centered(), duration=2e-4, step=1e-4)
    assert scene.verdict(scene.measure(run)) == "held"


HARD = ("wedge driven in, e = 0.5", "tower of ten on a slope", "quadruped on a slope")


@pytest.mark.parametrize("h", [1.03e-2, 1.03e-1])
@pytest.mark.parametrize("name", HARD)
def test_hard_scenes_are_solved_by_default_or_the_error_says_what_to_change(name, h):
    """In seconds, whatever the step."""
    found = cell(NAMES[name], "default", None, h, 60.0)
    if found.verdict in ("held", "degraded"):
        return
    # the springs of the quadruped are explicit: gains that are stable, and a step
    assert name == "quadruped on a slope" and found.said.startswith("DivergedError: the run diverges at t = ")
    assert "it is stable with a stiffness of " in found.said and ", or at h = " in found.said


@pytest.mark.slow(seconds=30)
@pytest.mark.parametrize("name", HARD)
def test_hard_scenes_are_held_by_default_at_a_millisecond(name):
    assert cell(NAMES[name], "default", None, 1.03e-3, 60.0).verdict == "held"


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

    def shaken(h):
        moving = mbvi.Scene()
        moving.add_halfspace((0, 0, 1), motion=mbvi.motion.Oscillation((0, 0, 0.01), 2.0))
        moving.add_sphere(0.1, position=(0, 0, 1))
        return moving.build()

    refused = cell(dataclasses.replace(scene, make=shaken), "EventDriven", mbvi.EventDriven(), 1e-3, 60.0)
    assert refused.verdict == "refused" and "EventDriven" in refused.said

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
    drawn = (tmp_path / "stress.svg").read_text()
    # each row says what its numbers are, with their unit
    assert "<svg" in drawn and all(scene["number"] in drawn for scene in told["scenes"])
    assert "reached its limit of CPU time" in drawn


def test_the_results_of_other_scenes_are_kept(tmp_path):
    def run(*words):
        asked = ["stress", *words, "--step", "0.01", "--tolerance", "1e-6", "--out", str(tmp_path)]
        return CliRunner().invoke(app, asked)

    def cells():
        return json.loads((tmp_path / "stress.json").read_text())["cells"]

    assert "is no file of `mbvi stress`" in str(run("rocking", "--keep").exception)
    assert run("stretch").exit_code == 0
    first = cells()
    result = run("rocking", "--keep")
    assert result.exit_code == 0 and "EventDriven: 2 held" in result.stdout
    # in the order of a sweep over both
    assert cells()[len(first) :] == first and len(cells()) == 2 * len(first)
    assert run("rocking", "--keep").exit_code == 0 and len(cells()) == 2 * len(first)
    refused = run("rocking", "--keep", "--budget", "3")
    assert "give --budget 10" in str(refused.exception) and len(cells()) == 2 * len(first)


def modelled(name, h):
    scene = NAMES[name]
    problem = scene.make(h)
    return problem, model_of(scene, problem)


LEFT_OUT = {"near-grazing chaos", "slider-crank with play", "arm at full stretch", "50 s in a disc"}
LEFT_OUT |= {scene.name for scene in FRICTION}


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_given_to_other_engines_in_its_own_coordinates_or_not_at_all(name, rng):
    if name in LEFT_OUT:
        with pytest.raises(NoModelError):
            modelled(name, 1e-3)
        return
    problem, model = modelled(name, 1e-3)
    q = problem.system.integrate(problem.q0, 1e-3 * rng.standard_normal(problem.system.nv))
    v = rng.standard_normal(problem.system.nv)
    again, rate = model.coordinates(model.state(q, v))
    np.testing.assert_allclose(problem.system.difference(q, again), 0.0, atol=1e-12)
    # angles that are small in the scene are turns about axes there
    np.testing.assert_allclose(rate, v, atol=1e-12)
    # what touches is as heavy in both
    poses = model.state(problem.q0, v)
    masses, inertias = np.array([b.mass for b in model.bodies]), np.array([b.inertia for b in model.bodies])
    turns = Rotation.from_quat(poses.quaternion)
    spins = turns.apply(poses.angular, inverse=True)
    energy = 0.5 * (masses * (poses.linear**2).sum(axis=1)).sum() + 0.5 * (inertias * spins**2).sum()
    assert energy == pytest.approx(problem.system.kinetic_energy(problem.q0, v), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in NAMES if n not in LEFT_OUT and "ratio" not in n])
def test_mujoco_moves_as_we_do_until_something_touches(name):
    engine, off = import_module("mbvi_studies.engines.in_mujoco"), []
    for h in (1e-3, 1e-4):
        problem, model = modelled(name, 1e-3)
        peer = engine.Free(model, h)
        peer.start(model.state(problem.q0, problem.v0))
        # compared are steps after which one more is free
        for here, ahead in pairwise(mbvi.steps(problem, mbvi.Centered(), step=h)):
            if ahead.percussion.any() or ahead.t > 0.5:
                break
            peer.advance()
            q, v = model.coordinates(peer.read())
            found = np.append(problem.system.difference(here.q, q), v - here.v)
        off.append(np.abs(found).max())
    # Euler's method, and no more
    assert off[1] < 1e-8 or off[1] == pytest.approx(0.1 * off[0], rel=0.1), off


def test_mujoco_is_judged_as_we_are_with_its_setting_said():
    found = peer_cell("in_mujoco", "rocking block", 1.03e-3, 60.0)
    assert found.verdict == "held" and found.scheme.startswith("MuJoCo") and "solref" in found.setting
    # too soft for what it carries
    assert peer_cell("in_mujoco", "mass ratio 1e8", 1.03e-2, 60.0).verdict == "failed"
    # what it gives back has no numbers any more
    lost = peer_cell("in_mujoco", "tumbling body, 20 s", 0.103, 60.0)
    assert lost.verdict == "failed" and "diverges" in lost.said
    none = peer_cell("in_mujoco", "50 s in a disc", 1.03e-3, 60.0)
    assert (none.verdict, none.setting) == ("not run", "") and "circle" in none.said


def test_what_an_engine_cannot_be_given_is_not_run_and_its_other_process_counts(monkeypatch):
    def refused(model, h):
        raise NoModelError("no words for it")

    class Slow:
        settings, continuous = "slowly", False

        def __init__(self, model, h):
            pass

        def clock(self):
            return 7.0

        def limit(self, seconds):
            self.allowed = seconds

        def start(self, state):
            assert self.allowed == 5.0
            raise TimeoutError

    engine = SimpleNamespace(NAME="Engine 1", FAILURES=(RuntimeError,), Free=refused)
    monkeypatch.setattr("mbvi_studies.stress.peers._engine", lambda module: engine)
    found = peer_cell("none", "rocking block", 1e-3, 5.0)
    assert (found.verdict, found.said, found.value, found.setting) == ("not run", "no words for it", np.inf, "")
    engine.Free = Slow
    found = peer_cell("none", "rocking block", 1e-3, 5.0)
    assert (found.verdict, found.setting) == ("too slow", "slowly") and 7.0 <= found.cpu < 8.0


SICONOS = next(peer for peer in PEERS if peer.name == "Siconos")
needs_siconos = pytest.mark.skipif(not SICONOS.installed, reason=SICONOS.install)


def test_of_turning_bodies_only_points_over_planes_are_passed_on_to_siconos():
    for name in NAMES.keys() - LEFT_OUT:
        _, model = modelled(name, 1e-3)
        if "ratio" in name:
            with pytest.raises(NoModelError, match="turn"):
                refuse(model)
        else:
            refuse(model)


@needs_siconos
def test_siconos_is_judged_as_we_are():
    def found(name, budget=60.0):
        return peer_cell("in_siconos", name, 1.03e-3, budget)

    block = found("rocking block")
    assert block.verdict == "held" and block.scheme.startswith("Siconos") and "Lemke" in block.setting
    assert found("mass ratio 1e8").verdict == "not run"
    assert found("cradle, gaps of 1e-3").value < 1e-2
    # what touches is taken for touching, whatever its rounding
    assert found("cradle, touching").value < 1e-3
    slow = found("table on 100 legs", 0.5)
    assert slow.verdict == "too slow" and slow.cpu > 0.4


@needs_siconos
def test_siconos_keeps_the_energy_of_balls_that_meet_aslant():
    engine, none = import_module("mbvi_studies.engines.in_siconos"), np.zeros((2, 3))
    ball = Body(Sphere(0.1), 1.0, np.full(3, 0.004))
    model = Bodies((ball, ball), (), none[0], 1.0, None, None, 1.0)
    peer = engine.Free(model, 1e-3)
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    peer.start(Poses(np.array([[0, 0.05, 0], [0.5, 0, 0]]), turn, np.array([[1.0, 0, 0], [0, 0, 0]]), none))
    peer.many(1000)
    speeds = peer.read().linear
    assert (speeds**2).sum() == pytest.approx(1.0, rel=1e-12)
    # the line of centres at a distance of 0.2 m
    normal = np.array([np.sqrt(0.2**2 - 0.05**2), -0.05, 0]) / 0.2
    np.testing.assert_allclose(speeds[1], normal[0] * normal, atol=2e-3)


def test_an_engine_whose_process_dies_fails_once(monkeypatch):
    asked = []

    @contextmanager
    def dying(silent):
        def call(what, *arguments):
            asked.append(arguments[1:3])
            if arguments[1:3] == ("rocking block", 0.1):
                raise BrokenExecutor
            return "Engine 1" if what.__name__ == "_name" else Cell(arguments[1], "Engine 1", 0, 0, 0, 0, 0)

        yield call

    monkeypatch.setattr("mbvi_studies.stress.peers.worker", dying)
    scenes = [NAMES["rocking block"], NAMES["obtuse corner"]]
    found = list(sweep_peer(PEERS[0], scenes, (0.1, 0.01), 1.0))
    assert [c.verdict for c in found] == ["failed", 0, 0, 0] and found[0].said == "its process died"
    assert asked == [(), *product(("rocking block", "obtuse corner"), (0.1, 0.01))]


def test_the_command_adds_the_engines_that_are_installed(tmp_path, monkeypatch):
    missing = PEERS[1]._replace(imported="no_such_package")
    monkeypatch.setattr("mbvi_studies.engines.PEERS", (PEERS[0], missing))
    asked = ["stress", "rocking", "stretch", "--step", "0.01", "--tolerance", "1e-6", "--peers", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, asked, catch_exceptions=False)
    assert result.exit_code == 0 and f"{missing.name} is not installed" in result.stdout
    cells = json.loads((tmp_path / "stress.json").read_text())["cells"]
    found = {c["scene"]: c for c in cells if c["scheme"].startswith("MuJoCo")}
    assert found["arm at full stretch"]["verdict"] == "not run" and "linkage" in found["arm at full stretch"]["said"]
    assert found["rocking block"]["verdict"] == "degraded" and "solref" in found["rocking block"]["setting"]
    assert found["rocking block"]["step"] == 0.0103
    drawn = {name: (tmp_path / f"{name}.svg").read_text() for name in ("stress", "stress_engines")}
    assert "MuJoCo" in drawn["stress_engines"] and "default" in drawn["stress_engines"]
    assert "MuJoCo" not in drawn["stress"] and "Paoli" in drawn["stress"]


def test_scenes_that_are_run_again_keep_the_cells_of_engines_that_are_not():
    def of(scene, scheme, value):
        return Cell(scene, scheme, 1e-3, value, "held", 1.0, "")

    first, second = SCENES[:2]
    engines = ("default", "MuJoCo 1", "Drake 1")
    old = [of(scene.name, name, 1.0) for name in engines for scene in (first, second)]
    new = [of(first.name, "default", 2.0), of(first.name, "Drake 1", 2.0)]
    found = {(cell.scene, cell.scheme): cell.value for cell in replaced(old, [first], new)}
    expected = dict.fromkeys(((scene.name, name) for name in engines for scene in (first, second)), 1.0)
    assert found == expected | {(first.name, "default"): 2.0, (first.name, "Drake 1"): 2.0}


def test_what_the_picture_needs_is_asked_before_the_sweep(tmp_path, monkeypatch):
    def start(*arguments):
        raise AssertionError("the sweep has begun")

    monkeypatch.setattr("mbvi_studies.stress.sweep.sweep", start)
    (tmp_path / "file").touch()
    found = CliRunner().invoke(app, ["stress", "rocking", "--out", str(tmp_path / "file/out")])
    assert isinstance(found.exception, mbvi.TrajectoryFileError)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    found = CliRunner().invoke(app, ["stress", "rocking", "--out", str(tmp_path)])
    assert isinstance(found.exception, mbvi.InputError) and 'pip install "mbvi[studies]"' in str(found.exception)


def test_scenes_are_listed_and_unknown_ones_refused():
    listed = CliRunner().invoke(app, ["stress", "--list"]).stdout
    assert all(scene.name in listed for scene in SCENES)
    result = CliRunner().invoke(app, ["stress", "no such scene"])
    assert isinstance(result.exception, mbvi.InputError)


_COUNTED = ("held", "degraded", "failed", "too slow")


def test_the_page_says_what_the_file_holds():
    """The table of docs/benchmarks/stability.md has the numbers of stress.json, and every scene's cause is told."""
    docs = DOCS / "benchmarks"
    told, page = json.loads((docs / "stress.json").read_text()), (docs / "stability.md").read_text()
    assert {scene["name"] for scene in told["scenes"]} == {scene.name for scene in SCENES if not scene.long}
    table = {line.split(" | ")[0].strip("| "): line for line in page.splitlines() if line.startswith("| ")}
    causes = page.split("## Causes")[1]
    for scene in told["scenes"]:
        name = scene["name"]
        assert name.split(",")[0].rsplit(" 1e", 1)[0] in causes
        for scheme, step in (("default", 1.03e-3), ("EventDriven", 1e-8)):
            found = [c for c in told["cells"] if (c["scene"], c["scheme"]) == (name, scheme)]
            own = next(c for c in found if c["step"] == pytest.approx(step))
            assert (f"{own['value']:.0e}" if own["value"] is not None else own["verdict"]) in table[name]
    # of the map of engines
    scenes = {c["scene"] for c in told["cells"] if c["scheme"] not in (*SCHEMES, "EventDriven")}
    mapped = [c for c in told["cells"] if c["scene"] in scenes]
    for scheme in {c["scheme"] for c in mapped} & set(table):
        counts = [sum(c["verdict"] == v for c in mapped if c["scheme"] == scheme) for v in _COUNTED]
        assert [int(n) for n in table[scheme].strip("| ").split(" | ")[1:]] == counts
    assert "default" in table
