"""Joint damping under `Centered`: one rule in flight, in contact and in any company, by Python and in the loop."""

import re
import warnings
from itertools import cycle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

import mbvi
from mbvi.run.loop.loop_scope import is_compiled
from mbvi_studies.chart.errors import fitted_order
from support.paths import ROBOTS, real_robot

SCHEMES = [mbvi.Centered(), mbvi.Centered(project_positions=True)]
each = pytest.mark.parametrize("scheme", SCHEMES, ids=["plain", "projecting"])
ROTOR = """<robot name="rotor"><link name="base"/>
  <link name="wheel"><inertial><mass value="2"/><inertia ixx="1" iyy="0.2" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="axle" type="revolute"><parent link="base"/><child link="wheel"/><axis xyz="0 1 0"/>
    <limit lower="-9" upper="{upper}" effort="1" velocity="1"/><dynamics damping="{d}"/></joint></robot>"""
# three slides across each other and a heavy load: M is constant, and not diagonal
SLIDES = """<robot name="slides"><link name="base"/>
  <link name="a"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="c"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="1"/><dynamics damping="{0}"/></joint>
  <joint name="b" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0.8 0.6 0"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="1"/><dynamics damping="{1}"/></joint>
  <joint name="c" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="-0.6 0.8 0"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="1"/><dynamics damping="{2}"/></joint></robot>"""
INERTIA, RATE = 0.2, 2.0


def damped(tmp_path, name, *coefficients):
    """The project's robot with damping of its joints, in the order of its file."""
    many = cycle(coefficients)
    text = (ROBOTS / f"{name}/{name}.urdf").read_text()
    path = tmp_path / f"{name}.urdf"
    path.write_text(re.sub("(<limit [^>]*/>)", lambda found: f'{found[1]}<dynamics damping="{next(many)}"/>', text))
    return path


def rotor(tmp_path, upper=9.0, at=0.0, v=1.0, d=RATE * INERTIA):
    path = tmp_path / f"rotor {upper:g}.urdf"
    path.write_text(ROTOR.format(upper=upper, d=d))
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(path, base="fixed", joints={"axle": at}, velocity={"axle": v})
    return scene.build()


def by_python(problem, scheme, h, count):
    for _, step in zip(range(count), mbvi.steps(problem, scheme, step=h), strict=False):
        last = step
    return last.q, last.v


def by_loop(problem, scheme, h, count):
    assert is_compiled(problem, scheme)
    run = mbvi.simulate(problem, scheme, step=h, duration=count * h, progress=False)
    assert len(run.t) == count + 1
    return run.q[-1], run.v[-1]


both = pytest.mark.parametrize("follow", [by_python, by_loop])


@both
@each
def test_a_wheel_slows_down_as_exp_at_order_two(tmp_path, scheme, follow):
    problem, counts = rotor(tmp_path), np.array([20, 40, 80])
    ends = [follow(problem, scheme, 1.0 / n, n) for n in counts.tolist()]
    turned, speeds = (np.array([end[k][0] for end in ends]) for k in (0, 1))
    assert 1.9 < fitted_order(1.0 / counts, np.abs(speeds - np.exp(-RATE))) < 2.1
    assert 1.9 < fitted_order(1.0 / counts, np.abs(turned - (1.0 - np.exp(-RATE)) / RATE)) < 2.1


@each
@given(z=st.floats(1e-6, 1e9))
def test_it_decays_no_faster_than_exp_and_no_slower_than_under_paoli(tmp_path_factory, scheme, z):
    """So it is L-stable, and a joint never turns back."""
    slow = 1e-9
    problem = rotor(tmp_path_factory.getbasetemp(), v=slow)
    left = by_python(problem, scheme, z / RATE, 1)[1][0] / slow
    assert np.exp(-z) - 1e-15 <= left <= 1 / (1 + z) + 1e-15
    np.testing.assert_allclose(left, (1 + z) / (1 + z / 2) ** 4, rtol=1e-12, atol=1e-15)


@both
@each
@pytest.mark.parametrize("v", [-1.0, 0.0])
def test_a_limit_that_bears_nothing_changes_nothing(tmp_path, scheme, follow, v):
    """The joint starts on its limit and leaves it; or the limit is far away."""
    far, near = (rotor(tmp_path, upper, at=0.25, v=v, d=3.0) for upper in (9.0, 0.25))
    first = next(iter(mbvi.steps(near, scheme, step=1e-1)))
    assert len(first.active.gap) == (v == 0.0)
    for count in (1, 5):
        for a, b in zip(follow(far, scheme, 1e-1, count), follow(near, scheme, 1e-1, count), strict=True):
            np.testing.assert_array_equal(a, b)


def oracle(model, q, v, h):
    """The velocity of docs/howto/schemes.md without rows: modes of D in M, each multiplied by its own factor."""
    data, middle = model.createData(), pin.integrate(model, q, 0.5 * h * v)
    M = pin.crba(model, data, middle)
    M = np.triu(M) + np.triu(M, 1).T
    D = np.diag(np.array(model.damping))
    half_on = v + np.linalg.solve(M + 0.5 * h * D, 0.5 * h * (-pin.nle(model, data, middle, v) - D @ v))
    F = -pin.nle(model, data, middle, half_on)
    rates, modes = eigh(D, M)
    z = h * np.maximum(rates, 0.0)
    decay = (1 + z) / (1 + z / 2) ** 4
    # (1 - decay) / z without division by zero
    pushed = (1 + 3 * z / 2 + z**2 / 2 + z**3 / 16) / (1 + z / 2) ** 4
    np.testing.assert_allclose(pushed * z, 1 - decay, atol=1e-12)
    return middle, M, modes @ (decay * (modes.T @ M @ v) + h * pushed * (modes.T @ F))


def test_its_velocity_is_that_of_the_documented_equation(tmp_path, rng):
    for name, base in (("double_pendulum", "fixed"), ("quadruped", "free")):
        scene = mbvi.Scene()
        scene.add_urdf(damped(tmp_path, name, 0.0, 0.3, 5.0), base=base, position=(0, 0, 9))
        problem = scene.build()
        model = problem.model(name)
        assert (np.array(model.damping) > 0.0).any()
        for h in (1e-3, 1e-2):
            q, v = problem.system.integrate(problem.q0, 0.1 * rng.normal(size=model.nv)), rng.normal(size=model.nv)
            for scheme in SCHEMES:
                _, _, x = oracle(model, q, v, h)
                for follow in (by_python, by_loop):
                    np.testing.assert_allclose(follow(problem.at(q, v), scheme, h, 1)[1], x, rtol=1e-9, atol=1e-10)


PARTS = {
    "arm": lambda scene, path: scene.add_urdf(ROBOTS / "arm/arm.urdf", base="fixed", velocity={"joint2": 4.0}),
    "pendulum": lambda scene, path: scene.add_urdf(
        path, base="fixed", position=(9, 0, 0), joints={"shoulder": 1.0, "elbow": -0.5}, name="pendulum"
    ),
    "held": lambda scene, path: scene.add_urdf(
        path, base="fixed", position=(0, 9, 0), control=mbvi.PDControl([0.5, 0.2], 20.0, 1.0), name="held"
    ),
    "box": lambda scene, path: scene.add_box(
        (0.3, 0.2, 0.1), mass=2.0, position=(0, -9, 0), angular_velocity=(5, 0.3, 1)
    ),
    "ball": lambda scene, path: scene.add_sphere(0.1, mass=1.0, position=(-9, 0, 0), velocity=(1, 0, 2)),
}


@pytest.mark.parametrize("names", [("arm", "pendulum"), ("arm", "held", "pendulum", "box", "ball")], ids=len)
@both
@each
def test_what_never_meets_moves_as_each_alone(tmp_path, scheme, follow, names):
    """The arm runs into a limit, the box tumbles, one pendulum has a control."""
    path = damped(tmp_path, "double_pendulum", 0.02, 0.3)

    def build(some):
        scene = mbvi.Scene(restitution=0.3)
        for name in some:
            PARTS[name](scene, path)
        return scene.build()

    together, alone = build(names), [build([name]) for name in names]
    assert together.system.nv == sum(problem.system.nv for problem in alone)
    h, count = 5e-3, 150
    q, v = (
        np.split(end, np.cumsum(sizes)[:-1])
        for end, sizes in zip(
            follow(together, scheme, h, count),
            ([p.system.nq for p in alone], [p.system.nv for p in alone]),
            strict=True,
        )
    )
    for k, problem in enumerate(alone):
        own = follow(problem, scheme, h, count)
        print(names[k], np.abs(q[k] - own[0]).max(), np.abs(v[k] - own[1]).max())
        np.testing.assert_allclose(q[k], own[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(v[k], own[1], rtol=0, atol=1e-11)


@each
@given(
    d=st.tuples(*[st.sampled_from([0.0, 1e-3, 1.0, 30.0, 1e6])] * 3),
    v=st.tuples(*[st.floats(-1, 1)] * 3),
    at=st.tuples(*[st.sampled_from([-0.5, 0.0, 0.5])] * 3),
    h=st.sampled_from([1e-3, 1e-2, 0.3]),
)
def test_damping_never_raises_the_energy(tmp_path_factory, scheme, d, v, at, h):
    """Neither in flight nor where slides are stopped at their limits."""
    path = tmp_path_factory.getbasetemp() / "slides.urdf"
    path.write_text(SLIDES.format(*d))
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(
        path, base="fixed", joints=dict(zip("abc", at, strict=True)), velocity=dict(zip("abc", v, strict=True))
    )
    problem, energies = scene.build(), []
    for _, step in zip(range(8), mbvi.steps(problem, scheme, step=h), strict=False):
        energies.append(problem.system.kinetic_energy(step.q, step.v))
    before = problem.system.kinetic_energy(problem.q0, problem.v0)
    assert (np.diff([before, *energies]) <= 1e-14 + 1e-12 * before).all()


PUBLISHED = {
    "allegro": ("allegro_hand_description/urdf/allegro_left_hand.urdf", 0.12),
    "talos": ("talos_data/robots/talos_reduced.urdf", 1.085),
}


@pytest.mark.parametrize("name", [pytest.param("talos", marks=pytest.mark.slow(seconds=20)), "allegro"])
def test_contacts_of_damped_robots_balance_their_momentum(name):
    """With friction and projected positions M (v+ - x) = J'p to rounding, in the M and the x of the step."""
    file, height = PUBLISHED[name]
    scene = mbvi.Scene(friction=0.6)
    scene.add_halfspace((0, 0, 1))
    with warnings.catch_warnings():
        # of what its files hold and is not modelled
        warnings.simplefilter("ignore")
        scene.add_urdf(real_robot(file), position=(0, 0, height), base_velocity=(0.3, 0, -0.5, 0, 0, 0), name=name)
        problem = scene.build()
    model, q, v, h, rough = problem.model(name), problem.q0, problem.v0, 1e-3, 0
    assert (np.array(model.damping) > 0.0).any()
    for _, step in zip(range(150), mbvi.steps(problem, SCHEMES[1], step=h), strict=False):
        _, M, x = oracle(model, q, v, h)
        rows, pushed = step.active, np.zeros(model.nv)
        if step.slip is not None:
            pushed = rows.jacobian.T @ step.percussion + rows.tangents.jacobian.T @ step.slip[0].ravel()
            rough += step.slip[0].any()
        np.testing.assert_allclose(M @ (step.v - x), pushed, rtol=0, atol=1e-11)
        q, v = step.q, step.v
    assert rough > 10
