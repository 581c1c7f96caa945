"""Swift bodies pass through no thin plate, at rest or with a prescribed motion, and leave it by Newton's law."""

import numpy as np
import pytest

import mbvi
from mbvi import motion

pytestmark = pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")
STEP = 1e-2
SCHEMES = {
    "Paoli": mbvi.Paoli(),
    "MoreauJean": mbvi.MoreauJean(),
    "Centered": mbvi.Centered(),
    "Centered, projected": mbvi.Centered(project_positions=True),
    "StewartTrinkle": mbvi.StewartTrinkle(),
    "SchatzmanPaoli": mbvi.SchatzmanPaoli(),
}
MOTIONS = {
    "at rest": None,
    "slides": motion.Translation((0.7, -0.3, 0.4)),
    "swift": motion.Translation((0.0, 0.0, 4.0)),
    "shakes": motion.Oscillation((2e-3, 0.0, 4e-3), frequency=4.0, phase=0.3),
    "turns": motion.Rotation((0.1, 0.2, 1.0), 1.5, centre=(0.05, 0.0, 0.0)),
}


def shot(plate, rng, kind, e):
    """A body shot at a plate of 4 mm, by many times its thickness a step."""
    scene = mbvi.Scene(restitution=e)
    scene.add_box((2.0, 2.0, 4e-3), fixed=True, motion=plate, name="plate")
    place, speed = (*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.2, 0.4)), rng.uniform(8.0, 30.0)
    velocity = np.array([*rng.normal(size=2), -speed])
    if kind == "sphere":
        scene.add_sphere(0.01, 0.1, position=place, velocity=velocity)
    else:
        turned = {"rotation": np.eye(3)[[1, 2, 0]], "angular_velocity": rng.normal(size=3)}
        scene.add_box((0.02, 0.03, 0.02), 0.1, position=place, velocity=velocity, **turned)
    return scene.build()


def run_of(problem, scheme, duration=0.08):
    return mbvi.simulate(problem, scheme, step=STEP, duration=duration, progress=False)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["sphere", "box"])
@pytest.mark.parametrize("plate", MOTIONS)
@pytest.mark.parametrize("name", SCHEMES)
def test_what_is_shot_at_a_plate_leaves_it_by_newtons_law(name, plate, kind, seed):
    prescribed, e = MOTIONS[plate], 0.5
    run = run_of(shot(prescribed, np.random.default_rng(seed), kind, e), SCHEMES[name])
    turn, place = (np.eye(3), np.zeros(3)) if prescribed is None else prescribed.pose(run.t[-1])
    # in the frame of the plate
    assert ((run.q[-1, :3] - place) @ turn)[2] > 0.0
    assert run.impacts
    first = run.impacts[0]
    hit = first.percussion > 0.0
    np.testing.assert_allclose(first.after[hit], -e * first.before[hit], rtol=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", SCHEMES)
def test_shots_at_plates_that_slide_are_those_at_plates_at_rest(name, seed):
    places = []
    for velocity in [None, np.zeros(3), np.array([0.7, -0.3, 0.4]), np.array([0.0, 2.0, -3.0])]:
        rng, given = np.random.default_rng(seed), velocity is not None
        own = velocity if given else np.zeros(3)
        scene = mbvi.Scene(restitution=0.5)
        scene.add_box((2.0, 2.0, 4e-3), fixed=True, motion=motion.Translation(velocity) if given else None)
        for k in range(2):
            place, speed = (
                (0.2 * k, 0.0, rng.uniform(0.2, 0.4)),
                np.array([*rng.normal(size=2), -rng.uniform(8.0, 30.0)]),
            )
            scene.add_sphere(0.01, 0.1, position=place, velocity=own + speed)
        run = run_of(scene.build(), SCHEMES[name])
        places.append(run.q.reshape(len(run.t), 2, 3) - run.t[:, None, None] * own)
    for place in places[1:]:
        np.testing.assert_allclose(place, places[0], rtol=0.0, atol=1e-8)


def test_a_body_that_a_plate_overtakes_is_taken_along():
    """The plate, not the body, is what moves by more than its thickness in a step."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((2.0, 2.0, 4e-3), position=(0, 0, -0.3), motion=motion.Translation((0, 0, 9.0)))
    scene.add_sphere(0.01, 0.1)
    for scheme in SCHEMES.values():
        run = run_of(scene.build(), scheme, duration=0.1)
        np.testing.assert_allclose(run.v[-1], [0.0, 0.0, 9.0], atol=1e-6)
        assert run.q[-1, 2] > 0.6
