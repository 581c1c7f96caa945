"""One faulty case a seed, of each kind that `make faults` tries: returns if the answer is right, raises otherwise."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import mbvi
from support.faults import damaged_files, mutated_robots, wrong_arguments
from support.faults.robot_cases import controls, gains, mjcf, names, pairs, rotations
from support.faults.study_cases import studies, workers
from support.paths import ROBOTS
from support.programs import run, started
from support.random_scenes import SHAPES, add_shape, random_scene

__all__ = [
    "arguments", "controls", "disks", "files", "gains", "kills", "mjcf", "names", "pairs", "rotations", "scenes",
    "studies", "units", "urdf", "workers",
]  # fmt: skip

SCHEMES = (
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.SchatzmanPaoli(),
    mbvi.StewartTrinkle(), mbvi.EventDriven(tolerance=1e-5), mbvi.Adaptive(), None,
)  # fmt: skip
HOPPER = ROBOTS / "hopper/hopper.urdf"


def scenes(seed: int) -> str:
    """Run a random scene twice by a random scheme: finite, solved, the same bytes, and the same from its file."""
    rng = np.random.default_rng(seed)
    scheme = SCHEMES[rng.integers(len(SCHEMES))]
    e = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else None
    steps = {"step": float(rng.choice([5e-4, 1e-3, 2e-3]))} if scheme and not hasattr(scheme, "tolerance") else {}
    runs = [
        mbvi.simulate(random_scene(seed, restitution=e).build(), scheme, duration=0.1, progress=False, **steps)
        for _ in range(2)
    ]
    run = runs[0]
    assert np.isfinite(run.q).all() and np.isfinite(run.v).all(), "states are not finite"
    assert run.residual.max() <= 1e-6, f"a residual of {run.residual.max():.1e}"
    assert runs[0].q.tobytes() == runs[1].q.tobytes(), "two runs differ"
    with tempfile.TemporaryDirectory() as folder:
        run.save(Path(folder) / "run.h5")
        again = mbvi.load(Path(folder) / "run.h5")
    assert again.v.tobytes() == run.v.tobytes() and len(again.impacts) == len(run.impacts), "the file is another run"
    return run.scheme


def units(seed: int) -> str:
    """Drop a pair of random shapes onto each other at two units of length: the dimensionless runs agree to 1e-6."""
    rng = np.random.default_rng(seed)
    first, second = rng.choice(SHAPES, 2)
    unit = float(10.0 ** rng.uniform(-4.0, 3.0))
    scheme = SCHEMES[rng.integers(5)]
    e = float(rng.choice([0.0, 0.5, 1.0]))

    def run(length: float) -> mbvi.Trajectory:
        draw = np.random.default_rng([seed, 1])
        scene = mbvi.Scene(gravity=(0.0, 0.0, -9.81 * length), restitution=e)
        add_shape(scene, str(first), draw, length, fixed=True)
        add_shape(scene, str(second), draw, length, still=True, at=(0.01, 0.02, 0.4))
        return mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.3, progress=False)

    one, other = run(1.0), run(unit)
    positions = [0, 1, 2]
    error = np.abs(one.q[:, positions] - other.q[:, positions] / unit).max()
    assert error < 1e-6, f"{first} on {second} at {unit:.3g} m by {scheme!r}: {error:.1e} apart"
    return f"{error:.1e}"


def urdf(seed: int) -> str:
    """Add a robot whose URDF was mutated, and run it for ten steps."""
    with tempfile.TemporaryDirectory() as folder:
        mutated_robots.write_meshes(Path(folder))
        said, data = mutated_robots.mutation(np.random.default_rng(seed))
        path = Path(folder) / "robot.urdf"
        path.write_bytes(data)
        try:
            found = [mutated_robots.attempt(path, base) for base in ("free", "fixed")]
        except Exception as error:
            raise AssertionError(f"{said}: {type(error).__name__}: {error}") from error
    if "taken" not in found:
        raise mbvi.UrdfError(f"{said}: {found[0]}")
    return said


def arguments(seed: int) -> str:
    """Call a public function with bad values for one to three of its parameters."""
    name, bad = wrong_arguments.random_fault(np.random.default_rng(seed))
    try:
        outcome = wrong_arguments.check(name, bad)
    except AssertionError as error:
        if name == "simulate" and {"duration", "step"} & set(bad) and "does not end" in str(error):
            # a long run is no fault
            return "a long run"
        raise
    if outcome == "refused":
        raise mbvi.InputError(name)
    return name


@functools.cache
def _run() -> mbvi.Trajectory:
    scene = mbvi.Scene(restitution=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(HOPPER, position=(0, 0, 1.0), joints={"knee": 0.4})
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0, progress=False)


@functools.cache
def _mutations() -> list[tuple[str, damaged_files.Mutation]]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        _run().save(path)
        return list(damaged_files.mutations(path))


def files(seed: int) -> str:
    """Load a file with flipped bytes, cut off, or with other contents: the same run or a TrajectoryFileError."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        _run().save(path)
        before = damaged_files.contents(mbvi.load(path))
        kind = rng.integers(4)
        if kind == 0:
            damaged_files.flip_bytes(path, rng, int(rng.integers(1, 5)))
        elif kind == 1:
            damaged_files.cut(path, rng)
        else:
            said, change = _mutations()[rng.integers(len(_mutations()))]
            try:
                damaged_files.mutate(path, change, rng, sealed=kind == 3)
            except (TypeError, ValueError, KeyError, OSError, RuntimeError) as error:
                # h5py itself does not write such a file
                return f"not written: {error}"
            if kind == 3:
                # whoever makes digest and checksums fit may change numbers: a clear answer is all that is asked
                mbvi.load(path)
                return said
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if damaged_files.loads_or_says(path, before) != "same":
                raise mbvi.TrajectoryFileError("refused")
    return "same"


_STREAM = """
import sys, mbvi
scene = mbvi.Scene(restitution=0.4)
scene.add_halfspace((0, 0, 1), name="floor")
scene.add_urdf(sys.argv[1], position=(0, 0, 1.0), joints={"knee": 0.4})
problem = scene.build()
print("go", flush=True)
try:
    mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=float(sys.argv[3]), out=sys.argv[2], progress=False)
except mbvi.TrajectoryFileError as error:
    assert not error.run.complete and len(error.run.t) > 1
    print("full", flush=True)
"""


def _is_a_part(path: Path) -> int:
    """Check that a file holds the beginning of the run, and return how many of its states."""
    run, whole = mbvi.load(path), _run()
    n = min(len(run.t), len(whole.t) - 1)
    assert not run.complete, "an unfinished file says that it is complete"
    for name in ("t", "q", "v"):
        assert getattr(run, name)[:n].tobytes() == getattr(whole, name)[:n].tobytes(), f"{name} is another run's"
    return len(run.t)


def kills(seed: int) -> str:
    """Kill a run that streams to a file after a random time: what was written loads."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        command = [sys.executable, "-c", _STREAM, str(HOPPER), str(path), "1000"]
        with started(command, stderr=subprocess.DEVNULL) as child:
            assert child.stdout is not None and child.stdout.readline() == "go\n"
            time.sleep(rng.uniform(0.0, 4.0))
        if not path.exists():
            return "killed before the file was there"
        return f"{_is_a_part(path)} states"


def disks(seed: int) -> str:
    """Run out of space at a random size, by a limit on files or, for root, on a small file system."""
    rng = np.random.default_rng(seed)
    size = int(10 ** rng.uniform(3.5, 6.7))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        mounted = os.geteuid() == 0 and seed % 2 and not subprocess.call(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], stderr=subprocess.DEVNULL
        )  # fmt: skip
        try:
            if mounted:
                command = [sys.executable, "-c", _STREAM, str(HOPPER), str(path), "60"]
                child = run(command)
            else:
                child = damaged_files.run_limited(_STREAM, size, str(HOPPER), str(path), "60")
            assert child.returncode == 0 or "TrajectoryFileError" in child.stderr, (
                f"{child.returncode} {child.stderr[-200:]}"
            )
            assert "full" in child.stdout or child.returncode, "the run ended as if the disk were not full"
            try:
                return f"{size} bytes, {_is_a_part(path)} states"
            except mbvi.TrajectoryFileError:
                # not even the first piece had room
                assert size < 100_000, f"nothing was kept in {size} bytes"
                raise
        finally:
            if mounted:
                subprocess.call(["umount", folder])
