"""What a command does not need is not imported, and what it needs is built once."""

import subprocess
import sys

import mbvi
from support.paths import ROBOTS

# they are slow to import, and a page of help needs none of them
NEEDLESS = {
    "coal",
    "dask",
    "h5py",
    "matplotlib",
    "numba",
    "pandas",
    "pinocchio",
    "proxsuite",
    "scipy",
    "tqdm",
    "xarray",
}


def test_a_page_of_help_imports_nothing_that_computes():
    program = (
        "import sys, mbvi_command\n"
        "sys.argv = ['mbvi', *sys.argv[1:]]\n"
        "try:\n    mbvi_command.main()\n"
        "except SystemExit:\n    print(*sys.modules, file=sys.stderr)\n"
    )
    for words in (["--help"], ["simulate", "--help"]):
        ended = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=True)
        loaded = set(ended.stderr.split())
        assert "Usage" in ended.stdout and "mbvi.cli.main" in loaded
        assert not loaded & NEEDLESS


def test_inspect_builds_the_scene_once(monkeypatch, capsys):
    from mbvi.cli.simulate import inspect

    built, build = [], mbvi.Scene.build

    def counted(self, *arguments, **options):
        built.append(self)
        return build(self, *arguments, **options)

    monkeypatch.setattr(mbvi.Scene, "build", counted)
    inspect(ROBOTS / "hopper/hopper.urdf")
    assert len(built) == 1
    assert "root_joint" in capsys.readouterr().out
