"""Linkages, a leg as Cassie's and a delta robot, and their motion in minimal coordinates from textbooks.

The bodies are a map y(s) of the minimal coordinates s to centres times sqrt(m) and unit directions times sqrt(I): the
kinetic energy is |dy/dt|^2 / 2. With J = dy/ds the motion is J' (J s'' + (dJ/dt) s') = -dV/ds.
"""

import numpy as np
from scipy.integrate import solve_ivp

import mbvi

G, WIDTH = 9.81, 0.02


def derivative(f, s):
    """The columns df/ds by complex steps."""
    return np.stack([f(s + 1e-30j * unit).imag / 1e-30 for unit in np.eye(len(s))], axis=-1)


def motion(rods, s, duration, floor=None, e=0.0):
    """s after a time, from rest, and the times of its impacts on a floor of that height, with restitution e.

    Parameters
    ----------
    rods : callable
        rods(s) -> both ends of each rod, its mass and its length; a body without a length is one that does not turn.
    """
    masses, lengths = (np.array(values) for values in zip(*[rod[2:] for rod in rods(s)], strict=True))
    inertias = masses * (lengths**2 + WIDTH**2) / 12.0

    def y(s):
        parts = []
        for (begin, end, mass, length), inertia in zip(rods(s), inertias, strict=True):
            parts.append(np.sqrt(mass) * 0.5 * (begin + end))
            if length:
                parts.append(np.sqrt(inertia) * (end - begin) / length)
        return np.concatenate(parts)

    def potential(s):
        return np.array([G * sum(mass * 0.5 * (a + b)[2] for a, b, mass, _ in rods(s))])

    def acceleration(t, state):
        s, rate = np.split(state, 2)
        J, step = derivative(y, s), 1e-4
        # dJ/dt s' by a difference of order four
        sides = [derivative(y, s + k * step * rate) @ rate for k in (-2, -1, 1, 2)]
        bend = (sides[0] - 8.0 * sides[1] + 8.0 * sides[2] - sides[3]) / (12.0 * step)
        force = -derivative(potential, s)[0] - J.T @ bend
        return np.concatenate([rate, np.linalg.solve(J.T @ J, force)])

    def lowest(t, state):
        return corners(rods, state[: len(s)]).real.min() - floor

    lowest.terminal, lowest.direction = True, -1
    state, now, struck = np.append(s, 0.0 * s), 0.0, []
    while now < duration:
        event = None if floor is None else lowest
        found = solve_ivp(acceleration, (now, duration), state, "DOP853", rtol=1e-11, atol=1e-12, events=event)
        now = found.t[-1]
        place, rate = np.split(found.y[:, -1], 2)
        if found.status == 1:
            struck.append(now)
            # J'J (s'+ - s'-) = g' p with g s'+ = -e g s'-, for the gradient g of the lowest corner's height
            J = derivative(y, place)
            g = derivative(lambda x: corners(rods, x), place)[corners(rods, place).real.argmin()]
            pushed = np.linalg.solve(J.T @ J, g)
            rate = rate - (1.0 + e) * (g @ rate) / (g @ pushed) * pushed
        state = np.append(place, rate)
    return state[: len(s)], struck


def corners(rods, s):
    """Heights of the lowest corners of the platform, or of each end of each rod, which have edges across x and z."""
    heights, bodies = [], rods(s)
    for begin, end, _, length in [body for body in bodies if not body[3]] or bodies:
        up = (end - begin)[2] / length if length else 0.0
        half = 0.5 * WIDTH * np.sqrt(1.0 - up * up)
        heights += [begin[2] - half, end[2] - half]
    return np.array(heights)


class FourBar:
    """A crank, a coupler and a rocker between two fixed hinges in the plane of x and z; s is the angle of the crank.

    `lengths` are those of the three, and the distance of the fixed hinges [m].
    """

    start = np.array([1.0])
    names = ("crank", "coupler", "rocker")

    def __init__(self, lengths=(0.4, 0.9, 0.7, 1.0)):
        self.lengths = lengths

    def rods(self, s):
        """Both ends, mass and length of each rod."""
        crank, coupler, rocker, ground = self.lengths
        zero = 0.0 * s[0]
        first, last = np.array([zero, zero, zero]), np.array([ground + zero, zero, zero])
        second = crank * np.array([np.cos(s[0]), zero, np.sin(s[0])])
        across = last - second
        apart = np.sqrt((across * across).sum())
        along = (apart**2 + coupler**2 - rocker**2) / (2.0 * apart)
        up = np.array([-across[2], zero, across[0]]) / apart
        third = second + along / apart * across + np.sqrt(coupler**2 - along**2) * up
        return [(first, second, 1.0, crank), (second, third, 2.0, coupler), (third, last, 1.5, rocker)]

    def scene(self, **options):
        """The scene of it, at rest."""
        scene, rods = mbvi.Scene(**options), self.rods(self.start)
        for name, rod in zip(self.names, rods, strict=True):
            add_rod(scene, name, *rod)
        ends = "world", *self.names, "world"
        for first, second, at in zip(ends, ends[1:], [*(rod[0] for rod in rods), rods[-1][1]], strict=False):
            scene.hinge(first, second, at=at, axis=(0, 1, 0))
        leave_out_others(scene, self.names)
        return scene


class FiveBar:
    """Two cranks, and two rods that meet in a hinge, in the plane of x and z; s are the angles of the cranks.

    `lengths` are those of the cranks and of the rods, and the distance of the fixed hinges [m].
    """

    start = np.array([2.9, 0.9])
    names = ("left", "right", "left_rod", "right_rod")

    def __init__(self, lengths=(0.3, 0.3, 0.5, 0.5, 0.4)):
        self.lengths = lengths

    def rods(self, s):
        """Both ends, mass and length of each rod."""
        *cranks, one, other, ground = self.lengths
        zero = 0.0 * s[0]
        pins = [np.array([x + zero, zero, zero]) for x in (0.0, ground)]
        ends = [
            pin + crank * np.array([np.cos(angle), zero, np.sin(angle)])
            for pin, crank, angle in zip(pins, cranks, s, strict=True)
        ]
        across = ends[1] - ends[0]
        apart = np.sqrt((across * across).sum())
        along = (apart**2 + one**2 - other**2) / (2.0 * apart)
        up = np.array([-across[2], zero, across[0]]) / apart
        tip = ends[0] + along / apart * across + np.sqrt(one**2 - along**2) * up
        return [
            (pins[0], ends[0], 1.0, cranks[0]), (pins[1], ends[1], 0.8, cranks[1]), (ends[0], tip, 0.5, one),
            (ends[1], tip, 0.6, other),
        ]  # fmt: skip

    def scene(self, **options):
        """The scene of it, at rest."""
        scene, rods = mbvi.Scene(**options), self.rods(self.start)
        for name, rod in zip(self.names, rods, strict=True):
            add_rod(scene, name, *rod)
        left, right, left_rod, right_rod = self.names
        for first, second, at in (
            ("world", left, rods[0][0]), ("world", right, rods[1][0]), (left, left_rod, rods[0][1]),
            (right, right_rod, rods[1][1]), (left_rod, right_rod, rods[2][1]),
        ):  # fmt: skip
            scene.hinge(first, second, at=at, axis=(0, 1, 0))
        leave_out_others(scene, self.names)
        return scene


class CassieLeg:
    """A leg as Cassie's, in the plane of x and z: thigh, shin, shank, and a tarsus whose heel a rod ties to the thigh.

    s are the angles of the thigh, and of the shin and the shank relative to the link before. `lengths` are those of
    thigh, shin, shank, from the ankle to the heel and to the foot, of the rod, and from the hip to the rod's upper end.
    """

    start = np.array([-0.6, -1.6, -0.2])
    names = ("thigh", "shin", "shank", "tarsus", "rod")

    def __init__(self, lengths=(0.3, 0.1, 0.3, 0.1, 0.3, 0.45, 0.05)):
        self.lengths = lengths

    def rods(self, s):
        """Both ends, mass and length of each link."""
        thigh, shin, shank, heel, foot, rod, offset = self.lengths
        zero = 0.0 * s[0]
        joints, angle = [np.array([zero, zero, zero])], zero
        for turn, length in zip(s, (thigh, shin, shank), strict=True):
            angle = angle + turn
            joints.append(joints[-1] + length * np.array([np.cos(angle), zero, np.sin(angle)]))
        top, ankle = offset / thigh * joints[1], joints[3]
        across = ankle - top
        apart = np.sqrt((across * across).sum())
        along = (apart**2 + rod**2 - heel**2) / (2.0 * apart)
        aside = np.array([-across[2], zero, across[0]]) / apart
        end = top + along / apart * across - np.sqrt(rod**2 - along**2) * aside
        tip = ankle + foot / heel * (ankle - end)
        return [
            (joints[0], joints[1], 2.0, thigh), (joints[1], joints[2], 0.8, shin), (joints[2], ankle, 0.6, shank),
            (end, tip, 0.7, heel + foot), (top, end, 0.2, rod),
        ]  # fmt: skip

    def scene(self, **options):
        """The scene of it, at rest."""
        scene, rods = mbvi.Scene(**options), self.rods(self.start)
        for name, rod in zip(self.names, rods, strict=True):
            add_rod(scene, name, *rod)
        for first, second, at in (
            ("world", "thigh", rods[0][0]), ("thigh", "shin", rods[0][1]), ("shin", "shank", rods[1][1]),
            ("shank", "tarsus", rods[2][1]), ("thigh", "rod", rods[4][0]), ("rod", "tarsus", rods[4][1]),
        ):  # fmt: skip
            scene.hinge(first, second, at=at, axis=(0, 1, 0))
        leave_out_others(scene, self.names)
        return scene


_RADIAL = [np.array([np.cos(a), np.sin(a), 0.0]) for a in np.arange(3) * 2.0 * np.pi / 3.0]


class Delta:
    """Three arms, a pair of parallel rods at each, and a platform at s, which does not turn.

    `lengths` are the radii of base and platform, the arms, the rods, and half the distance of the rods of a pair [m].
    """

    start = np.array([0.03, -0.02, -0.45])
    names = (*(f"{kind}_{k}" for k in range(3) for kind in ("arm", "first", "second")), "platform")

    def __init__(self, lengths=(0.3, 0.1, 0.25, 0.5, 0.05)):
        self.lengths = lengths

    def rods(self, s):
        """Both ends, mass and length of each rod; the platform has both ends in its centre, and no length."""
        base, platform, arm, forearm, half = self.lengths
        rods, up = [], np.array([0.0, 0.0, 1.0])
        for u in _RADIAL:
            apart = s + (platform - base) * u
            a, b = (apart * u).sum(), -apart[2]
            reach = np.sqrt(a * a + b * b)
            bend = np.arccos(((apart * apart).sum() + arm**2 - forearm**2) / (2.0 * arm * reach))
            # the elbow points away from the middle
            angle = 2.0 * np.arctan(b / (a + reach)) - bend
            pin, side = base * u + 0.0 * s, half * np.cross(up, u)
            elbow = pin + arm * (np.cos(angle) * u - np.sin(angle) * up)
            rods.append((pin, elbow, 0.4, arm))
            rods += [(elbow + k * side, s + platform * u + k * side, 0.1, forearm) for k in (1.0, -1.0)]
        return [*rods, (s, s, 0.7, 0.0)]

    def scene(self, **options):
        """The scene of it, at rest."""
        scene, rods = mbvi.Scene(**options), self.rods(self.start)
        *bars, platform = zip(self.names, rods, strict=True)
        scene.add_box((0.1, 0.1, 0.02), platform[1][2], position=self.start, name="platform")
        for name, rod in bars:
            add_rod(scene, name, *rod)
        for k, u in enumerate(_RADIAL):
            (arm, (pin, *_)), *pair = bars[3 * k : 3 * k + 3]
            scene.hinge("world", arm, at=pin, axis=np.cross((0, 0, 1), u))
            for name, (begin, end, *_) in pair:
                scene.connect(arm, name, at=begin)
                scene.connect(name, "platform", at=end)
        leave_out_others(scene, self.names)
        return scene


def leave_out_others(scene, names):
    """Let all pairs of bodies pass through each other."""
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            scene.exclude(first, second)


def add_rod(scene, name, begin, end, mass, length):
    """Add a thin box from one point to another."""
    x = (end - begin) / np.linalg.norm(end - begin)
    aside = np.eye(3)[np.abs(x).argmin()]
    y = np.cross(aside, x)
    y /= np.linalg.norm(y)
    axes = np.column_stack([x, y, np.cross(x, y)])
    scene.add_box((length, WIDTH, WIDTH), mass, position=0.5 * (begin + end), rotation=axes, name=name)
