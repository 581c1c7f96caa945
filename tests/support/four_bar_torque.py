"""A four-bar linkage with a torque about the hinge of coupler and rocker: as boxes, as two MJCFs, and in one angle."""

import numpy as np
from scipy.integrate import solve_ivp

import mbvi

from .four_bar import (
    CRANK,
    GROUND,
    MASSES,
    ROCKER,
    START,
    WIDTH,
    angles,
    derivative,
    four_bar,
    inertia,
    potential,
    rate,
)


def turned(crank):
    """The angle about (0, 1, 0) of the rocker to the coupler; complex arguments give derivatives."""
    coupler, rocker = angles(crank)
    return coupler - rocker


def held_by():
    """The torque about the hinge that holds the linkage where it starts."""
    return abs(derivative(potential, START) / derivative(turned, START))


def crank_at(time, stiffness=0.0, rest=0.0, damping=0.0, friction=0.0):
    """The angle of the crank a while after the start; the hinge turns one way in this time."""

    def torque(t, state):
        crank, speed = state
        turn = derivative(turned, crank)
        about = -stiffness * (turned(crank) - turned(START) - rest) - damping * turn * speed
        # from the start the crank falls
        about -= friction * np.sign(-turn)
        fallen = rate(t, state)
        return [fallen[0], fallen[1] + about * turn / inertia(crank)]

    found = solve_ivp(torque, (0.0, time), (START, 0.0), method="DOP853", rtol=1e-12, atol=1e-12)
    assert friction == 0.0 or found.y[1].max() <= 0.0
    return float(found.y[0, -1])


def boxes(e=0.0, floor=None, **acting):
    """The linkage of boxes; the hinge of coupler and rocker has these options."""
    scene = four_bar(e, floor, **acting)
    return scene.build()


def mjcfs(tmp_path, **acting):
    """Two files of the linkage with a torque where crank and coupler meet: about a joint, and about a closing hinge.

    Both begin with the angle of the crank, counted from the start, about (0, 1, 0).
    """
    rocker = angles(START)[1]
    a, d = np.zeros(2), np.array([GROUND, 0.0])
    b = CRANK * np.array([np.cos(START), np.sin(START)])
    c = d + ROCKER * np.array([np.cos(rocker), np.sin(rocker)])
    words = {"stiffness": "stiffness", "rest": "springref", "damping": "damping", "friction": "frictionloss"}
    joint = " ".join(f'{words[name]}="{value}"' for name, value in acting.items())
    chain = _rod("crank", a, b, 0, _rod("coupler", b, c, 1, _rod("rocker", c, d, 2), joint))
    halves = _rod("crank", a, b, 0) + _rod("rocker", d, c, 2, _rod("coupler", c, b, 1))
    closing = ("crank", "coupler", b), ("rocker", "world", d)
    problems = []
    for text, (first, second, at) in zip((halves, chain), closing, strict=True):
        path = tmp_path / f"closed_at_{second}.xml"
        compiler = '<compiler angle="radian" eulerseq="xyz"/>'
        path.write_text(f'<mujoco model="bars">{compiler}<worldbody>{text}</worldbody></mujoco>')
        scene = mbvi.Scene()
        scene.add_mjcf(path, name="bars")
        sides = [side if side == "world" else f"bars/{side}" for side in (first, second)]
        scene.hinge(*sides, at=(at[0], 0, at[1]), axis=(0, 1, 0), **(acting if second == "coupler" else {}))
        problems.append(scene.build())
    return problems


def _rod(name, begin, end, k, inner="", joint=""):
    """A body that hangs from a joint at its beginning, in the frame of the world."""
    middle, along = 0.5 * (begin + end), end - begin
    length, mass = np.hypot(*along), MASSES[k]
    thin, wide = mass * WIDTH**2 / 6.0, mass * (length**2 + WIDTH**2) / 12.0
    return (
        f'<body name="{name}"><joint name="{name}" axis="0 1 0" pos="{begin[0]} 0 {begin[1]}" {joint}/>'
        f'<inertial pos="{middle[0]} 0 {middle[1]}" mass="{mass}" euler="0 {-np.arctan2(along[1], along[0])} 0" '
        f'diaginertia="{thin} {wide} {wide}"/>{inner}</body>'
    )
