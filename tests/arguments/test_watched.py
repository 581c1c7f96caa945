"""A bar is seen on a terminal only, after a second, and the items are the same with and without it."""

import os
import sys
import termios

import pytest

from mbvi.arguments import watched
from support.programs import LIMIT, environment, started

SLOW = """
import sys, time
from mbvi.arguments import watched
for k in watched(range(5), "parts"):
    time.sleep(float(sys.argv[1]))
    print(k)
"""


# Ctrl-C within the making of the bar
INTERRUPTED = """
import os, signal, sys
from mbvi.arguments import watched
def called(frame, event, argument):
    if event == "call" and frame.f_code.co_qualname == "EMA.__init__":
        sys.setprofile(None)
        os.kill(os.getpid(), signal.SIGINT)
sys.setprofile(called)
try:
    list(watched(range(5), "parts"))
except KeyboardInterrupt:
    print("interrupted")
"""

# with bars from the start
WORK = """
import mbvi, mbvi.arguments.bar
from mbvi.cli.main import main
mbvi.arguments.bar.PATIENCE = 1e-9
scene = mbvi.Scene()
scene.add_halfspace((0, 0, 1))
scene.add_sphere(0.1, position=(0, 0, 0.5))
run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1, progress=True)
run.replay_html("replay.html")
run.energies()
main(["simulate", "robot:hopper", "--step", "1e-2", "--duration", "0.1"])
"""


def on_a_terminal(*command, **options):
    """What a program writes to stdout, and what a terminal shows of its stderr."""
    terminal, end = os.openpty()
    termios.tcsetwinsize(end, (24, 80))
    with started(command, stderr=end, text=False, **options) as child:
        os.close(end)
        said = b""
        try:
            while piece := os.read(terminal, 4096):
                said += piece
        except OSError:
            # the other end is closed
            pass
        printed = child.stdout.read()
        assert child.wait(LIMIT) == 0
    os.close(terminal)
    return printed, said


def test_without_a_terminal_items_are_yielded_as_they_are(capsys):
    assert list(watched("abc", "letters")) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("seconds", "shown"), [(0.4, True), (0.01, False)])
def test_a_terminal_shows_a_bar_after_a_second_and_clears_it(seconds, shown):
    printed, said = on_a_terminal(sys.executable, "-c", SLOW, seconds)
    assert printed.split() == [b"0", b"1", b"2", b"3", b"4"]
    assert (b"parts:" in said) is shown
    assert not said.rpartition(b"\r")[2].strip()
    assert not said.replace(b"\r", b"\n").strip().endswith(b"%")


def test_an_interrupt_while_the_bar_is_made_says_nothing_of_its_own():
    assert on_a_terminal(sys.executable, "-c", INTERRUPTED) == (b"interrupted\n", b"")


def test_runs_pages_energies_and_robots_show_bars(tmp_path):
    # these parts end sooner than tqdm draws again
    variables = environment() | {"TQDM_MININTERVAL": "0"}
    _, said = on_a_terminal(sys.executable, "-c", WORK, cwd=tmp_path, env=variables)
    assert all(name in said for name in (b"100/100 ", b"page:", b"energies:", b"robot:"))
