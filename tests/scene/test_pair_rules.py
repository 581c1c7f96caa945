"""Pairs that a user excludes do not meet; what is said of pairs that cannot touch is refused."""

import itertools

import numpy as np
import pytest

import mbvi
from support.paths import DATA, ROBOTS

H, T = 2e-3, 0.12
HOPPER = ROBOTS / "hopper/hopper.urdf"
DOWN = (0, 0, -4, 0, 0, 0)
MOTION = mbvi.motion.Translation((0.1, 0.0, 0.0))
GROUND = [[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 1, 2]]


def spheres(scene, name, places):
    return scene.add_spheres([(0.25 * k, 0, 0.5) for k in places], 0.1, 1.0, [DOWN[:3]] * len(places), name)


# everything that falls onto something else, one of each kind of pair
FALLING = {
    "sphere": lambda s, name: s.add_sphere(0.1, position=(0, 0, 0.5), velocity=DOWN[:3], name=name),
    "few": lambda s, name: spheres(s, name, range(3)),
    "many": lambda s, name: spheres(s, name, range(-20, 20)),
    "box": lambda s, name: s.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.5), velocity=DOWN[:3], name=name),
    "hopper": lambda s, name: s.add_urdf(HOPPER, position=(0, 0, 0.9), base_velocity=DOWN, name=name),
}
BELOW = {
    "half-space": lambda s, name: s.add_halfspace((0, 0, 1), name=name),
    "moving half-space": lambda s, name: s.add_halfspace((0, 0, 1), name=name, motion=MOTION),
    "mesh": lambda s, name: s.add_surface(*GROUND, name=name),
    "moving mesh": lambda s, name: s.add_surface(*GROUND, name=name, motion=MOTION),
    "slab": lambda s, name: s.add_box((20, 9, 0.2), position=(0, 0, -0.1), fixed=True, name=name),
    "moving slab": lambda s, name: s.add_box((20, 9, 0.2), position=(0, 0, -0.1), motion=MOTION, name=name),
    "tile": lambda s, name: s.add_box((0.5, 0.5, 0.2), position=(0, 0, -0.1), name=name, velocity=(0, 0, 4)),
    "ball": lambda s, name: s.add_sphere(0.2, position=(0, 0, -0.2), name=name, velocity=(0, 0, 4)),
}


def moved(build, named, crowd):
    """Return q of a thing after a while, with many other things far away or without."""
    scene = mbvi.Scene()
    build(scene)
    if crowd:
        for k in range(70):
            scene.add_box((0.1, 0.1, 0.1), position=(k, 30, 5), name=f"far{k}")
            if scene._items.surfaces:
                scene.exclude(f"far{k}", "down")
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=H, duration=T, progress=False)
    place = next(p for name, p in places(problem).items() if name == named)
    return run.q[:, place], {c for i in run.impacts for c in i.constraints}, problem


def places(problem):
    """Return where in q the things with the names "up" and "down" are."""
    found, k = {}, 0
    for item in problem.scene.items.robots:
        found[item.robot.name] = slice(k, k := k + len(item.q0))
    for body in problem.scene.items.bodies:
        if not body.fixed:
            found[body.name] = slice(k, k := k + 7)
    for item in problem.scene.items.spheres:
        found[item.name] = slice(k, k := k + 3 * len(item.radii))
    return found


@pytest.mark.parametrize("crowd", [False, True], ids=["alone", "crowd"])
@pytest.mark.parametrize(("up", "down"), list(itertools.product(FALLING, BELOW)))
def test_an_excluded_pair_moves_as_if_alone(up, down, crowd):
    assert moved(lambda s: (FALLING[up](s, "up"), BELOW[down](s, "down")), "up", crowd)[1]
    alone, met, _ = moved(lambda s: FALLING[up](s, "up"), "up", crowd)
    assert not met
    q, met, problem = moved(
        lambda s: (FALLING[up](s, "up"), BELOW[down](s, "down"), s.exclude("up", "down")), "up", crowd
    )
    assert not met
    np.testing.assert_allclose(q, alone, rtol=0, atol=1e-13)
    assert "pairs of down and up: excluded" in problem.report()


def test_only_the_excluded_pair_is(tmp_path):
    """One link passes the floor and the other meets it; a file keeps that."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(HOPPER, position=(0, 0, 0.9), name="robot")
    links = sorted(name for name in scene._items.parts() if name.startswith("robot/"))
    for out in links:
        other = mbvi.Scene()
        other.add_halfspace((0, 0, 1), name="floor")
        other.add_urdf(HOPPER, position=(0, 0, 0.9), name="robot")
        other.exclude(out, "floor")
        problem = other.build()
        assert named(problem) == named(scene.build()) - {f"{out} | floor"}
    mbvi.simulate(problem, mbvi.Paoli(), step=H, duration=H, progress=False).save(tmp_path / "run.h5")
    assert named(mbvi.load(tmp_path / "run.h5").problem) == named(problem)


def named(problem):
    return {
        problem.constraints.name(k) for k in range(len(problem.constraints)) if "floor" in problem.constraints.name(k)
    }


def test_spheres_of_one_group_pass_each_other():
    def build(scene, out):
        scene.add_spheres([(0, 0, 0), (0.5, 0, 0)], 0.1, 1.0, [(4, 0, 0), (-4, 0, 0)], "balls")
        if out:
            scene.exclude("balls", "balls")

    assert moved(lambda s: build(s, False), "balls", False)[1]
    assert not moved(lambda s: build(s, True), "balls", False)[1]


def everything():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((1, 0, 0), -50.0, name="wall")
    scene.add_container((-60, -60, -60), (60, 60), name="container")
    scene.add_surface(*GROUND, name="mesh")
    scene.add_box((1, 1, 1), position=(9, 0, 9), name="box")
    scene.add_box((1, 1, 1), position=(9, 9, 9), name="slab", fixed=True)
    scene.add_sphere(0.1, position=(0, 9, 9), name="ball")
    scene.add_spheres([(0, 0, 9), (0, 1, 9)], 0.1, 1.0, name="balls")
    scene.add_urdf(HOPPER, position=(0, 0, 9), name="hopper")
    scene.add_urdf(DATA / "fingers.urdf", position=(0, 0, 9), name="fingers", locked=["follower"])
    return scene


NEVER = [
    ("box", "box"), ("ball", "ball"), ("floor", "floor"), ("floor", "wall"), ("floor", "slab"), ("mesh", "slab"),
    ("mesh", "mesh"), ("container", "container/floor"), ("container", "container"), ("slab", "slab"),
    ("fingers", "floor"), ("fingers", "fingers"), ("fingers/one", "box"), ("hopper/foot", "hopper/foot"),
]  # fmt: skip
SOMETIMES = [
    ("box", "floor"), ("box", "ball"), ("ball", "balls"), ("balls", "balls"), ("hopper", "floor"), ("mesh", "ball"),
    ("hopper", "box"), ("hopper/foot", "container"), ("hopper/foot", "container/left"),
]  # fmt: skip


@pytest.mark.parametrize("call", ["set_friction", "set_restitution", "exclude"])
@pytest.mark.filterwarnings("ignore:contacts of fingers")
def test_what_is_said_of_pairs_that_never_touch_is_refused(call):
    scene = everything()
    more = () if call == "exclude" else (0.5,)
    for first, second in NEVER:
        for pair in ((first, second), (second, first)):
            with pytest.raises(mbvi.InputError, match="no pair of"):
                getattr(scene, call)(*pair, *more)
    for first, second in SOMETIMES:
        for pair in ((first, second), (second, first)):
            getattr(scene, call)(*pair, *more)
    with pytest.raises(mbvi.InputError, match="unknown name 'nothing'"):
        getattr(scene, call)("nothing", "floor", *more)


def test_a_link_of_several_shapes_goes_by_its_name(tmp_path):
    text = (DATA / "fingers.urdf").read_text()
    two = "".join(
        f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius=".1"/></geometry></collision>' for x in (0, 1)
    )
    file = tmp_path / "fingers.urdf"
    file.write_text(text.replace('<link name="palm">', f'<link name="palm">{two}'))
    scene = mbvi.Scene(friction=0.1)
    scene.add_halfspace((0, 0, 1), -5.0, name="floor")
    scene.add_urdf(file, name="robot", locked=["follower"])
    scene.set_friction("robot/palm", "floor", 0.5)
    family = next(f for f in scene.build().constraints.families if f.name(0).endswith("floor"))
    assert np.asarray(family.friction).tolist() == [0.5, 0.5]


@pytest.mark.parametrize("last", [0, 1])
@pytest.mark.parametrize("said_before", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_of_settings_equally_near_to_a_pair_the_last_said_holds(last, said_before, turned):
    """One names a body and a group, the other the other group and a body: the order of the bodies does not matter."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    groups = [("up", (0, 0, 1.0), (0, 0, -1)), ("down", (0, 0, 0), (0, 0, 0))]
    for name, at, velocity in groups[::-1] if turned else groups:
        scene.add_boxes([at], (0.2, 0.2, 0.2), 1.0, velocities=[velocity], name=name)
    settings = [("up[0]", "down", 1.0), ("up", "down[0]", 0.5)]
    if said_before:
        # what is said once more is the last said
        scene.set_restitution(*settings[last])
        scene.set_friction(*settings[last])
    for names in (settings[1 - last], settings[last]):
        scene.set_restitution(*names)
        scene.set_friction(*names)
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-2, duration=1.0)
    e = settings[last][2]
    assert run.impacts
    np.testing.assert_allclose(run.impacts[0].after, -e * run.impacts[0].before, rtol=1e-12)
    rows = problem.constraints.active(0.0, problem.q0, 1.0)
    assert rows.tangents is not None
    assert (rows.tangents.friction == e).all()
