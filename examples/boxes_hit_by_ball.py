"""A ball hits a stack of four boxes at rest: an impact on several touching faces at once."""

import mbvi


def main() -> float:
    """Return the percussion of the strike [N s]; 6 (1 + e) / (1 / 1 + 1 / 2) = 4.8 by hand."""
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace(normal=(0, 0, 1), name="floor")
    for k in range(4):
        scene.add_box((0.4, 0.4, 0.2), mass=2.0, position=(0, 0, 0.1 + 0.2 * k), name=f"box{k}")
    scene.add_sphere(radius=0.1, mass=1.0, position=(-1.0, 0, 0.3), velocity=(6, 0, 0.572), name="ball")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0)
    print(run.impact_table(6))
    print(f"the stack rests until {run.impacts[0].time:.3f} s; deepest penetration {run.penetration().max():.1e} m")
    strike = run.impacts[0]
    return float(strike.percussion[strike.constraints.index("box1 | ball")])


if __name__ == "__main__":
    print(f"the ball strikes with {main():.4f} N s")
