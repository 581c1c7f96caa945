"""`mbvi run` runs what a file of Python makes; a model from a MJCF runs by `mbvi simulate`."""

import sys

import pytest

import mbvi
from mbvi.cli.run import _values
from support.programs import environment, run

SCENE = """
import mbvi

def make(height=1.0, words="none given", still=None):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, position=(0, 0, height + 0.1), name=words.replace(" ", "_"))
    return scene.build() if still else scene

options = dict(duration=0.3, step=1e-3, scheme=mbvi.Paoli())
"""
FALLING = """<mujoco model="ball"><option gravity="0 0 -9.81"/><worldbody>{plane}
  <body name="b" pos="0 0 {z}"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
PLANE = '<geom name="ground" type="plane" size="1 1 1"/>'


def test_a_file_runs_with_the_arguments_that_are_set(command, tmp_path):
    (tmp_path / "one_scene.py").write_text(SCENE)
    code, out, err = command(
        "run", "one_scene.py", "--set", "height=0.2", "--set", "words=a ball", "--set", "still=true", "--out", "run.h5"
    )
    assert (code, err) == (0, "")
    run = mbvi.load("run.h5")
    assert run.q[0, 2] == pytest.approx(0.3) and run.t[-1] == 0.3 and run.scheme == "Paoli"
    assert run.problem.system.bodies == ("world", "a_ball") and "scheme       Paoli, h = 0.001 s" in out
    assert run.impacts and "loops" not in out


def test_a_run_with_loops_states_how_far_they_were_open(command, tmp_path):
    lines = ["import mbvi", "def make():", "    scene = mbvi.Scene()"]
    lines += ["    scene.add_box((1, 1, 1), 1.0, position=(1, 0, 0), name='box')"]
    lines += ["    scene.hinge('world', 'box', at=(0, 0, 0), axis=(0, 1, 0))", "    return scene"]
    (tmp_path / "hinged_scene.py").write_text("\n".join(lines))
    code, out, err = command("run", "hinged_scene.py", "--step", "1e-2", "--duration", "0.1", "--out", "run.h5")
    assert (code, err) == (0, "")
    assert f"loops        open by {mbvi.load('run.h5').loop_gap().max():.3g} m or rad at most" in out


def test_options_of_the_command_go_before_those_of_the_file(command, tmp_path):
    (tmp_path / "two_scene.py").write_text(SCENE)
    words = ("--scheme", "moreau-jean", "--step", "2e-3", "--duration", "0.1", "--out", "run.h5")
    assert command("run", "two_scene.py", *words)[0] == 0
    run = mbvi.load("run.h5")
    assert (run.scheme, run.step, run.t[-1]) == ("MoreauJean", 2e-3, 0.1)


def test_values_are_what_python_writes():
    given = ["a=1", "b=1e-3", "c=[1, 2]", "d=true", "e=None", "f=steel", "g=x=1", "h="]
    found = _values(given)
    assert found == {"a": 1, "b": 1e-3, "c": [1, 2], "d": True, "e": None, "f": "steel", "g": "x=1", "h": ""}


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        (None, (), "no such file: wrong_"),
        ("x = 1", (), "must define make"),
        ("raise ValueError('no')", (), "cannot be imported: ValueError: no"),
        ("def make(a): pass", (), "missing a required argument: 'a'; set its arguments by --set, which are a"),
        ("def make(a=1): pass", ("--set", "b=1"), "unexpected keyword argument 'b'"),
        ("def make(a=1): pass", ("--set", "b"), "--set must be NAME=VALUE; got 'b'"),
        ("def make(): pass", (), "make must return a Scene or a Problem; got NoneType"),
        ("def make(): return 1 / 0", (), "make raises ZeroDivisionError"),
        ("def make(): pass\noptions = 1", (), "options must be a dict"),
        ("def make(): pass\noptions = dict(stepp=1)", (), "no argument stepp"),
        ("import mbvi\ndef make(): return mbvi.Scene()", (), "nothing in the scene moves"),
    ],
)
def test_wrong_files_are_one_line_and_exit_code_2(command, tmp_path, text, words, said, request):
    name = f"wrong_{abs(hash(said))}.py"
    if text is not None:
        (tmp_path / name).write_text(text)
    code, _, err = command("run", name, *words)
    assert code == 2
    assert err.startswith("mbvi: ") and err.count("\n") == 1 and said in err


@pytest.mark.parametrize(("plane", "z", "start"), [("", 3, 0.6), (PLANE, 0.5, 0.5)])
def test_a_mjcf_falls_on_its_own_floor_or_on_that_of_the_command(command, tmp_path, plane, z, start):
    pytest.importorskip("mujoco")
    (tmp_path / "ball.xml").write_text(FALLING.format(plane=plane, z=z))
    code, out, err = command("simulate", "ball.xml", "--step", "1e-3", "--duration", "0.5", "--out", "run.h5")
    assert (code, err) == (0, "")
    run = mbvi.load("run.h5")
    assert run.q[0, 2] == pytest.approx(start) and run.impacts
    assert list(run.problem.scene.walls) == (["ground"] if plane else ["floor"])
    code, out, _ = command("inspect", "ball.xml")
    assert code == 0 and "b_joint" in out
    code, _, err = command("simulate", "ball.xml", "--base", "free")
    assert code == 2 and "a MJCF has its own base" in err


def test_gravity_is_that_of_the_mjcf(command, tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "moon.xml").write_text(FALLING.format(plane=PLANE, z=2.0).replace("-9.81", "-1.62"))
    code, out, _ = command("simulate", "moon.xml", "--duration", "0.5", "--step", "1e-3", "--out", "run.h5")
    assert code == 0 and "gravity" not in out
    run = mbvi.load("run.h5")
    assert run.q[-1, 2] == pytest.approx(2.0 - 0.5 * 1.62 * run.t[-1] ** 2)


def test_a_mjcf_without_gravity_floats(command, tmp_path):
    text = FALLING.format(plane=PLANE, z=2.0).replace(
        "<worldbody>", "<option><flag gravity='disable'/></option><worldbody>"
    )
    (tmp_path / "space.xml").write_text(text)
    code, out, err = command("simulate", "space.xml", "--duration", "0.5", "--step", "1e-3", "--out", "run.h5")
    assert code == 0 and "gravity" not in out + err
    run = mbvi.load(tmp_path / "run.h5")
    assert (run.q[-1] == run.q[0]).all()


def test_what_a_mjcf_loses_is_a_note(command, tmp_path):
    pytest.importorskip("mujoco")
    text = FALLING.format(plane=PLANE, z=0.5).replace(
        "</worldbody>", '</worldbody><actuator><motor body="b" gear="1"/></actuator>'
    )
    (tmp_path / "ball.xml").write_text(
        text.replace("<motor body", "<adhesion body").replace(' gear="1"', ' ctrlrange="0 1"')
    )
    for name in ("simulate", "inspect"):
        code, out, err = command(name, "ball.xml", *(("--duration", "0.01") if name == "simulate" else ()))
        assert (code, err) == (0, "") and out.count(
            "note         ball.xml: the file also holds what is not modelled: actuator 0"
        ) == 1


def test_a_terminal_of_few_characters_shows_the_others_as_escapes(tmp_path):
    (tmp_path / "named.py").write_text(SCENE, encoding="utf-8")
    command = [sys.executable, "-m", "mbvi", "run", "named.py", "--set", "height=0.2", "--set", "words=Käse 日"]
    done = run(command, cwd=tmp_path, env=environment() | {"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "") and r"K\xe4se_\u65e5 | floor" in done.stdout
