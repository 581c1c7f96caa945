"""Machine code that a wheel carries: where the same Python and numba made it, it is read and nothing is compiled."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import mbvi
from mbvi.compiled import all_kernels
from mbvi.compiled.cache import made_by
from mbvi.geometry.narrow.normal_search import normalise
from support.paths import ROOT
from support.programs import run

CARRY = """
import sys
from pathlib import Path
from mbvi.geometry.narrow.normal_search import normalise
normalise.carry(Path(sys.argv[1]))
"""
NORMALISE = """
import numpy as np
import mbvi
from mbvi.geometry.narrow.normal_search import normalise
print(mbvi.__file__, normalise(np.array([3.0, 0.0, 4.0])))
"""


def process(code, *arguments, package=None, **environment):
    """What a new process prints to both its ends, with this checkout or another copy of the package."""
    folder = str(ROOT if package is None else package.parent)
    variables = {**os.environ, "PYTHONPATH": folder, **environment}
    done = run([sys.executable, "-P", "-c", code, *arguments], env=variables)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.fixture(scope="module")
def carrying(tmp_path_factory):
    """A copy of the package that carries the machine code of one kernel."""
    folder = tmp_path_factory.mktemp("carrying")
    package = folder / "mbvi"
    shutil.copytree(Path(mbvi.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    generic = {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(folder / "cache")}
    process(CARRY, str(package / "compiled/machine_code"), **generic)
    return package


@pytest.fixture
def copy(carrying, tmp_path):
    """A copy of that package; its machine code, and where it keeps what it compiles."""
    shutil.copytree(carrying, tmp_path / "mbvi")
    (file,) = (tmp_path / "mbvi/compiled/machine_code" / made_by()).iterdir()
    return tmp_path / "mbvi", file, tmp_path / "cache"


def said_by(package, cache):
    """What a run of the kernel says; the result is right, and of that copy."""
    out, said = process(NORMALISE, package=package, NUMBA_CACHE_DIR=str(cache))
    assert out == f"{package / '__init__.py'} 5.0\n"
    return said


def test_what_a_wheel_carries_is_not_compiled(copy):
    package, file, cache = copy
    before = file.read_bytes()
    assert said_by(package, cache) == ""
    assert not cache.exists()
    assert file.read_bytes() == before and len([*file.parent.iterdir()]) == 1


def test_what_others_made_is_ignored(copy):
    package, file, cache = copy
    python, numba_, llvmlite_ = made_by().partition("-numba-")[0], "-numba-0.1.0", "-llvmlite-0.1.0"
    file.parent.rename(file.parent.with_name(python + numba_ + llvmlite_))
    assert said_by(package, cache).startswith("compiling")
    assert [*cache.glob("*.nbc")]


def test_what_was_made_of_other_source_is_ignored(copy):
    package, _, cache = copy
    source = package / "geometry/vectors.py"
    text = source.read_text()
    source.write_text(text.replace("return length", "return 1.0 * length"))
    assert source.read_text() != text
    assert said_by(package, cache).startswith("compiling")


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: data[:60] + data[59:]], ids=["cut", "longer"])
def test_what_is_damaged_is_named_and_compiled(copy, damage):
    package, file, cache = copy
    file.write_bytes(damage(file.read_bytes()))
    said = said_by(package, cache)
    assert f"{file} is damaged: its kernel is compiled on this machine" in said and "compiling" in said
    # what was compiled is in the cache
    assert "compiling" not in said_by(package, cache)


def test_the_code_of_this_processor_is_not_carried(tmp_path, monkeypatch):
    for name in ("amd64", None):
        monkeypatch.setenv("NUMBA_CPU_NAME", name) if name else monkeypatch.delenv("NUMBA_CPU_NAME", raising=False)
        with pytest.raises(mbvi.InputError, match="needs NUMBA_CPU_NAME=generic"):
            normalise.carry(tmp_path)
    assert not [*tmp_path.iterdir()]


# a robot, bodies with friction and grains, by every scheme that has a kernel and by others
RUNS = """
import mbvi
def scene(friction=0.0):
    made = mbvi.Scene(restitution=0.3, friction=friction)
    made.add_halfspace((0, 0, 1))
    return made
for friction in (0.0, 0.6):
    robot = scene(friction)
    robot.add_urdf(mbvi.robot("quadruped"), position=(0, 0, 0.5), rotation=(0.2, 0.1, 0))
    bodies = scene(friction)
    for k in range(3):
        bodies.add_box((0.2, 0.2, 0.2), position=(0.05 * k, 0, 0.11 + 0.21 * k))
    bodies.add_cylinder(0.1, 0.3, position=(0.7, 0, 0.2))
    grains = scene(friction)
    grains.add_spheres(*mbvi.packing.layers((-0.1, -0.1, 0.05), (0.1, 0.1), radius=0.02, count=40), density=1e3)
    for made in (robot, bodies, grains):
        problem = made.build()
        schemes = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True)]
        schemes += [None, mbvi.StewartTrinkle()] if made is not grains else [None]
        for scheme in schemes:
            run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.15, progress=False)
            print(run.q[-1].tobytes().hex()[:40])
"""


@pytest.mark.slow(seconds=40)
def test_runs_of_a_wheel_compile_nothing_and_are_those_of_this_checkout(tmp_path):
    """The wheel is built as for a release, and unpacked where nothing else is."""
    site = tmp_path / "site"
    subprocess.run([sys.executable, ROOT / "tools/wheel.py", tmp_path], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < 6e6
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    assert (site / "mbvi/robots/hopper/hopper.urdf").is_file() and (site / "mbvi_studies/__init__.py").is_file()
    cache = tmp_path / "cache"
    out, said = process(RUNS, package=site / "mbvi", NUMBA_CACHE_DIR=str(cache))
    assert "compiling" not in said
    assert [file.suffix for file in cache.iterdir()] == [".json"]
    assert out == process(RUNS)[0]


def test_tools_find_the_kernels_that_python_calls():
    code = """
import sys
sys.path.insert(0, sys.argv[1])
import wheel
print(*(item.__name__ for item in wheel.called_kernels()))
"""
    names = process(code, str(ROOT / "tools"))[0].split()
    assert {"normalise", "run_paoli", "distances_from_axes", "find"} <= set(names)
    # these only kernels call
    assert not {"known_gaps", "evaluate_forces", "paoli_step"} & set(names) and len(names) < len(all_kernels()) / 2
