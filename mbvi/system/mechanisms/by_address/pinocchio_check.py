"""The check whether Pinocchio can be called by address, made in a child process and remembered.

A library of another layout could crash the process that calls it. Therefore a child process compares all functions with
the Python bindings bit for bit first, once for each Pinocchio, Python and platform.
"""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np
import pinocchio as pin

from ....compiled import KERNELS, cache_folder
from ...free.spinning import free_links
from ..joint_tree import joint_tree
from ..mechanism import Mechanism, free_joint, mechanism
from . import pinocchio_address as by_address

Array = np.ndarray

_STATES = 5
_PATIENCE = 60.0
# of mbvi it imports this module only, and of the rest nothing
_CHILD = """
import sys, types
sys.path[:] = {path!r}
for name, folder in {packages!r}.items():
    package = sys.modules[name] = types.ModuleType(name)
    package.__path__ = [folder]
from {module} import compare
compare()
print("equal")
"""


@cache
def reason_for_bindings() -> str | None:
    """Return why Pinocchio cannot be called by address on this machine, or None if it can."""
    try:
        file = cache_folder() / f"pinocchio-{_key()}.json"
        try:
            return _remembered(file)
        except (FileNotFoundError, ValueError):
            return _checked(file)
    except (OSError, ValueError, AttributeError) as error:
        return str(error)


def _key() -> str:
    """Return a hash of all that the verdict depends on."""
    libraries = [Path(pin.pinocchio_pywrap_default.__file__)]
    for stem in (by_address.PINOCCHIO, by_address.BOOST):
        libraries.append(Path(by_address.loaded_library(stem)._name))
    stamps = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in libraries]
    sources = [Path(path).read_bytes() for path in (__file__, by_address.__file__)]
    told = pin.__version__, sys.version, platform.platform(), np.__version__, stamps, sources
    return sha256(repr(told).encode()).hexdigest()[:24]


def _remembered(file: Path) -> str | None:
    """Return the reason in a file; raise ValueError if it is damaged."""
    match json.loads(file.read_text()):
        case {"reason": None | str() as reason}:
            return reason
    raise ValueError(file)


def _checked(file: Path) -> str | None:
    """Run the check, and write its verdict to a file."""
    reason = _run()
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(f".{os.getpid()}")
    part.write_text(json.dumps({"reason": reason}))
    part.replace(file)
    return reason


def _run() -> str | None:
    """Run `compare` in a child process."""
    if not sys.executable:
        return "there is no Python to check the direct calls with"
    folder = Path(__file__).parent
    names = __package__.split(".")
    packages = {".".join(names[: k + 1]): str([*folder.parents][len(names) - 2 - k]) for k in range(len(names) - 1)}
    packages[__package__] = str(folder)
    code = _CHILD.format(path=sys.path, packages=packages, module=__name__)
    try:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=_PATIENCE)
    except subprocess.TimeoutExpired:
        return f"the check of the direct calls took more than {_PATIENCE:.0f} s"
    if done.returncode < 0:
        return f"the check of the direct calls ended by {signal.Signals(-done.returncode).name}"
    if done.returncode or done.stdout.split()[-1:] != ["equal"]:
        said = done.stderr.strip().splitlines() or ["it gave no result"]
        return f"the check of the direct calls failed: {said[-1]}"
    return None


def compare() -> None:
    """Compare every function with the bindings, on several models at random states.

    Raises
    ------
    ValueError
        If a result differs in any bit.
    OSError
        If a function or a library is missing.
    """
    _leave_no_core()
    for kernel in KERNELS:
        kernel.interpret()
    rng = np.random.default_rng(0)
    for model in _models(rng):
        data, expected = model.createData(), model.createData()
        # kernels compute nothing for a model without joints
        nothing = joint_tree(pin.Model(), np.zeros(0, np.int64))
        made = mechanism(model, data, np.zeros((0, 0)), nothing, free_links(pin.Model()))
        if made is None:
            raise ValueError("Pinocchio's results do not lie where they are expected")
        for _ in range(_STATES):
            q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
            v = rng.normal(size=model.nv)
            for name, here, there in _results(made, model, expected, q, v):
                if np.ascontiguousarray(here).tobytes() != np.ascontiguousarray(there).tobytes():
                    raise ValueError(f"{name} differs from what the bindings compute")


def _results(m: Mechanism, model: pin.Model, data: pin.Data, q: Array, v: Array) -> Iterator[tuple[str, Array, Array]]:
    """Yield the name of each result, what it is by address, and what it is by the bindings."""
    nv, new, dv = model.nv, np.empty(model.nq), np.empty(model.nv)
    by_address.retract(m.calls, q, v, new)
    yield "integrate", new, pin.integrate(model, q, v)
    by_address.tangent(m.calls, q, new, dv)
    yield "difference", dv, pin.difference(model, q, new)
    by_address.crba(m.calls, q)
    pin.crba(model, data, q, pin.Convention.WORLD)
    yield "crba", np.tril(m.mass), np.triu(data.M.reshape(nv, nv)).T
    yield "crba", m.columns, data.J.reshape(6, nv).T
    yield "crba", m.poses, np.array([[*pose.rotation.T, pose.translation] for pose in data.oMi])
    by_address.nonlinear_effects(m.calls, q, v)
    yield "nonLinearEffects", m.effects, pin.nonLinearEffects(model, data, q, v)


def _models(rng: np.random.Generator) -> Iterator[pin.Model]:
    """Yield one joint, a fixed arm, a robot on a free base, and a tree of other joints, also that of a free body."""
    turning = [pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelPX()]
    other = [
        pin.JointModelPlanar(), pin.JointModelSpherical(), pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
        pin.JointModelTranslation(), pin.JointModelRUBZ(), pin.JointModelPrismaticUnaligned(np.array([0.0, 0.6, 0.8])),
        free_joint(),
    ]  # fmt: skip
    for joints in (turning[:1], turning + turning[:3], [pin.JointModelFreeFlyer(), *turning * 3], other):
        model = pin.Model()
        for k, joint in enumerate(joints):
            place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
            body = model.addJoint(int(rng.integers(k + 1)), joint, place, f"joint{k}")
            inertia = pin.Inertia(1.0 + rng.random(), rng.normal(size=3), np.diag(1.0 + rng.random(3)))
            model.appendBodyToJoint(body, inertia, pin.SE3.Identity())
        model.armature = rng.random(model.nv)
        yield model


def _leave_no_core() -> None:
    """Have a crash of this process leave no core file."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
