"""Which elements and attributes of a MJCF mbvi knows: those that it takes, names, or may leave out in silence."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

_POSE = "pos quat axisangle euler xyaxes zaxis"
# of elements that are read the attributes that are taken, counted in the compiled model, or do not change the motion
_KNOWN = {
    "compiler": (
        "alignfree angle assetdir autolimits balanceinertia boundinertia boundmass conflict coordinate discardvisual "
        "eulerseq fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir passthrough savecanonical savecompiled "
        "saveinertial settotalmass strippath texturedir usethread"
    ),
    # what is not here solves MuJoCo's soft contacts; o_... acts with the flag override only, which is named
    "option": (
        "actuatorgroupdisable ccd_iterations ccd_tolerance cone density gravity impratio integrator iterations "
        "jacobian ls_iterations ls_tolerance magnetic noslip_iterations noslip_tolerance o_friction o_margin o_solimp "
        "o_solref sdf_initpoints sdf_iterations sleep_tolerance solver timestep tolerance viscosity wind"
    ),
    "body": f"childclass fuse gravcomp mocap name simple sleep user {_POSE}",
    "frame": f"childclass name {_POSE}",
    "inertial": f"diaginertia fullinertia mass {_POSE}",
    "joint": (
        "actuatorfrclimited actuatorfrcrange actuatorgravcomp armature axis class damping frictionloss group limited "
        "margin name pos range ref solimpfriction solimplimit solreffriction solreflimit springdamper springref "
        "springyield stiffness type user"
    ),
    "freejoint": "align group name",
    "geom": (
        "adhesion class conaffinity condim contype castshadow density fitscale fluidcoef fluidshape friction fromto "
        "gap group hfield margin mass material mesh name priority rgba shellinertia size solimp solmix solref "
        f"surfacevel type user {_POSE}"
    ),
    "mesh": (
        "builtin class content_type face file inertia material maxhullvert name normal params refpos refquat scale "
        "smoothnormal texcoord vertex"
    ),
    "model": "content_type file name",
    "pair": "adhesion class condim friction gap geom1 geom2 margin name solimp solref solreffriction",
    "exclude": "body1 body2 name",
    "hfield": "content_type elevation file name ncol nrow size",
    "default": "class",
    "worldbody": "childclass name",
    "mujoco": "model", "asset": "", "contact": "",
}  # fmt: skip
# elements whose bits or counts are looked at in the compiled model, or that do not change the motion
_ELSEWHERE = frozenset(
    "flag lengthrange size statistic visual texture material skin site camera light custom sensor keyframe actuator "
    "tendon equality deformable extension plugin attach composite flexcomp replicate include "
    "general motor position velocity intvelocity orientation pid damper cylinder muscle adhesion dcmotor".split()
)


def unknown_parts(text: str) -> list[str]:
    """Return in words the elements and attributes of a MJCF, as MuJoCo writes it, that mbvi does not know."""
    return list(dict.fromkeys(_unknown(ElementTree.fromstring(text))))


def _unknown(element: ElementTree.Element) -> Iterator[str]:
    if element.tag in _ELSEWHERE:
        return
    known = _KNOWN.get(element.tag)
    name = f" of {element.get('name')}" if element.get("name") else ""
    if known is None:
        yield f"element {element.tag}{name}"
        return
    for attribute in sorted(set(element.keys()) - set(known.split())):
        yield f"attribute {attribute} of element {element.tag}{name}"
    for child in element:
        yield from _unknown(child)
