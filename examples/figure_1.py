"""Figure 1 of the paper: two points 1 cm apart fly into an obtuse corner at e = 1 and leave it far apart.

Beside it a corner of 90 degrees, where condition (12) holds: points that start near each other stay near. Writes
out/figure_1.png; needs matplotlib (the extra `charts`).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import mbvi

OFFSET, DURATION = 5e-3, 1.0


def mass(q: np.ndarray) -> np.ndarray:
    """Return M of a unit mass."""
    return np.eye(2)


def force(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return g: none."""
    return np.zeros(2)


@dataclass
class Wall:
    """A wall through the origin, free where normal . q >= 0; methods can be pickled, lambdas cannot."""

    normal: np.ndarray

    def distance(self, q: np.ndarray) -> float:
        """Return f(q)."""
        return float(self.normal @ q)

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """Return grad f(q)."""
        return self.normal

    def gap(self, name: str) -> mbvi.GapFunction:
        """Return the constraint."""
        return mbvi.GapFunction(self.distance, self.gradient, name=name)


def fly_into_corner(degrees: float, side: float) -> mbvi.Trajectory:
    """Return the run of a point at unit speed that aims `side` to the right of a corner at the origin."""
    half, slope = np.radians(degrees) / 2, np.radians(70)
    right, left = (np.array([sign * np.cos(half), np.sin(half)]) for sign in (-1, 1))
    v0 = np.array([np.cos(slope), -np.sin(slope)])
    problem = mbvi.Problem(
        mbvi.LagrangianSystem(mass=mass, force=force, dim=2),
        [Wall(right).gap("right wall"), Wall(left).gap("left wall")],
        q0=-0.5 * v0 + side * np.array([np.sin(slope), np.cos(slope)]),
        v0=v0,
        restitution=1.0,
    )
    return mbvi.simulate(problem, mbvi.Paoli(), step=1e-4, duration=DURATION)


def draw(runs: dict[float, list[mbvi.Trajectory]], path: Path) -> None:
    """Draw the runs of each angle beside each other."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.8), layout="constrained")
    bottom, top, side = -0.14, 0.58, 0.52
    styles = {"5 mm to the left": "C0-", "5 mm to the right": "C3-", "into the corner": "k--"}
    for axes, (degrees, three) in zip(figure.subplots(1, 2, sharey=True), runs.items(), strict=True):
        wall = top * np.tan(np.radians(degrees) / 2)
        axes.fill([-wall, 0, wall, wall, -wall], [top, 0, top, bottom, bottom], color="0.85", label="obstacle")
        for run, (name, style) in zip(three, styles.items(), strict=True):
            axes.plot(*run.q.T, style, label=name)
            axes.plot(*run.q[-1], style[:-1].rstrip("-") + "o", markersize=5)
        axes.annotate("start", three[2].q[0], (-5, 4), textcoords="offset points", ha="right")
        fails = "(12) fails, three solutions" if degrees > 90 else "(12) holds, one solution"
        axes.set(title=f"{degrees:g} degrees, e = 1: {fails}", xlabel="x [m]", aspect="equal")
        axes.set(xlim=(-side, side), ylim=(bottom, top))
    figure.axes[0].set_ylabel("y [m]")
    figure.axes[1].legend(loc="lower left", fontsize="small")
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=130)


def main() -> float:
    """Return the final distance of two points that start a centimetre apart, in the obtuse corner [m]."""
    runs = {degrees: [fly_into_corner(degrees, side) for side in (-OFFSET, OFFSET, 0.0)] for degrees in (130.0, 90.0)}
    apart = {degrees: float(np.linalg.norm(left.q[-1] - right.q[-1])) for degrees, (left, right, _) in runs.items()}
    for degrees, distance in apart.items():
        print(f"{degrees:g} degrees: {2 * OFFSET:g} m apart at the start, {distance:.4g} m at the end")
        print(f"into the corner itself: {runs[degrees][2].diagnosis().report().splitlines()[0]}")
    draw(runs, Path("out/figure_1.png"))
    return apart[130.0]


if __name__ == "__main__":
    print(f"apart at the end: {main():.4f} m, drawn in out/figure_1.png")
