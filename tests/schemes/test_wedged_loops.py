"""A contact and a loop hold a body against each other within the friction cone: percussions are those of the body.

There J P, the gradients of the contact along the velocities that keep the equalities, has a direction in the friction
cone that is zero. What velocities have beside these, or gradients at another place than those of the equalities, of
order h, must not be divided by it.
"""

import numpy as np
import pytest

import mbvi

SCHEMES = {
    "Centered": mbvi.Centered(),
    "Centered projected": mbvi.Centered(project_positions=True),
    "Paoli": mbvi.Paoli(),
    "Paoli projected": mbvi.Paoli(project_positions=True),
    "MoreauJean": mbvi.MoreauJean(),
}
MASS, LENGTH, WIDTH = 1.0, 0.2, 0.06


def pole(joint, angle, height, e, mu=0.8, own=0.3, width=WIDTH, aside=(0.0, 0.0)):
    """A pole that hangs by its end at a height, turned out of the vertical; its corners land below the joint.

    `own` is its angle about its axis, and `aside` where its end is held.
    """
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), 0.0)
    c, s = np.cos(angle), np.sin(angle)
    tilt = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    spin = np.array([[np.cos(own), -np.sin(own), 0], [np.sin(own), np.cos(own), 0], [0, 0, 1]])
    turn, at = tilt @ spin, np.array([0.0, 0.0, height])
    middle = at - turn @ (*aside, 0.5 * LENGTH)
    scene.add_box((width, width, LENGTH), MASS, position=tuple(middle), rotation=turn, name="pole")
    if joint == "point":
        scene.connect("world", "pole", at=at)
    else:
        scene.hinge("world", "pole", at=at, axis=(0, 1, 0))
    return scene.build()


@pytest.mark.parametrize("step", [1e-3, pytest.param(2e-4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("joint", ["point", "axis"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_percussions_are_of_the_size_of_the_momentum_that_they_end(scheme, joint, step):
    rng = np.random.default_rng(5)
    for e in (0.0, 0.3, 0.0):
        angle, height = rng.uniform(0.8, 1.2), rng.uniform(0.16, 0.185)
        problem = pole(joint, angle, height, e)
        run = mbvi.simulate(problem, SCHEMES[scheme], step=step, duration=0.25)
        assert run.impacts
        # of a pole that turns about its end the impulse at the other is a third of m v there; the height that it falls
        # bounds v, and 3 leaves room for the slope
        fallen = 2.0 * 9.81 * 0.5 * LENGTH
        bound = 3.0 * MASS / 3.0 * np.sqrt(3.0 * fallen)
        assert max(np.abs(impact.percussion).max() for impact in run.impacts) < bound
        assert run.residual.max() <= 1e-6 and run.loop_gap().max() <= 1e-12
        assert (np.diff(run.energy()) <= 1e-5).all()


@pytest.mark.parametrize("joint", ["point", "axis"])
def test_all_schemes_find_the_same_first_percussion(joint):
    found = []
    for scheme in SCHEMES.values():
        run = mbvi.simulate(pole(joint, 0.9, 0.18, 0.0), scheme, step=2e-4, duration=0.12)
        found.append(np.abs(run.impacts[0].percussion).max())
    np.testing.assert_allclose(found, found[0], rtol=5e-3)


@pytest.mark.parametrize("step", [1e-3, 1e-4])
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    "drawn",
    [
        (1.4991, 0.20087, 1.1358, 0.49331, 0.13809, (-0.054686, 0.061348)),
        (0.96126, 0.18974, 1.0002, 0.44496, 0.0639, (-0.0099495, 0.027588)),
        (0.76072, 0.16827, 0.64245, 0.055009, 0.024933, (-0.0075554, -0.0071331)),
    ],
    ids=["thick", "held beside its axis", "thin"],
)
def test_percussions_of_poles_that_jam_do_not_grow(scheme, step, drawn):
    angle, height, mu, own, width, aside = drawn
    run = mbvi.simulate(
        pole("point", angle, height, 0.0, mu, own, width, aside), SCHEMES[scheme], step=step, duration=0.3
    )
    # no more than the momentum that the whole pole can have from its fall
    assert run.impacts and max(np.abs(impact.percussion).max() for impact in run.impacts) < 1.5
    assert run.residual.max() <= 1e-6 and (np.diff(run.energy()) <= 1e-5).all()
