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
