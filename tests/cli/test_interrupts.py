"""Ctrl-C at any time of a command is one line and the exit code 130."""

import signal
import sys
import time

import pytest

from support.paths import ROBOTS
from support.programs import LIMIT, started

PROGRAM = "import sys, mbvi_command; print('begins', flush=True); mbvi_command.main()"


# in the first of them packages are still being imported
@pytest.mark.parametrize("delay", [0.02, 0.1, 0.3, 0.6, 1.0])
def test_an_interrupt_while_packages_are_imported_is_one_line(delay, tmp_path):
    command = ["simulate", ROBOTS / "hopper/hopper.urdf", "--duration", "1000", "--every", "1000", "--step", "1e-3"]
    with started([sys.executable, "-c", PROGRAM, *command], cwd=tmp_path) as child:
        assert child.stdout.readline() == "begins\n"
        time.sleep(delay)
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=LIMIT)
    assert (child.returncode, said) == (130, "mbvi: interrupted\n")


# sends the signal when functions have been called one after the other
AT = """
import os, signal, sys, mbvi_command
def called(frame, event, argument):
    if event == "call" and frame.f_code.co_qualname == names[0]:
        del names[0]
        if not names:
            sys.setprofile(None)
            os.kill(os.getpid(), signal.SIGINT)
names = sys.argv.pop(1).split()
sys.setprofile(called)
mbvi_command.main()
"""


# of the last, Python 3.11 makes a RuntimeError
@pytest.mark.parametrize("where", ["get_command", "load_robot", "assemble", "page_of", "load_robot Field.__set_name__"])
def test_an_interrupt_at_each_stage_of_a_run_is_one_line(where, tmp_path):
    command = ["simulate", ROBOTS / "hopper/hopper.urdf", "--duration", "0.01", "--step", "1e-3", "--replay", "r.html"]
    with started([sys.executable, "-c", AT, where, *command], cwd=tmp_path) as child:
        _, said = child.communicate(timeout=LIMIT)
    assert (child.returncode, said) == (130, "mbvi: interrupted\n")
