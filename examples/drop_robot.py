"""Drop a one-legged hopper on a floor and write the replay of its impacts to hopper.html."""

from pathlib import Path

import mbvi

robots = Path(__file__).parents[1] / "robots"


def main() -> float:
    """Return the speed with which the foot strikes first [m/s]."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace(normal=(0, 0, 1), offset=0.0, name="floor")
    scene.add_urdf(robots / "hopper/hopper.urdf", position=(0, 0, 1), joints={"hip": -0.2, "knee": 0.4})
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=2.0)
    print(run.impact_table(8))
    run.replay_html("hopper.html")
    return -run.impacts[0].before[0]


if __name__ == "__main__":
    print(f"first strike at {main():.4f} m/s")
