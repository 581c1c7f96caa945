"""Wrong arguments: what is given in place of a right one, and a right call of every public function to put it into.

`CALLS` holds one right call of every public callable, under the name that `public_callables` finds it by; a parameter
that is added to one needs a value in its call here. `check` puts a bad value into a call: it may raise `MbviError` or
succeed, in time and without a foreign warning.
"""

from __future__ import annotations

import collections
import dataclasses
import decimal
import fractions
import functools
import inspect
import pathlib
import signal
import warnings
from collections.abc import Callable, Iterator
from typing import Any, get_type_hints

import numpy as np

import mbvi
import mbvi.results.replay.replay
from mbvi.interop.final_state import FinalState
from mbvi.scene.inputs import BodyArguments
from support.paths import ROBOTS

HOPPER = ROBOTS / "hopper" / "hopper.urdf"
# seconds that a call with a wrong argument may take
_PATIENCE = 10.0


class _Raises:
    """Raises whatever is done with it."""

    def _raise(self, *arguments: Any) -> Any:
        raise ZeroDivisionError("an object that always raises")

    __array__ = __bool__ = __float__ = __fspath__ = __index__ = __iter__ = __len__ = __repr__ = __str__ = _raise
    __abs__ = __lt__ = __gt__ = __le__ = __ge__ = __getitem__ = _raise


class _Motion:
    """Has the methods of a motion, which return words."""

    def pose(self, t: float) -> str:
        return "up"

    twist = pose


def _inside_itself() -> list[Any]:
    loop: list[Any] = []
    loop.append(loop)
    return loop


def _nested(depth: int) -> list[Any]:
    return functools.reduce(lambda inner, _: [inner], range(depth), [1.0])


# each makes its value, for some can be used once only
BAD: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "True": lambda: True,
    "numpy's True": lambda: np.True_,
    "empty text": lambda: "",
    "word": lambda: "abc",
    "digits": lambda: "1",
    "minus zero in words": lambda: "-0.0",
    "nan in words": lambda: "nan",
    "NUL": lambda: "a\0b",
    "lone surrogate": lambda: "\ud800",
    "line break": lambda: "a\nb",
    "parts": lambda: "a | b/c[0]",
    "long text": lambda: "x" * 10_000,
    "bytes": lambda: b"abc",
    "nan": lambda: np.nan,
    "inf": lambda: np.inf,
    "-inf": lambda: -np.inf,
    "-1": lambda: -1.0,
    "zero": lambda: 0,
    "a half": lambda: 0.5,
    "huge float": lambda: 1e308,
    "large float": lambda: -1e160,
    "denormal": lambda: 5e-324,
    "tiny": lambda: 1e-200,
    "huge integer": lambda: 10**400,
    "integer of many digits": lambda: 10**5000,
    "huge negative integer": lambda: -(10**400),
    "complex": lambda: 1.0 + 2.0j,
    "decimal": lambda: decimal.Decimal("NaN"),
    "fraction": lambda: fractions.Fraction(10**400, 3),
    "long double": lambda: np.longdouble("1e4000"),
    "date": lambda: np.datetime64("2026-11-22"),
    "object": object,
    "class": lambda: int,
    "raises": _Raises,
    "function without arguments": lambda: lambda: 1.0,
    "function that returns a word": lambda: lambda *_: "abc",
    "function that returns None": lambda: lambda *_: None,
    "function that returns nan": lambda: lambda *_: np.nan,
    "function that returns ragged lists": lambda: lambda *_: [[1.0], [1.0, 2.0]],
    "motion of words": _Motion,
    "empty list": list,
    "empty lists": lambda: [[]],
    "list of None": lambda: [None] * 3,
    "list of words": lambda: ["a", "b", "c"],
    "list of bools": lambda: [True, False, True],
    "list with a bool": lambda: [1.0, True, 0.0],
    "list with a huge integer": lambda: [10**400, 0, 1],
    "ragged": lambda: [[1.0, 2.0], [3.0]],
    "four numbers": lambda: [1.0, 2.0, 3.0, 4.0],
    "three nan": lambda: np.full(3, np.nan),
    "three huge": lambda: np.full(3, 1e308),
    "three denormals": lambda: np.full(3, 5e-324),
    "three zeros": lambda: np.zeros(3),
    "zeros (3, 3)": lambda: np.zeros((3, 3)),
    "huge (3, 3)": lambda: np.full((3, 3), 1e308),
    "nan (3, 3)": lambda: np.full((3, 3), np.nan),
    "mirror": lambda: np.diag([1.0, 1.0, -1.0]),
    "nothing (0, 3)": lambda: np.zeros((0, 3)),
    "one of four axes": lambda: np.ones((1, 1, 1, 1)),
    "complex array": lambda: np.array([1j, 2j, 3j]),
    "array of objects": lambda: np.array([object(), None, "a"]),
    "array of a word": lambda: np.array("abc"),
    "masked": lambda: np.ma.masked_array([1.0, 2.0, 3.0], [True, False, False]),
    "inside itself": _inside_itself,
    "deep": lambda: _nested(200),
    "set": lambda: {1.0, 2.0, 3.0},
    "generator": lambda: (x for x in (1.0, 2.0, 3.0)),
    "dict": lambda: {"knee": "a"},
    "dict of numbers": lambda: {1: 2.0},
    "dict of nan": lambda: {"knee": np.nan},
    "dict of a huge number": lambda: {"knee": 1e308},
    "dict of an unknown name": lambda: {"elbow": 0.1},
    "ellipsis": lambda: ...,
    "a folder": lambda: pathlib.Path("/"),
    "a path into nowhere": lambda: pathlib.Path("nowhere/at/all"),
}

# those that some parameter rightly takes; no parameter takes any other
RIGHT_SOMEWHERE = {
    "None", "True", "numpy's True", "word", "digits", "minus zero in words", "nan in words", "line break", "parts",
    "-1", "zero", "a half", "denormal", "tiny", "huge integer", "integer of many digits", "empty list",
    "function that returns nan", "function that returns None",
    "three denormals", "three zeros", "four numbers", "zeros (3, 3)", "mirror", "nothing (0, 3)",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Call:
    """A right call.

    Attributes
    ----------
    call : callable
        Takes the arguments by name.
    arguments : callable
        Returns a value for every parameter, new each time.
    use : callable
        What is done with the result, which must not fail where the arguments were taken.
    """

    call: Callable[..., Any]
    arguments: Callable[[], dict[str, Any]]
    use: Callable[[Any], Any] = lambda result: None


def scene() -> mbvi.Scene:
    """Return a scene with a floor and a sphere."""
    made = mbvi.Scene()
    made.add_halfspace((0, 0, 1), name="floor")
    made.add_sphere(0.1, position=(5.0, 0.0, 1.0), name="ball")
    return made


@functools.cache
def connected_run() -> mbvi.Trajectory:
    """Return a run of two spheres that are connected."""
    made = mbvi.Scene(friction=0.1)
    for name, x in (("a", 0.0), ("b", 0.3)):
        made.add_sphere(0.1, 1.0, position=(x, 0.0, 0.0), name=name)
    made.connect("a", "b", at=(0.15, 0.0, 0.0), name="rod")
    return mbvi.simulate(made.build(), mbvi.Paoli(), step=1e-3, duration=0.01, progress=False)


@functools.cache
def run() -> mbvi.Trajectory:
    """Return a short run."""
    made = _controlled(lambda t, q, v: np.zeros(8))
    made.add_force("ball", lambda t, q, v: np.zeros(3))
    return mbvi.simulate(made.build(), mbvi.Paoli(), step=1e-2, duration=0.02, progress=False, record="contacts")


def _controlled(control: Any = None) -> mbvi.Scene:
    made = scene()
    made.add_urdf(HOPPER, position=(0.0, 0.0, 1.0), name="hopper", control=control)
    return made


@functools.cache
def saved() -> str:
    """Return the path of its file."""
    import tempfile

    path = pathlib.Path(tempfile.mkdtemp()) / "run.h5"
    run().save(path)
    return str(path)


def dropped(height: float) -> mbvi.Scene:
    """Return a scene of a study."""
    made = mbvi.Scene()
    made.add_sphere(0.1, position=(0.0, 0.0, height))
    return made


def last_height(result: mbvi.Trajectory) -> dict[str, float]:
    """Measure a run of a study."""
    return {"height_of_ball": result.q[-1, 2]}


_STUDY = {"make": dropped, "parameters": {"height": [0.1, 0.2]}, "measure": last_height, "seed": 0, "keep": "all"}
_SWEEP = {"scheme": mbvi.Paoli(), "step": 1e-3, "duration": 3e-3}


@functools.cache
def study() -> str:
    """Return the path of a study that is complete."""
    import tempfile

    path = tempfile.mkdtemp()
    mbvi.sweep(**_STUDY, **_SWEEP, out=path, client=_client(), budget=100.0)
    return path


@functools.cache
def _client() -> Any:
    """Return the client of a thread of this process: worker processes would need longer to start."""
    import atexit

    import distributed

    made = distributed.Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0", set_as_default=False
    )
    atexit.register(made.close)
    return made


@functools.cache
def swept() -> Any:
    """Return its table."""
    # imported here, because a call is timed
    import matplotlib.figure  # noqa: F401

    return mbvi.sweep(**_STUDY, **_SWEEP, out=study(), budget=100.0)


@functools.cache
def mesh() -> str:
    """Return the path of a mesh file, a tetrahedron."""
    path = pathlib.Path(saved()).with_name("tetrahedron.obj")
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    return str(path)


@functools.cache
def srdf() -> str:
    """Return the path of an SRDF file."""
    path = pathlib.Path(saved()).with_name("pairs.srdf")
    path.write_text('<robot name="hopper"><disable_collisions link1="trunk" link2="shank"/></robot>')
    return str(path)


@functools.cache
def mjcf() -> str:
    """Return the path of a MJCF."""
    path = pathlib.Path(saved()).with_name("model.xml")
    path.write_text(
        '<mujoco model="model"><worldbody><body><freejoint/><geom size=".1"/><body pos="0 0 .5"><joint name="hinge"/>'
        '<geom size=".1"/><body pos="0 0 .5"><joint name="slide" type="slide" range="-1 1"/><geom size=".1"/></body>'
        '</body></body></worldbody><actuator><motor name="drive" joint="hinge"/></actuator>'
        '<keyframe><key name="home"/></keyframe></mujoco>'
    )
    return str(path)


def _adds(method: str, **arguments: Any) -> Call:
    """Return the call of a method that adds to a scene, which is then built and run for three steps."""

    def call(**given: Any) -> mbvi.Scene:
        made = scene()
        name = getattr(made, method)(**given)
        assert isinstance(name, str)
        return made

    return Call(call, lambda: dict(arguments), _runs)


def _acted(method: str) -> Callable[..., mbvi.Scene]:
    def call(**given: Any) -> mbvi.Scene:
        made = _controlled()
        getattr(made, method)(**given)
        return made

    return call


def _runs(made: mbvi.Scene) -> None:
    _moves(made.build())


def _moves(problem: mbvi.Problem) -> None:
    short = mbvi.simulate(problem, mbvi.Paoli(), step=1e-4, duration=3e-4, progress=False)
    assert np.isfinite(short.q).all() and np.isfinite(short.v).all()
    short.energy()


def _steps(walk: Iterator[Any]) -> None:
    for _ in range(2):
        assert np.isfinite(next(walk).v).all()


@functools.cache
def _hopper() -> mbvi.Problem:
    """Return a problem that calls leave as it is: building it would take most of their time."""
    return _controlled().build()


def _hoppers() -> tuple[Any, Any]:
    return np.tile(_hopper().q0, (2, 1)), np.tile(_hopper().v0, (2, 1))


def _simulator() -> mbvi.Simulator:
    return mbvi.Simulator(scene().build(), mbvi.Paoli(), step=1e-3)


def _clamped() -> mbvi.Simulator:
    made = _controlled()
    made.weld("world", "hopper/trunk", name="clamp")
    return mbvi.Simulator(made.build(), mbvi.Paoli(), step=1e-3)


def _acts(control: Any) -> None:
    _moves(_controlled(control).build())


def _nothing(t: float, q: Any, v: Any, tau: Any) -> None:
    pass


def _system() -> mbvi.LagrangianSystem:
    return mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([0.0, -9.81]), 2)


def _gap() -> mbvi.GapFunction:
    return mbvi.GapFunction(lambda q: q[1], lambda q: np.array([0.0, 1.0]), tangents=lambda q: np.array([[1.0, 0.0]]))


def _problem(system: Any = None, gap: Any = None) -> mbvi.Problem:
    return mbvi.Problem(system or _system(), [gap or _gap()], [0.0, 1.0], [0.0, 0.0], friction=0.2)


def _driven(motion: Any) -> None:
    made = scene()
    made.add_box((0.1, 0.1, 0.1), motion=motion)
    _runs(made)


def _strewn(pack: Any) -> None:
    assert len(pack.positions) == len(pack.radii)
    assert np.isfinite(pack.positions).all() and (pack.radii > 0.0).all()


def _drawn(sizes: Any) -> None:
    radii = sizes(np.random.default_rng(0), 10)
    assert (radii > 0.0).all() and np.isfinite(radii).all()


def _meets_a_sphere(mesh: Any) -> None:
    made = scene()
    made.add_surface(*mesh, position=(0.0, 0.0, -50.0))
    _runs(made)


def _finite_projection(result: Any) -> None:
    assert np.isfinite(getattr(result, "velocity", result)).all()


def _replay(speed: Any, shapes: Any) -> None:
    # right arguments open a browser
    right = isinstance(speed, float) and 1e-6 <= speed <= 1e6
    if not (right and isinstance(shapes, str) and shapes in ("visual", "collision")):
        run().replay(speed=speed, shapes=shapes)


def _replay_video(path: Any, **given: Any) -> None:
    # right arguments start a browser
    try:
        run().replay_video(path, **given)
    except mbvi.InputError as error:
        if not (isinstance(path, str) and path == "run" and "ends with one of" in str(error)):
            raise


_ROLLOUT = {
    "problem": lambda p: _hopper(), "scheme": mbvi.Centered(), "duration": 0.01, "step": 1e-3, "wrt": ["gravity"],
}  # fmt: skip


def _rollout(package: str) -> Callable[..., Any]:
    def call(**given: Any) -> Any:
        try:
            rollout = getattr(mbvi.interop, f"{package}_rollout")(**given)
        except mbvi.InputError as error:
            # PyTorch is not installed everywhere: without it, what it would differentiate is called
            if "pip install" not in str(error):
                raise
            names = "problem", "scheme", "duration", "step", "wrt"
            rollout = FinalState(*({"wrt": (), **given}.get(name) for name in names)).run
            return rollout(_hopper().q0, _hopper().v0, np.array([0.0, 0.0, -9.81]))
        return rollout(_hopper().q0, _hopper().v0, [0.0, 0.0, -9.81])

    return call


def _sweep(**given: Any) -> Any:
    # without a client it is the current one
    with _client().as_current():
        return mbvi.sweep(**given, **_SWEEP)


def _replay_of_study(html: Any, **given: Any) -> None:
    # right arguments open a browser
    if html is not None:
        mbvi.replay(html=html, **given).energy()


def _solved(reference: Any) -> None:
    q, v = reference.at(0.5 * reference.duration)
    assert np.isfinite(q).all() and np.isfinite(v).all()


_BODY = {
    "position": (0.0, 0.0, 1.0),
    "rotation": np.eye(3),
    "velocity": (0.0, 0.0, 0.0),
    "angular_velocity": (0.0, 0.0, 0.0),
    "name": "thing",
    "fixed": False,
    "motion": None,
}
_PLACES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
_STILL = np.zeros((2, 3))
_MANY = {"velocities": _STILL, "name": "things", "density": None}
_TURNING = {**_MANY, "rotations": np.eye(3), "angular_velocities": _STILL}
_POINTS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])
_SHEET = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
_REFERENCE = {"e": 0.5, "duration": 0.5}

CALLS: dict[str, Call] = {
    "Scene": Call(
        mbvi.Scene, lambda: {"gravity": (0.0, 0.0, -9.81), "restitution": 0.5, "plane": None, "friction": 0.3,
        "energy_cap": True},
        lambda made: (made.add_sphere(0.1), _runs(made)),
    ),
    "Scene.add_halfspace": _adds(
        "add_halfspace", normal=(0.0, 0.0, 1.0), offset=-1.0, name="wall",
        motion=mbvi.motion.Translation((1.0, 0.0, 0.0)),
    ),
    "Scene.add_container": _adds(
        "add_container", lower=(-9.0, -9.0, 0.0), upper=(9.0, 9.0), name="bin",
        motion=mbvi.motion.Translation((1.0, 0.0, 0.0)),
    ),
    "Scene.add_surface": _adds(
        "add_surface", mesh=_SHEET, triangles=[[0, 1, 2]], scale=1.0, position=(0.0, 0.0, -1.0), rotation=np.eye(3),
        name="ground", motion=None, one_sided=True,
    ),
    "Scene.add_heightfield": _adds(
        "add_heightfield", heights=np.zeros((3, 4)), size=(4.0, 2.0), position=(0.0, 0.0, -1.0), rotation=np.eye(3),
        name="hills", motion=None, height=None,
    ),
    "Scene.add_urdf": _adds(
        "add_urdf", path=HOPPER, base="free", position=(0.0, 0.0, 1.0), rotation=np.eye(3), joints={"knee": 0.4},
        velocity={"hip": 0.1}, control=lambda t, q, v: np.zeros(len(v)), name="hopper", srdf=srdf(), locked=["knee"],
        tolerance=1e-3, base_velocity=(0.1, 0.0, 0.0, 0.0, 0.0, 0.2), mimic=True, joint_friction={"knee": 0.1},
    ),
    "Scene.add_mjcf": _adds(
        "add_mjcf", path=mjcf(), position=(0.0, 0.0, 1.0), rotation=np.eye(3), joints={"hinge": 0.4},
        velocity={"hinge": 0.1}, control=None, name="model", locked=["slide"], tolerance=1e-3,
        base_velocity=(0.1, 0.0, 0.0, 0.0, 0.0, 0.2), keyframe="home", ctrl={"drive": 0.1}, joint_friction=True,
        rolling_friction=True,
    ),
    "Scene.add_sphere": _adds(
        "add_sphere", radius=0.1, mass=1.0, **{k: v for k, v in _BODY.items() if k in
        ("position", "velocity", "name", "fixed", "motion")},
    ),
    "Scene.add_control": Call(
        _acted("add_control"), lambda: {"control": lambda state: {"hopper": np.zeros(8)}}, _runs
    ),
    "Scene.add_force": Call(
        _acted("add_force"), lambda: {"body": "ball", "force": lambda t, q, v: np.zeros(3)}, _runs
    ),
    "Problem.at": Call(
        lambda **given: scene().build().at(**given),
        lambda: {"q": [5.0, 0.0, 1.0], "v": [0.0, 0.0, 0.0], "t": 0.5, "check": True}, _moves,
    ),
    "Problem.state": Call(
        lambda **given: scene().build().state(**given),
        lambda: {"q": {"ball": [5.0, 0.0, 1.0]}, "v": {"ball": [0.0, 0.0, 1.0]}},
    ),
    "Problem.model": Call(lambda **given: _controlled().build().model(**given), lambda: {"name": "hopper"}),
    "Scene.add_box": _adds("add_box", size=(0.1, 0.2, 0.3), mass=1.0, **_BODY),
    "Scene.add_ellipsoid": _adds("add_ellipsoid", radii=(0.1, 0.2, 0.3), mass=1.0, **_BODY),
    "Scene.add_capsule": _adds("add_capsule", radius=0.1, length=0.3, mass=1.0, **_BODY),
    "Scene.add_cylinder": _adds("add_cylinder", radius=0.1, length=0.3, mass=1.0, **_BODY),
    "Scene.add_mesh": _adds(
        "add_mesh", path=mesh(), mass=1.0, scale=0.1, tolerance=1e-3, convex=True, decompose=False, **_BODY
    ),
    "Scene.add_spheres": _adds("add_spheres", positions=_PLACES, radius=0.1, mass=1.0, **_MANY),
    "Scene.add_boxes": _adds("add_boxes", positions=_PLACES, size=(0.1, 0.1, 0.1), mass=1.0, **_TURNING),
    "Scene.add_convex": _adds(
        "add_convex", shape=_POINTS, positions=_PLACES, mass=1.0, scale=1.0, tolerance=1e-3, **_TURNING
    ),
    "Scene.set_restitution": Call(
        lambda **given: scene().set_restitution(**given), lambda: {"first": "ball", "second": "floor", "e": 0.5}
    ),
    "Scene.set_friction": Call(
        lambda **given: scene().set_friction(**given), lambda: {"first": "ball", "second": "floor", "mu": 0.5}
    ),
    "Scene.exclude": Call(
        lambda **given: scene().exclude(**given), lambda: {"first": "ball", "second": "floor"}
    ),
    "Scene.connect": Call(
        lambda **given: _controlled().connect(**given),
        lambda: {"first": "hopper/trunk", "second": "ball", "at": (5.0, 0.0, 1.0), "name": "rope", "active": False},
    ),
    "Scene.hinge": Call(
        _acted("hinge"),
        lambda: {
            "first": "world", "second": "hopper/trunk", "at": (0, 0, 1), "axis": (0, 1, 0), "name": "door",
            "limits": (-1, 1), "stiffness": 2.0, "rest": 0.1, "damping": 0.3, "friction": 0.4,
            "control": lambda t, q, v: np.zeros(1), "active": True,
        },
        _runs,
    ),
    "Scene.weld": Call(
        lambda **given: _controlled().weld(**given),
        lambda: {"first": "world", "second": "hopper/trunk", "name": "clamp", "active": False},
    ),
    "Scene.couple": Call(
        lambda **given: _controlled().couple(**given),
        lambda: {
            "first": "hopper/hip", "second": "hopper/knee", "ratio": 2.0, "offset": 0.1, "name": "gear",
            "active": False,
        },
    ),
    "Scene.build": Call(
        lambda **given: scene().build(**given), lambda: {"reduce": ("pairs", "rest"), "resolve": True}, _moves
    ),
    "Problem": Call(
        mbvi.Problem,
        lambda: {
            "system": _system(), "constraints": [_gap()], "q0": [0.0, 1.0], "v0": [0.0, 0.0], "restitution": 0.5,
            "friction": 0.2, "energy_cap": True, "t0": 0.0, "length": 1.0, "scene": None,
        },
        lambda problem: (problem.report(), _moves(problem)),
    ),
    "LagrangianSystem": Call(
        mbvi.LagrangianSystem,
        lambda: {
            "mass": lambda q: np.eye(2), "force": lambda t, q, v: np.zeros(2), "dim": 2, "potential": lambda q: 0.0
        },
        lambda system: _moves(_problem(system=system)),
    ),
    "GapFunction": Call(
        mbvi.GapFunction,
        lambda: {
            "f": lambda q: q[1], "grad_f": lambda q: np.array([0.0, 1.0]), "name": "floor",
            "tangents": lambda q: np.array([[1.0, 0.0]]),
        },
        lambda gap: _moves(_problem(gap=gap)),
    ),
    "simulate": Call(
        mbvi.simulate,
        lambda: {
            "problem": scene().build(), "scheme": mbvi.Paoli(), "duration": 3e-3, "step": 1e-3, "every": 2,
            "residual": 1e-6, "depth": None, "solver": mbvi.ProxQP(), "out": "run.h5", "progress": False,
            "record": "contacts", "switch": lambda state: {},
        },
        lambda made: made.energy(),
    ),
    "steps": Call(
        mbvi.steps,
        lambda: {
            "problem": scene().build(), "scheme": mbvi.StewartTrinkle(), "step": 1e-3, "residual": None, "depth": 1e-3,
            "solver": mbvi.SparsePCG(),
        },
        _steps,
    ),
    "rollout": Call(
        mbvi.rollout,
        lambda: {
            "problem": _hopper(), "q0": _hoppers()[0], "v0": _hoppers()[1], "steps": 2, "step": 1e-3,
            "scheme": mbvi.Paoli(), "control": None, "ctrl": None, "threads": 2,
        },
        lambda found: found.status,
    ),
    "Simulator": Call(
        mbvi.Simulator, lambda: {"problem": scene().build(), "scheme": mbvi.Paoli(), "step": 1e-3},
        lambda made: made.step(2),
    ),
    "Simulator.reset": Call(
        lambda **given: _simulator().reset(**given),
        lambda: {"q": [5.0, 0.0, 1.0], "v": [0.0, 0.0, 0.0], "t": 0.5},
    ),
    "Simulator.attach": Call(
        lambda **given: mbvi.Simulator(_controlled().build(), mbvi.Paoli(), step=1e-3).attach(**given),
        lambda: {
            "first": "hopper/trunk", "second": "world", "at": (0.0, 0.0, 1.0), "axis": (0, 1, 0), "name": "clamp",
        },
    ),
    "Simulator.detach": Call(lambda **given: _clamped().detach(**given), lambda: {"name": "clamp"}),
    "Simulator.switch": Call(lambda **given: _clamped().switch(**given), lambda: {"connections": {"clamp": False}}),
    "Simulator.step": Call(lambda **given: _simulator().step(**given), lambda: {"n": 2}),
    "ConstantTorque": Call(mbvi.ConstantTorque, lambda: {"torque": [0.1, 0.2]}, _acts),
    "PDControl": Call(
        mbvi.PDControl,
        lambda: {
            "q": [[0.0, 0.1], [0.2, 0.3]], "stiffness": 2.0, "damping": [0.1, 0.2], "v": [0.0, 0.1],
            "torque": [[0.0, 0.1], [0.2, 0.3]], "times": [0.0, 1.0], "limit": 3.0,
        },
        _acts,
    ),
    "CompiledControl": Call(mbvi.CompiledControl, lambda: {"control": _nothing, "nq": 9, "nv": 8}),
    "ProxQP": Call(mbvi.ProxQP, dict),
    "DualActiveSet": Call(mbvi.DualActiveSet, dict),
    "SparsePCG": Call(mbvi.SparsePCG, dict),
    "Paoli": Call(mbvi.Paoli, lambda: {"project_positions": True}),
    "Centered": Call(mbvi.Centered, lambda: {"project_positions": True}),
    "MoreauJean": Call(mbvi.MoreauJean, lambda: {"theta": 0.5, "project_positions": True}),
    "SchatzmanPaoli": Call(mbvi.SchatzmanPaoli, dict),
    "StewartTrinkle": Call(mbvi.StewartTrinkle, dict),
    "Adaptive": Call(mbvi.Adaptive, lambda: {"tolerance": 1e-3}),
    "EventDriven": Call(mbvi.EventDriven, lambda: {"tolerance": 1e-6}),
    "robot": Call(mbvi.robot, lambda: {"name": "quadruped"}),
    "load": Call(
        mbvi.load,
        lambda: {
            "path": saved(), "control": {"hopper": lambda t, q, v: np.zeros(8)},
            "force": {"ball": lambda t, q, v: np.zeros(3)},
        },
        lambda loaded: loaded.energy(),
    ),
    "project": Call(
        mbvi.project,
        lambda: {"x": [1.0, -1.0, 0.0], "M": np.eye(3), "J": np.eye(3), "lower": 0.0, "friction": None},
        _finite_projection,
    ),
    "impact": Call(
        mbvi.impact,
        lambda: {"v": [1.0, -1.0, 0.0], "M": np.eye(3), "J": np.eye(3), "e": 0.5, "friction": None},
        _finite_projection,
    ),
    "forks": Call(
        mbvi.forks, lambda: {"v": [1.0, -1.0, 0.0], "M": np.eye(3), "J": np.eye(3)[:2], "e": 0.5},
        lambda found: _finite_projection(found.law),
    ),
    "sensitivity": Call(
        mbvi.sensitivity,
        lambda: {
            "problem": scene().build(), "scheme": mbvi.Centered(), "duration": 0.01, "step": 1e-3,
            "wrt": ["state", "restitution"], "bodies": None, "one_sided": False,
        },
    ),
    "OneSidedSensitivity.branch": Call(
        lambda x: mbvi.sensitivity(scene().build(), duration=1e-3, wrt=["gravity"], one_sided=True).branch(x),
        lambda: {"x": [1.0, 0.0, 2.0]},
    ),
    "gradient": Call(
        mbvi.gradient,
        lambda: {
            "problem": scene().build(), "of": lambda q, v: (q.sum(), np.concatenate([v, v], axis=-1)),
            "scheme": mbvi.Centered(), "duration": 0.01, "step": 1e-3, "wrt": ["state", "restitution"],
            "bodies": None, "times": [0.005],
        },
    ),
    "Sensitivity.check": Call(
        lambda **given: mbvi.sensitivity(scene().build(), duration=1e-3).check(**given), lambda: {"directions": 1}
    ),
    "Sensitivity.trusted_until": Call(
        lambda **given: mbvi.sensitivity(scene().build(), duration=1e-3).trusted_until(**given),
        lambda: {"digits": 3.0, "start": 1e-9},
    ),
    "interop.jax_rollout": Call(_rollout("jax"), lambda: _ROLLOUT),
    "interop.torch_rollout": Call(_rollout("torch"), lambda: _ROLLOUT),
    "sweep": Call(
        _sweep,
        lambda: {**_STUDY, "out": study(), "client": _client(), "budget": 100.0},
        lambda table: table.load(),
    ),
    "plot_sweep": Call(mbvi.plot_sweep, lambda: {"ds": swept(), "names": ["height_of_ball"]}),
    "replay": Call(
        _replay_of_study,
        lambda: {"study": study(), "run": 1, "html": "run.html", "shapes": "collision"},
    ),
    "Trajectory.at": Call(lambda **given: run().at(**given), lambda: {"t": 0.015}),
    "Trajectory.diagnosis": Call(lambda **given: run().diagnosis(**given), lambda: {"tolerance": 1e-3}),
    "Trajectory.save": Call(lambda **given: run().save(**given), lambda: {"path": "again.h5"}),
    "Trajectory.replay": Call(_replay, lambda: {"speed": 1.0, "shapes": "visual"}),
    "Trajectory.replay_html": Call(
        lambda **given: run().replay_html(**given), lambda: {"path": "run.html", "shapes": "collision"}
    ),
    "Trajectory.report": Call(
        lambda **given: run().report(**given), lambda: {"path": "report.html", "diagnosis": run().diagnosis()}
    ),
    "Trajectory.plot": Call(lambda **given: run().plot(**given), lambda: {"diagnosis": run().diagnosis()}),
    "Trajectory.to_pandas": Call(lambda **given: run().to_pandas(**given), lambda: {"table": "impacts"}),
    "Trajectory.export": Call(
        lambda **given: run().export(**given), lambda: {"path": "run.csv", "table": "impacts"}
    ),
    "Trajectory.to_rerun": Call(lambda **given: run().to_rerun(**given), lambda: {"path": "run.rrd"}),
    "Trajectory.replay_video": Call(
        _replay_video, lambda: {"path": "run", "t": (0.0, 0.01), "speed": 1.0, "shapes": "visual"}
    ),
    "Trajectory.contacts": Call(lambda **given: run().contacts(**given), lambda: {"t": 0.015}),
    "Trajectory.loop_forces": Call(lambda **given: connected_run().loop_forces(**given), lambda: {"name": "rod"}),
    "Trajectory.contact_forces": Call(lambda **given: run().contact_forces(**given), lambda: {"name": "ball"}),
    "Trajectory.impact_table": Call(lambda **given: run().impact_table(**given), lambda: {"most": 3}),
    "motion.Translation": Call(mbvi.motion.Translation, lambda: {"velocity": (1.0, 0.0, 0.0)}, _driven),
    "motion.Translation.pose": Call(mbvi.motion.Translation((1.0, 0.0, 0.0)).pose, lambda: {"t": 1.0}),
    "motion.Translation.twist": Call(mbvi.motion.Translation((1.0, 0.0, 0.0)).twist, lambda: {"t": 1.0}),
    "motion.Oscillation": Call(
        mbvi.motion.Oscillation, lambda: {"amplitude": (0.1, 0.0, 0.0), "frequency": 2.0, "phase": 0.5}, _driven
    ),
    "motion.Oscillation.pose": Call(mbvi.motion.Oscillation((0.1, 0.0, 0.0), 2.0).pose, lambda: {"t": 1.0}),
    "motion.Oscillation.twist": Call(mbvi.motion.Oscillation((0.1, 0.0, 0.0), 2.0).twist, lambda: {"t": 1.0}),
    "motion.Rotation": Call(
        mbvi.motion.Rotation, lambda: {"axis": (0.0, 0.0, 1.0), "rate": 2.0, "centre": (0.0, 0.0, 0.0)}, _driven
    ),
    "motion.Rotation.pose": Call(mbvi.motion.Rotation((0.0, 0.0, 1.0), 2.0).pose, lambda: {"t": 1.0}),
    "motion.Rotation.twist": Call(mbvi.motion.Rotation((0.0, 0.0, 1.0), 2.0).twist, lambda: {"t": 1.0}),
    "packing.lattice": Call(
        mbvi.packing.lattice,
        lambda: {
            "shape": (2, 2, 2), "radius": 0.1, "spacing": 0.4, "corner": (0.0, 0.0, 0.0), "jitter": 0.01, "seed": 0
        },
        _strewn,
    ),
    "packing.layers": Call(
        mbvi.packing.layers,
        lambda: {
            "lower": (0.0, 0.0, 0.0), "upper": (1.0, 1.0), "radius": 0.1, "count": 3, "clearance": 0.1, "seed": 0
        },
        _strewn,
    ),
    "packing.random_loose": Call(
        mbvi.packing.random_loose,
        lambda: {
            "lower": (0.0, 0.0, 0.0), "upper": (1.0, 1.0, 1.0), "radius": 0.1, "count": 3, "fraction": None, "seed": 0
        },
        _strewn,
    ),
    "packing.poured": Call(
        mbvi.packing.poured,
        lambda: {"lower": (0.0, 0.0, 0.0), "upper": (0.5, 0.5), "radius": 0.2, "count": 1, "seed": 0}, _strewn,
    ),
    "packing.uniform": Call(mbvi.packing.uniform, lambda: {"low": 0.1, "high": 0.2}, _drawn),
    "packing.lognormal": Call(
        mbvi.packing.lognormal, lambda: {"median": 0.1, "sigma": 0.2, "low": 0.05, "high": 0.2}, _drawn
    ),
    "surfaces.revolved": Call(
        mbvi.surfaces.revolved, lambda: {"profile": [(0.1, 0.0), (0.3, 1.0)], "segments": 8}, _meets_a_sphere
    ),
    "surfaces.funnel": Call(
        mbvi.surfaces.funnel,
        lambda: {"top": 0.5, "neck": 0.1, "height": 0.5, "pipe": 0.2, "segments": 8}, _meets_a_sphere,
    ),
    "surfaces.hourglass": Call(
        mbvi.surfaces.hourglass, lambda: {"radius": 0.5, "neck": 0.1, "height": 0.5, "segments": 8}, _meets_a_sphere
    ),
    "surfaces.drum": Call(
        mbvi.surfaces.drum,
        lambda: {"radius": 0.5, "length": 0.5, "vanes": 2, "depth": 0.1, "segments": 8}, _meets_a_sphere,
    ),
    "surfaces.chute": Call(
        mbvi.surfaces.chute, lambda: {"length": 1.0, "width": 0.5, "angle": 0.4, "sides": 0.1}, _meets_a_sphere
    ),
    "surfaces.terrain": Call(
        mbvi.surfaces.terrain,
        lambda: {"x": [0.0, 1.0], "y": [0.0, 1.0, 2.0], "heights": np.zeros((2, 3))}, _meets_a_sphere,
    ),
    "reference.bouncing_ball": Call(
        mbvi.reference.bouncing_ball, lambda: {**_REFERENCE, "height": 1.0, "gravity": 9.81}, _solved
    ),
    "reference.sliding_in_disc": Call(mbvi.reference.sliding_in_disc, lambda: {**_REFERENCE, "speed": 1.0}, _solved),
    "reference.impact_oscillator": Call(
        mbvi.reference.impact_oscillator, lambda: {**_REFERENCE, "frequency": 2.5, "stop": 0.2, "n": 1}, _solved
    ),
    "reference.chaotic_oscillator": Call(
        mbvi.reference.chaotic_oscillator,
        lambda: {**_REFERENCE, "frequency": 4.2, "stop": 0.3, "q0": 0.5, "v0": 0.0}, _solved,
    ),
    "reference.corner": Call(
        mbvi.reference.corner,
        lambda: {**_REFERENCE, "angle": 1.0, "mass": ((2.0, 0.5), (0.5, 1.0)), "aim": False}, _solved,
    ),
    "reference.chain": Call(
        mbvi.reference.chain, lambda: {**_REFERENCE, "masses": (1.0, 1.0, 1.0), "gaps": (0.5, 0.3)}, _solved
    ),
    "reference.double_pendulum": Call(mbvi.reference.double_pendulum, lambda: dict(_REFERENCE), _solved),
    "reference.rod": Call(mbvi.reference.rod, lambda: dict(_REFERENCE), _solved),
    "reference.rocking_block": Call(mbvi.reference.rocking_block, lambda: dict(_REFERENCE), _solved),
    "reference.tumbling_body": Call(mbvi.reference.tumbling_body, lambda: {"e": 0.5, "duration": 0.3}, _solved),
    "reference.block_on_incline": Call(
        mbvi.reference.block_on_incline, lambda: {"mu": 0.5, "slope": 0.45, "speed": 0.0, "duration": 0.3}, _solved
    ),
    "reference.block_on_belt": Call(
        mbvi.reference.block_on_belt, lambda: {"mu": 0.3, "belt": 1.5, "speed": -0.5, "duration": 0.3}, _solved
    ),
    "reference.tipping_box": Call(
        mbvi.reference.tipping_box, lambda: {"mu": 0.9, "slope": 0.6, "duration": 0.3}, _solved
    ),
    "reference.rolling_ball": Call(
        mbvi.reference.rolling_ball,
        lambda: {"mu": 0.2, "slope": 0.0, "speed": 2.0, "spin": 0.0, "duration": 0.3}, _solved,
    ),
    "reference.ball_with_spin": Call(
        mbvi.reference.ball_with_spin,
        lambda: {
            "e": 0.7, "mu": 0.12, "velocity": (1.0, 0.5), "spin": (5.0, -20.0, 12.0), "height": 0.5, "bounces": 2
        },
        _solved,
    ),
    "reference.spinning_tripod": Call(
        mbvi.reference.spinning_tripod, lambda: {"mu": 0.4, "speed": 0.0, "spin": 10.0, "duration": 0.3}, _solved
    ),
    "reference.painleve_rod": Call(
        mbvi.reference.painleve_rod,
        lambda: {"mu": 1.6, "angle": 1.0, "speed": 1.0, "drop": 0.02, "tip": 0.0, "duration": 0.3}, _solved,
    ),
    "reference.wall_pendulum": Call(
        mbvi.reference.wall_pendulum, lambda: {"mu": 0.4, "angle": 1.2, "rate": 0.0, "duration": 0.3}, _solved
    ),
    "reference.references": Call(mbvi.reference.references, lambda: {"e": 0.5}),
    "reference.Reference.started": Call(
        lambda **given: mbvi.reference.bouncing_ball(0.5).started(**given), lambda: {"t": 0.1}, _moves
    ),
}  # fmt: skip

# what the library returns, which nobody makes by hand, and forms that others fill
_RETURNED = (
    mbvi.RolloutStatus, mbvi.Rollouts,
    mbvi.Trajectory, mbvi.Impact, mbvi.Diagnosis, mbvi.ErrorEstimate, mbvi.Forks, mbvi.Projection, mbvi.packing.Packing,
    mbvi.reference.Reference, mbvi.motion.Motion, mbvi.Gradient, mbvi.Sensitivity, mbvi.SensitivityCheck,
    mbvi.OneSidedSensitivity, mbvi.SensitivityBranch,
)  # fmt: skip
# classes whose methods a user calls; those of schemes, systems and constraints are called by a run
_WITH_METHODS = (
    mbvi.Simulator, mbvi.Sensitivity, mbvi.OneSidedSensitivity,
    mbvi.Scene, mbvi.Problem, mbvi.Trajectory, mbvi.Diagnosis, mbvi.reference.Reference, mbvi.motion.Translation,
    mbvi.motion.Oscillation, mbvi.motion.Rotation,
)  # fmt: skip


@functools.cache
def public_callables() -> dict[str, tuple[str, ...]]:
    """Return the parameters of every public function, constructor and method that takes some."""
    found: dict[str, Callable[..., Any]] = {}
    for prefix, module in [("", mbvi), *((f"{m}.", getattr(mbvi, m)) for m in mbvi.__all__ if _is_module(m))]:
        names = getattr(module, "__all__", None) or [n for n in vars(module) if not n.startswith("_")]
        for name in names:
            item = getattr(module, name)
            own = getattr(item, "__module__", "").startswith("mbvi") and not name.startswith("checked_")
            if not callable(item) or not own or (prefix and not item.__module__.startswith(module.__name__)):
                continue
            if isinstance(item, type):
                if issubclass(item, BaseException | Warning):
                    continue
                if item not in _RETURNED:
                    found[prefix + name] = item
                if item in _WITH_METHODS:
                    methods = inspect.getmembers(item, inspect.isfunction)
                    found |= {f"{prefix}{name}.{m}": f for m, f in methods if not m.startswith("_")}
            else:
                found[prefix + name] = item
    parameters = {name: _parameters(item) for name, item in found.items()}
    return {name: given for name, given in parameters.items() if given or name in CALLS}


def _is_module(name: str) -> bool:
    return inspect.ismodule(getattr(mbvi, name))


def _parameters(item: Callable[..., Any]) -> tuple[str, ...]:
    names: list[str] = []
    for parameter in inspect.signature(item).parameters.values():
        if parameter.kind is parameter.VAR_KEYWORD:
            # options of `simulate` have their own call
            names += get_type_hints(BodyArguments) if parameter.name != "simulate_options" else ()
        elif parameter.name != "self":
            names.append(parameter.name)
    return tuple(names)


class TooSlowError(BaseException):
    """A call that does not end; no `Exception`, so that nothing catches it."""


def check(name: str, bad: dict[str, Any]) -> str:
    """Call a function with bad values for some of its parameters.

    Returns
    -------
    str
        "refused" where an `MbviError` was raised, else "taken".

    Raises
    ------
    AssertionError
        On any other error, on a warning that is no `MbviWarning`, on a message without a word, and where the call does
        not end.
    """
    call = CALLS[name]
    # what they need is prepared before the time counts
    right = call.arguments()
    outcome = collections.deque(["taken"], maxlen=1)
    before = signal.signal(signal.SIGALRM, _too_slow)
    signal.setitimer(signal.ITIMER_REAL, _PATIENCE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", mbvi.MbviWarning)
            call.use(call.call(**{**right, **bad}))
    except mbvi.MbviError as error:
        outcome.append("refused")
        text = str(error)
        assert text and len(text) < 1000, f"{name}: a message of {len(text)} characters: {text[:200]}"
    except TooSlowError:
        raise AssertionError(f"{name} with bad {', '.join(bad)} does not end") from None
    except Exception as error:
        shown = ", ".join(f"{key}: {_shown(value)}" for key, value in bad.items())
        raise AssertionError(f"{name}({shown}) raised {type(error).__name__}: {error}") from error
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    return outcome[0]


def _too_slow(number: int, frame: Any) -> None:
    raise TooSlowError


def _shown(value: Any) -> str:
    try:
        return repr(value)[:100]
    except Exception:
        return f"<{type(value).__name__}>"


def random_fault(rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Return the name of a call and bad values for one to three of its parameters, as `check` takes them."""
    name = str(rng.choice([n for n, given in public_callables().items() if given]))
    parameters = public_callables()[name]
    count = int(rng.integers(1, min(3, len(parameters)) + 1))
    chosen = rng.choice(len(parameters), count, replace=False)
    return name, {parameters[k]: random_value(rng) for k in chosen}


def random_value(rng: np.random.Generator) -> Any:
    """Return one of `BAD`, or a number or an array of any magnitude and shape."""
    kind, span = rng.integers(4), float(rng.choice([3.0, 45.0, 308.0]))
    if kind == 0:
        return float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-span, span))
    if kind == 1:
        # most arguments that are arrays have three numbers
        shape = (3,) if rng.random() < 0.5 else tuple(rng.integers(0, 5, size=rng.integers(0, 4)).tolist())
        return rng.choice([-1.0, 1.0], shape) * 10.0 ** rng.uniform(-span, span, shape)
    return BAD[str(rng.choice(list(BAD)))]()
