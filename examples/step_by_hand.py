"""Step a problem by hand and stop at the third impact."""

import mbvi


def main() -> float:
    """Return the time of the third bounce [s]."""
    scene = mbvi.Scene(restitution=0.8)
    scene.add_halfspace(normal=(0, 0, 1))
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 1.1))
    bounces = []
    for step in mbvi.steps(scene.build(), mbvi.Paoli(), step=1e-4):
        if step.percussion.any():
            bounces.append(step.t)
            before, after, percussion = step.before[0], step.after[0], step.percussion[0]
            print(f"t = {step.t:.4f} s: {before:.4f} m/s becomes {after:.4f}, {percussion:.4f} N s")
        if len(bounces) == 3:
            return bounces[-1]
    raise AssertionError("steps never end")


if __name__ == "__main__":
    print(f"third bounce at {main():.4f} s")
