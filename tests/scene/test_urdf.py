"""What a URDF holds and mbvi does not model is said when the robot is added."""

import re
import warnings
import xml.etree.ElementTree as ElementTree

import pytest

import mbvi
from support.paths import DATA, REAL_ROBOTS, ROBOTS, real_robot

FINGERS = DATA / "fingers.urdf"


def said_of(path, **arguments):
    """Return a scene with a robot, and what was said when it was added."""
    scene = mbvi.Scene()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene.add_urdf(path, **arguments)
    assert all(one.category is mbvi.MbviWarning for one in said)
    return scene, " ".join(str(one.message) for one in said)


def test_a_joint_that_does_not_mimic_is_named():
    scene, said = said_of(FINGERS)
    assert re.match("fingers.urdf: joints do not mimic others: follower move on their own.*; stiff are fixed", said)
    report = scene.build().report()
    assert "mimic of joint follower: the joint moves on its own, and does not follow lead" in report
    assert "mimic of joint stiff: the joint is fixed" in report
    assert "follower" not in said_of(FINGERS, locked=["follower"])[1]
    assert not said_of(ROBOTS / "hopper/hopper.urdf")[1]


@pytest.mark.parametrize("path", ["panda_description/urdf/panda.urdf", "talos_data/robots/talos_left_arm.urdf"])
def test_mimic_joints_of_published_robots_are_named(path):
    check_mimics(real_robot(path))


def check_mimics(file):
    root = ElementTree.parse(file).getroot()
    mimics = [joint.get("name") for joint in root.findall("joint") if joint.find("mimic") is not None]
    said = said_of(file)[1]
    assert bool(mimics) == ("mimic" in said) and all(name in said for name in mimics)
    return len(mimics)


@pytest.mark.slow(seconds=90)
def test_mimic_joints_of_all_published_robots_are_named():
    found = []
    for file in sorted(REAL_ROBOTS.rglob("*.urdf")):
        try:
            mbvi.Scene().add_urdf(file)
        except mbvi.MbviError:
            continue
        found.append(check_mimics(file))
    assert len(found) > 60 and sum(n > 0 for n in found) > 10
