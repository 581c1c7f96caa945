"""The check of Pinocchio by address: whatever is wrong with a library, the process that asks lives on and is told."""

import ctypes
import json
import re
import shutil
import subprocess
import sys
import time

import pinocchio as pin
import pytest

from mbvi.system.mechanisms.by_address import pinocchio_address, pinocchio_check
from support.paths import ROBOTS
from support.programs import run


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of remembered verdicts, empty; nothing is known of the machine."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    pinocchio_check.reason_for_bindings.cache_clear()
    yield tmp_path
    pinocchio_check.reason_for_bindings.cache_clear()


@pytest.fixture
def sabotage(monkeypatch, folder):
    """Call it with lines of Python, and the child process runs them before it compares."""

    def do(lines):
        code = pinocchio_check._CHILD
        assert code.count("\ncompare()\n") == 1
        imports = "from mbvi.system.mechanisms.by_address import pinocchio_address as by_address"
        lines = f"import numpy as np, ctypes\n{imports}\n{lines}\n"
        # the code is a format
        lines = lines.replace("{", "{{").replace("}", "}}")
        monkeypatch.setattr(pinocchio_check, "_CHILD", code.replace("\ncompare()\n", f"\n{lines}compare()\n"))

    return do


def verdicts(folder):
    return [json.loads(file.read_text()) for file in folder.glob("pinocchio-*.json")]


@pytest.mark.skipif(sys.platform != "linux", reason="not known of other platforms")
def test_the_check_passes_here_and_is_remembered(folder, monkeypatch):
    start = time.perf_counter()
    assert pinocchio_check.reason_for_bindings() is None
    assert verdicts(folder) == [{"reason": None}]
    pinocchio_check.reason_for_bindings.cache_clear()
    monkeypatch.setattr(pinocchio_check, "_run", lambda: pytest.fail("the check is made again"))
    middle = time.perf_counter()
    assert pinocchio_check.reason_for_bindings() is None
    # hundreds of times faster than a child process, whatever else the machine does
    assert time.perf_counter() - middle < 0.1 * (middle - start)


FAULTS = {
    "a function is missing": (
        "by_address.SYMBOLS = ('_ZN9pinocchio4nullE', *by_address.SYMBOLS[1:])",
        r"_ZN9pinocchio4nullE is missing in .*libpinocchio_default",
    ),
    "the converter is missing": ("by_address.GET_LVALUE = '_ZN5boost4nullE'", r"_ZN5boost4nullE is missing in .*boost"),
    "the converter finds nothing": ("by_address.MODEL = b'N9pinocchio4nullE'", "Model holds no N9pinocchio4nullE"),
    "the converter finds another class": ("by_address.DATA = by_address.MODEL", "Data holds no N9pinocchio8ModelTpl"),
    "the converter lies": ("by_address._pointer = lambda instance, name: id(instance)", "ended by SIG"),
    "a library is not loaded": ("by_address.BOOST = 'boost_wave'", "the library boost_wave is not loaded"),
    "an argument means something else": ("by_address._WORLD = np.int32(1)", "crba differs from what the bindings"),
    "an answer is off by one bit": (
        "add = by_address.nonlinear_effects\n"
        "def changed(calls, q, v):\n"
        "    add.loops(calls, q, np.nextafter(v, 9.0))\n"
        "type(add).interpret = lambda self: setattr(type(self), '__call__', staticmethod(changed))",
        "nonLinearEffects differs",
    ),
    "a function of another kind": (
        "S = by_address.SYMBOLS\nby_address.SYMBOLS = (*S[:2], S[3], S[2])",
        "ended by SIGABRT|failed|differs",
    ),
    "a function lies elsewhere": ("by_address.function_addresses = lambda: [8] * 4", "ended by SIG(SEGV|BUS)"),
    "headers are laid out otherwise": ("by_address._HEADERS = 32", "ended by SIG|failed|differs"),
    "results lie elsewhere": (
        "from mbvi.system.mechanisms.by_address import memory\nmemory._POSE = 16",
        "do not lie where they are expected",
    ),
    "the child ends early": ("import os\nos._exit(0)", "it gave no result"),
    "the child fails": ("raise RuntimeError('no luck')", "no luck"),
}


@pytest.mark.skipif(sys.platform != "linux", reason="not known of other platforms")
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found_by_the_child_and_remembered(fault, sabotage, folder):
    lines, message = FAULTS[fault]
    sabotage(lines)
    reason = pinocchio_check.reason_for_bindings()
    assert reason is not None
    assert re.search(message, reason), reason
    assert verdicts(folder) == [{"reason": reason}]


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_library_that_crashes_takes_only_the_child_with_it(sabotage, folder, tmp_path):
    source, library = tmp_path / "crash.c", tmp_path / "crash.so"
    functions = "".join(f"void {name}(void) {{ *(volatile int *)0 = 0; }}\n" for name in pinocchio_address.SYMBOLS)
    source.write_text(functions)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
    assert ctypes.CDLL(str(library))[pinocchio_address.SYMBOLS[0]]
    sabotage(
        "own = by_address.loaded_library\n"
        f"by_address.loaded_library = lambda stem: own(stem) if stem == by_address.BOOST else ctypes.CDLL('{library}')"
    )
    assert pinocchio_check.reason_for_bindings() == "the check of the direct calls ended by SIGSEGV"
    assert verdicts(folder) == [{"reason": "the check of the direct calls ended by SIGSEGV"}]


def test_a_child_that_never_ends_is_not_waited_for(sabotage, monkeypatch):
    sabotage("import time\ntime.sleep(60)")
    monkeypatch.setattr(pinocchio_check, "_PATIENCE", 0.5)
    assert pinocchio_check.reason_for_bindings() == "the check of the direct calls took more than 0 s"


def test_without_a_python_to_start_the_bindings_are_used(folder, monkeypatch):
    monkeypatch.setattr(sys, "executable", "")
    assert "no Python" in pinocchio_check.reason_for_bindings()


def test_where_nothing_can_be_remembered_the_bindings_are_used(folder, monkeypatch):
    (folder / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder / "file"))
    assert "file" in pinocchio_check.reason_for_bindings()


@pytest.mark.parametrize("content", ["", "{", "[]", '{"reason": 3}', '{"because": null}', "\x00\xff" * 20])
def test_a_damaged_verdict_is_made_again(content, folder, monkeypatch):
    monkeypatch.setattr(pinocchio_check, "_run", lambda: "as before")
    file = folder / f"pinocchio-{pinocchio_check._key()}.json"
    file.write_text(content, encoding="latin-1")
    assert pinocchio_check.reason_for_bindings() == "as before"
    assert verdicts(folder) == [{"reason": "as before"}]


def test_another_pinocchio_is_checked_again(folder, monkeypatch):
    reasons = iter(["the first", "the second"])
    monkeypatch.setattr(pinocchio_check, "_run", lambda: next(reasons))
    assert pinocchio_check.reason_for_bindings() == "the first"
    monkeypatch.setattr(pin, "__version__", "99.0")
    pinocchio_check.reason_for_bindings.cache_clear()
    assert pinocchio_check.reason_for_bindings() == "the second"
    assert len(verdicts(folder)) == 2


def test_only_a_simulation_asks(tmp_path):
    code = f"""
from pathlib import Path
import mbvi
from mbvi.system.mechanisms.by_address import pinocchio_check
folder = Path({str(tmp_path)!r})
pinocchio_check.cache_folder = lambda: folder
scene = mbvi.Scene()
scene.add_urdf({str(ROBOTS / "hopper/hopper.urdf")!r}, position=(0, 0, 1))
problem = scene.build()
assert not list(folder.iterdir())
mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.01, progress=False)
assert len(list(folder.iterdir())) == 1
"""
    done = run([sys.executable, "-c", code])
    assert done.returncode == 0, done.stderr
