"""Commands of other packages: entry points, those of studies that are not installed, and commands that need none."""

import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points

import pytest

from support.programs import environment

GROUP = "mbvi.commands"
EXTRA = 'pip install "mbvi[studies]"'
PLUGIN = """import typer

app = typer.Typer(add_completion=False)


@app.command()
def greet(name: str):
    "Say hello."
    print(f"hello {name}")
"""


# the entry points are missing, or the package that they name
VALUES = pytest.mark.parametrize("values", [{}, {"chart": "no_package.a:app", "stress": "no_package.b:app"}])


@pytest.fixture
def plugged(monkeypatch):
    """Let the given entry points be all that are installed."""

    def plug(**values):
        points = [EntryPoint(name, value, GROUP) for name, value in values.items()]
        monkeypatch.setattr("mbvi.cli.commands.entry_points", lambda group: points)

    return plug


def test_studies_plug_in_their_commands_by_entry_points():
    found = {point.name: point.value for point in entry_points(group=GROUP) if point.value.startswith("mbvi")}
    assert found == {name: f"mbvi_studies.commands.{name}:app" for name in ("chart", "stress")}


@pytest.mark.parametrize(
    "arguments", [("chart",), ("chart", "piles", "--peers"), ("stress", "chain", "--step", "1e-3")]
)
@VALUES
def test_without_studies_their_commands_name_the_extra(command, plugged, arguments, values):
    plugged(**values)
    code, out, err = command(*arguments)
    assert (code, out) == (2, "") and err.count("\n") == 1
    assert err.startswith(f"mbvi: the command {arguments[0]} is not installed: ") and EXTRA in err
    assert ("no_package" in err) == bool(values)


@VALUES
def test_without_studies_the_help_lists_their_commands_with_the_extra(command, plugged, values):
    plugged(**values)
    code, out, _ = command("--help")
    assert code == 0 and out.count(EXTRA) == 2
    for name in ("chart", "stress"):
        code, out, _ = command(name, "--help")
        assert code == 0 and EXTRA in out


@pytest.mark.parametrize("arguments", [("chart", "rod"), ("chart", "piles"), ("chart", "friction"), ("stress",)])
def test_without_matplotlib_the_commands_name_the_extra_before_they_compute(command, monkeypatch, arguments):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, out, err = command(*arguments)
    assert (code, out) == (2, "") and EXTRA in err and err.count("\n") == 1


def test_any_package_adds_a_command_and_a_broken_one_leaves_the_others(command, plugged, tmp_path, monkeypatch):
    (tmp_path / "plugin_of_a_test.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    # a command of mbvi is never replaced
    plugged(greet="plugin_of_a_test:app", broken="no_package:app", demo="plugin_of_a_test:app")
    assert command("greet", "you") == (0, "hello you\n", "")
    code, out, _ = command("--help")
    assert code == 0 and "Say hello." in out and "  broken    not installed\n" in out and "Drop a quadruped" in out
    code, _, err = command("broken")
    assert code == 2 and "no_package" in err and EXTRA not in err
    code, _, err = command("gret")
    assert code == 2 and "Did you mean 'greet'" in err


def test_commands_of_mbvi_load_no_entry_point_and_nothing_of_studies():
    program = """import sys
import mbvi.cli.commands as commands
def refuse(group): raise AssertionError("looked up")
commands.entry_points = refuse
from mbvi.cli.main import app
app(["demo", "--help"], standalone_mode=False)
assert not [name for name in sys.modules if name.startswith("mbvi_studies")]
"""
    done = subprocess.run([sys.executable, "-c", program], env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Drop a quadruped" in done.stdout
