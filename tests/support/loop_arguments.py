"""Arguments of the kernels of the compiled loop: those of one of their calls within a run of a small robot.

The run goes by the interpreter down to the kernel in question. The arrays are those of the run itself, in which others
hold addresses, so that they cannot be copied: arguments that are wanted twice are those of two equal runs.
"""

import ctypes
import pickle
import warnings
from contextlib import contextmanager
from functools import cache, wraps
from types import FunctionType

import numpy as np
import pytest
from numba.extending import typeof_impl

import mbvi
from mbvi.compiled import Kernel, record_at, records
from mbvi.constraints.mechanism.row_callback import RowCallback
from mbvi.constraints.mechanism.state import row_buffer
from mbvi.constraints.mechanism.tables import BALLS, BALLS_AT_MESH, MOST_ROWS, SHAPES_AT_MESH
from mbvi.run.loop import compiled_loop, loop_scope, step_loop
from mbvi.run.loop.loop_record import LoopRecord
from mbvi.schemes.event_driven.runge_kutta import DEGREE
from mbvi.schemes.event_driven.stages import smooth_motion
from mbvi.system.mechanisms.mechanism import place
from support.closing_arguments import closing_arguments
from support.paths import DATA, ROBOTS

STEP, DURATION = 1e-3, 0.2
PAOLI, MOREAU, CENTERED, DEFAULT, PILES = (
    mbvi.Paoli(), mbvi.MoreauJean(theta=0.7), mbvi.Centered(), mbvi.Centered(project_positions=True),
    mbvi.StewartTrinkle(),
)  # fmt: skip
LEGS, JOINTS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")


class _Caught(Exception):
    """Ends a run at the call whose arguments it bears."""


def interpreted(item, wanted, catch, known=None):
    """Return what calls `catch` in place of a wanted kernel, and is run by Python down to there."""
    known = {} if known is None else known
    if item.__name__ == wanted:
        return catch
    if item not in known:
        others = {name: value for name, value in item._named().items() if isinstance(value, Kernel)}
        down = {name: interpreted(value, wanted, catch, known) for name, value in others.items()}
        same = all(down[name] is others[name] for name in down)
        namespace = {**item.loops.__globals__, **down}
        known[item] = item if same else FunctionType(item.loops.__code__, namespace, item.__name__)
    return known[item]


def hold_once(hold):
    """Return `hold` of records that it writes once each: Python gives the same ones to thousands of calls."""
    known = {}

    # kernels that are compiled meanwhile call it by its name
    @wraps(hold)
    def held(record):
        if id(record) not in known:
            known[id(record)] = record, hold(record)
        return known[id(record)][1]

    return held


@contextmanager
def typed_once():
    """Find the type of each record once: the interpreter gives the same ones, of hundreds of arrays, to many calls."""
    known, of_fields = {}, records._type_of

    def type_of(record, context):
        if id(record) not in known:
            known[id(record)] = record, of_fields(record, context)
        return known[id(record)][1]

    def find_by(function):
        # kinds of records that are met for the first time meanwhile are registered with it, too
        records._type_of = function
        for kind in records._known:
            typeof_impl.register(kind, function)

    find_by(type_of)
    try:
        yield
    finally:
        find_by(of_fields)


def arguments_of_call(number, wanted, problem, scheme):
    """Return the arguments of the call with a number, counted from 0, of a kernel within a run."""
    left = number

    def catch(*arguments):
        nonlocal left
        if left == 0:
            raise _Caught(arguments)
        left -= 1
        return item(*arguments)

    item = next(one for one in LOOP_KERNELS if one.__name__ == wanted)
    with (
        pytest.MonkeyPatch.context() as patched,
        warnings.catch_warnings(),
        typed_once(),
        pytest.raises(_Caught) as caught,
    ):
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        patched.setattr(compiled_loop, "held", lambda record: record)
        patched.setattr(records, "hold", hold_once(records.hold))
        loop = loop_scope.loop_of(scheme)
        patched.setattr(compiled_loop, "loop_of", lambda _: interpreted(loop, wanted, catch))
        mbvi.simulate(problem, scheme, step=STEP, duration=DURATION, progress=False)
    for record in caught.value.args[0]:
        if isinstance(record, LoopRecord):
            # not yet written
            for room in record[:3]:
                room[:] = 0.0
    return caught.value.args[0]


def _kernels_below(item, found):
    for other in item._named().values():
        if isinstance(other, Kernel) and other not in found:
            found.append(other)
            _kernels_below(other, found)
    return found


LOOPS = [step_loop.run_paoli, step_loop.run_moreau_jean, step_loop.run_centered, step_loop.run_stewart_trinkle]
LOOP_KERNELS = LOOPS.copy()
for loop in LOOPS:
    _kernels_below(loop, LOOP_KERNELS)


def arrays_of(value, path=()):
    """Yield the arrays in records with their places, but none with addresses and no scratch."""
    if isinstance(value, np.ndarray):
        yield path, value
    elif isinstance(value, tuple):
        names = getattr(value, "_fields", [""] * len(value))
        for k, (name, part) in enumerate(zip(names, value, strict=True)):
            if name not in ("calls", "address", "meshes", "out", "found"):
                yield from arrays_of(part, (*path, k))


def replaced(value, path, other):
    """Return the same with another array in one place."""
    if not path:
        return other
    parts = list(value)
    parts[path[0]] = replaced(parts[path[0]], path[1:], other)
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def hopper(e, mu):
    """It lands, with its knee at a limit, within some twenty steps."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.475), joints={"knee": 0.4}, velocity={"hip": -1.0})
    return scene.build()


def quadruped(e, mu):
    """Its front legs meet, and its feet land, within some sixty steps."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.44), velocity={"FL_hip_joint": -4.0, "FR_hip_joint": 4.0}
    )
    return scene.build()


def braked(e, mu):
    """A quadruped whose joints have dry friction lands; some of them turn, the others stick."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    rough = {f"{leg}_{joint}_joint": 3.0 for leg in LEGS[:3] for joint in JOINTS}
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf",
        position=(0, 0, 0.44),
        velocity={"FL_hip_joint": -4.0, "RR_calf_joint": 1.0},
        joint_friction=rough,
    )
    return scene.build()


def swaying(e, mu):
    """A quadruped under a PD control lands on four feet and sways on them; with friction they stick."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    stance = np.tile([0.0, 0.6, -1.2], 4)
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf",
        position=(0, 0, 0.354),
        base_velocity=(-0.3, -0.1, 0.0, -0.5, 0.0, 0.0),
        joints={f"{leg}_{joint}_joint": x for leg in LEGS for joint, x in zip(JOINTS, stance[:3], strict=True)},
        control=mbvi.PDControl(stance, 60.0, 1.5),
    )
    return scene.build()


RUBBLE = 0.03 * np.random.default_rng(0).random((21, 21))


def on_rubble(e, mu):
    """A quadruped under a PD control lands on its feet, which are balls, on a rough field; its trunk has boxes."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_heightfield(RUBBLE, (2.0, 2.0), name="rubble")
    stance = np.tile([0.0, 0.6, -1.2], 4)
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf",
        position=(0, 0, 0.38),
        joints={f"{leg}_{joint}_joint": x for leg in LEGS for joint, x in zip(JOINTS, stance[:3], strict=True)},
        control=mbvi.PDControl(stance, 60.0, 1.5),
        name="robot",
    )
    for leg in LEGS:
        for part in JOINTS:
            # cylinders do not meet meshes
            scene.exclude(f"robot/{leg}_{part}", "rubble")
    return scene.build()


def tumbling(e, mu):
    """A capsule, a box and a ball fall onto a rough field."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_heightfield(RUBBLE, (2.0, 2.0), name="rubble")
    turned = {"rotation": (1.0, 0.5, 0.2), "angular_velocity": (1.0, 2.0, 0.0)}
    scene.add_capsule(0.05, 0.2, mass=1.0, position=(0.0, 0.0, 0.125), **turned)
    scene.add_box((0.2, 0.15, 0.1), mass=1.0, position=(0.3, 0.0, 0.15), velocity=(0.5, 0.0, -1.0), name="box")
    scene.add_sphere(0.08, mass=1.0, position=(-0.3, 0.0, 0.12), velocity=(0.3, 0.2, -1.0))
    return scene.build()


def on_block(e, mu):
    """The trunk of the quadruped, which is a box, falls onto a box."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_box((0.2, 0.1, 0.1), position=(0.05, 0, 0.33), fixed=True, name="block")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.45), velocity={"FL_calf_joint": -3.0})
    return scene.build()


def on_tiles(e, mu):
    """The same falls onto two boxes side by side."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    for k in range(2):
        scene.add_box((0.2, 0.1, 0.1), position=(0.05, 0.1 * k, 0.33), fixed=True, name=f"block {k}")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.45), velocity={"FL_calf_joint": -3.0})
    return scene.build()


def struck(e, mu):
    """A quadruped under a PD control lands on four feet, and a ball hits it."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    stance = np.tile([0.0, 0.6, -1.2], 4)
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf",
        position=(0, 0, 0.36),
        joints={f"{leg}_{joint}_joint": x for leg in LEGS for joint, x in zip(JOINTS, stance[:3], strict=True)},
        control=mbvi.PDControl(stance, 60.0, 1.5),
    )
    scene.add_sphere(0.1, 1.5, position=(-0.5, 0.03, 0.4), velocity=(4.0, 0.0, 0.5), name="ball")
    return scene.build()


def two_hoppers(e, mu):
    """They fall side by side, and the leg of one hits the other."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    for x in (0.0, 0.35):
        joints, velocity = {"knee": 0.4}, {"hip": -1.0}
        scene.add_urdf(
            ROBOTS / "hopper/hopper.urdf",
            position=(x, 0, 0.475),
            joints=joints,
            velocity=velocity,
            name=f"hopper {x:g}",
        )
    return scene.build()


def among_boxes(e, mu):
    """Boxes fall onto a quadruped and beside it."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.44))
    scene.add_box((0.1, 0.12, 0.1), 0.5, position=(0.02, 0.01, 0.6), angular_velocity=(1, 2, 0), name="box 0")
    for k in (1, 2):
        scene.add_box((0.2, 0.1, 0.1), 0.5, position=(0.6, 0.03 * k, 0.2 * k - 0.14), velocity=(0, 0.3, 0))
    return scene.build()


def one_box(e, mu):
    """It lands on an edge, and tips over."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.3, 0.1), 1.0, position=(0, 0, 0.15), velocity=(1, 0, -1), angular_velocity=(1, 2, 0.5))
    return scene.build()


def one_body(e, mu):
    """A box as a file has it, which spins."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(DATA / "brick.urdf", position=(0, 0, 0.15), base_velocity=(1, 0, -1, 3, 9, 1))
    return scene.build()


def one_ball(e, mu):
    """It lands, and slips with friction."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0.15), velocity=(1, 0, -1))
    return scene.build()


def small_heap(e, mu):
    """Two balls and a box fall onto each other."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(2):
        scene.add_sphere(0.08, 0.5, position=(0.08 * k - 0.1, 0.02 * k, 0.25 + 0.17 * k), velocity=(0, 0, -1))
    scene.add_box((0.3, 0.2, 0.1), 1.0, position=(0, 0, 0.08), angular_velocity=(0.5, 0, 0), name="box")
    return scene.build()


def pile_of_six(e, mu):
    """Boxes fall onto each other and against a wall."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, 0), -0.5, name="wall")
    for k in range(6):
        place = (0.22 * (k % 2), 0.02 * k, 0.12 + 0.12 * (k // 2))
        scene.add_box((0.2, 0.15, 0.1), 0.5, position=place, velocity=(1, 0, 0), angular_velocity=(1, k, 0.5))
    return scene.build()


def tied(e, mu):
    """A quadruped whose front calves share a point lands within some sixty steps, a hind foot in front."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    joints = {"RL_thigh_joint": 0.3, "RL_calf_joint": -0.2}
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.44), joints=joints)
    scene.connect("quadruped/FL_calf", "quadruped/FR_calf", at=(0.2, 0.0, 0.2))
    scene.couple("quadruped/RL_thigh_joint", "quadruped/RR_thigh_joint", ratio=-1.0, offset=0.3)
    return scene.build()


def carried(e, mu):
    """A hopper lands with a box that hangs from its trunk on a hinge; the hinge has a free body on one side."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.475), joints={"knee": 0.4}, velocity={"hip": -1.0})
    scene.add_box((0.1, 0.1, 0.3), 0.5, position=(0.3, 0, 0.4), name="bag")
    scene.hinge("hopper/trunk", "bag", at=(0.2, 0, 0.5), axis=(0, 1, 0))
    return scene.build()


@cache
def shaken(e, mu):
    """Boxes and a ball land on a table that oscillates, beside a half-space that turns and a block that slides."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_box((2.0, 2.0, 0.2), position=(0, 0, -0.1), motion=mbvi.motion.Oscillation((1e-3, 0, 4e-3), 9.0, 0.4))
    scene.add_halfspace((1, 0, 0.1), -0.25, motion=mbvi.motion.Rotation((0, 1, 0.2), 0.3, centre=(-0.5, 0, 0)))
    scene.add_box((0.1, 0.4, 0.4), position=(0.3, 0, 0.2), motion=mbvi.motion.Translation((-0.2, 0, 0)))
    scene.add_box((0.1, 0.1, 0.06), 0.5, position=(-0.19, 0, 0.034), velocity=(-1.0, 0, 0))
    scene.add_box((0.12, 0.1, 0.06), 0.4, position=(0.17, 0, 0.034), velocity=(1.0, 0, 0))
    scene.add_sphere(0.03, 0.2, position=(0.0, 0, 0.035))
    return scene.build()


def _pickled(scene, material):
    return pickle.dumps(scene(*material))


def _call(wanted, scheme, scene, material, number):
    return arguments_of_call(number, wanted, pickle.loads(_pickled(scene, material)), scheme)


# e and mu
RIGID, BOUNCY, ROUGH, MIXED = (0.0, 0.0), (0.5, 0.0), (0.0, 0.6), (0.5, 0.6)
# with torsional and rolling friction
RESISTS = (0.0, (0.6, 0.02, 0.005))
# for each seed the scheme, the scene with its e and mu, and the number of the call
CALLS = {
    "run_paoli": [(PAOLI, hopper, BOUNCY, 0), (PAOLI, quadruped, RIGID, 0), (PAOLI, hopper, ROUGH, 0)],
    "run_moreau_jean": [(MOREAU, hopper, BOUNCY, 0), (MOREAU, quadruped, RIGID, 0), (MOREAU, hopper, ROUGH, 0)],
    "run_centered": [(CENTERED, hopper, BOUNCY, 0), (DEFAULT, quadruped, RIGID, 0), (DEFAULT, hopper, ROUGH, 0)],
    "run_stewart_trinkle": [(PILES, hopper, BOUNCY, 0), (PILES, quadruped, RIGID, 0), (PILES, hopper, ROUGH, 0)],
    "move": [(PAOLI, hopper, BOUNCY, 5), (MOREAU, quadruped, RIGID, 9), (MOREAU, hopper, ROUGH, 20)],
    "find": [(MOREAU, hopper, BOUNCY, 25), (MOREAU, quadruped, RIGID, 70), (MOREAU, hopper, ROUGH, 50)],
    "jump": [(PAOLI, hopper, BOUNCY, 25), (MOREAU, quadruped, RIGID, 70), (PAOLI, quadruped, ROUGH, 60)],
    "log_rows": [(PAOLI, hopper, BOUNCY, 2), (PAOLI, quadruped, ROUGH, 5), (CENTERED, hopper, ROUGH, 60)],
    "paoli_step": [(PAOLI, hopper, BOUNCY, 42), (PAOLI, quadruped, ROUGH, 70), (PAOLI, hopper, ROUGH, 41)],
    "moreau_jean_step": [(MOREAU, hopper, BOUNCY, 41), (MOREAU, quadruped, RIGID, 70), (MOREAU, hopper, ROUGH, 42)],
    "centered_step": [(DEFAULT, hopper, RIGID, 41), (DEFAULT, quadruped, ROUGH, 70), (CENTERED, hopper, MIXED, 41)],
    "step_of_shared_closings": [(DEFAULT, hopper, RIGID, 42), (CENTERED, tied, ROUGH, 9), (DEFAULT, tied, ROUGH, 70)],
    "act": [(PAOLI, hopper, BOUNCY, 5), (DEFAULT, struck, RIGID, 5), (CENTERED, swaying, RIGID, 5)],
    "fly": [(PAOLI, hopper, BOUNCY, 5), (MOREAU, swaying, RIGID, 5), (PAOLI, quadruped, RIGID, 5)],
    "evaluate_forces": [(PAOLI, hopper, BOUNCY, 2), (MOREAU, quadruped, ROUGH, 9), (PILES, quadruped, RIGID, 5)],
    "evaluate_effects": [(PAOLI, one_body, BOUNCY, 2), (PILES, one_body, ROUGH, 9), (PAOLI, quadruped, RIGID, 5)],
    **{
        name: [(CENTERED, one_body, BOUNCY, 5), (DEFAULT, one_body, ROUGH, 9), (DEFAULT, quadruped, RIGID, 5)]
        for name in ("evaluate_pushing_effects", "glide", "glide_to_end", "take_velocity_of_end")
    },
    "move_freely": [(PAOLI, hopper, BOUNCY, 1), (DEFAULT, quadruped, ROUGH, 9), (CENTERED, quadruped, RIGID, 5)],
    "centered_forces": [(CENTERED, hopper, BOUNCY, 2), (DEFAULT, quadruped, ROUGH, 9), (DEFAULT, on_block, RIGID, 5)],
    **{
        name: [(PAOLI, braked, BOUNCY, 65), (CENTERED, braked, RIGID, 40), (DEFAULT, braked, MIXED, 90)]
        for name in (
            "joints_with_friction", "write_wide", "coulomb_of_few", "bounded_coulomb", "apply_joint_friction",
            "factor_mass_again",
        )
    },
    **{
        name: [(PAOLI, hopper, RESISTS, 9), (DEFAULT, swaying, RESISTS, 9), (PILES, swaying, RESISTS, 5)]
        for name in ("resisting", "write_resistance", "read_resistance", "write_rotations")
    },
    "apply_law_with_joints": [(PAOLI, braked, BOUNCY, 9), (CENTERED, braked, RIGID, 4), (DEFAULT, braked, MIXED, 9)],
    "apply_law": [(PAOLI, hopper, BOUNCY, 2), (DEFAULT, quadruped, ROUGH, 9), (PAOLI, quadruped, ROUGH, 5)],
    "active_rows": [(PAOLI, hopper, BOUNCY, 25), (DEFAULT, quadruped, RIGID, 70), (CENTERED, hopper, ROUGH, 50)],
    "limit_rows": [(PAOLI, hopper, BOUNCY, 1), (DEFAULT, quadruped, RIGID, 20), (CENTERED, hopper, ROUGH, 5)],
    "half_space_contacts": [(PAOLI, hopper, RIGID, 99), (DEFAULT, quadruped, ROUGH, 90), (CENTERED, hopper, ROUGH, 3)],
    "touching_balls": [(PAOLI, small_heap, RIGID, 82), (PAOLI, small_heap, MIXED, 114), (PAOLI, small_heap, ROUGH, 9)],
    "append_tangents": [(PAOLI, hopper, ROUGH, 150), (PAOLI, quadruped, ROUGH, 200), (CENTERED, quadruped, ROUGH, 20)],
    "pair_contacts": [(PAOLI, quadruped, BOUNCY, 27), (DEFAULT, on_block, ROUGH, 90), (CENTERED, quadruped, RIGID, 99)],
    "measured_in_closed_form": [(DEFAULT, quadruped, RIGID, n) for n in (1, 4, 9)],
    "measured_from_axes": [(DEFAULT, on_block, BOUNCY, 0), (PAOLI, on_block, BOUNCY, 1), (PAOLI, on_block, BOUNCY, 2)],
    "is_hidden": [(DEFAULT, on_tiles, RIGID, n) for n in (1, 4, 9)],
    "append_contact": [(DEFAULT, quadruped, RIGID, n) for n in (1, 4, 9)],
    "place": [(PAOLI, hopper, BOUNCY, 8), (DEFAULT, quadruped, RIGID, 9), (CENTERED, on_block, RIGID, 20)],
    "weigh": [(PAOLI, hopper, BOUNCY, 8), (DEFAULT, quadruped, RIGID, 9), (CENTERED, on_block, RIGID, 20)],
    **{
        name: [(PAOLI, tied, BOUNCY, 8), (DEFAULT, tied, RIGID, 9), (PILES, tied, ROUGH, 9)]
        for name in ("carry", "close")
    },
    **{
        name: [(DEFAULT, tied, RIGID, 2), (DEFAULT, tied, ROUGH, 9), (CENTERED, tied, BOUNCY, 5)]
        for name in ("take_along_equalities", "add_across", "apply_law_of_rows")
    },
    "keep_those_at": [(DEFAULT, tied, RIGID, 1), (DEFAULT, tied, ROUGH, 3), (DEFAULT, carried, ROUGH, 2)],
    "make_tangent": [(DEFAULT, tied, RIGID, 9), (DEFAULT, tied, ROUGH, 60), (CENTERED, tied, BOUNCY, 30)],
    "evaluate_nonlinear_effects": [
        (PAOLI, hopper, BOUNCY, 8), (DEFAULT, quadruped, RIGID, 9), (CENTERED, on_block, RIGID, 20),
    ],
    "copy_row": [(CENTERED, hopper, BOUNCY, 1), (DEFAULT, quadruped, ROUGH, 9), (CENTERED, hopper, ROUGH, 1)],
    "take_near": [(DEFAULT, hopper, BOUNCY, 41), (DEFAULT, quadruped, RIGID, 70), (DEFAULT, shaken, ROUGH, 60)],
    "rows_in_the_middle": [(CENTERED, hopper, BOUNCY, 1), (CENTERED, on_block, RIGID, 9), (CENTERED, hopper, ROUGH, 5)],
    "mark_bouncing": [(DEFAULT, hopper, BOUNCY, 0), (DEFAULT, on_block, BOUNCY, 9), (DEFAULT, quadruped, RIGID, 5)],
    "bears_or_sinks": [(DEFAULT, swaying, ROUGH, 0), (DEFAULT, swaying, ROUGH, 1), (DEFAULT, swaying, MIXED, 0)],
    "closed_contacts": [(DEFAULT, swaying, ROUGH, 5), (DEFAULT, swaying, ROUGH, 50), (DEFAULT, swaying, MIXED, 9)],
    "project_positions": [(DEFAULT, swaying, ROUGH, 100), (DEFAULT, struck, MIXED, 90), (DEFAULT, swaying, BOUNCY, 9)],
    "close_what_returns": [(DEFAULT, swaying, BOUNCY, 9), (DEFAULT, quadruped, MIXED, 3), (DEFAULT, struck, MIXED, 5)],
    "join_law": [(DEFAULT, swaying, BOUNCY, 0), (DEFAULT, swaying, BOUNCY, 2), (DEFAULT, swaying, MIXED, 1)],
    "write_rates_at": [(DEFAULT, struck, ROUGH, 50), (DEFAULT, struck, BOUNCY, 3), (DEFAULT, one_box, ROUGH, 1)],
    **{
        name: [(DEFAULT, swaying, ROUGH, 12), (DEFAULT, struck, MIXED, 40), (DEFAULT, swaying, MIXED, 20)]
        for name in ("may_sink", "sticking_contacts")
    },
    "open_beside_bounces": [(DEFAULT, swaying, BOUNCY, 9), (DEFAULT, struck, BOUNCY, 9), (DEFAULT, swaying, MIXED, 20)],
    "advance_gaps": [(DEFAULT, swaying, ROUGH, 12), (DEFAULT, swaying, BOUNCY, 3), (DEFAULT, quadruped, MIXED, 30)],
    **{
        name: [(DEFAULT, struck, ROUGH, 20), (DEFAULT, small_heap, MIXED, 9), (DEFAULT, among_boxes, ROUGH, 9)]
        for name in ("keep_the_rest_of_law", "write_acting")
    },
    **{
        name: [(DEFAULT, struck, ROUGH, 2), (DEFAULT, small_heap, MIXED, 9), (DEFAULT, among_boxes, RESISTS, 3)]
        for name in ("correct_turn", "correct_displaced", "add_wrenches_of")
    },
    **{
        name: [(DEFAULT, struck, ROUGH, 2), (DEFAULT, small_heap, MIXED, 1), (DEFAULT, among_boxes, ROUGH, 1)]
        for name in ("move_parts", "acts_on_free_bodies")
    },
    "has_friction": [(DEFAULT, swaying, ROUGH, 0), (DEFAULT, swaying, RIGID, 5), (CENTERED, hopper, ROUGH, 1)],
    "known_gaps": [(DEFAULT, swaying, ROUGH, 0), (DEFAULT, hopper, ROUGH, 60), (DEFAULT, on_block, ROUGH, 50)],
    "set_prescribed_joints": [(PAOLI, hopper, BOUNCY, 9), (DEFAULT, shaken, RIGID, 50), (PILES, shaken, ROUGH, 70)],
    "is_moved_by_walls": [(DEFAULT, shaken, BOUNCY, 9), (DEFAULT, shaken, RIGID, 40), (DEFAULT, shaken, ROUGH, 30)],
    "widen_margins": [(DEFAULT, shaken, BOUNCY, 9), (DEFAULT, shaken, RIGID, 40), (DEFAULT, shaken, ROUGH, 30)],
    "take_mean_rates": [(PILES, hopper, BOUNCY, 9), (PILES, shaken, RESISTS, 40), (PILES, shaken, ROUGH, 30)],
    "write_rate": [(PILES, shaken, BOUNCY, 9), (PILES, shaken, RESISTS, 40), (PILES, shaken, ROUGH, 30)],
    "turn_half_spaces": [(PAOLI, shaken, BOUNCY, 9), (CENTERED, shaken, RIGID, 40), (PILES, shaken, ROUGH, 30)],
    "may_pass": [(PAOLI, hopper, BOUNCY, 9), (DEFAULT, quadruped, RIGID, 50), (PAOLI, quadruped, ROUGH, 70)],
    "stewart_trinkle_step": [(PILES, hopper, BOUNCY, 41), (PILES, swaying, RIGID, 70), (PILES, swaying, MIXED, 42)],
    "project_bounds_with_friction": [(PILES, hopper, ROUGH, 3), (PILES, swaying, ROUGH, 9), (PILES, swaying, MIXED, 9)],
    "open_the_gaps": [(PILES, swaying, BOUNCY, 0), (PILES, swaying, MIXED, 9), (PILES, swaying, BOUNCY, 50)],
    **{
        name: [(DEFAULT, swaying, ROUGH, 12), (DEFAULT, struck, BOUNCY, 9), (DEFAULT, swaying, MIXED, 20)]
        for name in ("apply_bounds", "write_rates_of")
    },
    **{
        name: [(PILES, hopper, BOUNCY, 30), (PILES, swaying, ROUGH, 50), (PILES, swaying, MIXED, 9)]
        for name in (
            "write_reach", "write_bounds", "project_bounds", "write_residual_depths",
            "displacing_velocity", "write_rates", "lower_to_the_end", "mark_deep",
        )
    },
    **{
        name: [(PILES, two_hoppers, BOUNCY, 30), (PILES, among_boxes, ROUGH, 9), (PILES, small_heap, MIXED, 40)]
        for name in ("has_groups", "take_within_reach", "take_deeper")
    },
    **{
        name: [(DEFAULT, swaying, ROUGH, 12), (DEFAULT, struck, MIXED, 40), (DEFAULT, swaying, BOUNCY, 30)]
        for name in (
            "rows_for", "copy_rows", "copy_of", "match_rows", "are_known", "find_nearby", "search_nearby",
            "nearby_rows", "may_bounce",
            "write_free_motion", "write_floor", "mark_rows", "raise_sunk",
            "displace", "least_displacement", "move_marks", "follow", "start_of_tangent_law",
        )
    },
}  # fmt: skip


def _within_a_run(wanted):
    return lambda rng, seed: _call(wanted, *CALLS[wanted][seed])


def may_pass(rng, seed):
    s, log, q, v, h, _ = _call("may_pass", *CALLS["may_pass"][seed])
    # at the first two no pair is farther apart than it travels, at the last some are
    scale = 10.0 ** rng.uniform(0.0, 3.0)
    return s._replace(v=scale * s.v), log, q, scale * v, h, 1e-9


def carry_along(rng, seed):
    s, *_ = _call("project_positions", DEFAULT, (swaying, struck, small_heap)[seed], ROUGH, 9)
    return s, s.rows, rng.random(s.rows.size[0]) < 0.7, s.room.middle.copy(), s.room.end.copy()


def body_of(rng, seed):
    constraints = carry_along(rng, seed)[0].constraints
    return constraints, int(rng.integers(constraints.pairs.number.max(initial=20) + 1)), int(rng.integers(2))


def way_of(rng, seed):
    constraints, pair = clearance_of(rng, seed)
    return constraints.pairs, constraints.cache.travel[-1] + rng.random(), pair


def has_clearance(rng, seed):
    constraints, pair = clearance_of(rng, seed)
    return constraints.pairs, pair, float(rng.choice([0.0, 0.1])), float(rng.choice([0.0, 0.1]))


def add_ways(rng, seed):
    family = clearance_of(rng, seed)[0].pairs
    return family, rng.permutation(len(family.clearance)), rng.random(len(family.clearance)), 3


def may_touch(rng, seed):
    s, log, q, v, *_ = _call("may_pass", PAOLI, quadruped, RIGID, 40 + seed)
    return s, log, int(rng.integers(len(s.constraints.pairs.clearance))), q, rng.uniform(0.0, 0.3) * v, rng.random()


def write_ways(rng, seed):
    """Of a quadruped, of balls and a box, and of a quadruped and a ball, where every other pair is swift."""
    scheme, scene, material = (
        (PAOLI, quadruped, RIGID), (DEFAULT, small_heap, ROUGH), (CENTERED, struck, MIXED)
    )[seed]  # fmt: skip
    s, log, q, v, h, _ = _call("may_pass", scheme, scene, material, 40)
    log.travel[:] = 1.0
    log.travel[1::2] = 0.5 if seed == 2 else 1.0
    return s, log, q.copy(), h * v, float(rng.choice([0.5, 1.0])), int(rng.integers(2))


def is_swift(rng, seed):
    _, log, *_ = write_ways(rng, seed)
    log.ways[:] = 2.0 * rng.random(log.ways.shape) * log.thickness
    return log, int(rng.integers(len(log.travel))), seed % 2


def relative_way(rng, seed):
    s, log, q, way, *_ = write_ways(rng, seed)
    place(s.mechanism, q)
    column = int(rng.integers(len(log.member)))
    kind = s.constraints.cache.kind[log.family[column]]
    table = s.constraints.touching if kind == BALLS else s.constraints.pairs
    return s.mechanism, table, int(log.member[column]), log.pairs, column, way, 2.0


def placed_centre(rng, seed):
    mechanism, *_, ways, column, _, _ = relative_way(rng, seed)
    return mechanism, int(ways.bodies[1, column]), ways.centres, 1, column


# a callback that changes nothing
_NOTHING = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p, ctypes.c_double)(lambda *_: None)


def rows_by_callback(rng, seed):
    address = np.array([ctypes.cast(_NOTHING, ctypes.c_void_p).value], np.int64)
    found, rows = row_buffer(2, True), row_buffer(2, True)
    for array in found[2:]:
        array[:] = rng.normal(size=array.shape)
    # answers that fail, that fit, and that do not
    found.size[0], rows.size[0] = (-1, 2, 3)[seed], (0, 1, MOST_ROWS - 2)[seed]
    return RowCallback(address, np.zeros(1), found), 1, rng.normal(size=3), 0.1, rows


def write_gradients(rng, seed):
    scene, material = (on_block, hopper, quadruped)[seed], (RIGID, ROUGH, ROUGH)[seed]
    s, middle, _ = _call("rows_in_the_middle", CENTERED, scene, material, 5)
    place(s.mechanism, middle)
    return s.mechanism, s.constraints, s.rows, int(rng.integers(s.rows.size[0]))


def write_gradient_of(rng, seed):
    mechanism, constraints, rows, _ = write_gradients(rng, seed)
    # rows of the family, and others
    return mechanism, constraints.walls if seed else constraints.pairs, rows, int(rng.integers(rows.size[0]))


def _sunk(seed):
    return _call("least_displacement", DEFAULT, struck, (ROUGH, BOUNCY, RIGID)[seed], 5)


def displacement_of_groups(rng, seed):
    s, active, sunk = _sunk(seed)
    if seed:
        # one that cannot be raised: it does not move
        active.J[0], sunk.floor[0] = 0.0, 1e-6
    return s, active, sunk


def independent_groups(rng, seed):
    s, active, _ = _sunk(seed)
    return active.J[: active.size[0]].copy(), s.scales.part, np.empty(active.size[0], np.int64)


def project_moving(rng, seed):
    s, J, A, W, x, lower, w, table = _call("project_moving", DEFAULT, swaying, BOUNCY, 5 + seed)
    if seed:
        for rows in (J, A, W):
            rows[0] = 0.0
        lower[0] = -1.0 if seed == 1 else 1.0
    return s, J, A, W, x, lower, w, table


def _near(seed):
    """A mechanism, the tables of its shapes, and its pairs."""
    s, *_ = _call("may_pass", PAOLI, quadruped, RIGID, 40 + seed)
    return s.mechanism, s.constraints.shapes, s.constraints.near


def write_distances(rng, seed):
    near = rng.permutation(2), float(rng.choice([0.0, np.inf]))
    return *_near(seed), *near, np.full(2, np.nan)


def distances_at(rng, seed):
    *rest, distance = write_distances(rng, seed)
    return *rest, rest[0].placed + 1e-3, distance


def distances_along(rng, seed):
    mechanism, shapes, pairs, *near, _ = write_distances(rng, seed)
    q, nv = mechanism.placed.copy(), len(mechanism.parent)
    dense, shares = 0.1 * rng.normal(size=(2, nv, DEGREE)), rng.random(3)
    motion = smooth_motion(mechanism, len(q), nv)
    return motion, shapes, pairs, *near, dense, 1e-2, shares, q, rng.normal(size=nv), np.full((3, 2), np.nan)


def is_beyond(rng, seed):
    _, shapes, near = _near(seed)
    return shapes, near, int(rng.integers(len(near.bound))), float(rng.choice([0.0, 0.1, 1.0]))


def clearance_of(rng, seed):
    s, *_ = _call("may_pass", PAOLI, quadruped, RIGID, 40 + seed)
    return s.constraints, int(rng.integers(len(s.constraints.pairs.clearance)))


def _above_rubble(seed):
    """The arguments of `may_pass`, with a record whose first row of shapes at a mesh travels far."""
    s, log, q, v, h, _ = _call("may_pass", PAOLI, tumbling, (RIGID, ROUGH, BOUNCY)[seed], 40 + 20 * seed)
    log.travel[:] = 1.5
    return s, log, q, v, h


def touching(rng, seed):
    s, _, q, *_ = _above_rubble(seed)
    return s.mechanism, s.constraints, q, float(rng.choice([1e-8, 0.02])), s.rows


def mesh_of(constraints, field, kind):
    """The first family of a kind at a mesh."""
    where = constraints.meshes[constraints.cache.kind.tolist().index(kind)]
    return record_at(getattr(constraints, field), where)


def touching_shapes(rng, seed):
    mechanism, constraints, *rest = touching(rng, seed)
    return mechanism, mesh_of(constraints, "shapes_at_mesh", SHAPES_AT_MESH), *rest


def touching_spheres(rng, seed):
    mechanism, constraints, *rest = touching(rng, seed)
    return mechanism, mesh_of(constraints, "spheres_at_mesh", BALLS_AT_MESH), *rest


def may_enter(rng, seed):
    s, log, q, v, h = _above_rubble(seed)
    kinds = s.constraints.cache.kind
    columns = np.flatnonzero(kinds[log.family] == SHAPES_AT_MESH)
    return s, log, int(rng.choice(columns)), q, float(rng.choice([1.0, 3.0])) * v, h


def may_get_deep(rng, seed):
    s, log, q, v, h = _above_rubble(seed)
    shapes = mesh_of(s.constraints, "shapes_at_mesh", SHAPES_AT_MESH)
    way, depth = float(rng.choice([1.0, 3.0])) * h * v, float(rng.choice([1e-4, 1e-2]))
    return s, shapes, log, int(rng.integers(2)), q, way, depth


LOOP_ARGUMENTS = {
    "place_at_mesh": lambda rng, seed: touching_shapes(rng, seed)[:2],
    "touching_shapes": touching_shapes,
    "touching_spheres": touching_spheres,
    "is_clear_of_mesh": lambda rng, seed: (*touching_shapes(rng, seed)[:3], int(rng.integers(2)), rng.random()),
    "may_get_deep": may_get_deep,
    "may_enter": may_enter,
    **{name: _within_a_run(name) for name in CALLS},
    "may_pass": may_pass,
    "clearance_of": clearance_of,
    "way_of": way_of,
    "carry_along": carry_along,
    "body_of": body_of,
    "has_clearance": has_clearance,
    "add_ways": add_ways,
    "may_touch": may_touch,
    "write_ways": write_ways,
    "is_swift": is_swift,
    "relative_way": relative_way,
    "placed_centre": placed_centre,
    "distance_after": lambda rng, seed: (*may_touch(rng, seed)[:-1], rng.random(), float(rng.choice([0.0, 1.0]))),
    "write_travels": lambda rng, seed: (rng.random((4, 7)), rng.random(4), np.zeros(7)),
    "rows_by_callback": rows_by_callback,
    "place_bodies": lambda rng, seed: _near(seed)[::2],
    "distance_of": lambda rng, seed: (*_near(seed)[1:], int(rng.integers(2)), float(rng.choice([0.0, 1.0]))),
    "is_beyond": is_beyond,
    **closing_arguments(_near),
    "write_distances": write_distances,
    "distances_at": distances_at,
    "distances_along": distances_along,
    "write_gradients": write_gradients,
    "write_gradient_of": write_gradient_of,
    "displacement_of_groups": displacement_of_groups,
    "independent_groups": independent_groups,
    "project_moving": project_moving,
    "stays_sunk": lambda rng, seed: (*rng.normal(size=3), rng.choice([0.0, 0.5, 1.0]), 1e-8),
    "is_closed": lambda rng, seed: (rng.choice([0.0, 1.0]), rng.choice([-1.0, 1.0]) * rng.choice([1e-9, 1e-3]), 1e-8),
    "joins": lambda rng, seed: (*rng.normal(scale=(1e-6, 2e-6)), 0.5 * (seed % 3), 1.0, 1e-9, 1e-6 * seed),
}
