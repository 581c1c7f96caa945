"""`mbvi.interop`: derivatives by JAX and PyTorch through impacts, against those of closed forms by the same program."""

import sys
from contextlib import contextmanager

import numpy as np
import pytest

import mbvi
from support.derivatives import agrees

G, RADIUS, WALL, DURATION = 9.81, 0.1, 2.0, 0.7
WORKS = ["jax", "torch"]


@contextmanager
def double_precision():
    """What JAX calls its switch; all versions have it."""
    import jax

    jax.config.update("jax_enable_x64", True)
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", False)


class Jax:
    """What tests need of JAX, in double precision."""

    def __init__(self):
        import jax

        self._jax, self.rollout = jax, mbvi.interop.jax_rollout
        self.sin, self.cos = jax.numpy.sin, jax.numpy.cos

    def gradients(self, function, *x):
        """The derivatives of a number by arrays."""
        with double_precision():
            given = [self._jax.numpy.asarray(one) for one in x]
            return list(map(np.array, self._jax.grad(function, argnums=tuple(range(len(x))))(*given)))


class Torch:
    """The same of PyTorch."""

    def __init__(self):
        self._torch, self.rollout = pytest.importorskip("torch"), mbvi.interop.torch_rollout
        self.sin, self.cos = self._torch.sin, self._torch.cos

    def gradients(self, function, *x):
        given = [self._torch.tensor(one, dtype=self._torch.float64, requires_grad=True) for one in x]
        return [one.numpy() for one in self._torch.autograd.grad(function(*given), given)]


@pytest.fixture(params=[Jax, Torch], ids=WORKS)
def work(request):
    return request.param()


def thrown(e):
    """A ball that is thrown over a floor at a wall."""
    scene = mbvi.Scene(gravity=(0, 0, -G), restitution=float(e))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, 0), offset=-WALL, name="wall")
    scene.add_sphere(RADIUS, 1.0, position=(0, 0, 1), name="ball")
    return scene.build()


def end(q, v, e):
    """Its place and velocity at the end, after one impact with each."""
    strikes = (WALL - RADIUS - q[0]) / v[0]
    down = (v[2] ** 2 + 2 * G * (q[2] - RADIUS)) ** 0.5
    left = DURATION - (v[2] + down) / G
    place = WALL - RADIUS - e * v[0] * (DURATION - strikes), q[1] + v[1] * DURATION, (
        RADIUS + e * down * left - 0.5 * G * left**2
    )  # fmt: skip
    return place, (-e * v[0], v[1], e * down - G * left)


def mix(q, v):
    """Some number that depends on all of a final state, with curvature."""
    return sum((k + 1) * q[k] ** 2 + (2 * k - 1) * q[k] * v[k] ** 2 + v[k] for k in range(3))


@pytest.mark.parametrize("seed", range(3))
def test_a_ball_at_a_floor_and_a_wall(work, seed):
    """By place, velocity and restitution, against the closed form that the same program differentiates."""
    rng = np.random.default_rng(seed)
    q, v, e = rng.normal([0, 0, 0.7], [0.1, 1, 0.02]), rng.normal([3.5, 0, 0], 0.2), rng.uniform(0.6, 0.9)
    scheme = mbvi.EventDriven(1e-11)
    assert len(mbvi.simulate(thrown(e).at(q, v), scheme, duration=DURATION).impacts) == 2
    rollout = work.rollout(thrown, scheme, duration=DURATION, wrt=["restitution"])
    found = work.gradients(lambda q, v, e: mix(*rollout(q, v, e)), q, v, e)
    exact = work.gradients(lambda q, v, e: mix(*end(q, v, e)), q, v, e)
    agrees(np.hstack(found), np.hstack(exact))
    # without parameters, as arrays of numbers
    fixed = work.rollout(thrown(e), scheme, duration=DURATION)
    agrees(np.hstack(work.gradients(lambda q, v: mix(*fixed(q, v)), q, v)), np.hstack(exact[:2]))


def turning(e=0.5):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0.1, 1), name="floor")
    scene.add_box((0.3, 0.5, 0.7), 2.0, position=(0, 0, 0.6), angular_velocity=(1.2, 3.0, 2.4), name="box")
    return scene.build()


def test_two_runs_one_after_the_other(work):
    """They have the derivative of one run, also where configurations hold quaternions."""
    problem, scheme = turning(), mbvi.EventDriven(1e-11)
    whole = mbvi.simulate(problem, scheme, duration=0.3)
    assert len(whole.impacts) > 0
    weights = np.random.default_rng(0).normal(size=13)

    def number(q, v):
        return sum(w * x**2 for w, x in zip(weights, [*q, *v], strict=True))

    once, first, second = (work.rollout(problem, scheme, duration=T) for T in (0.3, 0.12, 0.18))
    found = work.gradients(lambda q, v: number(*second(*first(q, v))), problem.q0, problem.v0)
    exact = work.gradients(lambda q, v: number(*once(q, v)), problem.q0, problem.v0)
    agrees(np.hstack(found), np.hstack(exact))
    # no number depends on the length of a quaternion
    assert abs(found[0][3:7] @ problem.q0[3:7]) < 1e-9 * np.abs(found[0]).max()


def test_a_free_turn(work):
    """A cube turns at a constant rate: the quaternion at the end is q exp(w T / 2)."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((0.3, 0.3, 0.3), 2.0, name="cube")
    problem, T = scene.build(), 0.7
    rng = np.random.default_rng(1)
    q, v = np.concatenate([rng.normal(size=3), rng.normal(size=4)]), rng.normal(size=6)
    q[3:] /= np.linalg.norm(q[3:])

    def turned(q, v):
        a, w = q[3:], v[3:] * (T / 2)
        angle = (w * w).sum() ** 0.5
        s, c = work.sin(angle) / angle, work.cos(angle)
        b = [w[0] * s, w[1] * s, w[2] * s]
        return [
            a[3] * b[0] + a[0] * c + a[1] * b[2] - a[2] * b[1],
            a[3] * b[1] + a[1] * c + a[2] * b[0] - a[0] * b[2],
            a[3] * b[2] + a[2] * c + a[0] * b[1] - a[1] * b[0],
            a[3] * c - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
        ]

    weights = rng.normal(size=4)
    rollout = work.rollout(problem, mbvi.EventDriven(1e-11), duration=T)
    found = work.gradients(lambda q, v: sum(w * x for w, x in zip(weights, rollout(q, v)[0][3:], strict=True)), q, v)
    exact = work.gradients(lambda q, v: sum(w * x for w, x in zip(weights, turned(q, v), strict=True)), q, v)
    # along the sphere of unit quaternions
    exact[0][3:] -= (exact[0][3:] @ q[3:]) * q[3:]
    agrees(np.hstack(found), np.hstack(exact))


def hinged():
    """Two boxes that a hinge connects, and that fall on a floor one after the other."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0.1, 0.05, 1), name="floor")
    scene.add_box((0.3, 0.04, 0.06), 1.0, position=(0, 0, 0.4), angular_velocity=(1, 2, 1.5), name="first")
    scene.add_box((0.3, 0.06, 0.04), 2.0, position=(0.3, 0, 0.4), name="second")
    scene.hinge("first", "second", at=(0.15, 0, 0.4), axis=(0, 1, 0))
    return scene.build()


def coupled():
    """A robot of which one joint follows another."""
    scene = mbvi.Scene()
    fingers = ["left_finger_joint", "right_finger_joint"]
    scene.add_urdf("robot:arm", base="fixed", joints={"joint2": 0.3}, locked=fingers, name="arm")
    scene.couple("arm/joint2", "arm/joint4", ratio=-0.5)
    return scene.build(resolve=True)


@pytest.mark.parametrize(("make", "impacts"), [(hinged, 1), (coupled, 0)])
def test_closed_loops_against_differences_of_runs(work, make, impacts):
    """Along variations that keep the loop, whose tangent vectors are fewer than the velocities."""
    problem, scheme, T = make(), mbvi.EventDriven(1e-12), 0.3
    assert len(mbvi.simulate(problem, scheme, duration=T).impacts) >= impacts
    nv, system = problem.system.nv, problem.system
    rng = np.random.default_rng(3)
    weights = rng.normal(size=problem.system.nq + nv)
    rollout = work.rollout(problem, scheme, duration=T)

    def number(q, v):
        return sum(w * x for w, x in zip(weights, [*q, *v], strict=True))

    by_q, by_v = work.gradients(lambda q, v: number(*rollout(q, v)), problem.q0, problem.v0)
    keeping = mbvi.sensitivity(problem, scheme, duration=T).matrices[0]
    for _ in range(3):
        varied, h = keeping @ rng.normal(size=2 * nv), 1e-5
        ends, starts = [], []
        for sign in (1, -1):
            q, v = system.integrate(problem.q0, sign * h * varied[:nv]), problem.v0 + sign * h * varied[nv:]
            run = mbvi.simulate(problem.at(q, v), scheme, duration=T)
            ends.append(number(run.q[-1], run.v[-1]))
            starts.append(q)
        found = by_q @ (starts[0] - starts[1]) / (2 * h) + by_v @ varied[nv:]
        assert found == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-5, abs=1e-5)


def test_of_fixed_steps_the_derivative_is_that_of_the_motion(work):
    q, v, e = np.array([0, 0, 0.7]), np.array([3.5, 0.3, 0.1]), 0.7
    rollout = work.rollout(thrown, mbvi.Paoli(), duration=DURATION, step=1e-4, wrt=["restitution"])
    found = work.gradients(lambda q, v, e: mix(*rollout(q, v, e)), q, v, e)
    agrees(np.hstack(found), np.hstack(work.gradients(lambda q, v, e: mix(*end(q, v, e)), q, v, e)), 2e-3)


def on_two_feet():
    system = mbvi.LagrangianSystem(lambda q: np.diag([1.0, 0.1]), lambda t, q, v: np.array([-G, 0.0]), 2)
    feet = [
        mbvi.GapFunction(lambda q, s=s: q[0] + s * np.sin(q[1]), lambda q, s=s: np.array([1.0, s * np.cos(q[1])]))
        for s in (-1, 1)
    ]
    return mbvi.Problem(system, feet, [0.3, 0.0], [0.0, 0.0], restitution=0.5)


def test_where_there_is_no_derivative_going_back_raises(work):
    problem = on_two_feet()
    rollout = work.rollout(problem, duration=0.4)
    assert np.isfinite(np.asarray(rollout(problem.q0, problem.v0)[0])).all()
    with pytest.raises(mbvi.SensitivityError, match="not orthogonal") as caught:
        work.gradients(lambda q, v: rollout(q, v)[0][0], problem.q0, problem.v0)
    assert caught.value.time == pytest.approx(np.sqrt(0.6 / G), abs=1e-9)


def test_wrong_arguments(work):
    for problem, given in (
        (thrown, {}), (thrown(0.5), {"wrt": ["restitution"]}), (3.0, {}), (lambda: None, {"wrt": ["gravity"]}),
        (thrown(0.5), {"duration": -1.0}), (thrown(0.5), {"scheme": "Paoli"}), (thrown(0.5), {"step": 0.0}),
    ):  # fmt: skip
        with pytest.raises(mbvi.InputError):
            work.rollout(problem, **{"duration": 0.1} | given)
    q, v = np.array([0, 0, 0.7]), np.zeros(3)
    with pytest.raises(mbvi.InputError, match="must return a Problem"):
        work.rollout(lambda p: p, duration=0.1, wrt=["gravity"])(q, v, 1.0)
    with pytest.raises(mbvi.InputError, match="3 numbers, gravity, and 1 are given"):
        work.rollout(lambda p: thrown(0.5), duration=0.1, wrt=["gravity"])(q, v, 0.5)
    with pytest.raises(mbvi.InputError, match="0 numbers, none, and 1 are given"):
        work.rollout(thrown(0.5), duration=0.1)(q, v, 0.5)
    with pytest.raises(mbvi.InadmissibleStartError):
        work.rollout(thrown(0.5), duration=0.1)(q - 0.65, v)


@pytest.mark.parametrize("name", WORKS)
def test_without_the_package_it_says_what_to_install(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(mbvi.InputError, match=rf"pip install 'mbvi\[{name}\]'"):
        getattr(mbvi.interop, f"{name}_rollout")(thrown(0.5), duration=0.1)


def test_what_jax_compiles_and_maps():
    """`jit`, `vmap` and `jacrev` give the same; there JAX puts the text of an error into one of its own."""
    import jax

    rollout = mbvi.interop.jax_rollout(thrown, duration=DURATION, wrt=["restitution"])
    q, v, e = np.array([0, 0, 0.7]), np.array([[3.5, 0.3, 0.1], [3.2, -0.3, 0.2]]), 0.7

    def number(v):
        return mix(*rollout(q, v, e))

    with double_precision():
        plain = np.array([jax.grad(number)(one) for one in v])
        assert np.array_equal(jax.vmap(jax.grad(number))(v), plain)
        # what JAX compiles of `mix` may fuse products and sums where the machine can
        np.testing.assert_allclose(jax.jit(jax.grad(number))(v[0]), plain[0], rtol=1e-14)
        matrix = mbvi.sensitivity(thrown(e).at(q, v[0]), duration=DURATION).matrix[:3]
        by_q, by_v = jax.jacrev(lambda q, v: rollout(q, v, e)[0], argnums=(0, 1))(q, v[0])
        agrees(np.hstack([by_q, by_v]), matrix)
        refused = mbvi.interop.jax_rollout(on_two_feet(), duration=0.4)
        with pytest.raises(Exception, match=r"SensitivityError: no derivative at t = 0\.247"):
            jax.jit(jax.grad(lambda q: refused(q, np.zeros(2))[0][0]))(np.array([0.3, 0.0]))
    # JAX's own precision is single
    single = jax.grad(number)(v[0].astype(np.float32))
    assert single.dtype == np.float32 and np.abs(single - plain[0]).max() < 1e-4 * np.abs(plain).max()


def test_tensors_keep_their_kind():
    torch = pytest.importorskip("torch")
    rollout = mbvi.interop.torch_rollout(thrown(0.7), duration=DURATION)
    v = torch.tensor([3.5, 0.3, 0.1], dtype=torch.float32, requires_grad=True)
    q, _ = rollout([0, 0, 0.7], v)
    assert q.dtype == torch.float64 and rollout(torch.tensor([0.0, 0.0, 0.7]), v)[0].dtype == torch.float32
    q[2].backward()
    assert v.grad.dtype == torch.float32
    # no second derivative is known
    with pytest.raises(RuntimeError, match="once_differentiable"):
        torch.autograd.grad(rollout([0, 0, 0.7], v)[0][2] ** 2, v, create_graph=True)[0][2].backward()
