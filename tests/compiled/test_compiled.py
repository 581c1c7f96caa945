"""Kernels: what is compiled equals the plain form behind which it stands, one by one and in whole runs."""

import copy
import ctypes
import dis
import pickle
import resource
import sys
import threading
from typing import NamedTuple

import numba
import numpy as np
import pytest

import mbvi
from mbvi.compiled import KERNELS as ALL_KERNELS
from mbvi.compiled import Kernel, all_kernels, call_address, calling_others, held, record, record_at
from mbvi.compiled.kernels import ALLOCATING
from mbvi.constraints import HalfSpaceContacts
from mbvi.projection import Projector
from support.kernel_arguments import ARGUMENTS, IF_ACCEPTED, accepted, arguments, equal, seeds, specified
from support.loop_arguments import arrays_of, replaced, typed_once
from support.paths import ROBOTS
from support.plain import PLAIN
from support.robot_problems import path_of, problem_of

# other tests make kernels of their own
KERNELS = [item for item in all_kernels() if item.loops.__module__.startswith("mbvi.")]


def test_every_kernel_is_compared():
    names = [item.__name__ for item in KERNELS]
    assert len(set(names)) == len(names)
    assert set(ARGUMENTS) == set(names)
    assert set(PLAIN) <= set(names)


def plain_form(item):
    """A numpy form of the same where there is one, else the kernel's own loops run by the interpreter."""
    return PLAIN.get(item.__name__, item.loops)


# what kernels take from numpy that makes no array
NUMBERS = {
    "arccos", "arctan2", "bool_", "copysign", "cos", "float64", "floor", "inf", "int32", "int64", "isnan", "nan", "pi",
    "rint", "round", "searchsorted", "sign", "sin", "sqrt", "tan", "uint32",
}  # fmt: skip


def test_of_what_kernels_take_from_numpy_it_is_known_whether_it_makes_arrays():
    taken = set()
    for item in KERNELS:
        last = None
        for each in dis.get_instructions(item.loops.__code__):
            if last == "np" and each.opname in ("LOAD_ATTR", "LOAD_METHOD"):
                taken.add(each.argval)
            last = each.argval if each.opname == "LOAD_GLOBAL" else None
    assert "empty" in taken and taken <= ALLOCATING | NUMBERS


@pytest.mark.parametrize("item", KERNELS, ids=lambda item: item.__name__)
def test_a_kernel_equals_its_plain_form(item):
    plain = plain_form(item)
    answers = set()
    for seed in seeds(item.__name__):
        first, second = arguments(item, seed), arguments(item, seed)
        results = plain(*first), item(*second)
        expected, found = (specified(item.__name__, *both) for both in zip(results, (first, second), strict=True))
        for a, b in zip(expected, found, strict=True):
            equal(a, b)
        answers.add(item.__name__ not in IF_ACCEPTED or bool(accepted(item.__name__, results[0])))
    # one that may refuse has done both
    assert answers == ({True, False} if item.__name__ in IF_ACCEPTED else {True})


@pytest.mark.parametrize("item", KERNELS, ids=lambda item: item.__name__)
@typed_once()
def test_a_kernel_refuses_other_arrays_than_it_was_made_for(item):
    """Other numbers, gaps between them, another order, and read-only memory where it writes."""
    refused, types, given = 0, item.compiled().nopython_signatures[0].args, arguments(item, 0)
    places = list(arrays_of(tuple(given)))
    # of the arrays in records, some
    for place, value in places[:: 1 + len(places) // 20]:
        frozen = value.copy()
        frozen.setflags(write=False)
        narrower = value.astype({"f": np.float32, "i": np.int32, "u": np.uint16, "b": np.int64}[value.dtype.kind])
        others = [frozen, narrower, np.repeat(value, 2, axis=-1)[..., ::2], np.asfortranarray(value), value[None]]
        kind = types[place[0]]
        for k in place[1:]:
            kind = kind.types[k]
        for other in others:
            # of one row or one column any order is the same
            if other.dtype == value.dtype and other.ndim == value.ndim and other.flags.carray:
                continue
            if other is frozen and not kind.mutable:
                continue
            with pytest.raises(TypeError, match="No matching definition"):
                item(*replaced(tuple(given), place, other))
            refused += 1
    if not places:
        with pytest.raises(TypeError, match="No matching definition"):
            item(*(np.array([number]) for number in given))
        return
    assert refused >= 3


def test_references_are_counted_where_arrays_are_made_or_returned():
    counted = {item.__name__: item._allocates() for item in KERNELS}
    assert counted["separation_of"] and counted["_points_about"] and counted["refine_pair"] and counted["separated"]
    assert not (counted["reach"] or counted["pair_separation"] or counted["outermost"] or counted["dot"])


@record("f8[::1], f8[::1]")
class Two(NamedTuple):
    a: np.ndarray
    b: np.ndarray


def make_two(x):
    return Two(np.full(100_000, x), np.full(100_000, 2.0 * x))


def sum_of_two(x):
    # no array is made here, but some are received
    two = made(x)
    return two.a[0] + two.b[-1]


def unlisted(loops, signature):
    """A kernel that is none of the package's."""
    return type(loops.__name__, (Kernel,), {})(loops, signature)


made = unlisted(make_two, "Two(f8)")


def test_arrays_of_a_record_that_a_kernel_returns_are_released():
    found = unlisted(sum_of_two, "f8(f8)")
    assert found(1.0) == 3.0
    assert isinstance(made(1.0), Two)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(200):
        assert found(2.0) == 6.0
    # all of them together would be 320 MB
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 60_000


def sum_of_fill(x):
    # an array type that no kernel of the package fills
    return np.full((2, 3, 1, 1, 1), x).sum()


def test_a_kernel_may_call_what_numba_has_compiled_for_a_user():
    assert numba.njit(sum_of_fill)(2.0) == 12.0
    assert unlisted(sum_of_fill, "f8(f8)")(2.0) == 12.0


def test_a_record_with_other_fields_is_compiled_again(monkeypatch):
    item = unlisted(make_two, "Two(f8)")
    before = item.stamp()
    monkeypatch.setattr(Two, "kernel_types", "f8[::1], f8[:]")
    assert item.stamp() != before


@record("Two, i8[::1], f8")
class Outer(NamedTuple):
    two: Two
    b: np.ndarray
    c: float


def sum_of_outer(o):
    return o.two.a[0] + o.b[0] + o.c


def test_a_record_may_hold_another_one():
    o = Outer(Two(np.ones(1), np.ones(1)), np.full(1, 2), 3.0)
    assert unlisted(sum_of_outer, "f8(Outer)")(o) == sum_of_outer(o) == 6.0


def test_a_held_record_stands_for_it_and_its_arrays_may_be_replaced():
    item, o = unlisted(sum_of_outer, "f8(Outer)"), Outer(Two(np.ones(1), np.ones(1)), np.full(1, 2), 3.0)
    kept = held(o)
    assert item(kept) == item(o) == sum_of_outer(kept) == 6.0
    o.two.a[0] = 5.0
    assert item(kept) == 10.0
    kept.replace(b=np.full(4, 7))
    assert item(kept) == sum_of_outer(kept) == 15.0


@record("UniTuple(f8[::1], 20), Two, UniTuple(f8, 20)")
class Long(NamedTuple):
    arrays: tuple
    two: Two
    numbers: tuple


def sum_of_long(long, last):
    return long.arrays[0][0] + long.arrays[19][0] + long.two.a[0] + long.two.b[0] + long.numbers[0] + long.numbers[last]


def test_a_long_record_is_written_by_python_for_each_call_and_released():
    item = unlisted(sum_of_long, "f8(Long, i8)")
    arrays, two = tuple(np.full(1, 10.0 * k) for k in range(20)), Two(np.ones(1), np.full(1, 2.0))
    long = Long(arrays, two, tuple(0.5 * k for k in range(20)))
    assert item(long, 19) == item(held(long), 19) == sum_of_long(long, 19) == 190.0 + 3.0 + 9.5
    arrays[19][0] = 0.0
    assert item(long, 2) == 3.0 + 1.0
    counts = [sys.getrefcount(each) for each in (long, two, arrays[0])]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(5_000):
        item(long, 0)
    assert [sys.getrefcount(each) for each in (long, two, arrays[0])] == counts
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 4000
    with pytest.raises(TypeError, match="No matching definition"):
        item(long._replace(numbers=("a", *long.numbers[1:])), 0)


@pytest.mark.parametrize("wrong", [np.ones(1), np.ones((1, 1), np.int64), np.ones(4, np.int64)[::2]])
def test_a_held_record_refuses_arrays_that_kernels_would_misread(wrong):
    two = Two(np.ones(1), np.ones(1))
    with pytest.raises(TypeError, match="kernels take int64 with 1, contiguous"):
        held(Outer(two, wrong, 3.0))
    with pytest.raises(TypeError, match="kernels take int64 with 1, contiguous"):
        held(Outer(two, np.full(1, 2), 3.0)).replace(b=wrong)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_held_record_is_not_copied(copied):
    record = held(Outer(Two(np.ones(1), np.ones(1)), np.full(1, 2), 3.0))
    with pytest.raises(TypeError, match="a held record is not copied"):
        copied(record)


def total_of_two(two):
    return two.a.sum() + two.b[0]


total = unlisted(total_of_two, "f8(Two)")


def total_of_made(a, b):
    found = 0.0
    for k in range(3):
        b[0] = k
        found += total(Two(a, b))
    return found


def test_kernels_pass_a_record_by_its_address():
    """Also one that a kernel makes, and whose arrays change meanwhile."""
    a, b = np.array([0.5, 1.5]), np.zeros(1)
    assert unlisted(total_of_made, "f8(f8[::1], f8[::1])")(a, b) == 3 * 2.0 + 0.0 + 1.0 + 2.0
    (found,) = total.callee().overloads.values()
    function = found.library._get_module_for_linking().get_function(found.fndesc.llvm_func_name)
    # beside it only where the result and an error go
    assert len(list(function.arguments)) == 3


def test_a_kernel_can_be_made_again_with_other_callees():
    def twice(two):
        return 2.0 * (two.a.sum() + two.b[0])

    caller = unlisted(total_of_made, "f8(f8[::1], f8[::1])")
    other = calling_others(caller, "twice_of_made", total=unlisted(twice, "f8(Two)"))
    ALL_KERNELS.remove(other)
    a, b = np.array([0.5, 1.5]), np.zeros(1)
    assert caller(a, b) == 9.0
    assert other(a, b) == 18.0
    assert other.stamp() != caller.stamp()


def call_it(address, a, b):
    call_address(address, a, np.int32(b))


@pytest.mark.parametrize("nogil", [False, True])
def test_a_function_is_called_by_its_address(nogil):
    found = []
    # a callback takes the lock of Python by itself
    function = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int)(lambda a, b: found.append((a, b)))
    address = ctypes.cast(function, ctypes.c_void_p).value
    item = type("call_it", (Kernel,), {})(call_it, "void(i8, i8, i8)", nogil)
    for each in (item, call_it):
        each(address, -(2**40), -3)
    assert found == [(-(2**40), -3)] * 2


def total_of_all(like, where):
    found = 0.0
    for k in range(len(where)):
        if where[k] != 0:
            each = record_at(like, where[k])
            found += each.a.sum() + each.b[0]
    return found


def test_a_kernel_takes_records_by_their_addresses():
    """Each as it is now, and as long as the array with the addresses lives."""
    like = held(Two(np.zeros(2), np.zeros(1)))
    records = [held(Two(np.full(2, float(k)), np.full(1, 0.5))) for k in range(3)]
    where = record_at.addresses([records[0], None, *records[1:]])
    records[2].replace(b=np.full(1, 10.0))
    del records
    item = unlisted(total_of_all, "f8(Two, i8[::1])")
    assert item(like, where) == total_of_all(like, where) == 0.5 + 2.5 + 14.0


def half_of(x):
    return 0.5 * x


def quarter_of(x):
    return apart(x) * 0.5


apart = type("half_of", (Kernel,), {})(half_of, "f8(f8)", False, True)


def test_a_kernel_calls_the_machine_code_of_one_that_is_apart():
    caller = unlisted(quarter_of, "f8(f8)")
    (inner,) = apart.callee().overloads.values()
    assert caller(3.0) == 0.75
    # loaded before its caller, whose code names it without holding it
    assert apart._compiled is not None
    (outer,) = caller.callee().overloads.values()
    assert outer.library._get_module_for_linking().get_function(inner.fndesc.llvm_func_name).is_declaration
    assert apart(3.0) == 1.5


def wait_for(flag):
    count = 0
    # the other thread sets it while this one is here
    while flag[0] == 0 and count < 10**10:
        count += 1
        call_address(flag[1], 100)
    return flag[0]


def test_other_threads_run_while_a_kernel_that_lets_them_does():
    sleep = ctypes.cast(ctypes.CDLL(None).usleep, ctypes.c_void_p).value
    flag = np.array([0, sleep])
    item = type("wait_for", (Kernel,), {})(wait_for, "i8(i8[::1])", True)
    item.compiled()

    def stop():
        flag[0] = 7

    timer = threading.Timer(0.1, stop)
    timer.start()
    assert item(flag) == 7
    timer.join()


# arrays that a kernel does not take as they are


def hopper(control=None, e=0.5):
    """A hopper that lands with its knee at a limit within some twenty steps of a millisecond."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(
        ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.56), joints={"knee": 0.4}, velocity={"hip": -1.0},
        control=control,
    )  # fmt: skip
    return scene.build()


def test_a_projection_takes_any_array(rng):
    J, x, B = rng.normal(size=(4, 6)), rng.normal(size=6), rng.normal(size=(6, 6))
    M = B @ B.T + np.eye(6)
    expected = mbvi.project(x, M, J, np.full(4, 0.1))
    assert (expected.percussion > 0.0).any()
    frozen, spaced = np.asfortranarray(J), np.repeat(J, 2, axis=1)[:, ::2]
    frozen.setflags(write=False)
    others = [
        mbvi.project(x, M, frozen, 0.1),
        mbvi.project(np.repeat(x, 2)[::2], np.asfortranarray(M), spaced, np.broadcast_to(0.1, 4)),
        mbvi.project(x.tolist(), M.tolist(), J.tolist(), [0.1] * 4),
    ]  # fmt: skip
    for other in others:
        np.testing.assert_allclose(other.velocity, expected.velocity, rtol=1e-13)
        np.testing.assert_allclose(other.percussion, expected.percussion, rtol=1e-12, atol=1e-14)
    whole = np.array([[2, 0, 1], [0, 1, 0]])
    w = mbvi.project(np.array([-1, -1, 1]), np.eye(3, dtype=int), whole, 0).velocity
    np.testing.assert_allclose(w, mbvi.project([-1.0, -1.0, 1.0], np.eye(3), whole * 1.0).velocity)
    assert mbvi.impact(x, M, frozen, 0.5) == pytest.approx(mbvi.impact(x, M, J, np.full(4, 0.5)))


class Columns:
    """A metric of someone else's, whose answers stand in memory column by column."""

    def __init__(self, M):
        self.M, self.L = M, np.linalg.cholesky(M)

    def apply(self, w):
        return self.M @ w

    def whiten(self, w):
        return np.linalg.solve(self.L, w)

    def unwhiten(self, y):
        return np.linalg.solve(self.L.T, y)

    def solve_rows(self, rows):
        return np.asfortranarray(np.linalg.solve(self.M, rows.T).T)

    def dense(self):
        return self.M


def test_a_projection_takes_any_metric(rng):
    J, x, B = rng.normal(size=(4, 6)), rng.normal(size=6), rng.normal(size=(6, 6))
    M = B @ B.T + np.eye(6)
    given, expected = mbvi.project(x, Columns(M), J), mbvi.project(x, M, J)
    np.testing.assert_allclose(given.velocity, expected.velocity, rtol=1e-12)


@pytest.mark.parametrize("of_a_robot", [True, False])
def test_a_step_goes_on_from_the_read_only_states_of_a_trajectory(of_a_robot):
    def build():
        if of_a_robot:
            return hopper()
        scene = mbvi.Scene(restitution=0.5)
        scene.add_halfspace((0, 0, 1))
        scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.13), angular_velocity=(1, 2, 0))
        return scene.build()

    h = 1e-3
    problem, run = build(), mbvi.simulate(build(), mbvi.Paoli(), step=h, duration=0.15, progress=False)
    assert run.impacts
    assert not run.q.flags.writeable
    pressed = 0
    for i in range(len(run.t) - 1):
        step = mbvi.Paoli().step(problem, run.t[i], run.q[i], run.v[i], h, Projector())
        np.testing.assert_allclose(step.q, run.q[i + 1], atol=1e-13)
        np.testing.assert_allclose(step.v, run.v[i + 1], atol=1e-9)
        pressed += step.percussion.any()
    assert pressed


def test_a_kernel_takes_what_a_control_returns():
    """Read-only, strided, of integers, a list, or the same array every time."""

    def torque(t):
        return np.round(20.0 * np.sin(40.0 * t + np.arange(problem.system.nv))) * (np.arange(problem.system.nv) >= 6)

    problem = hopper()
    same = np.empty(problem.system.nv)

    def frozen(t, q, v):
        tau = torque(t)
        tau.setflags(write=False)
        return tau

    def again(t, q, v):
        same[:] = torque(t)
        return same

    controls = [
        frozen,
        again,
        lambda t, q, v: np.repeat(torque(t), 3)[::3],
        lambda t, q, v: torque(t).astype(int),
        lambda t, q, v: torque(t).astype(np.float32),
        lambda t, q, v: torque(t).tolist(),
        lambda t, q, v: np.array([torque(t)]).T[:, 0],
    ]
    expected = mbvi.simulate(hopper(lambda t, q, v: torque(t)), mbvi.Paoli(), duration=0.15, progress=False)
    assert expected.impacts
    free = mbvi.simulate(hopper(), mbvi.Paoli(), duration=0.15, progress=False)
    assert np.abs(free.q - expected.q).max() > 1e-3
    for control in controls:
        run = mbvi.simulate(hopper(control), mbvi.Paoli(), duration=0.15, progress=False)
        np.testing.assert_array_equal(run.q, expected.q)
        np.testing.assert_array_equal(run.v, expected.v)


# whole runs


@pytest.fixture
def plain_forms(monkeypatch):
    """Call it to have every kernel run its plain form until the end of the test."""

    def replace():
        for item in KERNELS:
            monkeypatch.setattr(type(item), "__call__", staticmethod(plain_form(item)))

    return replace


def swinging(name, e):
    """A fixed robot that moves towards a wall one centimetre away."""
    towards = {"double_pendulum": (-1, 0, 0), "ur5": (0, 0, 1)}[name]
    velocity = {"shoulder": -3.0, "elbow": 1.0} if name == "double_pendulum" else {"elbow_joint": 1.0}

    def build(offset):
        scene = mbvi.Scene(restitution=e)
        scene.add_halfspace(towards, offset, name="floor")
        scene.add_urdf(path_of(name), base="fixed", velocity=velocity)
        # far away no link meets the wall at any angle
        return scene.build(reduce=())

    far = build(-5.0)
    wall = next(c for c in far.constraints.constraints if isinstance(c, HalfSpaceContacts))
    return build(wall.gap(0.0, far.q0).min() - 5.01)


def meeting(name, e):
    """A scene in which the robot touches something within a hundred steps."""
    if name in ("double_pendulum", "ur5"):
        return swinging(name, e)
    return problem_of(name, "fall" if name == "talos" else "limits", e)


def check_whole_run(name, e, plain_forms):
    compiled = mbvi.simulate(meeting(name, e), mbvi.Paoli(), step=1e-3, duration=0.1, progress=False)
    plain_forms()
    plain = mbvi.simulate(meeting(name, e), mbvi.Paoli(), step=1e-3, duration=0.1, progress=False)
    assert plain.impacts
    scale = max(1.0, np.abs(plain.v).max())
    np.testing.assert_allclose(compiled.q, plain.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(compiled.v, plain.v, rtol=0, atol=1e-12 * scale)
    assert [i.constraints for i in compiled.impacts] == [i.constraints for i in plain.impacts]
    np.testing.assert_allclose(compiled.penetration(), plain.penetration(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("name", ["arm", "biped", "double_pendulum", "hopper", "quadruped"])
def test_a_run_is_the_same_with_the_plain_forms(name, e, plain_forms):
    check_whole_run(name, e, plain_forms)


@pytest.mark.slow(seconds=12)
@pytest.mark.parametrize(("name", "e"), [("ur5", 0.0), ("panda", 0.5), ("solo12", 0.0), ("talos", 0.5)])
def test_a_run_of_a_real_robot_is_the_same_with_the_plain_forms(name, e, plain_forms):
    check_whole_run(name, e, plain_forms)
