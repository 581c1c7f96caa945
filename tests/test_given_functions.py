"""Faulty functions of a user: each is named where it fails, under every scheme, and no run goes on without end."""

import signal
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.arguments import returned
from mbvi.constraints.finite_differences import slopes

SCHEMES = [
    mbvi.Paoli(),
    mbvi.Paoli(project_positions=True),
    mbvi.MoreauJean(),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.SchatzmanPaoli(),
    mbvi.StewartTrinkle(),
    mbvi.EventDriven(1e-6),
]
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
WEIGHT, UP, UNIT = np.array([0.0, -9.81]), np.array([0.0, 1.0]), np.eye(2)
# the height below which functions become faulty
LATE = 0.3


@pytest.fixture(autouse=True)
def alarm():
    """No test of this file may take longer than this."""

    def ring(number, frame):
        raise AssertionError("still running after 30 s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def point(f=lambda q: q[1], gradient=lambda q: UP, mass=lambda q: UNIT, force=lambda t, q, v: WEIGHT, e=0.0):
    """A point that falls from a height of 1 m onto a floor."""
    floor = mbvi.GapFunction(f, gradient, name="floor")
    return mbvi.Problem(mbvi.LagrangianSystem(mass, force, 2), [floor], [0.0, 1.0], [0.3, 0.0], restitution=e)


def run(problem, scheme):
    step = {} if isinstance(scheme, mbvi.EventDriven) else {"step": 2e-3}
    return mbvi.simulate(problem, scheme, duration=1.0, **step)


def below(good, bad, height=LATE):
    """A function of q that turns faulty below a height."""
    return lambda q: good(q) if q[1] > height else bad(q)


def forced(bad):
    return lambda t, q, v: WEIGHT if q[1] > LATE else bad(t, q, v)


def raises(*_):
    raise ZeroDivisionError("the user's own")


def gap(q):
    return q[1]


def up(q):
    return UP


NAN, INF = np.nan, np.inf
# what is given, the error, and what its message names
NOT_FINITE = {
    "f is NaN": ({"f": below(gap, lambda q: NAN)}, "f of floor is not finite at t = 0.3"),
    "f is infinite": ({"f": below(gap, lambda q: INF)}, "f of floor is not finite at t = 0.3"),
    "f is minus infinity": ({"f": below(gap, lambda q: -INF)}, "f of floor is not finite at t = 0.3"),
    "f is a root": ({"f": lambda q: q[1] if q[1] > 0.0 else NAN}, "f of floor is not finite at t = 0.4"),
    "the gradient is NaN": ({"gradient": below(up, lambda q: NAN * UP)}, "floor is not finite at t = 0.[34]"),
    "the gradient is infinite": ({"gradient": below(up, lambda q: np.full(2, INF))}, "gradient of floor is not finite"),
    "the mass is NaN": ({"mass": below(lambda q: UNIT, lambda q: NAN * UNIT)}, "mass .* is not finite at t = 0.3"),
    "one of the mass is infinite": (
        {"mass": below(lambda q: UNIT, lambda q: np.diag([1.0, INF]))}, "mass .* is not finite at t = 0.3",
    ),
    "a lower one of the mass is NaN": (
        {"mass": below(lambda q: UNIT, lambda q: np.array([[1.0, 0.0], [NAN, 1.0]]))}, "mass .* is not finite",
    ),
    "the force is NaN": ({"force": forced(lambda t, q, v: NAN * q)}, "force .* is not finite at t = 0.3"),
    "the force is infinite": ({"force": forced(lambda t, q, v: np.full(2, INF))}, "force .* is not finite at t = 0.3"),
    "the force is NaN in time": (
        {"force": lambda t, q, v: WEIGHT if t < 0.2 else NAN * q}, "force .* is not finite at t = 0.2",
    ),
}  # fmt: skip
WRONG = {
    "f is None": ({"f": below(gap, lambda q: None)}, "f .* returned None"),
    "f is complex": ({"f": below(gap, lambda q: 1.0 + 0.0j)}, "f .* returned"),
    "f is a string": ({"f": below(gap, lambda q: "1.0")}, "f .* returned '1.0'"),
    "f is an array": ({"f": below(gap, lambda q: q)}, r"f .* returned shape \(2,\)"),
    "f is a list of lists": ({"f": below(gap, lambda q: [[1.0], [1.0, 2.0]])}, "f .* returned"),
    "the gradient is None": ({"gradient": below(up, lambda q: None)}, "grad_f .* returned None"),
    "the gradient is complex": ({"gradient": below(up, lambda q: UP + 0j)}, "grad_f .* returned"),
    "the gradient is too long": ({"gradient": below(up, lambda q: np.ones(3))}, r"gradient of floor has shape \(3,\)"),
    "the gradient is too short": ({"gradient": below(up, lambda q: 1.0)}, "gradient of floor has shape"),
    "the gradient is a matrix": ({"gradient": below(up, lambda q: UNIT)}, r"grad_f .* returned shape \(2, 2\)"),
    "the gradient is zero": ({"gradient": below(up, lambda q: 0.0 * UP)}, r"gradient of floor at .* no percussion"),
    "the gradient turns round": ({"gradient": below(up, lambda q: -UP, 0.02)}, "f falls where its gradient says"),
    "one entry turns round": (
        {"f": lambda q: q[1] - 0.1 * q[0], "gradient": lambda q: np.array([-0.1 if q[1] > LATE else 0.1, 1.0])},
        "f falls where its gradient says",
    ),
    "the mass is no matrix": ({"mass": below(lambda q: UNIT, lambda q: np.ones(2))}, r"mass .* returned shape \(2,\)"),
    "the mass is not square": ({"mass": below(lambda q: UNIT, lambda q: np.ones((2, 3)))}, r"returned shape \(2, 3\)"),
    "the mass is None": ({"mass": below(lambda q: UNIT, lambda q: None)}, "mass .* returned None"),
    "the mass is complex": ({"mass": below(lambda q: UNIT, lambda q: UNIT + 0j)}, "mass .* returned"),
    "a negative mass": ({"mass": below(lambda q: UNIT, lambda q: -UNIT)}, "mass .* not positive definite near t"),
    "no mass": ({"mass": below(lambda q: UNIT, lambda q: 0.0 * UNIT)}, "mass .* not positive definite near t"),
    "the mass is not symmetric": (
        {"mass": below(lambda q: UNIT, lambda q: np.array([[1.0, 0.1], [0.0, 1.0]]))}, "mass .* not symmetric near t",
    ),
    "the force is too long": ({"force": forced(lambda t, q, v: np.zeros(3))}, r"force .* returned shape \(3,\)"),
    "the force is None": ({"force": forced(lambda t, q, v: None)}, "force .* returned None"),
    "the force is complex": ({"force": forced(lambda t, q, v: WEIGHT + 0j)}, "force .* returned"),
    "the force is a string": ({"force": forced(lambda t, q, v: "weight")}, "force .* returned 'weight'"),
}  # fmt: skip


@each_scheme
@pytest.mark.parametrize("fault", NOT_FINITE, ids=NOT_FINITE)
def test_what_is_not_finite_raises_at_the_step_where_it_happens(scheme, fault):
    functions, message = NOT_FINITE[fault]
    with pytest.raises(mbvi.DivergedError, match=message):
        run(point(**functions), scheme)


@each_scheme
@pytest.mark.parametrize("fault", WRONG, ids=WRONG)
def test_what_is_of_another_kind_raises_where_it_happens(scheme, fault):
    functions, message = WRONG[fault]
    with pytest.raises(mbvi.InputError, match=message):
        run(point(**functions), scheme)


@pytest.mark.parametrize("fault", [*NOT_FINITE, *WRONG])
def test_what_is_faulty_at_the_start_raises_there(fault):
    """The same functions, of a point that starts below the height."""
    functions, _ = (NOT_FINITE | WRONG)[fault]
    if fault in ("f is a root", "the force is NaN in time", "the gradient is zero"):
        return
    low = {name: shifted(function) for name, function in functions.items()}
    with pytest.raises(mbvi.InputError):
        point(**low)


def shifted(function):
    """A function of a user as it is 0.99 m lower, and there as high as before."""
    return lambda *a: function(*[x - np.array([0.0, 0.99]) if k == len(a) // 2 else x for k, x in enumerate(a)])


@each_scheme
@pytest.mark.parametrize("place", ["f", "gradient", "mass", "force"])
def test_the_users_own_exceptions_pass_unchanged(scheme, place):
    good = {"f": gap, "gradient": up, "mass": lambda q: UNIT}
    bad = forced(raises) if place == "force" else below(good[place], raises)
    with pytest.raises(ZeroDivisionError, match="the user's own"):
        run(point(**{place: bad}), scheme)


GRADIENTS = {
    "twice as long": lambda q: 2.0 * UP,
    "a thousandth": lambda q: 1e-3 * UP,
    "aslant": lambda q: np.array([0.3, 1.0]),
    "half a percent": lambda q: 1.005 * UP,
}


@pytest.mark.parametrize("gradient", GRADIENTS, ids=GRADIENTS)
def test_a_gradient_that_differs_is_warned_of_with_both_values(gradient):
    with pytest.warns(
        mbvi.MbviWarning, match=r"gradient of floor at t = 0 s, q = \[0., 1.\] is .* differences .* give"
    ):
        point(gradient=GRADIENTS[gradient])


def test_one_that_differs_at_the_wall_only_is_warned_of_there():
    problem = point(gradient=below(up, lambda q: 2.0 * UP, 0.02))
    with pytest.warns(mbvi.MbviWarning, match="gradient of floor at t = 0.4"):
        run(problem, mbvi.Paoli())


# right gradients of functions that are hard to difference
HARD = {
    "steep": (lambda q: 1e9 * q[1] ** 3, lambda q: 3e9 * q[1] ** 2 * UP),
    "flat": (lambda q: 1e-9 * q[1] ** 3, lambda q: 3e-9 * q[1] ** 2 * UP),
    "an offset": (lambda q: 1e6 + 1e-3 * q[1], lambda q: 1e-3 * UP),
    "a kink": (lambda q: max(q[1], 0.5 + 0.5 * q[1]), lambda q: UP if q[1] >= 1.0 else 0.5 * UP),
    "a kink downwards": (lambda q: 2.0 - abs(q[1] - 1.0), lambda q: -UP if q[1] >= 1.0 else UP),
    "a corner": (lambda q: np.abs(q).max(), lambda q: UNIT[np.argmax(np.abs(q))]),
    "a jump": (lambda q: q[1] + (q[1] >= 1.0), lambda q: UP),
    "steps": (lambda q: np.floor(1e3 * q[1] + 0.5) / 1e3, lambda q: 0.0 * UP),
    "noise": (lambda q: q[1] + 1e-9 * np.sin(1e12 * q[1]), lambda q: UP),
    "single precision": (lambda q: float(np.float32(q[1] + q[0] + 0.3)), lambda q: np.ones(2)),
    "a wave": (lambda q: 2.0 + np.sin(1e3 * q[1]), lambda q: 1e3 * np.cos(1e3 * q[1]) * UP),
    "a short wave": (lambda q: 2.0 + np.sin(1e6 * q[1]), lambda q: 1e6 * np.cos(1e6 * q[1]) * UP),
    "a root at its end": (lambda q: np.sqrt(max(q[1] - 1.0, 0.0)) + 1.0, lambda q: 0.0 * UP),
    "undefined beside": (lambda q: q[1] if q[1] <= 1.0 else raises(), lambda q: UP),
    "of a small unit": (lambda q: 1e-6 * np.sin(1e6 * (q[1] - 1.0)) + 1e-6, lambda q: np.cos(1e6 * (q[1] - 1.0)) * UP),
}


@pytest.mark.parametrize("hard", HARD, ids=HARD)
def test_a_right_gradient_raises_no_alarm(hard):
    point(*HARD[hard])


@given(
    scale=st.floats(-6.0, 6.0).map(lambda x: 10.0**x),
    place=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    wrong=st.sampled_from(["none", "sign", "entry", "scale"]),
    seed=st.integers(0, 1000),
)
def test_gradients_of_random_smooth_functions_are_told_from_wrong_ones(scale, place, wrong, seed):
    """In any unit of length."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=3), rng.normal(size=(3, 3))
    b = b + b.T

    def f(q):
        x = q / scale
        return scale * (a @ x + 0.1 * x @ b @ x + np.sin(x[0]) + 100.0)

    def gradient(q):
        x = q / scale
        g = a + 0.2 * b @ x + np.array([np.cos(x[0]), 0.0, 0.0])
        if wrong == "sign":
            return -g
        if wrong == "entry":
            k = np.argmax(np.abs(g))
            return g * np.where(np.arange(3) == k, -1.0, 1.0)
        return 1.01 * g if wrong == "scale" else g

    system = mbvi.LagrangianSystem(lambda q: np.eye(3), lambda t, q, v: np.zeros(3), 3)

    def make():
        return mbvi.Problem(system, [mbvi.GapFunction(f, gradient)], scale * np.array(place), np.zeros(3))

    if wrong == "none":
        make()
    elif wrong == "scale":
        with pytest.warns(mbvi.MbviWarning):
            make()
    else:
        with pytest.raises(mbvi.InputError, match="correct its sign"):
            make()


@given(st.floats(-5.0, 5.0), st.floats(-3.0, 3.0))
def test_slopes_hold_the_derivative_between_their_bounds(x, power):
    scale = 10.0**power
    found = slopes(
        lambda w: [np.sin(scale * (x + w[0])), np.exp(x + w[0])],
        np.array([np.sin(scale * x), np.exp(x)]), np.eye(1), max(1.0, abs(x)), True,
    )  # fmt: skip
    exact = np.array([scale * np.cos(scale * x), np.exp(x)])
    assert (found.low[0] <= exact).all()
    assert (exact <= found.high[0]).all()
    np.testing.assert_allclose(found.middle[0], exact, rtol=1e-4, atol=1e-4 * scale)
    assert (found.high - found.low < 2e-3 * np.array([scale, np.exp(x)]) * max(scale, 1.0)).all()


class Box:
    """A user's own constraint, of four rows and in place of a GapFunction."""

    size = 4

    def __init__(self, sign=1.0, fault=None):
        self._sign, self._fault = sign, fault

    def gap(self, t, q):
        gap = np.array([q[0] + 1.0, 1.0 - q[0], q[1], 2.0 - q[1]])
        if self._fault is not None and q[1] < LATE:
            return self._fault(gap)
        return gap

    def gradient(self, t, q):
        return self._sign * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


def boxed(box):
    return mbvi.Problem(
        mbvi.LagrangianSystem(lambda q: UNIT, lambda t, q, v: WEIGHT, 2), [box], [0.0, 1.0], [0.3, 0.0], restitution=0.0
    )


@each_scheme
def test_a_constraint_of_ones_own_is_checked_too(scheme):
    assert run(boxed(Box()), scheme).q[-1, 1] == pytest.approx(0.0, abs=0.02)
    with pytest.raises(mbvi.InputError, match="f falls"):
        boxed(Box(sign=-1.0))
    for row in range(4):
        # a row far from its wall as well
        faulty = boxed(Box(fault=lambda g, row=row: np.where(np.arange(4) == row, NAN, g)))
        with pytest.raises(mbvi.DivergedError, match=f"f of f {row} is not finite at t = 0.3"):
            run(faulty, scheme)
    with pytest.raises(mbvi.InputError, match="has 3 numbers now, and had 4 before"):
        run(boxed(Box(fault=lambda g: g[:3])), scheme)


NO_END = {
    "f is 0": lambda q: 0.0,
    "f is 0 below": lambda q: max(q[1], 0.0),
    "f is 1": lambda q: 1.0,
    "f rises by steps": lambda q: np.floor(100.0 * q[1]) / 100.0 + 0.001,
    "f jumps down": lambda q: q[1] - 0.5 if q[1] < 0.5 else q[1],
    "f jumps up": lambda q: q[1] + 0.5 if q[1] < 0.2 else q[1] - 0.1,
    "f jumps to and fro": lambda q: 1.0 if np.floor(1e3 * q[1]) % 2 else -1.0,
    "f is a saw": lambda q: q[1] % 0.1,
    "f is noise": lambda q: q[1] + 1e-6 * np.sin(1e9 * q[1]),
    "f is folded": lambda q: abs(q[1]),
    "f falls and rises": lambda q: abs(q[1] - 0.5) - 1e-3,
    "f is a cusp": lambda q: np.cbrt(q[1]),
    "f depends on how often it is asked": iter(np.random.default_rng(0).uniform(-0.1, 0.1, 10_000_000)).__next__,
}


@each_scheme
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("f", NO_END, ids=NO_END)
def test_no_function_makes_a_run_go_on_without_end(scheme, f, e):
    """It ends in time, or with an error that says so."""
    if isinstance(scheme, mbvi.StewartTrinkle) and e > 0.0:
        return
    function = NO_END[f]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        try:
            problem = point(f=(lambda q: function()) if "often" in f else function, e=e)
            run(problem, scheme)
        except mbvi.MbviError as error:
            assert len(str(error)) > 20


def test_event_driven_says_where_it_makes_no_progress():
    """A damping so large that steps of an explicit method stay short for ever."""
    stiff = point(force=lambda t, q, v: WEIGHT - 1e12 * v)
    with pytest.raises(mbvi.DivergedError, match=r"steps and events since t = 0 s led to t = .* only"):
        run(stiff, mbvi.EventDriven(1e-6))


@pytest.mark.parametrize("bad", [NAN, INF])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_control_that_is_not_finite_raises_at_its_step(scheme, bad, tmp_path):

    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(
        mbvi.robot("hopper"), position=(0, 0, 2),
        control=lambda t, q, v: np.where(t > 0.05, bad, 0.0) * np.ones(len(v)),
    )  # fmt: skip
    problem = scene.build()
    with pytest.raises(mbvi.DivergedError, match=r"control of hopper is not finite at t = 0\.05"):
        run(problem, scheme)


def test_numbers_are_what_they_are():
    for good in (
        1,
        1.5,
        np.float32(2.0),
        [1, 2],
        (1.0,),
        np.arange(3),
        [np.float64(1.0)],
        np.array([1, 2], object),
    ):
        assert returned(good, "f").dtype == np.float64
    for bad in (
        None,
        True,
        "1",
        b"1",
        1j,
        [None],
        [1, None],
        {},
        {1: 2},
        [[1], [1, 2]],
        object(),
        np.datetime64("now"),
        [1j],
    ):
        with pytest.raises(mbvi.InputError, match="f must return real numbers"):
            returned(bad, "f")


class Shaking:
    """A user's own motion of walls that is lost after a time."""

    def pose(self, t):
        return np.eye(3), np.array([0.0, 0.0, 0.01 * t if t < 0.1 else NAN])

    def twist(self, t):
        return np.array([0.0, 0.0, 0.01]), np.zeros(3)


@pytest.mark.parametrize("scheme", SCHEMES[:-1], ids=repr)
def test_walls_whose_motion_is_not_finite_raise_at_their_step(scheme):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), motion=Shaking())
    scene.add_sphere(0.1, position=(0, 0, 0.5))
    with pytest.raises(mbvi.DivergedError, match=r"motion .* is not finite at t = 0\.1"):
        run(scene.build(), scheme)


def root_at_the_boundary(t, q, v):
    with np.errstate(invalid="ignore"):
        return -np.sqrt(q)


def test_a_force_that_ends_at_the_start_has_no_mode_to_choose_a_step_by():
    """Its differences there cannot be taken; a run where it holds can."""
    walls = [
        mbvi.GapFunction(lambda q, k=k: q[0] + 1.0 + k, lambda q: np.ones(1), name=f"wall {k}") for k in range(101)
    ]
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), root_at_the_boundary, 1)
    problem = mbvi.Problem(system, walls, [0.0], [0.1])
    found = mbvi.simulate(problem, duration=0.01)
    assert "Centered" in found.notes[0]
    assert np.isfinite(found.q).all()
