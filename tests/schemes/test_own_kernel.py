"""A scheme of a user as a kernel, with hulls and friction, beside its step in Python."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import mbvi
from mbvi.run.loop.kernel_scheme import KernelScheme
from mbvi.schemes import Scheme, Step, Timing
from mbvi.schemes.kernels.phases import DONE, Array, MechanismStep, find, jump, kernel, move
from mbvi.schemes.step import NO_RATES, law
from support.paths import ROBOTS


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def law_first(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    code = find(s, t, q)
    if code == DONE:
        code = jump(s, t, q, v, h)
    move(s, q, s.v, h, s.q)
    return code


class LawFirst(Scheme):
    timing = Timing(jump=0.0)

    def step(self, problem, t, q, v, h, projector):
        system, motion = problem.system, problem.system.free_motion(t, q, v, h)
        active = problem.constraints.active(t, q, problem.tolerance)
        if not active.gap.size:
            return Step(t + h, system.integrate(q, h * motion.free), motion.free, active, NO_RATES, 0.0)
        w, rates, residual, slip, active = law(projector, v, motion, active)
        return Step(t + h, system.integrate(q, h * w), w, active, rates, residual, slip)


def fall(folder, mu):
    path, corners = folder / "rock.obj", np.random.default_rng(1).normal(size=(9, 3)) * [0.3, 0.2, 0.03]
    hull = ConvexHull(corners).simplices
    path.write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c}\n" for a, b, c in hull + 1)
    )
    scene = mbvi.Scene(restitution=0.3, friction=mu)
    scene.add_halfspace((0.0, 0.0, 1.0))
    scene.add_mesh(path, fixed=True)
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0.0, 0.0, 0.55), base_velocity=(0.5, 0, 0, 0, 1, 0))
    return scene.build()


@pytest.mark.parametrize("mu", [0.0, 0.6, (0.6, 0.02, 0.005)])
def test_the_kernel_is_the_step_written_in_python(mu, tmp_path):
    options = {"step": 1e-3, "duration": 0.3, "progress": False}
    kernels, python = KernelScheme(law_first, Timing(jump=0.0)), LawFirst()
    one, other = (mbvi.simulate(fall(tmp_path, mu), scheme, **options) for scheme in (kernels, python))
    touched = {name for impact in one.impacts for name in impact.constraints}
    assert len(one.impacts) == len(other.impacts) > 5
    assert any("rock" in name for name in touched) and any("floor" in name for name in touched)
    np.testing.assert_allclose(one.q[-1], other.q[-1], rtol=0, atol=1e-9)
    steps = mbvi.steps(fall(tmp_path, mu), kernels, step=1e-3)
    found = [next(steps) for _ in range(300)]
    np.testing.assert_array_equal(found[-1].q, one.q[-1])
    for step in found:
        assert (step.slip is None) == (mu == 0.0 or not step.active.gap.size)
        if step.slip is not None:
            np.testing.assert_allclose(step.slip[2], step.active.tangents.slip(step.v), rtol=0, atol=1e-12)
