"""Which starts of a rocking block end upright, and which on its side: a map over angle and rate, by many runs.

`python examples/rocking_block.py 100 map.png` makes 100 x 100 runs on all cores and draws them.
Called again, it makes the runs that are missing.
"""

import sys

import numpy as np

import mbvi

# half width and half height [m]; the diagonal leans by the angle LEAN, and R is half of it
B, H, G = 0.1, 0.25, 9.81
LEAN, R = np.arctan2(B, H), np.hypot(B, H)
# rate at which an upright block of no width tips [rad/s]
RATE = np.sqrt(0.75 * G / R)
# kinetic energy over m g R that a turn about a corner has at 1 rad/s
INERTIA = 2.0 * R / (3.0 * G)


def upright() -> mbvi.Problem:
    """Return the block at rest; friction keeps its corners in place."""
    scene = mbvi.Scene(plane="xz", friction=2.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((2 * B, 2 * B, 2 * H), position=(0, 0, H), name="block")
    return scene.build()


# built once in each process
BLOCK = upright()


def make(angle: float, rate: float) -> mbvi.Problem:
    """Return the block turned about a corner by an angle [LEAN], turning at a rate [RATE]."""
    theta, omega = angle * LEAN, rate * RATE
    side = 1.0 if theta > 0.0 else -1.0
    c, s = np.cos(theta), np.sin(theta)
    # from the corner that stands to the centre
    x, z = -side * B * c + H * s, side * B * s + H * c
    q = (side * B + x, 0.0, z, 0.0, np.sin(theta / 2), 0.0, np.cos(theta / 2))
    # the rate in the plane xz counts from x to z, the angle leans to x
    return BLOCK.at(q, (omega * z, -omega * x, -omega))


def measure(run: mbvi.Trajectory) -> dict[str, float]:
    """Return the side on which the block lies at the end, or 0 if it stands, and the number of impacts."""
    angle = 2.0 * np.arctan2(run.q[-1, 4], run.q[-1, 6])
    return {"side": int(np.sign(angle)) if abs(angle) > LEAN else 0, "impacts": len(run.impacts)}


def housner(angle: float, rate: float) -> int:
    """Return the side by Housner's energies: a block that passes upright keeps 1 - 3/2 sin^2 LEAN of its rate."""
    theta, omega = angle * LEAN, rate * RATE
    side = int(np.sign(theta))
    energy = INERTIA * omega**2 + np.cos(LEAN - abs(theta))
    if omega * theta > 0.0 and energy > 1.0:
        return side
    # it passes upright
    kept = (energy - np.cos(LEAN)) * (1.0 - 1.5 * np.sin(LEAN) ** 2) ** 2
    return -side if kept + np.cos(LEAN) > 1.0 else 0


def main(count: int = 4, picture: str | None = None) -> float:
    """Return the part of the starts that end as by Housner's energies."""
    angles, rates = np.linspace(-0.95, 0.95, count), np.linspace(-0.7, 0.7, count)
    ds = mbvi.sweep(
        make, {"angle": angles, "rate": rates}, measure=measure, out=f"rocking_block_{count}", scheme=mbvi.Paoli(),
        step=2e-3, duration=2.5, every=1000,
    )  # fmt: skip
    expected = np.array([[housner(angle, rate) for rate in rates] for angle in angles])
    stands, agrees = float((ds["side"] == 0).mean()), float((ds["side"] == expected).mean())
    print(f"{ds.sizes['angle'] * ds.sizes['rate']} runs: {stands:.3f} of the starts end upright")
    if picture:
        mbvi.plot_sweep(ds).savefig(picture, dpi=110)
    return agrees


if __name__ == "__main__":
    print(f"{main(*map(int, sys.argv[1:2]), *sys.argv[2:]):.4f} of the starts end as by Housner's energies")
