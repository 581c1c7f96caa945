"""A model of MuJoCo beside that which a scene makes of its MJCF."""

import numpy as np
import pinocchio as pin
import pytest

import mbvi

mujoco = pytest.importorskip("mujoco")


def scene_of(text, folder, **arguments):
    """Return a scene with a MJCF, its name, and MuJoCo's own model."""
    file = folder / "model.xml"
    file.write_text(text)
    scene = mbvi.Scene()
    return scene, scene.add_mjcf(file, **arguments), mujoco.MjModel.from_xml_string(text)


class Beside:
    """A model of MuJoCo and one of Pinocchio, and how q and v of the first become those of the second."""

    def __init__(self, m, model):
        self.m, self.model = m, model
        self.d, self.data = mujoco.MjData(m), model.createData()
        # position in MuJoCo and in Pinocchio: joints have the same order
        self.joints = [(int(m.jnt_type[j]), int(m.jnt_qposadr[j]), int(m.jnt_dofadr[j])) for j in range(m.njnt)]

    def q(self, qpos):
        q = np.array(qpos)
        for kind, at, _ in self.joints:
            if kind in (0, 1):
                k = at + 3 * (kind == 0)
                q[k : k + 4] = qpos[[k + 1, k + 2, k + 3, k]]
        return q

    def turn(self, qpos):
        """Return S with v = S qvel, and dS/dt qvel as a function of qvel."""
        S = np.eye(self.m.nv)
        for kind, at, dof in self.joints:
            if kind == 0:
                w, x, y, z = qpos[at + 3 : at + 7]
                S[dof : dof + 3, dof : dof + 3] = pin.Quaternion(w, x, y, z).toRotationMatrix().T
        return S

    def turning(self, S, qvel):
        rate = np.zeros(self.m.nv)
        for kind, _, dof in self.joints:
            if kind == 0:
                local = S[dof : dof + 3, dof : dof + 3] @ qvel[dof : dof + 3]
                rate[dof : dof + 3] = -np.cross(qvel[dof + 3 : dof + 6], local)
        return rate

    def random(self, rng):
        qpos = np.zeros(self.m.nq)
        qpos[:] = self.m.qpos0
        mujoco.mj_integratePos(self.m, qpos, rng.normal(size=self.m.nv), 1.0)
        return qpos, rng.normal(size=self.m.nv)

    def acceleration(self, qpos, qvel, ctrl=()):
        """Return MuJoCo's acceleration as the rate of our v."""
        d = self.d
        d.qpos[:], d.qvel[:], d.ctrl[:] = qpos, qvel, ctrl
        mujoco.mj_forward(self.m, d)
        S = self.turn(qpos)
        return S @ d.qacc + self.turning(S, qvel)

    def check(self, qpos, qvel, rtol=1e-12):
        """Compare the mass matrix, the bias and the damped free acceleration."""
        m, d, model, data = self.m, self.d, self.model, self.data
        d.qpos[:], d.qvel[:] = qpos, qvel
        mujoco.mj_forward(m, d)
        mass = np.zeros((m.nv, m.nv))
        full_mass(m, d, mass)
        S, q = self.turn(qpos), self.q(qpos)
        pin.crba(model, data, q, pin.Convention.WORLD)
        ours = np.triu(data.M) + np.triu(data.M, 1).T
        np.testing.assert_allclose(S.T @ ours @ S, mass, rtol=0, atol=rtol * np.abs(mass).max())
        bias = S.T @ (pin.nonLinearEffects(model, data, q, S @ qvel) + ours @ self.turning(S, qvel))
        scale = max(np.abs(bias).max(), np.abs(mass).max() * float(qvel @ qvel))
        np.testing.assert_allclose(bias, d.qfrc_bias, rtol=0, atol=rtol * scale)
        system = mbvi.system.ArticulatedSystem(model)
        energy = 0.5 * float(qvel @ mass @ qvel)
        np.testing.assert_allclose(system.kinetic_energy(q, S @ qvel), energy, rtol=1e-11)
        np.testing.assert_allclose(model.damping * (S @ qvel), S @ -d.qfrc_damper, rtol=0, atol=rtol * scale)


def full_mass(m, d, mass):
    try:
        mujoco.mj_fullM(m, d, mass)
    except TypeError:
        # before version 4
        mujoco.mj_fullM(m, mass, d.qM)
