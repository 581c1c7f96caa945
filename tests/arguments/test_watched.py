"""A bar is seen on a terminal only, after a second, and the items are the same with and without it."""

import os
import subprocess
import sys
import termios

import pytest

from mbvi.arguments import watched
from support.programs import LIMIT

SLOW = """
import sys, time
from mbvi.arguments import watched
for k in watched(range(5), "parts"):
    time.sleep(float(sys.argv[1]))
    print(k)
"""


def test_without_a_terminal_items_are_yielded_as_they_are(capsys):
    assert list(watched("abc", "letters")) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("seconds", "shown"), [(0.4, True), (0.01, False)])
def test_a_terminal_shows_a_bar_after_a_second_and_clears_it(seconds, shown):
    terminal, end = os.openpty()
    termios.tcsetwinsize(end, (24, 80))
    with subprocess.Popen([sys.executable, "-c", SLOW, str(seconds)], stdout=subprocess.PIPE, stderr=end) as child:
        os.close(end)
        said = b""
        try:
            while piece := os.read(terminal, 4096):
                said += piece
        except OSError:
            # the other end is closed
            pass
        assert child.stdout.read().split() == [b"0", b"1", b"2", b"3", b"4"]
        assert child.wait(LIMIT) == 0
    os.close(terminal)
    assert (b"parts:" in said) is shown
    assert not said.rpartition(b"\r")[2].strip()
    assert not said.replace(b"\r", b"\n").strip().endswith(b"%")
