"""Processes of their own: when numba is imported, what the first use says, and when the cache is out of date."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROBOTS

import mbvi

LANDING = """
import sys
import mbvi
assert "numba" not in sys.modules
scene = mbvi.Scene(restitution=0.5)
scene.add_halfspace((0, 0, 1))
scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.11))
scene.add_sphere(0.1, position=(0, 0, 0.5))
problem = scene.build()
assert "numba" not in sys.modules
"""
RUN = """
run = mbvi.simulate(problem, step=1e-3, duration=0.1, progress=False)
assert run.impacts
print(repr(run.v[-1].tolist()))
"""


def process(code, package=None, **environment):
    """What a new process that runs some code with a copy of the package prints, to both its ends."""
    variables = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | environment
    if package is not None:
        variables["PYTHONPATH"] = str(package.parent)
        code = f"import mbvi\nassert mbvi.__path__ == [{str(package)!r}]\n{code}"
    # without -P the working directory's package would come first
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.mark.parametrize("start", ["next(mbvi.steps(problem, step=1e-3))", "mbvi.simulate(problem, duration=1e-3)"])
def test_numba_is_imported_when_a_run_starts_and_not_before(start):
    process(LANDING + start + '\nassert "numba" in sys.modules')


def copy_of_the_package(folder):
    """The package's own files, without what was compiled from them."""
    source = Path(mbvi.__file__).parent
    shutil.copytree(source, folder / "mbvi", ignore=shutil.ignore_patterns("__pycache__", "robots"))
    return folder / "mbvi"


@pytest.mark.slow
def test_the_first_run_says_that_it_compiles_and_the_second_reads_what_it_compiled(tmp_path):
    first, said = process(LANDING + RUN, NUMBA_CACHE_DIR=str(tmp_path))
    assert said.startswith("mbvi: compiling")
    assert list(tmp_path.rglob("*.nbc"))
    again, silent = process(LANDING + RUN, NUMBA_CACHE_DIR=str(tmp_path))
    assert silent == ""
    assert again == first


@pytest.mark.slow
def test_where_nothing_can_be_cached_every_process_compiles_and_runs(tmp_path):
    """No place is left: a file stands where each folder of compiled code would be."""
    package = copy_of_the_package(tmp_path)
    for folder in {file.parent for file in package.rglob("*.py")}:
        (folder / "__pycache__").touch()
    (tmp_path / "file").touch()
    nowhere = {name: str(tmp_path / "file" / "cache") for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME")}
    expected, _ = process(LANDING + RUN)
    for _ in range(2):
        found, said = process(LANDING + RUN, package, **nowhere)
        assert said.startswith("mbvi: compiling")
        assert found == expected
    assert not [*tmp_path.rglob("*.nbc"), *tmp_path.rglob("*.nbi")]


@pytest.mark.slow
def test_a_kernel_is_compiled_anew_when_one_that_it_calls_elsewhere_has_changed(tmp_path):
    """`_touch` calls `row` of another file, which a new version doubles."""
    package, cache_ = copy_of_the_package(tmp_path), str(tmp_path / "cache")
    code = f"""
import numpy as np
import mbvi
from mbvi.compiled import load
load()
scene = mbvi.Scene()
scene.add_halfspace((0, 0, 1))
scene.add_urdf({str(ROBOTS / "hopper/hopper.urdf")!r}, position=(0, 0, 2))
problem = scene.build()
rows = [c.active(0.0, problem.q0, 10.0, None).jacobian for c in problem.constraints.constraints if hasattr(c, "rows")]
print(np.concatenate(rows)[:, 2].max())
"""
    before, _ = process(code, package, NUMBA_CACHE_DIR=cache_)
    file = package / "system/articulated.py"
    text = file.read_text()
    changed = text.replace("row[k] = sign * (", "row[k] = 2.0 * sign * (")
    assert changed != text
    file.write_text(changed)
    after, _ = process(code, package, NUMBA_CACHE_DIR=cache_)
    assert (float(before), float(after)) == (1.0, 2.0)
