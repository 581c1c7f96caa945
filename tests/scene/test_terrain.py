"""Height fields and meshes as they are in a scene: from arrays, pictures and files; kept by files; what is refused."""

import itertools

import numpy as np
import pytest

import mbvi

Image = pytest.importorskip("PIL.Image")
BOX = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
# the sides of a cube, outwards
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def write_obj(path, sides=SIDES):
    """A cube of edge 1, its triangles facing outwards."""
    lines = [f"v {x} {y} {z}" for x, y, z in BOX.tolist()]
    for a, b, c, d in sides:
        lines += [f"f {a + 1} {b + 1} {c + 1}", f"f {a + 1} {c + 1} {d + 1}"]
    path.write_text("\n".join(lines) + "\n")
    return path


def with_ball(scene, position=(0.1, 0.2, 3.0), **options):
    scene.add_sphere(0.1, mass=1.0, position=position, **options)
    return scene.build()


def is_on(problem, x, y, z):
    """Whether a point, the centre of the ball, is on the surface: there the sign of its distance changes."""
    family, q = problem.constraints.constraints[0], problem.q0.copy()
    q[:3] = x, y, z
    low, high = (family.gap(0.0, q + np.eye(q.size)[2] * dz)[0] + 0.1 for dz in (-1e-9, 1e-9))
    return low < 0.0 < high


def test_an_array_and_pictures_have_their_heights_where_they_should(tmp_path):
    grey = np.random.default_rng(0).integers(0, 256, (4, 6)).astype(np.uint8)
    grey[0, 0], grey[-1, -1] = 0, 255
    Image.fromarray(grey).save(tmp_path / "hills.png")
    Image.fromarray(grey.astype(np.uint16) * 257).save(tmp_path / "fine.png")
    heights = 0.4 * grey[::-1] / 255.0
    problems = []
    for given, more in ((heights, {}), *((tmp_path / f, {"height": 0.4}) for f in ("hills.png", "fine.png"))):
        scene = mbvi.Scene()
        name = scene.add_heightfield(given, (5.0, 3.0), position=(0.5, -0.5, 0.2), **more)
        assert name == ("field" if given is heights else given.stem)
        problems.append(with_ball(scene))
    for problem in problems:
        for i, j in ((1, 1), (2, 4), (1, 3)):
            # corners of the grid lie 1 m apart
            assert is_on(problem, -2.0 + j, -2.0 + i, 0.2 + heights[i, j])
        # the diagonal of a cell leads from its corner of least x and y
        assert is_on(problem, -0.5, -0.5, 0.2 + 0.5 * (heights[1, 1] + heights[2, 2]))


@pytest.mark.parametrize("motion", [None, mbvi.motion.Oscillation((0, 0, 0.05), frequency=2.0)])
def test_a_scene_with_terrain_is_kept_by_files_and_shown(tmp_path, motion):
    scene = mbvi.Scene(friction=0.4, restitution=0.2)
    x = np.linspace(-1, 1, 21)
    scene.add_heightfield(0.1 * np.add.outer(x**2, x**2), (2.0, 2.0), name="bowl", motion=motion)
    scene.add_mesh(write_obj(tmp_path / "step.obj"), convex=False, scale=0.4, position=(0.8, 0.0, 0.0))
    assert "bowl" in repr(scene) and "step" in repr(scene)
    scene.add_sphere(0.1, mass=1.0, position=(0.1, 0.2, 0.4), name="ball", velocity=(1.0, 0.0, 0.0))
    scene.set_friction("bowl", "ball", 0.1)
    problem = scene.build()
    assert problem.report().count("1 sphere at a mesh") == 2
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=2e-3, duration=0.6)
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    assert again.problem.report() == problem.report()
    items = again.problem.scene.items.surfaces
    assert [item.surface.one_sided for item in items] == [True, True] and items[1].surface.closed
    np.testing.assert_array_equal(items[0].heights, problem.scene.items.surfaces[0].heights)
    repeated = mbvi.simulate(again.problem, mbvi.StewartTrinkle(), step=2e-3, duration=0.6)
    np.testing.assert_array_equal(repeated.q, run.q)
    again.replay_html(tmp_path / "page.html")
    assert "svg" in scene._repr_html_()
    assert run.penetration().max() < 1e-3


def test_a_large_field_is_small_in_a_file(tmp_path):
    x = np.linspace(0.0, 20.0, 300)
    scene = mbvi.Scene()
    scene.add_heightfield(np.sin(np.add.outer(x, x)), (20.0, 20.0))
    mbvi.simulate(with_ball(scene), mbvi.Paoli(), step=1e-3, duration=1e-3).save(tmp_path / "run.h5")
    # eight bytes each, as text a third more
    assert (tmp_path / "run.h5").stat().st_size < 11.0 * x.size**2 + 1e5


def test_a_closed_mesh_is_solid_and_an_open_one_a_sheet(tmp_path):
    solid, sheet = mbvi.Scene(), mbvi.Scene()
    assert solid.add_mesh(write_obj(tmp_path / "box.obj"), convex=False) == "box"
    sheet.add_mesh(write_obj(tmp_path / "tray.obj", SIDES[:5]), convex=False)
    with pytest.raises(mbvi.InadmissibleStartError, match="sphere is within box, whose triangles face outwards"):
        with_ball(solid, (0.0, 0.0, 0.0))
    solid = mbvi.Scene()
    solid.add_mesh(tmp_path / "box.obj", convex=False)
    assert with_ball(solid, (0.0, 0.0, 0.7)).constraints.gap(0.0, np.array([0, 0, 0.45])) == pytest.approx(-0.15)
    # within the tray, whose upper side is open
    assert with_ball(sheet, (0.0, 0.0, 0.3)).constraints.gap(0.0, np.zeros(3)) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s, p: s.add_heightfield(np.zeros((1, 4)), (1, 1)), "two rows and columns at least"),
        (lambda s, p: s.add_heightfield(np.zeros(4), (1, 1)), "rows, columns"),
        (lambda s, p: s.add_heightfield(np.zeros((2, 2)), (1, 0)), "size must be positive"),
        (lambda s, p: s.add_heightfield(np.zeros((2, 2)), (1, 1), height=1.0), "height is for a PNG"),
        (lambda s, p: s.add_heightfield("hills.png", (1, 1)), "give the height of white"),
        (lambda s, p: s.add_heightfield("hills.png", (1, 1), height=1.0), "no such file"),
        (lambda s, p: s.add_heightfield(write_obj(p / "a.png"), (1, 1), height=1.0), "cannot be read as a PNG"),
        (lambda s, p: s.add_mesh("part.stl", convex=False), "no such file"),
        (lambda s, p: s.add_mesh("part.stl", convex=False, fixed=False), "part.stl as it is cannot move freely"),
        (lambda s, p: s.add_mesh("part.stl", 2.0, convex=False), "mass is not for a mesh as it is"),
        (lambda s, p: s.add_mesh("part.stl", convex=False, tolerance=1e-3), "tolerance is not for"),
        (lambda s, p: s.add_mesh("part.stl", convex=False, velocity=(1, 0, 0)), "velocity is not for"),
        (lambda s, p: s.add_mesh("part.stl", convex=False, colour="red"), "unknown argument"),
    ],
)
def test_wrong_terrain_says_what_is_wrong(call, message, tmp_path):
    with pytest.raises(mbvi.InputError, match=message):
        call(mbvi.Scene(), tmp_path)


@pytest.mark.parametrize("line", ["f 1 2 99999999999999999999", "f 1 2 nothing", "f 1_0 2 3"])
def test_numbers_that_no_reader_takes_are_refused(line, tmp_path):
    (tmp_path / "part.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n{line}\n")
    with pytest.raises(mbvi.MbviError, match=r"part\.obj cannot be read as a mesh"):
        mbvi.Scene().add_mesh(tmp_path / "part.obj", convex=False)


def test_a_coloured_picture_is_refused(tmp_path):
    Image.new("RGB", (4, 4)).save(tmp_path / "red.png")
    with pytest.raises(mbvi.InputError, match="has colours"):
        mbvi.Scene().add_heightfield(tmp_path / "red.png", (1, 1), height=1.0)
