"""An arm falls into its joint limits. A limit is a constraint like a contact; its percussions are in N m s."""

from pathlib import Path

import mbvi

robots = Path(__file__).parents[1] / "robots"


def main() -> float:
    """Return the largest percussion of a joint limit [N m s]."""
    scene = mbvi.Scene(restitution=0.3)
    scene.add_urdf(
        robots / "arm/arm.urdf", base="fixed", joints={"joint2": 0.6, "joint3": 0.4}, velocity={"joint2": 1.0}
    )
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.5)
    print(run.impact_table(8))
    return max(p for i in run.impacts for p, name in zip(i.percussion, i.constraints, strict=True) if "joint" in name)


if __name__ == "__main__":
    print(f"largest percussion of a joint limit {main():.4f} N m s")
