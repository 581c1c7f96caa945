"""What is left out of a model changes nothing: each reduction on and off, or against a model that spells it out."""

import numpy as np
import pytest
from conftest import ROBOTS

import mbvi

HOPPER = ROBOTS / "hopper" / "hopper.urdf"
EVERY_SCHEME = (mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.SchatzmanPaoli(), mbvi.StewartTrinkle())


def places_of(problem, q, names):
    """Poses of shapes by name, shape (n, 4, 3)."""
    shapes = {s.name: s for s in problem.scene.shapes}
    poses = []
    for name in names:
        placed = shapes[name]
        own = np.vstack([placed.rotation.T, placed.position])
        if placed.body:
            world = problem.system.placements(q, np.array([placed.body]))[0]
            own = np.vstack([own[:3] @ world[:3], own[3] @ world[:3] + world[3]])
        poses.append(own)
    return np.array(poses)


def same_motion(one, other, scheme, duration=0.4, tolerance=1e-10, **options):
    """Run two problems and compare where their shapes are, at every instant."""
    names = [s.name for s in one.scene.shapes if s.body]
    assert names
    runs = [mbvi.simulate(p, scheme, duration=duration, **options) for p in (one, other)]
    assert len(runs[0].t) == len(runs[1].t)
    for q, r in zip(runs[0].q, runs[1].q, strict=True):
        np.testing.assert_allclose(places_of(one, q, names), places_of(other, r, names), rtol=0, atol=tolerance)
    np.testing.assert_allclose(runs[0].energy(), runs[1].energy(), rtol=0, atol=100 * tolerance)
    return runs


# --- joints that never move


def hopper(text, tmp_path, e=0.5, **more):
    file = tmp_path / "hopper.urdf"
    file.write_text(text)
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace(normal=(0, 0, 1), name="floor")
    scene.add_urdf(file, position=(0, 0, 0.7), velocity=more.pop("velocity", {"hip": 2.0}), **more)
    return scene


def knee_fixed(text, angle):
    """The hopper's URDF with its knee welded at an angle."""
    start = text.index('<joint name="knee"')
    end = text.index("</joint>", start)
    knee = text[start:end].replace('type="revolute"', 'type="fixed"')
    assert knee.count("<origin") == 1 and "rpy" not in knee
    return text[:start] + knee.replace("<origin ", f'<origin rpy="0 {angle} 0" ') + text[end:]


def knee_without_range(text, angle):
    limits = 'lower="-0.1" upper="2.2"'
    assert limits in text
    return text.replace(limits, f'lower="{angle}" upper="{angle}"')


@pytest.mark.parametrize("scheme", EVERY_SCHEME, ids=lambda s: type(s).__name__)
def test_a_locked_joint_moves_as_a_fixed_one(scheme, tmp_path):
    text = HOPPER.read_text()
    e = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.5
    locked = hopper(text, tmp_path, e, joints={"knee": 0.4}, locked=["knee"]).build()
    welded = hopper(knee_fixed(text, 0.4), tmp_path, e).build()
    assert locked.system.nv == welded.system.nv == 7
    assert "joint hopper/knee: locked, at 0.4; saves 1 degree of freedom, 2 rows" in locked.report()
    runs = same_motion(locked, welded, scheme, step=1e-3)
    assert runs[0].impacts


@pytest.mark.parametrize("scheme", EVERY_SCHEME, ids=lambda s: type(s).__name__)
def test_a_joint_without_range_moves_the_same_with_and_without(scheme, tmp_path):
    e = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.5
    scene = hopper(knee_without_range(HOPPER.read_text(), 0.25), tmp_path, e)
    reduced, full = scene.build(), scene.build(reduce=())
    assert (reduced.system.nv, full.system.nv) == (7, 8)
    assert (
        "joint hopper/knee: its limits leave no range, at 0.25; saves 1 degree of freedom, 2 rows" in reduced.report()
    )
    assert "no range" not in full.report()
    # these two step otherwise where a constraint, here the full model's limits, is active: equal to their own order
    own = isinstance(scheme, mbvi.Centered | mbvi.SchatzmanPaoli)
    tolerance, duration = (1e-5, 0.2) if own else (1e-10, 0.4)
    same_motion(reduced, full, scheme, duration, tolerance, step=1e-3)


def test_a_joint_that_something_asks_for_stays(tmp_path):
    text = knee_without_range(HOPPER.read_text(), 0.25)
    # a control counts it, and a velocity is an impact of its limits
    for more in ({"control": lambda t, q, v: np.zeros(8)}, {"velocity": {"knee": 1.0}}):
        assert hopper(text, tmp_path, **more).build().system.nv == 8


def test_a_locked_joint_keeps_damping_files_and_replay(tmp_path):
    text = HOPPER.read_text().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics damping="0.3"/>', 1)
    scene = hopper(text, tmp_path, joints={"knee": 0.4}, locked=["knee", "knee"])
    scene.add_urdf(HOPPER, position=(2, 0, 0.7), name="other")
    problem = scene.build()
    assert problem.system.parts[0].damping.tolist() == [0] * 6 + [0.3]
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05)
    run.save(tmp_path / "run.h5")
    run.replay_html(tmp_path / "run.html")
    again = mbvi.load(tmp_path / "run.h5").problem
    assert again.report() == problem.report()
    np.testing.assert_array_equal(again.q0, problem.q0)
    names = [s.name for s in problem.scene.shapes]
    np.testing.assert_array_equal(places_of(again, run.q[-1], names), places_of(problem, run.q[-1], names))


def test_locks_that_cannot_be_are_refused(tmp_path):
    def add(**more):
        return hopper(HOPPER.read_text(), tmp_path, velocity={}, **more)

    for more, words in (
        ({"locked": ["elbow"]}, "no joint 'elbow' to lock; known are hip, knee"),
        ({"locked": ["knee"], "joints": {"knee": 3.0}}, "'knee' is locked at 3, outside its limits"),
        ({"locked": ["knee", "hip"], "base": "fixed"}, "all joints of hopper are locked"),
    ):
        with pytest.raises(mbvi.InputError, match=words):
            add(**more)
    with pytest.raises(mbvi.InputError, match="'hip' is locked and cannot have a velocity"):
        hopper(HOPPER.read_text(), tmp_path, locked=["hip"])
    with pytest.raises(mbvi.InputError, match="unknown reduction 'joint'; known are joints, "):
        add().build(reduce=["joint"])
