"""Controls that the compiled loop evaluates: their laws, and that they act as functions of Python do."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.run.loop.loop_scope import has_user_forces, is_compiled
from support.paths import ROBOTS

SEEDS = st.integers(0, 2**32 - 1)
STEP = 1e-3


def hopper(control, **options):
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(
        ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.52), joints={"knee": 0.4}, control=control, name="hopper",
        **options,
    )  # fmt: skip
    return scene.build()


@given(SEEDS)
def test_a_pd_control_is_its_formula(seed):
    rng = np.random.default_rng(seed)
    n, extra, k = (int(i) for i in rng.integers(1, 5, size=3))
    times = np.cumsum(rng.random(k) + 0.01)
    rows = dict(zip(("q", "v", "torque"), rng.normal(size=(3, k, n)), strict=True))
    stiffness, damping, limit = rng.random((3, n))
    given = {"v": rows["v"], "torque": rows["torque"], "times": times, "limit": limit}
    control = mbvi.PDControl(rows["q"], stiffness, damping, **given)
    q, v, t = rng.normal(size=n + extra + 1), rng.normal(size=n + extra), 1.5 * times[-1] * rng.random()
    at_t = {name: np.array([np.interp(t, times, column) for column in row.T]) for name, row in rows.items()}
    wanted = at_t["torque"] + stiffness * (at_t["q"] - q[-n:]) + damping * (at_t["v"] - v[-n:])
    found = control(t, q, v)
    np.testing.assert_allclose(found[-n:], np.clip(wanted, -limit, limit), rtol=1e-12, atol=1e-13)
    assert not found[:-n].any()


WHEELED = """<robot name="wheeled"><link name="base"/>
<link name="arm"><inertial><origin xyz=".3 0 0"/><mass value="1"/>
<inertia ixx=".01" iyy=".02" izz=".03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="wheel"><inertial><mass value=".5"/>
<inertia ixx=".01" iyy=".02" izz=".03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="10" velocity="10"/></joint>
<joint name="roll" type="continuous"><parent link="arm"/><child link="wheel"/><origin xyz=".6 0 0"/>
<axis xyz="0 1 0"/></joint></robot>"""


def test_a_pd_control_finds_its_joints_before_one_without_limits(tmp_path):
    path = tmp_path / "wheeled.urdf"
    path.write_text(WHEELED)
    drive = mbvi.PDControl([0.3, 0.0], [50.0, 0.0], [5.0, 1.0])
    scene = mbvi.Scene()
    for name in ("wheeled", "other"):
        scene.add_urdf(path, base="fixed", joints={"lift": 1.0, "roll": 0.7}, control=drive, name=name)
    problem = scene.build()
    v = np.array([0.2, 0.4, -0.1, 0.3])
    wanted = [50.0 * (0.3 - 1.0) - 5.0 * 0.2, -1.0 * 0.4, 50.0 * (0.3 - 1.0) + 5.0 * 0.1, -1.0 * 0.3]
    np.testing.assert_allclose(problem.system.torque(0.0, problem.q0, v), wanted, rtol=1e-13)
    # targets may still be set from outside
    drive.q[:] = 0.8, 0.0
    wanted[0], wanted[2] = 50.0 * (0.8 - 1.0) - 5.0 * 0.2, 50.0 * (0.8 - 1.0) + 5.0 * 0.1
    np.testing.assert_allclose(problem.system.torque(0.0, problem.q0, v), wanted, rtol=1e-13)


def test_a_constant_torque_acts_on_the_last_velocities():
    control = mbvi.ConstantTorque([1.0, -2.0])
    assert control(0.3, np.zeros(9), np.zeros(8)).tolist() == [0.0] * 6 + [1.0, -2.0]
    control.torque[:] = 3.0
    assert control(0.3, np.zeros(9), np.zeros(8)).tolist() == [0.0] * 6 + [3.0, 3.0]


def test_arrays_of_the_caller_are_not_kept():
    torque, q = np.zeros(2), np.zeros(2)
    constant, tracking = mbvi.ConstantTorque(torque), mbvi.PDControl(q, 1.0, 0.0)
    torque[:], q[:] = 1.0, 1.0
    assert not constant(0.0, np.zeros(2), np.zeros(2)).any()
    assert not tracking(0.0, np.zeros(2), np.zeros(2)).any()


def swing(t, q, v, tau):
    tau[6] = 3.0 * np.sin(10.0 * t) - 0.2 * v[6]
    tau[7] = 2.0 * (0.5 - q[8])


def in_python(t, q, v):
    tau = np.zeros(8)
    swing(t, q, v, tau)
    return tau


CONTROLS = {
    "constant": (lambda: mbvi.ConstantTorque([1.5, -2.0]), lambda t, q, v: np.array([0.0] * 6 + [1.5, -2.0])),
    "PD": (
        lambda: mbvi.PDControl([0.1, 0.7], 12.0, [0.4, 0.5], limit=5.0),
        lambda t, q, v: np.concatenate(
            [np.zeros(6), np.clip(12.0 * ([0.1, 0.7] - q[-2:]) - [0.4, 0.5] * v[-2:], -5.0, 5.0)]
        ),
    ),
    "trajectory": (
        lambda: mbvi.PDControl([[0.0, 0.4], [0.3, 0.9]], 15.0, 0.5, times=[0.0, 0.1]),
        lambda t, q, v: np.concatenate(
            [np.zeros(6), 15.0 * ([0.0, 0.4] + min(t / 0.1, 1.0) * np.array([0.3, 0.5]) - q[-2:]) - 0.5 * v[-2:]]
        ),
    ),
    "compiled": (lambda: mbvi.CompiledControl(swing, 9, 8), in_python),
}  # fmt: skip


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True)], ids=repr)
@pytest.mark.parametrize("name", CONTROLS)
def test_a_control_in_the_loop_acts_as_a_function_does(name, scheme):
    make, function = CONTROLS[name]
    inside, outside = hopper(make()), hopper(function)
    assert is_compiled(inside, scheme)
    assert is_compiled(outside, scheme)
    assert [has_user_forces(problem.system) for problem in (inside, outside)] == [False, True]
    runs = [mbvi.simulate(problem, scheme, step=STEP, duration=0.15, progress=False) for problem in (inside, outside)]
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(runs[0].v, runs[1].v, rtol=0, atol=1e-9)
    assert np.abs(runs[0].q - mbvi.simulate(hopper(None), scheme, step=STEP, duration=0.15).q).max() > 1e-3


@pytest.mark.parametrize("way", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))], ids=["deepcopy", "pickle"])
@pytest.mark.parametrize("name", CONTROLS)
def test_controls_are_copied(name, way):
    control = CONTROLS[name][0]()
    q, v = np.linspace(0.0, 1.0, 9), np.linspace(-1.0, 1.0, 8)
    assert way(control)(0.05, q, v).tobytes() == control(0.05, q, v).tobytes()


@pytest.mark.parametrize("index", [8, 100, 10**8, -9])
@pytest.mark.parametrize("reads", [True, False])
def test_a_compiled_control_raises_beyond_its_arrays(index, reads):
    """From the first call that does, in the loop too: a silent write would change other memory."""

    def beyond(t, q, v, tau):
        if t > 0.02:
            if reads:
                tau[7] = v[index]
            else:
                tau[index] = 1.0

    problem = hopper(mbvi.CompiledControl(beyond, 9, 8))
    assert is_compiled(problem, mbvi.Paoli())
    words = rf"the control beyond at t = 0.021: index {index} is out of bounds for axis 0 with size 8"
    with pytest.raises(mbvi.InputError, match=words) as caught:
        mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.1)
    assert caught.value.run.t[-1] == pytest.approx(0.02)
    states = {"q0": np.tile(problem.q0, (2, 1)), "v0": np.tile(problem.v0, (2, 1))}
    assert mbvi.rollout(problem, **states, steps=30, step=STEP, scheme=mbvi.Paoli()).status.all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: mbvi.ConstantTorque([np.nan]), "torque"),
        (lambda: mbvi.PDControl([0.0, 0.0], -1.0, 0.0), "stiffness must be at least 0"),
        (lambda: mbvi.PDControl([0.0, 0.0], 1.0, [0.0] * 3), "damping has shape"),
        (lambda: mbvi.PDControl([[0.0], [1.0]], 1.0, 0.0, times=[1.0, 1.0]), "times must ascend"),
        (lambda: mbvi.PDControl([0.0], 1.0, 0.0, v=[0.0, 0.0]), "v has shape"),
        (lambda: mbvi.CompiledControl(lambda t, q, v, tau: open("x"), 9, 8), "cannot be compiled"),
        (lambda: mbvi.CompiledControl(lambda t, q, v, tau: tau, 9, 8), "it must write the torques to tau"),
        (lambda: mbvi.CompiledControl(3, 9, 8), "control"),
        (lambda: hopper(mbvi.CompiledControl(swing, 9, 9)), r"is made for nq, nv = \(9, 9\); it has \(9, 8\)"),
        (lambda: mbvi.CompiledControl(swing, 9, 8)(0.0, np.zeros(3), np.zeros(8)), "q and v have 3 and 8 entries"),
        (lambda: hopper(mbvi.ConstantTorque(np.zeros(9))), "acts on 9 velocities; it has 8"),
        (lambda: hopper(mbvi.PDControl(np.zeros(4), 1.0, 0.0)), "stiffness on a joint whose position is not one"),
    ],
)  # fmt: skip
def test_arguments_are_checked(make, words):
    with pytest.raises(mbvi.InputError, match=words):
        make()
