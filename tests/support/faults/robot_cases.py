"""Faulty states, controls and rules of pairs, one case a seed: refused, or what an independent rule gives."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path

import numpy as np

import mbvi
from support.paths import ROBOTS
from support.random_scenes import BASES, SHAPES, add_shape

SCHEMES = (mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True))
# free bases of these begin with a position and a quaternion
_FREE = [name for name, base in BASES.items() if base == "free"]
_LENGTHS = (0.0, 1e-320, 1e-200, 1e-9, 1e-4, 0.5, 1.0 - 1e-12, 1.0, 1.0 + 1e-12, 1.001, 2.0, 1e9, np.nan, np.inf)


def _above_floor(name: str, **more: object) -> mbvi.Problem:
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / name / f"{name}.urdf", base=BASES[name], position=(0, 0, 1.5), name="robot", **more)
    return scene.build()


def rotations(seed: int) -> str:
    """Give a state whose quaternion has any length: what is taken moves as the same state with a unit quaternion."""
    rng = np.random.default_rng(seed)
    problem = _above_floor(str(rng.choice(_FREE)))
    length = float(rng.choice(_LENGTHS))
    turn = rng.normal(size=4)
    turn /= np.linalg.norm(turn)
    v = rng.normal(size=len(problem.v0))
    q, unit = problem.q0.copy(), problem.q0.copy()
    q[3:7], unit[3:7] = length * turn, turn
    way = str(rng.choice(["at", "reset", "rollout"]))
    scheme = SCHEMES[rng.integers(len(SCHEMES))]
    with np.errstate(all="ignore"):
        found = _moved(problem, way, q, v, scheme)
    assert 1e-3 < length < 1e3, f"a quaternion of length {length:g} is taken by {way}"
    assert np.abs(np.linalg.norm(found[..., 3:7], axis=-1) - 1.0).max() < 1e-12, f"{way} leaves the unit quaternions"
    error = np.abs(found - _moved(problem, way, unit, v, scheme)).max()
    assert error < 1e-6, f"{way} at length {length:g}: {error:.1e} apart"
    return f"{way} at {length:g}"


def _moved(problem: mbvi.Problem, way: str, q: np.ndarray, v: np.ndarray, scheme: object) -> np.ndarray:
    """Return the configuration after ten steps, the state given in one of three ways."""
    if way == "at":
        run = mbvi.simulate(problem.at(q, v), scheme, step=1e-3, duration=0.01, progress=False)
        return np.asarray(run.q[1:])
    if way == "reset":
        simulator = mbvi.Simulator(problem, scheme, step=1e-3)
        simulator.reset(q, v)
        return np.asarray(simulator.step(10)[0])
    rollouts = mbvi.rollout(problem, q[None], v[None], steps=10, step=1e-3, scheme=scheme)
    if rollouts.status[0] != mbvi.RolloutStatus.COMPLETE:
        raise mbvi.InputError(f"the rollout ended as {rollouts.status[0]}")
    return np.asarray(rollouts.q[0, 1:])


def names(seed: int) -> str:
    """Give joints by name in any order: each has the value of its name, wherever Pinocchio puts it."""
    rng = np.random.default_rng(seed)
    robot = str(rng.choice(sorted(BASES)))
    model = _above_floor(robot).model("robot")
    joints = {
        model.names[j]: (model.joints[j].idx_q, model.joints[j].idx_v)
        for j in range(1, model.njoints)
        if (model.joints[j].nq, model.joints[j].nv) == (1, 1)
    }
    chosen = [str(name) for name in rng.permutation(sorted(joints))[: rng.integers(1, len(joints) + 1)]]
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    given = {
        name: float(rng.uniform(max(low[joints[name][0]], -0.3), min(high[joints[name][0]], 0.3))) for name in chosen
    }
    speeds = {name: float(rng.normal()) for name in chosen}
    problem = _above_floor(robot, joints=given, velocity=speeds)
    for name in chosen:
        at_q, at_v = joints[name]
        assert problem.q0[at_q] == given[name], f"{robot}: {name} is not where it was said to be"
        assert problem.v0[at_v] == speeds[name], f"{robot}: {name} does not move as it was said to"
    return f"{len(chosen)} joints of {robot}"


_WRITES = """def control(t, q, v, tau):
    if t >= {since}:
        tau[{place}] = {value}
"""


def controls(seed: int) -> str:
    """Compile a control that writes at any index, from any time on: beyond the array it is refused by its index."""
    rng = np.random.default_rng(seed)
    robot = str(rng.choice(sorted(BASES)))
    model = _above_floor(robot).model("robot")
    place = int(rng.choice([-1, 1]) * rng.choice([0, 1, model.nv - 1, model.nv, model.nv + 1, 100, 10**8]))
    since = float(rng.choice([0.0, 0.005]))
    space: dict[str, object] = {}
    exec(_WRITES.format(since=since, place=place, value=f"{rng.normal():.3f}"), space)
    inside = -model.nv <= place < model.nv
    try:
        control = mbvi.CompiledControl(space["control"], model.nq, model.nv)
        problem = _above_floor(robot, control=control)
        scheme = SCHEMES[rng.integers(len(SCHEMES))]
        run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.02, progress=False)
    except mbvi.InputError:
        assert not inside, f"tau[{place}] of {model.nv} is refused"
        raise
    assert inside, f"tau[{place}] of {model.nv} is taken"
    assert np.isfinite(run.v).all()
    return f"tau[{place}] of {model.nv}"


def gains(seed: int) -> str:
    """Hold a robot by gains of any size: it stays finite, or the error says when it ran away."""
    rng = np.random.default_rng(seed)
    robot = str(rng.choice(sorted(BASES)))
    free = BASES[robot] == "free"
    model = _above_floor(robot).model("robot")
    count = model.nv - 6 * free
    stiffness, damping = 10.0 ** rng.uniform(-1.0, 7.0), 10.0 ** rng.uniform(-2.0, 5.0)
    problem = _above_floor(robot, control=mbvi.PDControl(rng.uniform(-0.1, 0.1, count), stiffness, damping))
    scheme = SCHEMES[rng.integers(len(SCHEMES))]
    said = f"{robot}, {stiffness:.1e} N m, {damping:.1e} N m s, {scheme!r}"
    try:
        run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.2, progress=False)
    except mbvi.DivergedError as error:
        assert " s" in str(error) and error.run is not None, f"{said}: no time: {error}"
        raise
    except mbvi.ProjectionError as error:
        raise AssertionError(f"{said}: {error}") from error
    assert np.isfinite(run.q).all() and np.isfinite(run.v).all(), f"{said}: states are not finite"
    return said


def pairs(seed: int) -> str:
    """Exclude some pairs of three shapes that fall on each other: exactly these never touch."""
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene(restitution=float(rng.choice([0.0, 0.5])))
    floor = scene.add_halfspace((0, 0, 1), name="floor")
    bodies = [
        add_shape(scene, str(rng.choice(SHAPES)), rng, still=True, at=(0.01 * k, 0.0, 0.25 + 0.4 * k)) for k in range(3)
    ]
    both = [(a, b) for k, a in enumerate([floor, *bodies]) for b in [floor, *bodies][k + 1 :]]
    # every body falls on something
    excluded = [both[k] for k in rng.permutation(len(both))[:2]]
    for pair in excluded:
        scene.exclude(*(pair if rng.random() < 0.5 else pair[::-1]))
    if rng.random() < 0.3:
        # a body has no pair with itself
        scene.set_friction(bodies[0], bodies[0], 0.5)
        scene.build()
        raise AssertionError(f"friction of {bodies[0]} with itself is taken")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.4, progress=False)
    touched = {frozenset(part.split(" ")[0].split("/")[0] for part in name.split(" | "))
               for impact in run.impacts for name in impact.constraints}  # fmt: skip
    wrong = touched & {frozenset(pair) for pair in excluded}
    assert not wrong, f"{wrong} touch although they are excluded"
    return f"{len(touched)} pairs touched"


# what stands in a model, and the word that says it is not modelled; without a word it must be modelled
_PARTS = {
    "spring": ('<joint name="j" type="hinge" axis="0 1 0" stiffness="5"/>', "", "springs"),
    "dry friction": ('<joint name="j" type="hinge" axis="0 1 0" frictionloss="1"/>', "", "dry friction"),
    "flag contact": ("<freejoint/>", '<option><flag contact="disable"/></option>', "contact"),
    "flag gravity": ("<freejoint/>", '<option><flag gravity="disable"/></option>', "gravity"),
    "flag limit": (
        '<joint name="j" type="hinge" axis="0 1 0" limited="true" range="-5 5"/>',
        '<option><flag limit="disable"/></option>', "limit",
    ),
    "flag damper": (
        '<joint name="j" type="hinge" axis="0 1 0" damping="2"/>', '<option><flag damper="disable"/></option>', "damp",
    ),
    "flag constraint": ("<freejoint/>", '<option><flag constraint="disable"/></option>', "constraint"),
    "wind": ("<freejoint/>", '<option wind="1 0 0" density="1.2"/>', "wind"),
}  # fmt: skip


def mjcf(seed: int) -> str:
    """Load a model with something that mbvi may not model: a warning or the report names it, or it is honoured."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(sorted(_PARTS)))
    joint, option, word = _PARTS[kind]
    text = (
        f'<mujoco>{option}<worldbody><geom name="ground" type="plane" size="1 1 1"/>'
        f'<body pos="0 0 {rng.uniform(0.5, 2.0):.3f}">{joint}<geom type="sphere" size="0.1" pos="0.2 0 0"/></body>'
        "</worldbody></mujoco>"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(text)
        scene = mbvi.Scene()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scene.add_mjcf(path)
            problem = scene.build()
    said = " ".join(str(one.message) for one in caught) + str(problem.report())
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=1.0, progress=False)
    if kind in ("flag contact", "flag constraint"):
        assert not run.impacts, kind
    elif kind == "flag limit":
        # 5 degrees are 0.087 rad
        assert run.q.max() > 1.0, kind
    elif kind == "flag damper":
        assert not problem.system.damping.any(), kind
    elif kind in ("spring", "dry friction"):
        assert problem.system.springs if kind == "spring" else problem.system.has_joint_friction, kind
    else:
        assert word in said.lower(), f"{kind}: nothing is said of it"
    return kind
