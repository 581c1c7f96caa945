"""What `import mbvi` gives: its public names and no others, each imported when it is used."""

import json
import sys

import pytest

import mbvi
from support.programs import environment, run


def fresh(code):
    """What a new process prints, as JSON."""
    done = run([sys.executable, "-c", f"import json, sys\n{code}"], env=environment())
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_new_process_sees_the_public_names_only():
    names, docs, imported = fresh("""
import mbvi
names = dir(mbvi)
engines = "scipy", "pinocchio", "coal", "numba", "h5py", "meshcat", "jax", "torch"
imported = [name for name in engines if name in sys.modules]
print(json.dumps([names, [getattr(mbvi, name).__doc__ for name in names], imported]))
""")
    assert names == sorted({*mbvi.__all__, "__version__"})
    assert all(docs)
    # their weight is paid by what uses them
    assert imported == []


def test_a_star_imports_the_public_names():
    namespace = {}
    exec("from mbvi import *", namespace)
    assert sorted(name for name in namespace if name != "__builtins__") == sorted(mbvi.__all__)


def test_modules_among_the_names_can_be_imported():
    names = ", ".join(f"mbvi.{name}" for name in ("motion", "surfaces", "interop", "packing", "reference"))
    code = f"import {names}\nprint(json.dumps([mbvi.motion.__name__, 'jax' in sys.modules, 'torch' in sys.modules]))"
    assert fresh(code) == ["mbvi.geometry.motion", False, False]


def test_a_name_that_is_none_is_refused():
    with pytest.raises(AttributeError, match="module 'mbvi' has no attribute 'nothing'"):
        mbvi.nothing  # noqa: B018


def test_python_m_mbvi_is_the_command():
    done = run([sys.executable, "-m", "mbvi", "--version"], env=environment())
    assert done.returncode == 0 and done.stdout.startswith(f"mbvi {mbvi.__version__}\n")
    done = run([sys.executable, "-m", "mbvi", "--help"], env=environment())
    assert done.returncode == 0 and "Usage: mbvi [OPTIONS] COMMAND" in done.stdout


def test_help_imports_no_engine():
    code = """
import io, contextlib
from mbvi.cli.main import main
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    main(["--help"])
names = "scipy", "pinocchio", "coal", "numba", "h5py", "matplotlib"
print(json.dumps([name for name in names if name in sys.modules]))
"""
    assert fresh(code) == []


def test_an_error_leaves_python_m_mbvi_as_it_leaves_the_command(tmp_path):
    done = run([sys.executable, "-m", "mbvi", "inspect", tmp_path / "none.urdf"], env=environment())
    assert done.returncode == 2 and done.stderr.startswith("mbvi: ")
