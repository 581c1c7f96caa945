"""Adapter to Siconos: the scheme of Moreau and Jean, in the system's Python, because Siconos needs NumPy 1."""

from __future__ import annotations

import json
import signal
import subprocess
import weakref
from contextlib import suppress
from pathlib import Path
from time import process_time
from typing import Any, NoReturn

import numpy as np

from . import SYSTEM
from .bodies import Bodies, Body, Poses
from .free_body import alone, placed, points, posed, refuse
from .rig import Rig, State


def _version() -> str:
    asked = [SYSTEM, "-I", "-c", "import siconos; print(siconos.version)"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False)
    if found.returncode:
        raise ImportError(f"{SYSTEM} cannot import siconos")
    return found.stdout.strip()


NAME = f"Siconos {_version()}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (RuntimeError,)
_SERVER = Path(__file__).with_name("siconos_server.py")
_SETTINGS = (
    "TimeStepping, MoreauJeanOSI(theta = 0.5), NewtonImpactNSL(e), LCP by Lemke's pivots (SICONOS_LCP_PIVOT) to 1e-12, "
    "contacts from gaps of 1e-9 m on; bodies that turn by Newton's iteration to 1e-12 (at most 20), gaps between "
    "others linear in a step"
)


class SiconosBodies:
    """Free bodies in Siconos, with relations of `siconos_server`: points and planes, balls and balls."""

    settings = _SETTINGS
    continuous = False
    # when in a step the velocity changes, as in `Scheme`
    jump = 0.5

    def __init__(self, model: Bodies, h: float) -> None:
        refuse(model)
        self._size, self._spent, self._budget = len(model.bodies), 0.0, np.inf
        self._server = subprocess.Popen(
            [SYSTEM, "-I", str(_SERVER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._close = weakref.finalize(self, _end, self._server)
        model_data = {
            "h": h,
            "e": model.e,
            "gravity": model.gravity.tolist(),
            "bodies": [_body_data(b) for b in model.bodies],
        }
        planes = [(normal.tolist(), float(offset)) for normal, offset in model.planes]
        fixed = [(centre.tolist(), list(solid.size)) for solid, centre in model.fixed]
        self._send("model", **model_data, planes=planes, fixed=fixed)

    def limit(self, seconds: float) -> None:
        """Limit the CPU time of this process and the child from now on; then `TimeoutError` is raised."""
        self._budget = process_time() + self._spent + seconds
        self._send("limit", seconds=seconds)

    def start(self, state: Poses) -> None:
        """Set poses and velocities."""
        self._send("start")
        self._answer(np.hstack([*state]).astype(float).tobytes())

    def advance(self) -> None:
        """Advance by one step."""
        self.many(1)

    def many(self, count: int) -> None:
        """Advance by several steps."""
        self._send("go", count=count)
        self._answer()

    def clock(self) -> float:
        """Return the CPU time of the steps in the child process [s]."""
        return self._spent

    def read(self) -> Poses:
        """Return poses and velocities."""
        return Poses(*np.split(self._state, [3, 7, 10], axis=1))

    def _send(self, what: str, **more: Any) -> None:
        assert self._server.stdin is not None
        try:
            self._server.stdin.write(json.dumps({"do": what, **more}).encode() + b"\n")
        except BrokenPipeError:
            self._lost()

    def _answer(self, more: bytes = b"") -> None:
        pipe, size = self._server, 8 * (1 + 13 * self._size)
        assert pipe.stdin is not None and pipe.stdout is not None
        try:
            pipe.stdin.write(more)
            pipe.stdin.flush()
        except BrokenPipeError:
            self._lost()
        kind = pipe.stdout.read(1)
        if kind == b"E":
            raise RuntimeError(json.loads(pipe.stdout.readline()))
        found = np.frombuffer(pipe.stdout.read(size)).copy() if kind else np.zeros(0)
        if 8 * len(found) != size:
            self._lost()
        self._state = found[1:].reshape(self._size, 13)
        self._spent += float(found[0])
        if process_time() + self._spent > self._budget:
            raise TimeoutError

    def _lost(self) -> NoReturn:
        code = self._server.wait()
        if code == -signal.SIGPROF:
            self._spent = self._budget - process_time()
            raise TimeoutError
        raise RuntimeError(f"its process ended with {code}")


Free = SiconosBodies


class Siconos:
    """A rig without joints in Siconos."""

    settings = _SETTINGS
    continuous = False
    jump = SiconosBodies.jump

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        self._body = SiconosBodies(alone(rig, e), h)
        self.many, self.clock = self._body.many, self._body.clock

    def start(self, state: State) -> None:
        """Set the state."""
        self._body.start(posed(state))

    def advance(self) -> None:
        """Advance by one step."""
        self._body.advance()

    def read(self) -> State:
        """Return the state."""
        return placed(self._body.read())


Peer = Siconos


def _body_data(body: Body) -> dict[str, Any]:
    places, radius = points(body)
    return {
        "mass": body.mass, "inertia": body.inertia.tolist(), "turns": body.turns, "radius": radius,
        "points": places.tolist(),
    }  # fmt: skip


def _end(server: subprocess.Popen[bytes]) -> None:
    server.kill()
    for pipe in (server.stdin, server.stdout):
        if pipe is not None:
            # unread input is lost
            with suppress(BrokenPipeError):
                pipe.close()
    server.wait()
