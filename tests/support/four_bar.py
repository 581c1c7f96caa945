"""A four-bar linkage of three boxes with four hinges, and its motion in one angle, from textbook equations alone."""

import numpy as np
from scipy.integrate import solve_ivp

import mbvi

# lengths of crank, coupler and rocker, and the distance of the two fixed hinges [m]; masses [kg]; width of the boxes
CRANK, COUPLER, ROCKER, GROUND = LENGTHS = 0.4, 0.9, 0.7, 1.0
MASSES, WIDTH, G = (1.0, 2.0, 1.5), 0.04, 9.81
# where x and z of the three centres of mass are in q
CENTRES = [0, 2, 7, 9, 14, 16]
START = 1.0


def angles(crank):
    """The angles of the coupler and the rocker to that of the crank; complex arguments give derivatives."""
    x, z = GROUND - CRANK * np.cos(crank), -CRANK * np.sin(crank)
    apart = np.sqrt(x * x + z * z)
    between = np.arccos((apart**2 + COUPLER**2 - ROCKER**2) / (2.0 * apart * COUPLER))
    coupler = 2.0 * np.arctan(z / (x + apart)) + between
    x = CRANK * np.cos(crank) + COUPLER * np.cos(coupler) - GROUND
    z = CRANK * np.sin(crank) + COUPLER * np.sin(coupler)
    return coupler, 2.0 * np.arctan(z / (x + ROCKER))


def places(crank):
    """x and z of the centres of the three boxes, and their angles."""
    coupler, rocker = angles(crank)
    ends = (0.0, 0.0), (CRANK * np.cos(crank), CRANK * np.sin(crank)), (GROUND, 0.0)
    turns = crank, coupler, rocker
    found = [
        part
        for (x, z), turn, length in zip(ends, turns, LENGTHS, strict=False)
        for part in (x + 0.5 * length * np.cos(turn), z + 0.5 * length * np.sin(turn))
    ]
    return np.array(found), np.array(turns)


def derivative(f, x):
    """df/dx by a complex step."""
    return f(x + 1e-30j).imag / 1e-30


def inertia(crank, step=1e-30):
    """m of the kinetic energy m (dcrank/dt)^2 / 2."""
    moved, turned = (part.imag / step for part in places(crank + 1j * step))
    own = [m * (length**2 + WIDTH**2) / 12.0 for m, length in zip(MASSES, LENGTHS, strict=False)]
    return sum(m * (moved[2 * k] ** 2 + moved[2 * k + 1] ** 2) + own[k] * turned[k] ** 2 for k, m in enumerate(MASSES))


def potential(crank):
    """The potential energy."""
    return G * sum(m * places(crank)[0][2 * k + 1] for k, m in enumerate(MASSES))


def rate(t, state):
    """Lagrange's equation: m d2crank/dt2 + m' (dcrank/dt)^2 / 2 + V' = 0."""
    crank, speed = state
    e = 1e-3
    near = [inertia(crank + k * e) for k in (-3, -2, -1, 1, 2, 3)]
    slope = np.dot([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0], near) / (60.0 * e)
    return [speed, (-0.5 * slope * speed**2 - derivative(potential, crank)) / inertia(crank)]


def motion(duration, state=(START, 0.0), events=None):
    """The motion of the crank from a state."""
    return solve_ivp(rate, (0.0, duration), state, method="DOP853", rtol=1e-12, atol=1e-12, events=events)


def four_bar(e=0.0, floor=None, **acting):
    """The linkage at rest; with a floor, and with what acts about the hinge of coupler and rocker."""
    scene = mbvi.Scene(restitution=e)
    coupler, rocker = angles(START)
    pin = CRANK * np.cos(START), 0.0, CRANK * np.sin(START)
    ends = (0.0, 0.0, 0.0), pin, (GROUND, 0.0, 0.0)
    for name, end, turn, length, mass in zip(
        ("crank", "coupler", "rocker"), ends, (START, coupler, rocker), LENGTHS, MASSES, strict=False
    ):
        c, s = np.cos(turn), np.sin(turn)
        place = np.array(end) + 0.5 * length * np.array([c, 0.0, s])
        axes = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        scene.add_box((length, WIDTH, WIDTH), mass, position=place, rotation=axes, name=name)
    y = (0.0, 1.0, 0.0)
    scene.hinge("world", "crank", at=ends[0], axis=y)
    scene.hinge("crank", "coupler", at=pin, axis=y)
    joint = GROUND + ROCKER * np.cos(rocker), 0.0, ROCKER * np.sin(rocker)
    scene.hinge("coupler", "rocker", at=joint, axis=y, name="elbow", **acting)
    scene.hinge("rocker", "world", at=ends[2], axis=y, name="bearing")
    if floor is not None:
        scene.add_halfspace((0, 0, 1), floor, name="floor")
    return scene
