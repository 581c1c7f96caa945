"""Visual shapes in the replay: where Pinocchio has them, in the colours of their files, and what is shown without."""

import base64
import json
import re
import xml.etree.ElementTree as ElementTree
import zlib

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.results.replay.browser import Browser
from mbvi.results.replay.page import Page
from mbvi.results.replay.replay import page_of
from mbvi.scene.inputs import mesh_of
from mbvi.scene.meshes.collada import collada_mesh
from mbvi.scene.meshes.visual import Mesh, visual_mesh
from mbvi.scene.urdf.visuals import visual_shapes
from support.browser import HEIGHT, WIDTH, distinct_colors, look, needs_browser
from support.browser import shown as page_shown
from support.paths import REAL_ROBOTS, ROBOTS, real_robot

G1 = "g1_description/urdf/g1_29dof_rev_1_0.urdf"
GO2 = "go2_description/urdf/go2.urdf"
SIDES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
LINK = """<link name="{name}"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>"""
VISUAL = '<visual><geometry><mesh filename="{mesh}"/></geometry>{material}</visual>'
TOUCH = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def short(scene):
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.02, progress=False)


def drawn(run, shapes="visual"):
    """The instances that a page shows at first: (column, color, material) of each; column -1 is the world."""
    page = page_of(run, shapes)
    meshes = [c["object"] for c in page.commands if c["type"] == "set_object" and "/instances/" in c["path"]]
    found = []
    for group, mesh in zip(page.data["groups"], meshes, strict=True):
        columns, kinds, rows = (
            np.frombuffer(zlib.decompress(base64.b64decode(group[name])), kind)
            for name, kind in (("columns", np.int32), ("kinds", np.uint8), ("rows", np.float32))
        )
        for column, kind, row in zip(columns, kinds, rows.reshape(-1, 15), strict=True):
            if kind & page.data["shapes"]:
                found.append((int(column), tuple(row[:3].tolist()), mesh["materials"][0]))
    return found


def robot_file(folder, links, extra=""):
    """A URDF of links in a row, each what is given of it."""
    text = "".join(LINK.format(name=f"link{k}", more=more) for k, more in enumerate(links))
    for k in range(1, len(links)):
        text += (
            f'<joint name="joint{k}" type="revolute"><parent link="link{k - 1}"/><child link="link{k}"/>'
            '<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="robot">{extra}{text}</robot>')
    return path


def write_obj(path, points, triangles=SIDES, head=""):
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in np.asarray(points).tolist())
    path.write_text(head + text + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in np.asarray(triangles).tolist()))


def pinocchio_places(path, base, q):
    """Every visual shape of a URDF as Pinocchio places it at a configuration of the whole robot, by link and number."""
    root = [pin.JointModelFreeFlyer()] if base == "free" else []
    model = pin.buildModelFromUrdf(str(path), *root)
    folders = [str(p) for p in path.parents]
    geometry = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.VISUAL, package_dirs=folders)
    data, places = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, places, q)
    items = list(geometry.geometryObjects)
    links = [item.name.rsplit("_", 1)[0] for item in items]
    names = [link if links.count(link) == 1 else item.name for link, item in zip(links, items, strict=True)]
    return {name: (pose.copy(), item) for name, pose, item in zip(names, places.oMg, items, strict=True)}


def our_places(problem, q, robot):
    shapes, notes = visual_shapes(problem.scene)
    assert not notes
    found = {}
    for shape in shapes:
        name = shape.name.partition("/")
        if name[0] == robot:
            place = problem.system.placements(q, np.array([shape.body]))[0] if shape.body else np.eye(4, 3)
            body = pin.SE3(place[:3].T.copy(), place[3].copy())
            found[name[2]] = (body * pin.SE3(shape.rotation, shape.position), shape.shape)
    return found


CASES = {
    "quadruped": (ROBOTS / "quadruped/quadruped.urdf", "free", {"locked": ["FL_hip_joint", "RR_calf_joint"]}, None),
    "hopper": (ROBOTS / "hopper/hopper.urdf", "fixed", {"locked": ["hip"]}, None),
    "planar hopper": (ROBOTS / "hopper/hopper.urdf", "free", {}, "xz"),
    "go2": (REAL_ROBOTS / GO2, "free", {}, None),
    "panda": (REAL_ROBOTS / "panda_description/urdf/panda.urdf", "fixed", {"locked": ["panda_joint3"]}, None),
    "anymal": (REAL_ROBOTS / "anymal_b_simple_description/robots/anymal.urdf", "free", {}, None),
    "solo12": (REAL_ROBOTS / "solo_description/robots/solo12.urdf", "free", {}, None),
    "talos": (REAL_ROBOTS / "talos_data/robots/talos_reduced.urdf", "free", {}, None),
    "laikago": (REAL_ROBOTS / "laikago_description/urdf/laikago.urdf", "free", {}, None),
    "g1": (REAL_ROBOTS / G1, "free", {}, None),
}


SLOW = ("anymal", "solo12", "talos", "laikago", "g1")


@pytest.mark.parametrize("kind", [pytest.param(k, marks=[pytest.mark.slow] * (k in SLOW)) for k in CASES])
def test_every_visual_shape_is_where_pinocchio_has_it(kind):
    path, base, options, plane = CASES[kind]
    turn = Rotation.from_euler("y" if plane else "xyz", 0.3 if plane else [0.2, 0.3, 0.4])
    position = (0.4, 0, 5) if plane else (0.4, -0.3, 5)
    scene = mbvi.Scene(plane=plane)
    # what comes before must not shift the numbers of bodies
    scene.add_urdf(ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", position=(9, 0, 9), locked=[])
    scene.add_urdf(path, base, position, turn, name="it", **options)
    item = scene._items.robots[1]
    problem = scene.build()
    ours = our_places(problem, problem.q0, "it")
    theirs = pinocchio_places(path, base, item.q0)
    assert set(ours) == set(theirs)
    pose = pin.SE3(turn.as_matrix(), np.array(position, dtype=float))
    for name, (place, item) in theirs.items():
        # Pinocchio's fixed base stands at the origin
        wanted = pose * place if base == "fixed" else place
        got, shape = ours[name]
        np.testing.assert_allclose(got.homogeneous, wanted.homogeneous, atol=1e-9)
        if isinstance(shape, Mesh):
            vertices = np.array(item.geometry.vertices()) if hasattr(item.geometry, "vertices") else None
            size = np.abs(vertices).max()
            for side in (np.min, np.max):
                np.testing.assert_allclose(side(shape.vertices, axis=0), side(vertices, axis=0), atol=1e-5 * size)


def test_several_robots_and_other_things_are_all_shown():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    for k in range(3):
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(k, 0, 2), name=f"h{k}")
    scene.add_box((0.1, 0.1, 0.1), position=(0, 3, 1))
    scene.add_box((0.1, 0.1, 0.1), position=(0, 4, 1), fixed=True)
    scene.add_sphere(0.1, position=(0, 5, 1))
    found = drawn(short(scene))
    visuals = len(ElementTree.parse(ROBOTS / "hopper/hopper.urdf").findall("link/visual"))
    assert len(found) == 3 * visuals + 3
    assert sum(column < 0 for column, *_ in found) == 1


def test_collision_shapes_are_shown_where_asked_for():
    scene = mbvi.Scene()
    scene.add_urdf(real_robot(GO2), position=(0, 0, 1), name="go2")
    run = short(scene)
    shapes = run.problem.scene.shapes
    assert len(drawn(run, "collision")) == len(shapes) != len(drawn(run))


@pytest.mark.parametrize("wrong", ["visuals", "", None, 3, ["visual"]])
def test_another_word_for_the_shapes_is_refused(wrong, tmp_path):
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1))
    run = short(scene)
    for play in (lambda: run.replay(shapes=wrong), lambda: run.replay_html(tmp_path / "page.html", shapes=wrong)):
        with pytest.raises(mbvi.InputError, match="shapes"):
            play()
    assert not list(tmp_path.iterdir())


def test_colours_are_those_of_the_urdf(tmp_path):
    """Named for the robot, named in another link, of its own, half transparent, unknown, none."""
    materials = [
        '<material name="red"/>',
        '<material name="blue"><color rgba="0 0 1 1"/></material>',
        '<material name="blue"/>',
        '<material name="red"><color rgba="0 1 0 0.5"/></material>',
        '<material name=""><color rgba="1 1 0 1"/></material>',
        '<material name="unknown"/>',
        "",
    ]
    box = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry>{}</visual>'
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    path = robot_file(tmp_path, [TOUCH + box.format(m) for m in materials], red)
    scene = mbvi.Scene()
    scene.add_urdf(path, position=(0, 0, 1))
    found = [shape.color for shape in visual_shapes(short(scene).problem.scene)[0]]
    assert found[:5] == [(1, 0, 0, 1), (0, 0, 1, 1), (0, 0, 1, 1), (0, 1, 0, 0.5), (1, 1, 0, 1)]
    assert found[5] == found[6]
    shapes = sorted(drawn(short(scene)), key=lambda one: one[0])
    assert [color for _, color, _ in shapes[:5]] == [(1, 0, 0), (0, 0, 1), (0, 0, 1), (0, 1, 0), (1, 1, 0)]
    assert [(m["transparent"], m["opacity"]) for _, _, m in shapes[2:4]] == [(False, 1.0), (True, 0.5)]


def file_colours(path):
    """The diffuse colours that a DAE file names, read as text."""
    text = path.read_text(encoding="utf-8")
    return {tuple(map(float, c.split()[:3])) for c in re.findall(r'<color sid="diffuse">([^<]*)<', text)}


@pytest.mark.parametrize("part", ["base", "hip", "thigh", "calf", "foot"])
def test_colours_of_a_mesh_file_go_before_the_urdfs(part):
    """Go2's URDF calls every link white."""
    scene = mbvi.Scene()
    scene.add_urdf(real_robot(GO2), position=(0, 0, 1), name="go2")
    link = {"base": "base", "hip": "FL_hip", "thigh": "FL_thigh", "calf": "FL_calf", "foot": "FL_foot"}[part]
    shapes = {s.name: s for s in visual_shapes(scene.build().scene)[0]}
    found = np.unique(shapes[f"go2/{link}"].shape.colors, axis=0)
    wanted = np.array(sorted(file_colours(real_robot(f"go2_description/visuals/{part}.dae"))))
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_parts_of_a_mesh_without_a_colour_take_the_urdfs(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    (tmp_path / "part.mtl").write_text("newmtl teal\nKd 0 0.5 0.5\nnewmtl picture\nKd 1 1 1\nmap_Kd a.png\n")
    faces = ["usemtl teal", "f 1 3 2", "usemtl picture", "f 1 2 4", "usemtl nowhere", "f -4 -1 -2", "f 2 3 4"]
    lines = ["mtllib part.mtl", *(f"v {x} {y} {z}" for x, y, z in points), *faces]
    (tmp_path / "part.obj").write_text("\n".join(lines))
    visual = VISUAL.format(mesh="part.obj", material='<material name="x"><color rgba="1 0 0 1"/></material>')
    scene = mbvi.Scene()
    scene.add_urdf(robot_file(tmp_path, [visual, TOUCH]), position=(0, 0, 1))
    (shape,), _ = visual_shapes(scene.build().scene)
    colours = shape.shape.colors[shape.shape.triangles]
    np.testing.assert_allclose(colours[0], [[0, 0.5, 0.5]] * 3)
    np.testing.assert_allclose(colours[1:], np.broadcast_to([1.0, 0, 0], (3, 3, 3)))
    np.testing.assert_allclose(shape.shape.vertices[shape.shape.triangles], points[SIDES], atol=1e-7)


def test_links_without_a_visual_shape_show_nothing_unless_none_has_one(tmp_path):
    box = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
    for links, shown in (([TOUCH + box, TOUCH, TOUCH], 1), ([TOUCH, TOUCH, TOUCH], 3)):
        scene = mbvi.Scene()
        scene.add_urdf(robot_file(tmp_path, links), position=(0, 0, 1))
        run = short(scene)
        assert len(drawn(run)) == shown
        assert len(drawn(run, "collision")) == 3
    # what only visual shapes move can be seen too
    scene = mbvi.Scene()
    scene.add_urdf(robot_file(tmp_path, [box, ""]), position=(0, 0, 1))
    run = short(scene)
    assert len(drawn(run)) == 1
    with pytest.raises(mbvi.InputError, match="give the links a <collision>"):
        run.replay_html(tmp_path / "page.html", shapes="collision")


def test_adding_a_robot_reads_no_visual_mesh(tmp_path):
    scene = mbvi.Scene()
    scene.add_urdf(robot_file(tmp_path, [TOUCH + VISUAL.format(mesh="no.stl", material="")]), position=(0, 0, 1))
    run = short(scene)
    page = tmp_path / "page.html"
    with pytest.warns(mbvi.MbviWarning, match=r"robot is shown by its collision shapes: mesh 'no\.stl' is not found"):
        run.replay_html(page)
    assert page.is_file()


def test_a_loaded_run_looks_the_same_while_its_mesh_files_are_there(tmp_path):
    write_obj(tmp_path / "part.obj", np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]))
    path = robot_file(tmp_path, [TOUCH + VISUAL.format(mesh="part.obj", material="")] * 2)
    scene = mbvi.Scene()
    scene.add_urdf(path, position=(0, 0, 1))
    run = short(scene)
    run.save(tmp_path / "run.h5")
    pages = [tmp_path / f"{k}.html" for k in range(3)]
    run.replay_html(pages[0])
    mbvi.load(tmp_path / "run.h5").replay_html(pages[1])
    assert pages[0].read_bytes() == pages[1].read_bytes()
    (tmp_path / "part.obj").unlink()
    for gone in (run, mbvi.load(tmp_path / "run.h5")):
        with pytest.warns(mbvi.MbviWarning, match=r"robot is shown by its collision shapes: mesh 'part\.obj' is not"):
            gone.replay_html(pages[2])
    collision = tmp_path / "collision.html"
    run.replay_html(collision, shapes="collision")
    assert pages[2].read_bytes() == collision.read_bytes()


def test_a_mesh_used_many_times_is_stored_once(tmp_path):
    points = np.random.default_rng(0).normal(size=(3000, 3))
    write_obj(tmp_path / "part.obj", points, np.arange(3000).reshape(-1, 3))
    sizes = []
    for count in (1, 9):
        scene = mbvi.Scene()
        scene.add_urdf(robot_file(tmp_path, [TOUCH + VISUAL.format(mesh="part.obj", material="")] * count))
        page = tmp_path / f"{count}.html"
        short(scene).replay_html(page)
        sizes.append(page.stat().st_size)
    mesh = 3000 * (3 + 1) * 4 * 4 / 3
    assert sizes[1] - sizes[0] < 0.5 * mesh


def test_page_commands_come_back_as_they_were():
    page = Page()
    array = umsgpack.Ext(0x17, np.random.default_rng(1).normal(size=900).astype(np.float32).tobytes())
    page.commands = [{"a": [array, {"b": array}], "n": k} for k in range(3)] + [{"d": "no array"}]
    (texts,) = re.findall(r"^const COMMANDS = (\[.*\]);$", page.html(), re.M)
    assert [umsgpack.unpackb(base64.b64decode(text)) for text in json.loads(texts)] == page.commands


def test_the_command_line_has_both_kinds_of_shapes(tmp_path, monkeypatch, capsys):
    from mbvi.cli.main import main

    monkeypatch.chdir(tmp_path)
    path = robot_file(tmp_path, [TOUCH + VISUAL.format(mesh="no.stl", material=""), TOUCH])
    pages = {}
    for shapes in ("visual", "collision"):
        with pytest.raises(SystemExit) as stop:
            out = ["--duration", "0.01", "--out", "run.h5", "--replay", "a.html"]
            main(["simulate", str(path), *out, "--shapes", shapes])
        assert stop.value.code == 0
        assert ("is shown by its collision shapes" in capsys.readouterr().out) == (shapes == "visual")
        with pytest.raises(SystemExit) as stop:
            main(["replay", "run.h5", "--html", "b.html", "--shapes", shapes])
        assert stop.value.code == 0
        pages[shapes] = (tmp_path / "b.html").read_bytes()
        assert (tmp_path / "a.html").read_bytes() == pages[shapes]
        capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        main(["replay", "run.h5", "--html", "b.html", "--shapes", "none"])
    assert stop.value.code == 2


SOME = [pytest.param(f"{name}_description", marks=pytest.mark.slow) for name in ("panda", "ur", "icub", "kinova")]


@pytest.mark.parametrize("folder", ["go2_description", *SOME])
def test_collada_files_have_the_vertices_that_coal_reads(folder):
    files = sorted((REAL_ROBOTS / folder).rglob("*.dae"))
    assert files
    for file in files:
        found = collada_mesh(file)
        assert found is not None
        vertices, size = mesh_of(file)[0], np.abs(mesh_of(file)[0]).max()
        used = found[0]
        np.testing.assert_allclose(used.min(axis=0), vertices.min(axis=0), atol=1e-5 * size)
        np.testing.assert_allclose(used.max(axis=0), vertices.max(axis=0), atol=1e-5 * size)


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}"/></asset>
<library_effects><effect id="e"><profile_COMMON><technique><phong><diffuse><color>0.25 0.5 0.75 1</color></diffuse>
</phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="{count}">{points}</float_array>
<technique_common><accessor source="#a" count="{n}" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles material="x" count="{half}"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#s" offset="1"/><p>{first}</p></triangles>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>{sides}</vcount><p>{polygon}</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>{shift}</translate><rotate>{axis} {angle}</rotate>
<node><scale>{scale}</scale><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="x" target="#m"/></technique_common></bind_material></instance_geometry></node></node>
<node><matrix>{matrix}</matrix><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def words(numbers):
    return " ".join(map(repr, np.asarray(numbers).ravel().tolist()))


def write_dae(path, random, sides):
    """Write a file of four triangles and a polygon, shown twice; return its triangles, shape (t, 3, 3) [m]."""
    n, unit = sides + 2, float(random.uniform(0.001, 2))
    points, shift, scale = random.normal(size=(n, 3)), random.normal(size=3), random.uniform(0.1, 3, size=3)
    axis, angle = random.normal(size=3), float(random.uniform(-300, 300))
    axis /= np.linalg.norm(axis)
    matrix = np.eye(4)
    matrix[:3] = random.normal(size=(3, 4))
    triangles, polygon = random.integers(n, size=(4, 3)), random.permutation(n)[:sides]
    # beside each vertex stands the number of a normal
    pairs = np.stack([triangles.ravel(), random.integers(n, size=12)], axis=1)
    path.write_text(
        DAE.format(
            unit=unit, count=3 * n, points=words(points), n=n, half=4, first=words(pairs), sides=sides,
            polygon=words(polygon), shift=words(shift), axis=words(axis), angle=angle, scale=words(scale),
            matrix=words(matrix),
        )
    )  # fmt: skip
    fan = np.array([[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, sides - 1)])
    corners = points[np.concatenate([triangles, fan])]
    turn = Rotation.from_rotvec(np.radians(angle) * axis).as_matrix()
    one = unit * ((scale * corners) @ turn.T + shift)
    other = unit * (corners @ matrix[:3, :3].T + matrix[:3, 3])
    return np.concatenate([one, other])


@given(st.integers(0, 2**32 - 1), st.integers(3, 7))
def test_collada_nodes_units_and_polygons(tmp_path_factory, seed, sides):
    path = tmp_path_factory.mktemp("dae") / "part.dae"
    wanted = write_dae(path, np.random.default_rng(seed), sides)
    vertices, faces, colors = collada_mesh(path)
    np.testing.assert_allclose(vertices[faces], wanted, atol=1e-9)
    named = np.full(wanted.shape, np.nan)
    named[:4] = 0.25, 0.5, 0.75
    np.testing.assert_allclose(colors[faces], named)
    mesh = visual_mesh(path, np.array([2.0, -1.0, 0.5]))
    np.testing.assert_allclose(mesh.vertices[mesh.triangles], vertices[faces] * [2, -1, 0.5], rtol=1e-6, atol=1e-6)


@given(st.integers(0, 2**32 - 1))
def test_damaged_mesh_files_are_refused_or_shown(tmp_path_factory, seed):
    """None of them raises anything but an InputError, on which the collision shapes are shown."""
    random = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("damaged") / ("part.dae", "part.obj")[seed % 2]
    if path.suffix == ".dae":
        write_dae(path, random, 5)
    else:
        write_obj(path, random.normal(size=(4, 3)), head="# four faces\no part\n")
    data = bytearray(path.read_bytes())
    if random.random() < 0.5:
        del data[random.integers(len(data)) :]
    for at in random.integers(len(data), size=5) if data else ():
        data[at] = random.choice(list(b"0 <>/-#\nnan9xe"))
    path.write_bytes(data)
    try:
        mesh = visual_mesh(path, np.ones(3))
    except mbvi.InputError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert 0 <= mesh.triangles.min() <= mesh.triangles.max() < len(mesh.vertices)


@pytest.mark.slow
@needs_browser
def test_a_browser_shows_g1_with_its_feet(tmp_path):
    path = real_robot(G1)
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(path, position=(0, 0, 1.0))
    run = short(scene)
    page = tmp_path / "g1.html"
    run.replay_html(page)
    assert page.stat().st_size < 12e6
    links = ElementTree.parse(path).findall("link")
    visuals = [link.get("name") for link in links for _ in link.findall("visual")]
    assert {"left_ankle_roll_link", "right_ankle_roll_link"} <= set(visuals)
    ask = """replay.groups.flatMap(g => g.shown.map((k, n) => [g.columns[k],
        Math.round(255 * g.mesh.instanceColor.array[3 * n])]))"""
    with Browser(WIDTH, HEIGHT) as browser:
        page_shown(browser, page)
        found = browser.evaluate(ask)
        feet = [
            browser.evaluate("DATA.names").index(name)
            for name in browser.evaluate("DATA.names")
            if "ankle_roll" in name
        ]
        assert distinct_colors(look(browser, 0.0)) > 500
    assert len(found) == len(visuals) and len(feet) == 2
    assert {color for column, color in found if column in feet} == {round(0.2 * 255)}


@needs_browser
def test_a_browser_shows_go2_in_its_colours(tmp_path):
    scene = mbvi.Scene()
    scene.add_urdf(real_robot(GO2), position=(0, 0, 1.0))
    run = short(scene)
    page = tmp_path / "go2.html"
    run.replay_html(page)
    ask = """[...new Set(replay.groups.filter(g => g.colored && g.mesh.geometry.attributes.color).flatMap(g => {
        const c = g.mesh.geometry.attributes.color; return [`${c.getX(0)},${c.getY(0)},${c.getZ(0)}`]; }))]"""
    with Browser(WIDTH, HEIGHT) as browser:
        page_shown(browser, page)
        assert "0,0,0" in browser.evaluate(ask)
        # the feet are black; the collision shapes are white all over; the panel is at the right
        assert (look(browser, 0.0)[:390, :420].max(axis=2) < 12).sum() > 20
        browser.evaluate("replay.choose(2)")
        assert (look(browser, 0.0)[:390, :420].max(axis=2) < 12).sum() == 0


def area(corners):
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()


@pytest.mark.parametrize("seed", range(5))
def test_a_surface_of_several_meshes_has_all_their_triangles(tmp_path, seed):
    """Coal's loader joins triangles of all but the first at wrong vertices."""
    path = tmp_path / "part.dae"
    wanted = write_dae(path, np.random.default_rng(seed), 5)
    scene = mbvi.Scene()
    scene.add_surface(path)
    surface = scene._items.surfaces[0].surface
    assert area(surface.vertices[surface.triangles]) == pytest.approx(area(wanted), rel=1e-6)


ONE_LINK = """<robot name="part"><link name="part"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><mesh filename="part.dae" scale="1 2 .5"/></geometry></collision></link></robot>"""
# a tetrahedron whose node is shifted by (5, 0, 0)
TETRAHEDRON = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{unit}<up_axis>Y_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node><translate>5 0 0</translate>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize(("unit", "metres"), [("", 1.0), ('<unit meter="0.01" name="cm"/>', 0.01)])
def test_hulls_have_the_unit_of_a_collada_file(tmp_path, unit, metres):
    """As what is shown has, and meshes as they are."""
    (tmp_path / "part.dae").write_text(TETRAHEDRON.format(unit=unit))
    (tmp_path / "part.urdf").write_text(ONE_LINK)
    scene = mbvi.Scene()
    scene.add_mesh(tmp_path / "part.dae", name="mesh")
    scene.add_mesh(tmp_path / "part.dae", name="rock", convex=False)
    scene.add_urdf(tmp_path / "part.urdf", name="robot")
    items = scene._items
    hulls = items.bodies[0].shape, items.surfaces[0].surface, items.robots[0].robot.shapes[0].shape
    for points, scale in zip((one.vertices for one in hulls), (1.0, 1.0, np.array([1, 2, 0.5])), strict=True):
        np.testing.assert_allclose(np.min(points, axis=0), metres * scale * np.array([5, 0, 0]), atol=1e-7)
        np.testing.assert_allclose(np.max(points, axis=0), metres * scale * np.array([6, 2, 3]), rtol=1e-6)
