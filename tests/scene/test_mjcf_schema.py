"""Every element and attribute of MJCF's schema is modelled, named, or without effect on the motion."""

import re
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest

import mbvi
from mbvi.scene.mjcf.schema import unknown_parts

mujoco = pytest.importorskip("mujoco")

# attributes that change the motion in MuJoCo and not here: where they stand, a value, and the words that name them
NAMED = {
    "geom margin": ("g", 'margin=".01"', "margin of g"),
    "geom condim": ("g", 'condim="4"', "torsional and rolling friction of g"),
    "geom gap": ("g", 'gap=".01"', "gap of g"),
    "geom adhesion": ("g", 'adhesion="10"', "adhesion of g"),
    "geom surfacevel": ("g", 'surfacevel="1 0 0 0 0 0"', "surface velocity (surfacevel) of g"),
    "joint stiffness": ("j", 'stiffness="2 1"', "springs of j"),
    "joint springyield": ("j", 'stiffness="2" springyield="1"', "springs of j"),
    "joint margin": ("j", 'margin=".1" range="-1 1" limited="true"', "margins of limits of j"),
    "joint ref": ("j", 'ref="2" range="-57.2 57.2" limited="true"', ""),
    "body gravcomp": ("b", 'gravcomp="1"', "gravity compensation of b"),
    "body mocap": ("m", 'mocap="true"', "1 mocap bodies"),
    "pair margin": ("p", 'margin=".01"', "margin of pair g | h"),
    "pair condim": ("p", 'condim="6"', "torsional and rolling friction of pair g | h"),
    "pair gap": ("p", 'gap=".01"', "gap of pair g | h"),
    "pair friction": ("p", 'friction="1 .5 0 0 0"', "friction of two directions of pair g | h"),
    "pair adhesion": ("p", 'adhesion="10"', "adhesion of pair g | h"),
    "option density": ("option", 'density="1"', "air and water"),
    "option viscosity": ("option", 'viscosity="1"', "air and water"),
    "option wind": ("option", 'wind="1 0 0"', "air and water"),
    "option gravity": ("option", 'gravity="0 0 -1"', "gravity [0.0, 0.0, -1.0] of the file"),
    "flag override": ("flag", 'override="enable"', "flag override"),
    "flag gravity": ("flag", 'gravity="disable"', "gravity [0.0, 0.0, 0.0] of the file"),
    "tendon": (
        "end",
        '<tendon><fixed name="t" range="0 1" limited="true"><joint joint="j" coef="1"/></fixed></tendon>',
        "limits of tendon t",
    ),
    "equality": (
        "end",
        '<equality><joint name="e" joint1="j" joint2="k" polycoef="0 1 2 0 0"/></equality>',
        "equality constraint e",
    ),
    "actuator": ("end", '<actuator><muscle name="a" joint="j" lengthrange="0 1"/></actuator>', "actuator a"),
}


def text(place="", value=""):
    """Return a model with an attribute or elements at a place."""
    at = {one: value if one == place else "" for one in ("option", "flag", "g", "j", "b", "m", "p", "end")}
    return f"""<mujoco><option {at["option"]}><flag {at["flag"]}/></option><worldbody>
      <body name="b" pos="0 0 1" {at["b"]}><joint name="j" {at["j"]}/>
        <geom name="g" size=".1" pos=".2 0 0" {at["g"]}/></body>
      <body name="c" pos="0 0 3"><joint name="k"/><geom name="h" size=".1" pos=".2 0 0"/></body>
      <body name="m" pos="0 0 5" {at["m"]}><geom size=".1"/></body></worldbody>
      <contact><pair geom1="g" geom2="h" {at["p"]}/></contact>{at["end"]}</mujoco>"""


def warned(folder, given, **build):
    file = folder / "model.xml"
    file.write_text(given)
    scene = mbvi.Scene()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene.add_mjcf(file)
    return " ".join(str(one.message) for one in caught), scene


def schema():
    """Return all paths of elements in MuJoCo's schema, with their attributes."""
    found, path, element = {}, [], None
    for line in mujoco.mj_printSchema(False, False).splitlines():
        head = re.match(r"^( *)(\S+) \([!*?R]\)(.*)$", line)
        if head:
            path = [*path[: len(head[1]) // 3], head[2].replace("(world)body", "body")]
            element = tuple(path)
            found.setdefault(element, []).extend(head[3].split())
        elif line.strip():
            found[element].extend(line.split())
    return found


def test_the_schema_is_read():
    found = schema()
    assert len(found) > 100 and sum(map(len, found.values())) > 1000
    assert "surfacevel" in found["mujoco", "default", "geom"]


def test_every_element_and_attribute_is_known():
    """What a later MuJoCo adds is named as unknown until it is looked at."""
    for path, attributes in schema().items():
        root = at = ElementTree.Element(path[0])
        for tag in path[1:]:
            at = ElementTree.SubElement(at, tag)
        for attribute in attributes:
            at.set(attribute, "1")
        assert unknown_parts(ElementTree.tostring(root, "unicode")) == [], path


@pytest.mark.parametrize("change", ["geom shape='1'", "body mood='1'", "joint wear='1'", "spring", "option glue='1'"])
def test_what_is_not_known_is_named(change):
    tag = change.split()[0]
    attribute = change.partition(" ")[2].partition("=")[0]
    [named] = unknown_parts(f"<mujoco><worldbody><body name='b'><{change}/></body></worldbody></mujoco>")
    assert named == (f"attribute {attribute} of element {tag}" if attribute else f"element {tag}")


def test_the_model_without_any_of_it_warns_of_nothing(tmp_path):
    assert warned(tmp_path, text())[0] == ""


@pytest.mark.parametrize("what", sorted(NAMED))
def test_what_changes_the_motion_is_named(what, tmp_path):
    place, value, words = NAMED[what]
    said, _ = warned(tmp_path, text(place, value))
    assert words in said and (said or what == "joint ref"), said


def test_a_reference_outside_its_limits_is_named_with_where_it_starts(tmp_path):
    said, scene = warned(tmp_path, text("j", 'ref="90" range="-10 30" limited="true"'))
    assert "reference of joint j, outside its limits; it starts at their middle, 0.1745" in said
    assert scene.build((), resolve=True).scene.items.robots[0].q0[0] == pytest.approx(np.deg2rad(10))


@pytest.mark.parametrize("flag", sorted(schema()["mujoco", "option", "flag"]))
def test_flags_are_honoured_named_or_without_effect(flag, tmp_path):
    """Where MuJoCo moves otherwise with the flag, so does the model, or it is named."""
    default = mujoco.MjModel.from_xml_string(text())
    for state in ("enable", "disable"):
        given = text("flag", f'{flag}="{state}"')
        if flag == "ipc" and state == "enable":
            given = given.replace("<option ", '<option integrator="discrete" ')
        m = mujoco.MjModel.from_xml_string(given)
        if (m.opt.disableflags, m.opt.enableflags) == (default.opt.disableflags, default.opt.enableflags):
            continue
        said, scene = warned(tmp_path, given)
        problem = scene.build((), resolve=True)
        assert (said != "") == (flag in ("override", "gravity")), said
        if flag in ("contact", "constraint"):
            assert not problem.constraints.families


def test_disabled_contacts_limits_damping_and_friction_are_left_out(tmp_path):
    model = """<mujoco><option><flag {}="disable"/></option><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 .5"><joint name="j" axis="0 1 0" range="-10 10" limited="true" damping="2" frictionloss=".5"/>
      <geom size=".1" pos=".2 0 0"/></body></worldbody></mujoco>"""
    found = {}
    for flag in ("sensor", "contact", "limit", "damper", "frictionloss", "constraint"):
        said, scene = warned(tmp_path, model.format(flag))
        assert not said
        problem = scene.build((), resolve=True)
        names = [problem.constraints.name(k) for k in range(len(problem.constraints))]
        found[flag] = (
            any("plane" in n for n in names), any("limit" in n for n in names), bool(problem.model().damping.any()),
            problem.system.has_joint_friction,
        )  # fmt: skip
    assert found == {
        "sensor": (True, True, True, True),
        "contact": (False, True, True, True),
        "limit": (True, False, True, True),
        "damper": (True, True, False, True),
        "frictionloss": (True, True, True, False),
        "constraint": (False, False, True, False),
    }
