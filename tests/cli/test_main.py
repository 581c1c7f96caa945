"""The command line: what it prints, what it writes, and one line on anything the user can put right."""

import logging
import os
import re
import shlex
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import mbvi
from mbvi.cli.names.schemes import SchemeName
from mbvi.cli.names.solvers import SolverName
from support.paths import DATA, ROBOTS
from support.programs import run

HOPPER = ROBOTS / "hopper/hopper.urdf"
ARM = ROBOTS / "arm/arm.urdf"
COMMANDS = ("demo", "simulate", "run", "inspect", "replay", "chart", "stress", "sweep")
NAMES = sorted(p.name for p in ROBOTS.iterdir())


def lowest_gap(problem):
    floor = next(c for c in problem.constraints.constraints if isinstance(c, mbvi.constraints.HalfSpaceContacts))
    return floor.gap(0.0, problem.q0).min()


def test_simulate_takes_friction(command):
    code, out, err = command(
        "simulate", HOPPER, "--friction", 0.5, "--step", 1e-3, "--duration", 0.4, "--out", "run.h5"
    )
    assert (code, err) == (0, "")
    assert "Coulomb friction, mu 0.5" in out
    assert mbvi.load("run.h5").problem.constraints.frictional


def test_simulate_prints_and_writes(command):
    code, out, err = command(
        *("simulate", HOPPER, "--base", "free", "--height", 0.2, "--restitution", 0.4, "--step", 1e-3),
        *("--duration", 0.3, "--out", "run.h5", "--replay", "run.html"),
    )
    assert (code, err) == (0, "")
    trajectory = mbvi.load("run.h5")
    first = trajectory.impacts[0]
    fall = np.sqrt(2 * 0.2 / 9.81)
    assert fall < first.time < fall + 2e-3
    np.testing.assert_allclose(first.after, -0.4 * first.before, rtol=1e-9)
    assert trajectory.impact_table() in out
    start, end = trajectory.energy()[[0, -1]]
    assert f"{start:.6g} J at the start, {end:.6g} J at the end" in out
    assert f"{trajectory.penetration().max():.3g} m at most" in out
    assert "for 300 steps" in out and "8 degrees of freedom" in out and "7 pairs" in out
    assert f"Left out: {len(trajectory.problem.scene.omitted)} items, which `mbvi inspect` lists" in out
    assert "run.h5" in out and "run.html" in out
    assert "Centered, h = 0.001 s" in out and "default at a given step" in out
    assert Path("run.html").read_text().lstrip().lower().startswith("<!doctype html")


@pytest.mark.parametrize(
    ("words", "scheme", "step"),
    [
        ((), "Centered", 1e-3),
        (("--scheme", "paoli"), "Paoli", 1e-3),
        (("--scheme", "moreau-jean", "--step", 2e-3), "MoreauJean", 2e-3),
        (("--scheme", "centered"), "Centered", 1e-3),
        (("--scheme", "schatzman-paoli"), "SchatzmanPaoli", 1e-3),
        (("--scheme", "event-driven"), "EventDriven", 0.0),
        (("--scheme", "event-driven", "--tolerance", 1e-4), "EventDriven", 0.0),
        (("--scheme", "adaptive", "--tolerance", 1e-2), "Adaptive", 0.0),
        (("--tolerance", 1e-4), "EventDriven", 0.0),
    ],
)
def test_a_scheme_is_named_or_chosen_and_said(command, words, scheme, step):
    code, out, err = command("simulate", HOPPER, "--height", 0.01, "--duration", 0.1, *words, "--out", "run.h5")
    assert (code, err) == (0, "")
    trajectory = mbvi.load("run.h5")
    assert (trajectory.scheme, trajectory.step) == (scheme, step)
    assert f"scheme       {scheme}" in out
    if scheme == "EventDriven":
        assert trajectory.record.scheme.tolerance == (1e-4 if 1e-4 in words else 1e-6)
    # the reason stands there where nothing was named
    assert ("was chosen: the contact normal of hopper/trunk_0 | hopper/shin_0 can jump" in out) == (not words)


@pytest.mark.parametrize("word", SchemeName)
def test_every_word_of_a_scheme_runs(command, word):
    code, out, err = command("simulate", HOPPER, "--height", 0.01, "--duration", 0.06, "--scheme", word)
    assert (code, err) == (0, "") and f"scheme       {type(word.make()).__name__}" in out


@pytest.mark.parametrize("word", SolverName)
def test_every_word_of_a_solver_runs_and_is_said(command, word):
    words = ("simulate", HOPPER, "--height", 0.01, "--duration", 0.06, "--solver", word)
    code, out, err = command(*words)
    assert (code, err) == (0, "")
    assert f"note         every projection was solved by {word.solver!r}" in out


@pytest.mark.parametrize("height", [0.0, 0.3])
def test_height_of_a_free_robot_is_its_clearance_in_its_starting_pose(command, height):
    code, *_ = command(
        *("simulate", HOPPER, "--height", height, "--joint", "hip=-0.5", "--joint", "knee=1"),
        *("--step", 1e-3, "--duration", 0.01, "--every", 5, "--out", "run.h5"),
    )
    trajectory = mbvi.load("run.h5")
    assert code == 0
    assert lowest_gap(trajectory.problem) == pytest.approx(height, abs=1e-12)
    np.testing.assert_array_equal(trajectory.q[0, 7:], [-0.5, 1.0])
    np.testing.assert_allclose(trajectory.t, [0.0, 5e-3, 1e-2])


@pytest.mark.parametrize("height", [None, 0.2])
def test_height_of_a_fixed_robot_is_its_base(command, height):
    given = () if height is None else ("--height", height)
    code, *_ = command("simulate", ARM, "--base", "fixed", *given, "--duration", 0.01, "--out", "run.h5")
    position = mbvi.load("run.h5").problem.scene.items.robots[0].position
    assert code == 0
    np.testing.assert_array_equal(position, [0.0, 0.0, height or 0.0])


@pytest.mark.parametrize("name", NAMES)
def test_the_command_in_each_robots_readme_runs(command, name):
    text = (ROBOTS / name / "README.md").read_text()
    line = text.split("```\nmbvi ")[1].split("```")[0].replace("\\\n", " ").replace("--duration 2", "--duration 0.05")
    words = [str(ROBOTS.parent / w) if w.startswith("robots/") else w for w in shlex.split(line)]
    code, _, err = command(*words)
    assert (code, err) == (0, "")
    assert Path("run.h5").is_file() and Path("run.html").is_file()


def test_inspect_names_joints_shapes_pairs_and_what_is_left_out(command):
    code, out, err = command("inspect", ARM, "--base", "fixed")
    assert (code, err) == (0, "")
    lines = [line.split() for line in out.splitlines()]
    assert ["joint3", "revolute", "1", "-2.4", "to", "0.9", "rad"] in lines
    assert ["left_finger_joint", "prismatic", "1", "0", "to", "0.04", "m"] in lines
    assert ["left_finger", "box", "0.065", "x", "0.012", "x", "0.024", "left_finger_joint"] in lines
    assert ["elbow", "cylinder", "radius", "0.045,", "length", "0.1", "joint3"] in lines
    assert "8 degrees of freedom" in out and "65 pairs of shapes" in out
    assert "pair arm/elbow | arm/forearm: adjacent links" in out


def test_inspect_names_what_mimic_joints_follow(command):
    code, out, err = command("inspect", DATA / "fingers.urdf")
    assert (code, err) == (0, "")
    lines = [line.split() for line in out.splitlines()]
    assert ["name", "type", "dof", "limits", "follows"] in lines
    assert ["follower", "revolute", "1", "-1", "to", "1", "rad", "2", "lead"] in lines
    assert ["lead", "revolute", "1", "-1", "to", "1", "rad"] in lines


def test_inspect_takes_an_srdf_and_a_robot_that_would_stand_in_the_floor(command, tmp_path):
    srdf = tmp_path / "double.srdf"
    srdf.write_text('<robot name="arm"><disable_collisions link1="elbow" link2="hand_1"/></robot>')
    _, out, _ = command("inspect", ARM, "--base", "fixed", "--srdf", srdf)
    assert "disabled by the SRDF" in out
    pendulum = tmp_path / "pendulum.urdf"
    pendulum.write_text(PENDULUM)
    code, out, _ = command("inspect", pendulum, "--base", "fixed")
    assert code == 0 and "would start it, the initial configuration is not admissible" in out
    assert ["turn", "continuous", "1", "none"] in [line.split() for line in out.splitlines()]


def test_inspect_shows_the_limit_of_a_joint_that_has_one(command, tmp_path):
    file, none = tmp_path / "pendulum.urdf", "1.79e308"
    for lower, upper, words in (("-0.5", none, "at least -0.5 m"), (f"-{none}", "0.5", "at most 0.5 m")):
        given = PENDULUM.replace('lower="-0.5" upper="0.5"', f'lower="{lower}" upper="{upper}"')
        file.write_text(given)
        _, out, _ = command("inspect", file, "--base", "fixed")
        assert ["slide", "prismatic", "1", *words.split()] in [line.split() for line in out.splitlines()]


PENDULUM = """<robot name="pendulum"><link name="base"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="bob"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="bob"/><origin xyz="0 0 -1"/><axis xyz="0 0 1"/>
<limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint></robot>"""


def test_a_robot_without_shapes_touches_nothing(command, tmp_path):
    bare = tmp_path / "bare.urdf"
    bare.write_text(re.sub("<collision>.*?</collision>", "", PENDULUM))
    code, out, err = command("simulate", bare, "--base", "fixed", "--duration", 0.1)
    assert (code, err) == (0, "") and "the robot touches nothing" in out and "no impact" in out
    code, out, _ = command("inspect", bare, "--base", "fixed")
    assert code == 0 and "none: it touches nothing" in out


def test_inspect_names_a_free_base(command):
    _, out, _ = command("inspect", HOPPER)
    assert ["root_joint", "free", "6", "none"] in [line.split() for line in out.splitlines()]


def test_demo_and_replay(command):
    code, out, err = command("demo")
    assert (code, err) == (0, "")
    page = Path("out/demo.html")
    assert page.is_file() and str(page) in out and "opens in any browser" in out
    with pytest.warns(mbvi.MbviWarning, match="control of robot 'quadruped'"):
        trajectory = mbvi.load("out/demo.h5")
    names = {n for impact in trajectory.impacts for n in impact.constraints}
    assert any("ball" in n and "quadruped" in n for n in names) and any("foot | floor" in n for n in names)
    assert trajectory.t[-1] == 2.0 and trajectory.penetration().max() < 0.01
    code, out, _ = command("replay", "out/demo.h5", "--html", "again.html")
    assert code == 0 and "again.html" in out
    assert Path("again.html").stat().st_size == pytest.approx(page.stat().st_size, rel=0.01)


def test_an_interrupted_run_leaves_its_file(command, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("mbvi.run.recording.recorder.Recorder.impact", interrupt)
    code, out, err = command("simulate", HOPPER, "--height", 0.01, "--out", "run.h5")
    assert (code, err) == (130, "mbvi: interrupted\n") and "run.h5 (interrupted at t = " in out
    code, out, _ = command("replay", "run.h5", "--html", "run.html")
    assert code == 0 and "is incomplete" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("simulate", "missing.urdf"), "no such file: missing.urdf"),
        (("simulate", "text.urdf"), "text.urdf is no XML"),
        (("inspect", "empty.urdf"), "no <link>"),
        (("simulate", "orphan.urdf"), "orphan.urdf: "),
        (("simulate", HOPPER, "--restitution", 1.5), "restitution e must lie in [0, 1]; got 1.5"),
        (("simulate", HOPPER, "--friction", -0.5), "friction must be zero or a positive"),
        (("simulate", HOPPER, "--step", 0), "step must be positive"),
        (("simulate", HOPPER, "--step", "abc"), "'--step'"),
        (("simulate", HOPPER, "--scheme", "euler"), "'euler' is not one of"),
        (("simulate", HOPPER, "--solver", "osqp"), "'osqp' is not one of"),
        (("simulate", HOPPER, "--scheme", "paoli", "--tolerance", 1e-6), "--tolerance is an option of event-driven"),
        (("simulate", HOPPER, "--tolerance", 1e-6, "--step", 1e-3), "leave out step"),
        (("simulate", HOPPER, "--base", "flying"), "'flying' is not one of"),
        (("simulate", HOPPER, "--joint", "knee"), "--joint must be NAME=VALUE"),
        (("simulate", HOPPER, "--joint", "knee=bent"), "--joint must be NAME=VALUE"),
        (("simulate", HOPPER, "--joint", "elbow=1"), "known are hip, knee"),
        (("simulate", HOPPER, "--joint", "knee=3"), "hopper/knee upper limit"),
        (("simulate", HOPPER, "--height", -0.1), "hopper/foot | floor penetrates by 0.1"),
        (("simulate", ARM, "--base", "fixed", "--height", -0.5), "--height raises the base"),
        (("simulate", HOPPER, "--out", "nowhere/run.h5"), "there is no folder nowhere"),
        (("simulate", HOPPER, "--replay", "folder.html"), "it is a folder"),
        (("simulate", HOPPER, "--replay", "page.txt"), "its name ends with .html"),
        (("replay", "missing.h5", "--html", "page.pdf"), "its name ends with .html"),
        (("simulate", HOPPER, "--step", 0), "step must be positive"),
        (("simulate", "folder.html"), "is a folder, not a URDF"),
        (("simulate", "text.urdf", "--out", "text.urdf"), "files must be different"),
        (("simulate", HOPPER, "--duration", 1e9), "not enough memory"),
        (("simulate", HOPPER, "--replay", "/proc/page.html"), "/proc/page.html cannot be written: No such file"),
        (("simulate", HOPPER, "--every", 10**21), f"every must be {2**53} at most"),
        (("replay", "missing.h5"), "no such file"),
        (("replay", "around.h5"), "around.h5 cannot be read: Too many levels of symbolic links"),
        (("simulate", "around.h5"), "around.h5 cannot be read: Too many levels of symbolic links"),
        (("run", "around.h5"), "around.h5 cannot be read: Too many levels of symbolic links"),
        (("replay", "text.urdf"), "truncated or no HDF5 file"),
        (("demo", "--out-dir", "text.urdf"), "cannot be made"),
        (("bounce",), "No such command 'bounce'"),
        (("simulate",), "(see: mbvi simulate --help)"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(command, tmp_path, arguments, said):
    (tmp_path / "text.urdf").write_text("a robot")
    (tmp_path / "folder.html").mkdir()
    (tmp_path / "around.h5").symlink_to("around.h5")
    (tmp_path / "empty.urdf").write_text("<robot name='none'/>")
    (tmp_path / "orphan.urdf").write_text(PENDULUM.replace('<parent link="base"/>', '<parent link="stand"/>'))
    code, out, err = command(*arguments)
    # all of it before the run
    assert code == 2 and "scheme" not in out
    assert err.startswith("mbvi: ") and err.count("\n") == 1 and said in err
    if "--step" in arguments and "0" in map(str, arguments):
        # before the problem is built
        assert not out


def test_help_and_version(command):
    for arguments in ((), ("--help",)):
        code, out, _ = command(*arguments)
        assert code == 0 and all(name in out for name in ("demo", "simulate", "inspect", "replay"))
        # no description is cut
        assert not any(line.endswith("...") for line in out.splitlines()[1:])
    code, out, _ = command("--version")
    assert code == 0 and out.startswith(f"mbvi {mbvi.__version__}\nPython 3.")
    for name in ("pin", "coal", "proxsuite", "numba", "mujoco"):
        assert f"\n{name} {version(name)}\n" in out


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_every_command_has_examples_with_options_that_exist(command, name):
    code, out, _ = command(name, "--help")
    assert code == 0
    shown, _, lines = out.partition("Examples:\n")
    assert "[OPTIONS]" in shown and lines.count("mbvi ") >= 2
    for line in lines.strip().splitlines():
        words = shlex.split(line)
        assert words[:2] == ["mbvi", name]
        assert all(re.search(rf"{word}\b", shown) for word in words if word.startswith("--"))


def test_commands_are_completed_by_the_shell():
    environment = {**os.environ, "_MBVI_COMPLETE": "complete_bash", "COMP_WORDS": "mbvi s", "COMP_CWORD": "1"}
    program = "from mbvi.cli.main import main; main()"
    done = run([sys.executable, "-c", program], env=environment, cwd=ROBOTS.parent)
    assert sorted(done.stdout.split()) == ["simulate", "stress", "sweep"]


def test_the_log_of_the_library_is_lines_on_stderr(command):
    logger = logging.getLogger("mbvi.scene")
    assert command("--help")[0] == 0
    logger.warning("said")
    logger.info("not said")
    code, _, err = command("--verbose", "--version")
    assert (code, err) == (0, "mbvi: said\n")


def test_a_run_that_fails_has_exit_code_1(command, tmp_path):
    (tmp_path / "fails.py").write_text("import mbvi\ndef make():\n    raise mbvi.DivergedError('at t = 1 s')\n")
    assert command("run", "fails.py") == (1, "", "mbvi: at t = 1 s\n")


def test_the_installed_command_runs():
    done = run([Path(sys.executable).parent / "mbvi", "--version"], env=None)
    assert done.returncode == 0 and done.stdout.startswith(f"mbvi {mbvi.__version__}\n")


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_robot_is_found(name):
    assert mbvi.robot(name).read_bytes() == (ROBOTS / name / f"{name}.urdf").read_bytes()


def test_an_unknown_robot_is_refused_with_the_known_ones():
    with pytest.raises(mbvi.InputError, match=f"known are {', '.join(NAMES)}"):
        mbvi.robot("unicycle")
