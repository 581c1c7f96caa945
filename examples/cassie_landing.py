"""Cassie drops on its feet and stands: two loops in each leg stay closed through the impacts.

Needs the package example-robot-data, whose SDF of Cassie is written as MJCF here, and the extra mbvi[mjcf].
`python examples/cassie_landing.py landing.html` writes the replay too.
"""

import sys
import sysconfig
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin

import mbvi

CASSIE = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots/cassie_description")
# joints that close loops by a common point: the other ends of the rods, of which the file has the first as a hinge
LOOPS = ("achilles-spring-joint", "plantar-foot-joint")
# the stand [rad]; stiffness [N m/rad] and damping [N m s/rad] that servos give the motors' joints
STAND = {"roll-op": 0.0, "yaw-op": 0.0, "pitch-op": 0.745, "knee-op": -0.9, "foot-op": -1.845}
SERVOS = {
    "roll-op": (1500, 80),
    "yaw-op": (1500, 80),
    "pitch-op": (1500, 80),
    "knee-op": (1500, 80),
    "foot-op": (500, 16),
}
# where the loops of the feet are nearly closed, far from their dead centre at zero
NEAR = {"foot-op": -1.5, "tarsus-crank-joint": -1.5, "crank-rod-joint": 1.5}
# height of the pelvis, which has the feet 5 cm above the floor [m]; duration and step [s]
HEIGHT, MU, DURATION, STEP = 0.9, 0.8, 1.5, 1e-3
# with Centered, the default here, the servos make Cassie fall at this step, and stand at half of it
SCHEME = mbvi.MoreauJean(project_positions=True)


def pose(element: ElementTree.Element | None) -> pin.SE3:
    """Return the pose that an element of the SDF states."""
    numbers = np.array((element.text if element is not None else "0 0 0 0 0 0").split(), float)
    # right angles that are rounded would open loops in a plane by 2e-8 m
    right = 0.5 * np.pi * np.round(numbers[3:] / (0.5 * np.pi))
    angles = np.where(np.abs(numbers[3:] - right) < 1e-3, right, numbers[3:])
    return pin.SE3(pin.rpy.rpyToMatrix(angles), numbers[:3])


def placed(where: pin.SE3) -> str:
    """Return a pose as attributes of MJCF."""
    x, y, z, w = pin.SE3ToXYZQUAT(where)[3:]
    return f'pos="{" ".join(map(repr, where.translation.tolist()))}" quat="{w} {x} {y} {z}"'


def motor(joint: str) -> str:
    """Return the name of a motor's joint without its side; empty for another joint."""
    own = joint.partition("-")[2]
    return own if own in SERVOS else ""


class Sdf:
    """The SDF of Cassie as MJCF."""

    def __init__(self) -> None:
        root = ElementTree.parse(CASSIE / "robots/cassie_v2.sdf").getroot().find("model")
        self.links = {link.get("name"): link for link in root.findall("link")}
        self.joints = {joint.get("name"): joint for joint in root.findall("joint")}
        self.at = {name: pose(link.find("pose")) for name, link in self.links.items()}

    def ends(self, name: str) -> tuple[str, str]:
        """Return parent and child of a joint in the tree, where a rod hangs on the hip."""
        parent, child = (self.joints[name].findtext(side).strip() for side in ("parent", "child"))
        return (child, parent) if name.endswith("pitch-rod-joint") else (parent, child)

    def anchor(self, name: str, body: str) -> str:
        """Return where a joint is, as a body sees it."""
        joint = self.joints[name]
        point = self.at[joint.findtext("child").strip()].act(pose(joint.find("pose")).translation)
        return " ".join(map(repr, self.at[body].actInv(point).tolist()))

    def joint(self, name: str) -> str:
        """Return a joint of the tree."""
        given, ball = self.joints[name].find("axis"), self.joints[name].get("type") == "ball"
        values = {one.tag: one.text for one in given.iter()}
        if motor(name):
            values["damping"] = SERVOS[motor(name)][1]
        text = f'name="{name}" damping="{values.get("damping", 0)}" pos="{self.anchor(name, self.ends(name)[1])}"'
        if not ball:
            text += f' axis="{values["xyz"]}" stiffness="{values.get("spring_stiffness", 0)}"'
        # the loop of a foot has a dead centre at zero, outside limits: servos keep the feet within them
        if float(values.get("upper", -1)) >= 0.0:
            text += f' range="{values["lower"]} {values["upper"]}"'
        return f'<joint type="{"ball" if ball else "hinge"}" {text}/>'

    def body(self, name: str, joint: str) -> Iterator[str]:
        """Yield a link and all that hangs on it."""
        link, parent = self.links[name], self.ends(joint)[0] if joint else None
        where = self.at[parent].actInv(self.at[name]) if joint else pin.SE3.Identity()
        yield f'<body name="{name}" {placed(where)}>' + (self.joint(joint) if joint else "<freejoint/>")
        inertia = " ".join(link.findtext(f"inertial/inertia/i{k}") for k in ("xx", "yy", "zz", "xy", "xz", "yz"))
        centre = " ".join(link.findtext("inertial/pose").split()[:3])
        yield f'<inertial pos="{centre}" mass="{link.findtext("inertial/mass")}" fullinertia="{inertia}"/>'
        shapes = link.findall("collision")
        if not shapes:
            # rods and other links without a shape have the hull of their mesh
            yield f'<geom type="mesh" mesh="{Path(link.findtext("visual/geometry/mesh/uri")).stem}"/>'
        for shape in shapes:
            kind = shape.find("geometry")[0]
            size = [float(kind.findtext("radius")), 0.5 * float(kind.findtext("length", "0"))]
            yield f'<geom type="{kind.tag}" size="{size[0]} {size[1]}" {placed(pose(shape.find("pose")))}/>'
        for other in self.joints:
            if not other.endswith(LOOPS) and self.ends(other)[0] == name:
                yield from self.body(self.ends(other)[1], other)
        yield "</body>"

    def mjcf(self, gravity: float) -> str:
        """Return the whole file."""
        meshes = "".join(f'<mesh file="{file.name}"/>' for file in sorted((CASSIE / "meshes").glob("*.stl")))
        loops = [(name, *self.ends(name)) for name in self.joints if name.endswith(LOOPS)]
        ties = (f'<connect name="{n}" body1="{a}" body2="{b}" anchor="{self.anchor(n, a)}"/>' for n, a, b in loops)
        motors = (f'<position name="{n}" joint="{n}" kp="{SERVOS[motor(n)][0]}"/>' for n in self.joints if motor(n))
        return f"""<mujoco model="cassie"><compiler angle="radian" meshdir="{CASSIE / "meshes"}" autolimits="true"/>
<option gravity="0 0 {-gravity}"/>
<default><geom contype="1" conaffinity="0" rgba="0.7 0.7 0.75 1"/></default><asset>{meshes}</asset>
<worldbody>{"".join(self.body("pelvis", ""))}</worldbody>
<equality>{"".join(ties)}</equality><actuator>{"".join(motors)}</actuator></mujoco>"""


def both(values: dict[str, float]) -> dict[str, float]:
    """Return values of joints of one leg for both legs."""
    return {f"{side}-{name}": value for side in ("left", "right") for name, value in values.items()}


def balance(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the inputs of the servos: the stand, but toes go down and a leg gets longer where the pelvis leans."""
    inputs = np.array(list(both(STAND).values()))
    inputs[[4, 9]] -= 4.0 * q[0] + v[0] + 2.0 * q[4] + 0.2 * v[4]
    inputs[[3, 8]] += (2.0 * q[3] + 0.1 * v[3]) * np.array([-1, 1])
    return inputs


def scene(gravity: float) -> mbvi.Scene:
    """Return the robot, which servos take to its stand, and with gravity a floor."""
    made = mbvi.Scene(gravity=(0, 0, -gravity), friction=MU)
    if gravity:
        made.add_halfspace((0, 0, 1), name="floor")
    with tempfile.TemporaryDirectory() as folder:
        file, inputs = Path(folder, "cassie.xml"), balance if gravity else both(STAND)
        file.write_text(Sdf().mjcf(gravity))
        made.add_mjcf(file, position=(0, 0, 2), joints=both(NEAR), ctrl=inputs, name="cassie")
    return made


def start() -> np.ndarray:
    """Return q above the floor, where the servos come to rest without gravity: loops are closed and springs relaxed."""
    q = mbvi.simulate(scene(0.0).build(), SCHEME, step=STEP, duration=2.0, progress=False).q[-1].copy()
    q[:7] = 0, 0, HEIGHT, 0, 0, 0, 1
    return q


def land(duration: float = DURATION, step: float = STEP) -> mbvi.Trajectory:
    """Return the run."""
    problem = scene(9.81).build()
    problem = problem.at(start(), np.zeros(problem.system.nv))
    return mbvi.simulate(problem, SCHEME, step=step, duration=duration, record="contacts", progress=False)


def main(page: str | None = None, step: float = STEP) -> float:
    """Return the percussions of the floor over weight times duration plus gain of momentum."""
    run = land(step=step)
    model = run.problem.system.model
    data, mass = model.createData(), pin.computeTotalMass(model)
    pin.centerOfMass(model, data, run.q[-1], run.v[-1])
    floor = sum(np.diff(run.t) @ force[1:, 2] for force in run.contact_forces().values())
    print(f"the loops are never open by more than {run.loop_gap().max():.0e} m")
    if page:
        run.replay_html(page)
    return floor / (mass * (9.81 * DURATION + data.vcom[0][2]))


if __name__ == "__main__":
    print(f"the floor gave {main(*sys.argv[1:]):.6f} of the momentum that the robot gained against gravity")
