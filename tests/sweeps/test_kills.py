"""Studies on worker processes: the same table whatever is killed, and whatever the batches and the workers are."""

import contextlib
import os
import signal
import sys
import time

import numpy as np
import pytest

import mbvi
from mbvi.sweeps.points import points_of
from mbvi.sweeps.rows import read_rows
from mbvi.sweeps.study import Study, StudyFolder
from mbvi.sweeps.sweep import run_study
from support import sweep_functions as f
from support.programs import LIMIT, environment, started, wait_until
from support.programs import run as run_program

OPTIONS = {"scheme": mbvi.Paoli(), "step": 2e-3, "duration": 0.1}
# 60 runs
GRID = {"height": np.linspace(0.1, 0.3, 15).tolist(), "e": [0.0, 0.3, 0.5, 0.9]}


ENTRY = [sys.executable, "-c", "from mbvi_command import main; main()"]


class Fixed:
    """Batches of one size."""

    def __init__(self, size):
        self.size = size

    def next(self, left, workers):
        return self.size

    def add(self, done):
        pass


@pytest.fixture(scope="module")
def client():
    """Return the client of worker processes whose number can change."""
    from mbvi.sweeps.cluster import local_client

    with local_client(1) as made:
        yield made


def run(client, folder, make, parameters, measure, size, workers, keep="none", budget=None):
    client.cluster.scale(workers)
    client.wait_for_workers(workers)
    study, points = Study(make, measure, 0, keep, budget, OPTIONS), points_of(parameters, make)
    here = StudyFolder(folder)
    here.open(study, points)
    return run_study(here, study, points, client, Fixed(size))


def table_bytes(folder):
    """Return all columns but those that name the machine."""
    table = read_rows(folder / "rows")
    return {name: table[name].to_pylist() for name in sorted(table.column_names) if name not in ("cpu", "host")}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """Return the rows of the study of `slow`, made in this process without Dask."""
    from mbvi.sweeps.one_run import row_of

    points = points_of(GRID, f.slow)
    study = Study(f.slow, f.energy, 0, "none", None, OPTIONS)
    return [row_of(study, k, points[k], tmp_path_factory.mktemp("runs")) for k in range(len(points))]


def check(folder, expected):
    found = table_bytes(folder)
    assert found["run"] == list(range(len(expected)))
    for name in ("status", "message", "notes", "energy", "v"):
        assert found[name] == [row[name] for row in expected], name


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "size"), [(1, 37), (2, 10), (4, 1)])
def test_batches_and_workers_do_not_change_the_table(workers, size, client, expected, tmp_path):
    run(client, tmp_path / "study", f.slow, GRID, f.energy, size, workers)
    check(tmp_path / "study", expected)


def wait_for_rows(folder, count, child=None):
    def written():
        assert child is None or child.poll() is None
        return (folder / "rows").is_dir() and read_rows(folder / "rows", ["run"]).num_rows >= count

    wait_until(written, "no rows are written")


@pytest.mark.slow
def test_a_worker_killed_at_a_third(client, expected, tmp_path, monkeypatch):
    import threading

    client.cluster.scale(2)
    client.wait_for_workers(2)
    folder = tmp_path / "study"

    def kill():
        wait_for_rows(folder, 20)
        os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)
        killed.append(True)

    killed = []
    thread = threading.Thread(target=kill)
    thread.start()
    run(client, folder, f.slow, GRID, f.energy, 30, 2)
    thread.join()
    assert killed
    check(folder, expected)


PROGRAM = """
import sys, mbvi
from support import sweep_functions as f
if __name__ == "__main__":
    mbvi.sweep(f.slow, {grid}, measure=f.energy, out=sys.argv[1], scheme=mbvi.Paoli(), step=2e-3, duration=0.1)
"""


@pytest.mark.slow
def test_everything_killed_at_a_third_and_resumed(client, expected, tmp_path):
    folder, calls, program = tmp_path / "study", tmp_path / "calls", tmp_path / "program.py"
    program.write_text(PROGRAM.format(grid=GRID))
    with started(
        [sys.executable, program, folder], env=environment() | {"MBVI_TEST_CALLS": str(calls)},
        start_new_session=True, stdout=None, stderr=None,
    ) as child:  # fmt: skip
        wait_for_rows(folder, 20, child)
    kept, begun = read_rows(folder / "rows", ["run"]).num_rows, len(calls.read_text())
    assert 20 <= kept < len(expected)
    # what is repeated: runs of a second of each worker, and one that it was at
    assert begun - kept <= len(os.sched_getaffinity(0)) * (1.0 / 0.05 + 2)
    run(client, folder, f.slow, GRID, f.energy, 10, 2)
    check(folder, expected)


@pytest.mark.slow
def test_a_run_that_kills_its_worker_is_a_row_and_the_rest_finish(tmp_path):
    kinds = ["a", "b", "kills", "raises", "endless", "c"]
    table = mbvi.sweep(f.troubled, {"kind": kinds}, measure=f.height, out=tmp_path / "study", budget=0.5, **OPTIONS)
    assert table["status"].values.tolist() == ["ok", "ok", "killed", "failed", "over budget", "ok"]
    assert table["message"].values[2] == "the worker process ended in this run, 2 times"
    assert np.isnan(table["height"][2]) and np.isfinite(table["height"][[0, 1, 5]]).all()


@pytest.mark.slow(seconds=30)
def test_runs_that_end_their_process_again_and_again_do_not_end_the_study(tmp_path):
    """Each kills the only worker twice, while others wait on it."""
    from mbvi.sweeps.cluster import local_client

    kinds = ["a", "exits", "segfaults", "kills", "leaves", *"bcdef"]
    study, points = Study(f.troubled, f.height, options=OPTIONS), points_of({"kind": kinds}, f.troubled)
    folder = StudyFolder(tmp_path / "study")
    folder.open(study, points)
    with local_client(1) as made:
        table = run_study(folder, study, points, made)
    assert table["status"].values.tolist() == ["ok", "killed", "killed", "killed", "failed", *["ok"] * 5]
    assert table["message"].values[1].startswith("the worker process ended in this run, ")
    assert table["message"].values[4] == "SystemExit: 2"


STUCK = """
import faulthandler, sys
from mbvi.sweeps import limit
from support.sweep_functions import troubled
limit._STUCK = 0.5
with limit.Limit(0.1, ends_process=True):
    troubled("stuck")
"""


@pytest.mark.slow
def test_a_process_that_does_not_answer_ends():
    child = run_program([sys.executable, "-c", STUCK])
    assert child.returncode == 1 and "Timeout" in child.stderr


def running_in_session(leader):
    """Return the processes of a session; those that ended and wait for their parent do not count."""
    import psutil

    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, ProcessLookupError):
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def interrupted(command, ready):
    """Start a command, wait, interrupt all its processes as Ctrl-C does; return its code and what it said."""
    with started([*ENTRY, *command], start_new_session=True, stdout=None) as child:
        wait_until(lambda: ready(child.pid) or child.poll() is not None)
        assert child.poll() is None
        os.killpg(child.pid, signal.SIGINT)
        _, said = child.communicate(timeout=LIMIT)
        wait_until(lambda: not running_in_session(child.pid))
    return child.returncode, said


@pytest.fixture
def throws(tmp_path):
    """Return a file that defines a study."""
    file = tmp_path / "slow_throws.py"
    file.write_text(
        "import mbvi\n"
        "from support.sweep_functions import energy as measure, slow as make\n"
        f"parameters = {GRID}\n"
        "options = dict(scheme=mbvi.Paoli(), step=2e-3, duration=0.1)\n"
    )
    return file


@pytest.mark.slow
def test_an_interrupt_ends_all_processes_in_one_line_and_the_rows_are_kept(throws, tmp_path):
    folder = tmp_path / "study"
    command = ["sweep", throws, "--out", folder, "--workers", "1"]

    def ready(leader):
        return (folder / "rows").is_dir() and read_rows(folder / "rows", ["run"]).num_rows >= 5

    assert interrupted(command, ready) == (130, "mbvi: interrupted\n")
    assert 5 <= read_rows(folder / "rows", ["run"]).num_rows < 60


@pytest.mark.slow(seconds=20)
@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0])
def test_an_interrupt_while_workers_start_is_one_line(delay, throws, tmp_path):
    times = []

    def ready(leader):
        # the command, multiprocessing's tracker, and a worker
        if len(running_in_session(leader)) > 2:
            times.append(time.monotonic())
        return times and times[-1] - times[0] >= delay

    assert interrupted(["sweep", throws, "--out", tmp_path / "study"], ready) == (130, "mbvi: interrupted\n")


@pytest.mark.slow(seconds=18)
def test_the_command_line_begins_goes_on_and_says_how_far_it_is(tmp_path):
    file = tmp_path / "throws.py"
    file.write_text(
        "import functools, mbvi\n"
        "from support import sweep_functions as f\n"
        "@functools.cache\n"
        "def base():\n    return f.drop(0.1).build()\n"
        "def make(height):\n    return base().at([0, 0, 0.1 + height], [0, 0, 0])\n"
        "measure = f.height\n"
        "parameters = dict(height=[0.1, 0.2, 0.3])\n"
        "options = dict(scheme=mbvi.Paoli(), step=2e-3, duration=0.1)\n"
    )

    def mbvi_sweep(*arguments):
        child = run_program([*ENTRY, "sweep", *arguments], cwd=tmp_path)
        return child.returncode, child.stdout, child.stderr

    code, out, err = mbvi_sweep(file, "--out", tmp_path / "study", "--workers", 1)
    assert (code, err) == (0, "")
    assert "runs         3 of 3, complete" in out
    before = table_bytes(tmp_path / "study")
    for path in (tmp_path / "study/rows").iterdir():
        path.unlink()
    code, out, err = mbvi_sweep("--resume", tmp_path / "study", "--workers", 1)
    assert (code, err) == (0, "")
    assert table_bytes(tmp_path / "study") == before
    file.write_text(file.read_text().replace("0, 0, 0.1 + height", "0, 0, 0.2 + height"))
    code, _, err = mbvi_sweep("--resume", tmp_path / "study")
    assert code == 2 and "make is another one there" in err
    code, _, err = mbvi_sweep("--resume", tmp_path / "study", "--status", tmp_path)
    assert code == 2 and "give STUDY.py, or" in err
