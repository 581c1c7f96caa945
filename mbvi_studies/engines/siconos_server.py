"""Server of free bodies in Siconos, controlled through pipes; the system's Python runs it without mbvi."""

from __future__ import annotations

import json
import os
import signal
import sys
from time import process_time
from typing import Any, BinaryIO

import numpy as np
from siconos import kernel, numerics

Array = np.ndarray

THETA, TOLERANCE, ITERATIONS = 0.5, 1e-12, 20
# gap that counts as closed, so that rounding does not open contacts [m]
TOUCHING = 1e-9
# pairs that can touch within this number of steps get a relation
_AHEAD = 1.0


class Point(kernel.NewtonEuler1DR):
    """A point of a body and a plane."""

    def __init__(self, place: list[float], normal: list[float], offset: float) -> None:
        super().__init__()
        self._place, self._normal, self._offset = place, normal, offset
        self.nc()[:] = normal

    def computeh(self, time: float, q: Array, y: Array) -> None:
        """Set the gap and the contact point."""
        (x, y0, z, w, a, b, c), (px, py, pz), n = q.tolist(), self._place, self._normal
        # scalars, because arrays of three are slower
        u, v, t = 2.0 * (b * pz - c * py), 2.0 * (c * px - a * pz), 2.0 * (a * py - b * px)
        x += px + w * u + b * t - c * v
        y0 += py + w * v + c * u - a * t
        z += pz + w * t + a * v - b * u
        self.pc1()[:] = x, y0, z
        y[0] = n[0] * x + n[1] * y0 + n[2] * z - self._offset


class BallGap:
    """A gap of balls, linearised at the start of every step, because Siconos fails on gaps computed in Python."""

    def __init__(self, law: Any, *bodies: Any) -> None:
        self._bodies = bodies
        self._relation = kernel.LagrangianLinearTIR(np.ones((1, 3 * len(bodies))), np.zeros(1))
        self.interaction = kernel.Interaction(law, self._relation)
        self.linearise()

    def linearise(self) -> None:
        """Set the gap and its gradient at the present positions."""
        places = np.concatenate([body.q() for body in self._bodies])
        gap, gradient = self.gap_and_gradient(places)
        self._relation.C()[0, :] = gradient
        self._relation.e()[0] = gap - gradient @ places

    def gap_and_gradient(self, places: Array) -> tuple[float, Array]:
        """Return the gap and its gradient."""
        raise NotImplementedError


class BallPairGap(BallGap):
    """The gap of two balls."""

    def __init__(self, law: Any, distance: float, *bodies: Any) -> None:
        self._distance = distance
        super().__init__(law, *bodies)

    def gap_and_gradient(self, places: Array) -> tuple[float, Array]:
        """Return the gap and its gradient."""
        line = places[3:] - places[:3]
        far = float(np.linalg.norm(line))
        return far - self._distance, np.append(-line, line) / far


class BallBoxGap(BallGap):
    """The gap of a ball and a fixed box."""

    def __init__(self, law: Any, centre: list[float], size: list[float], radius: float, body: Any) -> None:
        self._centre, self._half, self._radius = np.array(centre), 0.5 * np.array(size), radius
        super().__init__(law, body)

    def gap_and_gradient(self, places: Array) -> tuple[float, Array]:
        """Return the gap and its gradient."""
        arm = places - self._centre
        over = np.abs(arm) - self._half
        out = np.copysign(np.maximum(over, 0.0), arm)
        far = float(np.linalg.norm(out))
        if far > 0.0:
            return far - self._radius, out / far
        axis = int(np.argmax(over))
        return float(over[axis]) - self._radius, np.copysign(np.eye(3)[axis], arm)


class World:
    """Bodies with their relations.

    Parameters
    ----------
    model : dict
        Model, as `in_siconos` writes it.
    state : ndarray, shape (n, 13)
        Positions, quaternions x, y, z, w, velocities and angular velocities, all in the world.
    """

    def __init__(self, model: dict[str, Any], state: Array) -> None:
        self._h, self._law = model["h"], kernel.NewtonImpactNSL(model["e"])
        self._model = kernel.NonSmoothDynamicalSystem(0.0, 1e12)
        self._bodies: list[Any] = []
        self._turning: list[bool] = []
        self._kept: list[Any] = []
        self._linked: dict[int, BallPairGap] = {}
        self._solids: list[BallBoxGap] = []
        gravity = np.array(model["gravity"])
        self._fall = float(np.linalg.norm(gravity))
        for body, row in zip(model["bodies"], state, strict=True):
            m, turning = body["mass"], body["turns"]
            if turning:
                start = [*row[:3], row[6], *row[3:6]], [*row[7:10], *_turned(row[3:7], row[10:13], -1.0)]
                here = kernel.NewtonEulerDS(*start, m, np.diag(body["inertia"]))
            else:
                here = kernel.LagrangianLinearTIDS(row[:3], row[7:10], m * np.eye(3))
            here.setFExtPtr(m * gravity)
            self._model.insertDynamicalSystem(here)
            self._bodies.append(here)
            self._turning.append(turning)
            for normal, offset in model["planes"]:
                for place in body["points"]:
                    off = offset + body["radius"]
                    if turning:
                        relation = Point(place, normal, off)
                    else:
                        relation = kernel.LagrangianLinearTIR([normal], [-off])
                    self._link(relation, here)
            for centre, size in model["fixed"]:
                solid = BallBoxGap(self._law, centre, size, body["radius"], here)
                self._model.link(solid.interaction, here)
                self._solids.append(solid)
        self._radii = np.array([body["radius"] for body in model["bodies"]])
        self._pairs = np.triu_indices(len(self._bodies), 1)
        integrator, self._problem = kernel.MoreauJeanOSI(THETA), kernel.LCP(numerics.SICONOS_LCP_PIVOT)
        self._problem.numericsSolverOptions().dparam[numerics.SICONOS_DPARAM_TOL] = TOLERANCE
        integrator.setConstraintActivationThreshold(TOUCHING)
        self._sim = kernel.TimeStepping(self._model, kernel.TimeDiscretisation(0.0, self._h))
        self._sim.insertIntegrator(integrator)
        self._sim.insertNonSmoothProblem(self._problem)
        self._sim.setNewtonTolerance(TOLERANCE)
        self._sim.setNewtonMaxIteration(ITERATIONS)
        self._sim.setNewtonOptions(kernel.SICONOS_TS_NONLINEAR if any(self._turning) else kernel.SICONOS_TS_LINEAR)
        self._kept.append(integrator)
        self._sim.initialize()

    def _link(self, relation: Any, *bodies: Any) -> Any:
        interaction = kernel.Interaction(self._law, relation)
        self._model.link(interaction, *bodies)
        # keep the Python objects alive
        self._kept.append((relation, interaction))
        return interaction

    def go(self, count: int) -> None:
        """Advance by several steps."""
        moving = len(self._pairs[0]) or self._solids
        for _ in range(count):
            if len(self._pairs[0]):
                self._find()
            if moving:
                # Siconos treats linear relations as constant
                self._problem.setHasBeenUpdated(False)
            self._sim.computeOneStep()
            # before the state is kept as the start of the next step
            for pair in (*self._linked.values(), *self._solids):
                pair.linearise()
                for level in (0, 1):
                    pair.interaction.computeOutput(self._sim.nextTime(), level)
            self._sim.nextStep()

    def _find(self) -> None:
        """Add relations of pairs that are near, and remove those of pairs that are not."""
        i, j = self._pairs
        q, v = (np.array(both) for both in zip(*((b.q(), b.velocity()) for b in self._bodies), strict=True))
        gap = np.linalg.norm(q[j] - q[i], axis=1) - (self._radii[i] + self._radii[j])
        reach = _AHEAD * self._h * (2.0 * np.linalg.norm(v, axis=1).max() + self._fall * self._h)
        for k in np.flatnonzero(gap < reach).tolist():
            if k not in self._linked:
                bodies = self._bodies[i[k]], self._bodies[j[k]]
                pair = self._linked[k] = BallPairGap(self._law, float(self._radii[i[k]] + self._radii[j[k]]), *bodies)
                self._model.link(pair.interaction, *bodies)
        for k in [k for k in self._linked if gap[k] > 2.0 * reach]:
            self._model.removeInteraction(self._linked.pop(k).interaction)

    def state(self) -> Array:
        """Return the state, as in `__init__`."""
        rows = []
        for body, turning in zip(self._bodies, self._turning, strict=True):
            q = body.q()
            if turning:
                twist, turn = body.twist(), np.array([*q[4:7], q[3]])
                rows.append([*q[:3], *turn, *twist[:3], *_turned(turn, twist[3:], 1.0)])
            else:
                rows.append([*q, 0.0, 0.0, 0.0, 1.0, *body.velocity(), 0.0, 0.0, 0.0])
        return np.array(rows)


def _turned(turn: Array, vector: Array, sense: float) -> Array:
    axis = sense * turn[:3]
    across = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + turn[3] * across + np.cross(axis, across))


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until the input ends: CPU time of the steps and state, or a line with the error."""
    model: dict[str, Any] = {}
    world = None
    while line := requests.readline():
        request, spent = json.loads(line), process_time()
        try:
            if request["do"] == "model":
                model = request
                continue
            if request["do"] == "limit":
                # the default action ends this process
                signal.setitimer(signal.ITIMER_PROF, request["seconds"])
                continue
            if request["do"] == "start":
                size = len(model["bodies"])
                world = World(model, np.frombuffer(requests.read(8 * 13 * size)).reshape(size, 13))
            else:
                spent = process_time()
                world.go(request["count"])  # type: ignore[union-attr]
            answer = np.append(process_time() - spent, world.state()).tobytes()  # type: ignore[union-attr]
        except Exception as error:
            answers.write(b"E" + json.dumps(f"{type(error).__name__}: {error}").encode() + b"\n")
        else:
            answers.write(b"K" + answer)
        answers.flush()


if __name__ == "__main__":
    # output of C++ must not mix with answers
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    serve(sys.stdin.buffer, answers)
