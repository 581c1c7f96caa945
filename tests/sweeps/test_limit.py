"""Limits of CPU time: what they raise stays inside, and leaves nothing behind in the process."""

import contextlib
import sys
import threading
import time

import pytest

from mbvi.sweeps.limit import Limit, OverBudget
from support.programs import run

# a process that is traced looks for exceptions of other threads at each call, until none is there
TRACED = """
import faulthandler, sys, time
from mbvi.sweeps.limit import Limit, OverBudget
faulthandler.dump_traceback_later(60, exit=True)
def spin(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass
for seconds in {seconds}:
    try:
        with Limit(0.02):
            spin(seconds)
    except OverBudget:
        print("over budget")
sys.settrace(lambda *_: None)
spin(0.01)
print("done")
"""


@pytest.mark.parametrize(
    ("seconds", "said"),
    [([0.0, 0.0], "done\n"), ([5.0], "over budget\ndone\n"), ([0.02] * 20, None)],
    ids=["within", "beyond", "at the limit"],
)
def test_a_process_is_as_before_after_runs_with_a_limit(seconds, said):
    child = run([sys.executable, "-c", TRACED.format(seconds=seconds)])
    assert child.returncode == 0, child.stderr
    assert child.stdout.endswith("done\n") and said in (None, child.stdout)


def test_what_is_raised_at_the_end_never_leaves_the_limit():
    """Runs that end when their limit is reached: nothing is raised after them, which would end the thread."""
    done = []

    def go():
        for k in range(40):
            with contextlib.suppress(OverBudget), Limit(2e-3):
                end = time.thread_time() + 2e-3 + 1e-4 * (k % 20)
                while time.thread_time() < end:
                    pass
            # it would arrive here
            for _ in range(1000):
                time.sleep(0.0)
            done.append(k)

    thread = threading.Thread(target=go)
    thread.start()
    thread.join()
    assert len(done) == 40
