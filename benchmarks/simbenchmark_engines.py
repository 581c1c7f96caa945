"""mbvi and MuJoCo on the tests of SimBenchmark: the states before each step, and the CPU time of a run."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
import simbenchmark_cases as cases
from simbenchmark_cases import TRIALS, States

import mbvi

Array = np.ndarray

# steps that MuJoCo's solver without regularisation takes after the main one, where it is switched on
NOSLIP = 10


class Variant(NamedTuple):
    """How MuJoCo is set: its integrator, the time constant of contacts in steps (None as delivered), the noslip solver.

    Contacts have the elliptic cone; at e = 1 they are springs without damping.
    """

    label: str
    integrator: str = "Euler"
    stiff: float | None = None
    noslip: bool = False


DELIVERED, RUNGE_KUTTA = Variant("Euler"), Variant("RK4", "RK4")
STIFF, STIFF_RUNGE_KUTTA = Variant("Euler, contacts 2 h", stiff=2.0), Variant("RK4, contacts 2 h", "RK4", 2.0)
EVERYWHERE = (DELIVERED, RUNGE_KUTTA, STIFF, STIFF_RUNGE_KUTTA)
VARIANTS = {name: EVERYWHERE for name in TRIALS} | {
    "energy": (DELIVERED, RUNGE_KUTTA),
    "PD": (DELIVERED, STIFF, Variant("Euler, noslip", noslip=True)),
}


@cache
def problems(name: str) -> tuple[mbvi.Problem, ...]:
    """Return the problem of a test, or those of its parts."""
    match name:
        case "rolling":
            return (cases.rolling_problem(),)
        case "bouncing":
            return (cases.balls_problem(cases.bouncing_centres(), 1.0),)
        case "666":
            return (cases.balls_problem(cases.six_centres(cases.LOW), 0.0),)
        case "elastic 666":
            return (cases.balls_problem(cases.six_centres(cases.HIGH), 1.0),)
        case "momentum":
            return (cases.momentum_problem(),)
        case "energy":
            return cases.energy_problems()
    return (cases.standing_problem(),)


def simulated_time(name: str) -> float:
    """Return the time that a run of a test simulates, all its parts [s]."""
    return TRIALS[name].duration + (cases.PUSHED if name == "energy" else 0.0)


class Ours:
    """mbvi: the default scheme at a step, or a scheme that chooses its steps."""

    def __init__(self, name: str, h: float, scheme: mbvi.schemes.SchemeBase | None = None) -> None:
        self.name, self.h, self.scheme = name, h, scheme
        self.used = ""

    def run(self, one_step: bool = False) -> mbvi.Trajectory:
        """Return the run, of its last part where the test has two; or one step of each part."""
        parts = problems(self.name)
        push, duration = (self.h, self.h) if one_step else (cases.PUSHED, TRIALS[self.name].duration)
        step = None if self.scheme is not None and self.scheme.timing.own_steps else self.h
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mbvi.MbviWarning)
            first = parts[0].at(parts[0].q0, parts[0].v0)
            if len(parts) == 1:
                return mbvi.simulate(first, self.scheme, step=step, duration=duration, progress=False)
            up = mbvi.simulate(first, self.scheme, step=step, duration=push, progress=False)
            # the same problem without the control, from where the push has brought it
            flying = parts[1].at(up.q[-1], up.v[-1])
            return mbvi.simulate(flying, self.scheme, step=step, duration=duration, progress=False)

    def states(self) -> States:
        """Return the states before each step."""
        run = self.run()
        scheme = run.record.scheme
        lifts = ", positions projected" if getattr(scheme, "project_positions", False) else ""
        self.used = run.scheme + lifts
        if self.scheme is not None and self.scheme.timing.own_steps:
            times = self.h * np.arange(round(TRIALS[self.name].duration / self.h))
            places = [run.at(t) for t in times]
            q, v = np.array([p[0] for p in places]), np.array([p[1] for p in places])
        else:
            q, v = run.q[:-1], run.v[:-1]
        return self._states(q, v)

    def time(self) -> float:
        """Return the CPU time of a run, recording included, less that of a run of one step [s]."""
        spent = []
        for one_step in (True, False):
            start = time.process_time()
            self.run(one_step)
            spent.append(time.process_time() - start)
        return spent[1] - spent[0]

    def _states(self, q: Array, v: Array) -> States:
        if self.name in ("bouncing", "666", "elastic 666"):
            shape = len(q), -1, 3
            return _balls(q.reshape(shape), v.reshape(shape))
        if self.name == "rolling":
            # the box comes first; each free body has a centre and a quaternion
            return States(velocities=v.reshape(len(v), -1, 6)[:, :2, :3])
        model = problems(self.name)[-1].model("anymal")
        if self.name == "PD":
            return States(centres=q[:, None, :3])
        data = model.createData()
        if self.name == "energy":
            return States(
                energy=np.array([pin.computeMechanicalEnergy(model, data, *s) for s in zip(q, v, strict=True)])
            )
        robot = [
            pin.computeCentroidalMomentum(model, data, a[: model.nq], b[: model.nv]).linear
            for a, b in zip(q, v, strict=True)
        ]
        return States(momentum=np.array(robot) + cases.MASS * v[:, model.nv : model.nv + 3])


def _balls(centres: Array, velocities: Array) -> States:
    kinetic = 0.5 * cases.MASS * (velocities**2).sum(axis=(1, 2))
    return States(centres, velocities, kinetic + cases.MASS * cases.G * centres[..., 2].sum(axis=1))


class Theirs:
    """MuJoCo on a test."""

    def __init__(self, name: str, h: float, variant: Variant) -> None:
        self.name, self.h = name, h
        self.model = _compiled(name, h, variant)
        self.data = mujoco.MjData(self.model)
        self._parts = [round(TRIALS[name].duration / h)]
        if name == "energy":
            self._parts.insert(0, round(cases.PUSHED / h))

    def _begin(self) -> None:
        mujoco.mj_resetData(self.model, self.data)
        if self.name == "rolling":
            self.data.xfrc_applied[1, :3] = cases.PUSH * cases.DIRECTION
        elif self.name == "momentum":
            self.data.qvel[-3:] = 0.0, cases.SPEED, 0.0
        if self.name in ("momentum", "energy", "PD"):
            self.data.qpos[:7] = (
                0.0,
                0.0,
                cases.STAND if self.name == "PD" else cases.ALOFT,
                1.0,
                0.0,
                0.0,
                0.0,
            )
            for joint, angle in cases.JOINTS.items():
                self.data.joint(joint).qpos[0] = angle

    def _push(self, part: int) -> None:
        if self.name == "energy":
            weight = self.model.body_subtreemass[1] * cases.G
            self.data.qfrc_applied[2] = 0.0 if part else 2.0 * weight

    def time(self) -> float:
        """Return the CPU time of a run [s]."""
        self._begin()
        start = time.process_time()
        for part, count in enumerate(self._parts):
            self._push(part)
            mujoco.mj_step(self.model, self.data, nstep=count)
        return time.process_time() - start

    def states(self) -> States:
        """Return the states before each step of the last part."""
        self._begin()
        for part, count in enumerate(self._parts[:-1]):
            self._push(part)
            mujoco.mj_step(self.model, self.data, nstep=count)
        self._push(len(self._parts) - 1)
        q, v = np.empty((self._parts[-1], self.model.nq)), np.empty((self._parts[-1], self.model.nv))
        for k in range(len(q)):
            q[k], v[k] = self.data.qpos, self.data.qvel
            mujoco.mj_step(self.model, self.data)
        return self._states(q, v)

    def _states(self, q: Array, v: Array) -> States:
        if self.name in ("bouncing", "666", "elastic 666"):
            start = self.model.body_pos[1:]
            return _balls(start + q.reshape(len(q), -1, 3), v.reshape(len(v), -1, 3))
        if self.name == "rolling":
            return States(velocities=v.reshape(len(v), -1, 6)[:, :2, :3])
        if self.name == "PD":
            return States(centres=q[:, None, :3])
        probe, energy, momentum = mujoco.MjData(self.model), np.empty(len(q)), np.empty((len(q), 3))
        for k in range(len(q)):
            probe.qpos[:], probe.qvel[:] = q[k], v[k]
            mujoco.mj_fwdPosition(self.model, probe)
            mujoco.mj_fwdVelocity(self.model, probe)
            mujoco.mj_energyPos(self.model, probe)
            mujoco.mj_energyVel(self.model, probe)
            mujoco.mj_subtreeVel(self.model, probe)
            energy[k] = probe.energy.sum()
            momentum[k] = self.model.body_subtreemass[0] * probe.subtree_linvel[0]
        return States(energy=energy, momentum=momentum)


def _compiled(name: str, h: float, variant: Variant) -> mujoco.MjModel:
    spec = _robot(name) if name in ("momentum", "energy", "PD") else mujoco.MjSpec()
    option = spec.option
    option.timestep, option.cone = h, mujoco.mjtCone.mjCONE_ELLIPTIC
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{variant.integrator.upper()}")
    option.gravity = (0.0, 0.0, 0.0 if name == "momentum" else -cases.G)
    option.noslip_iterations = NOSLIP if variant.noslip else 0
    spec.memory = 1 << 30
    if name != "energy":
        spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    _add_bodies(spec, name)
    rough = name in ("rolling", "PD")
    for geom in spec.geoms:
        geom.condim = 3 if rough else 1
        if name == "PD":
            geom.friction[0] = cases.FRICTION
        constant = 0.02 if variant.stiff is None else variant.stiff * h
        # negative numbers are stiffness and damping, of each unit of mass
        geom.solref = (-(constant**-2.0), 0.0) if name in ("bouncing", "elastic 666") else (constant, 1.0)
    if name in ("momentum", "PD"):
        _leave_out_overlaps(spec)
    model = spec.compile()
    if name == "PD":
        for joint, angle in cases.JOINTS.items():
            here = model.joint(joint).id
            model.jnt_stiffness[here] = cases.STIFFNESS
            model.qpos_spring[model.jnt_qposadr[here]] = angle
            model.dof_damping[model.jnt_dofadr[here]] = cases.DAMPING
    return model


def _robot(name: str) -> mujoco.MjSpec:
    """Return ANYmal with a free base, from the file that mbvi reads."""
    world = '<link name="world"/><joint name="base" type="floating"><parent link="world"/><child link="base"/></joint>'
    options = '<mujoco><compiler discardvisual="true" fusestatic="true"/></mujoco>'
    text = cases.anymal_text(name != "energy")
    return mujoco.MjSpec.from_string(text.replace("</robot>", world + options + "</robot>"))


def _add_bodies(spec: mujoco.MjSpec, name: str) -> None:
    kinds = mujoco.mjtGeom
    if name == "rolling":
        spec.geom("ground").friction[0] = cases.MU_GROUND_BOX
        box, *balls = cases.rolling_centres()
        body = spec.worldbody.add_body(pos=box)
        body.add_freejoint()
        # of two coefficients MuJoCo takes the greater
        body.add_geom(type=kinds.mjGEOM_BOX, size=[10, 10, 0.5], mass=cases.BOX_MASS).friction[0] = cases.MU_GROUND_BOX
        for place in balls:
            body = spec.worldbody.add_body(pos=place)
            body.add_freejoint()
            geom = body.add_geom(type=kinds.mjGEOM_SPHERE, size=[0.5, 0, 0], mass=cases.BALL_MASS)
            geom.friction[0] = cases.MU_BOX_BALL
        return
    places = {
        "bouncing": cases.bouncing_centres,
        "666": lambda: cases.six_centres(cases.LOW),
        "elastic 666": lambda: cases.six_centres(cases.HIGH),
        "momentum": lambda: np.array([(0.0, cases.FAR, cases.ALOFT)]),
    }
    radius = cases.BALL_RADIUS if name == "momentum" else cases.RADIUS
    for place in places.get(name, lambda: ())():
        body = spec.worldbody.add_body(pos=place)
        for axis in np.eye(3):
            # without friction nothing turns a ball
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        body.add_geom(type=kinds.mjGEOM_SPHERE, size=[radius, 0, 0], mass=cases.MASS)


def _leave_out_overlaps(spec: mujoco.MjSpec) -> None:
    """Leave out the pairs of links that overlap at the neutral configuration, as mbvi does."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pairs = {tuple(sorted(model.geom_bodyid[contact.geom].tolist())) for contact in data.contact}
    for first, second in sorted(pair for pair in pairs if pair[0]):
        spec.add_exclude(bodyname1=model.body(first).name, bodyname2=model.body(second).name)


def agreement(name: str) -> Callable[[], float]:
    """Return a function that compares what both engines start from: the largest difference of the states."""
    ours, theirs = Ours(name, TRIALS[name].step), Theirs(name, TRIALS[name].step, DELIVERED)

    def difference() -> float:
        first = problems(name)[0]
        mine = ours._states(first.q0[None], first.v0[None])
        theirs._begin()
        other = theirs._states(theirs.data.qpos[None].copy(), theirs.data.qvel[None].copy())
        return max(
            float(np.abs(a - b).max(initial=0.0)) for a, b in zip(mine, other, strict=True) if a.shape == b.shape
        )

    return difference
