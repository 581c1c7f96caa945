"""Meshes with hollows that move, as convex parts."""

import sys

import numpy as np
import pytest

import mbvi
from mbvi.geometry.shapes.shapes import Hull
from mbvi.scene.meshes.convex_parts import mass_properties


def write_obj(path, points, faces):
    lines = [*("v {:.17g} {:.17g} {:.17g}".format(*p) for p in points), *("f {} {} {}".format(*f) for f in faces)]
    path.write_text("\n".join(lines) + "\n")
    return path


def angle(path):
    """An L 1 m long and high, 0.2 m thick and 0.4 m wide: two boxes."""
    outline = np.array([(0, 0), (1, 0), (1, 0.2), (0.2, 0.2), (0.2, 1), (0, 1)])
    points = [(x, y, z) for y in (0.0, 0.4) for x, z in outline]
    cap = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    sides = [side for k in range(6) for j in [(k + 1) % 6] for side in [(k, k + 6, j + 6), (k, j + 6, j)]]
    faces = [*cap, *((a + 6, c + 6, b + 6) for a, b, c in cap), *sides]
    return write_obj(path / "angle.obj", points, [(a + 1, b + 1, c + 1) for a, b, c in faces])


def ring(path):
    """A torus of the radii 0.3 m and 0.06 m about z."""
    a, b = (np.arange(n) * 2 * np.pi / n for n in (24, 12))
    points = [((0.3 + 0.06 * np.cos(y)) * np.cos(x), (0.3 + 0.06 * np.cos(y)) * np.sin(x), 0.06 * np.sin(y))
              for x in a for y in b]  # fmt: skip
    faces = []
    for i in range(24):
        for j in range(12):
            p, q, r, s = (12 * ((i + k) % 24) + (j + n) % 12 + 1 for k, n in ((0, 0), (1, 0), (0, 1), (1, 1)))
            faces += [(p, q, s), (p, s, r)]
    return write_obj(path / "ring.obj", points, faces)


def test_parts_have_the_mass_properties_of_the_mesh(tmp_path):
    """As near as CoACD cuts: here within a thousandth of the size."""
    scene = mbvi.Scene()
    scene.add_mesh(angle(tmp_path), mass=3.6, decompose=True)
    problem = scene.build()
    assert [s.name for s in problem.scene.shapes] == ["angle[0]", "angle[1]"]
    # 2 kg of 1 m x 0.4 m x 0.2 m and 1.6 kg of 0.2 m x 0.4 m x 0.8 m above one end of it
    masses, centres = np.array([2.0, 1.6]), np.array([(0.5, 0.2, 0.1), (0.1, 0.2, 0.6)])
    sizes = np.array([(1.0, 0.4, 0.2), (0.2, 0.4, 0.8)])
    centre = masses @ centres / 3.6
    np.testing.assert_allclose(problem.q0[:3], centre, rtol=0, atol=1e-3)
    inertia = np.zeros((3, 3))
    for m, c, size in zip(masses, centres - centre, sizes, strict=True):
        inertia += m * (size @ size * np.eye(3) - np.diag(size**2)) / 12 + m * (c @ c * np.eye(3) - np.outer(c, c))
    np.testing.assert_allclose(problem.system.inertias[0], inertia, rtol=0, atol=2e-3)
    (line,) = (one for one in problem.scene.omitted if one.what == "mesh angle")
    assert line.why.startswith("cut into 2 convex parts, together +0.")


def test_the_inertia_of_parts_is_that_of_their_sum():
    """Of boxes, which have it in closed form."""
    low, high = np.array([(0, 0, 0), (0, 0, 0.2)]), np.array([(1.0, 0.4, 0.2), (0.2, 0.4, 1.0)])
    corners = np.array(np.meshgrid((0, 1), (0, 1), (0, 1))).reshape(3, -1).T
    parts = tuple(Hull(a + (b - a) * corners) for a, b in zip(low, high, strict=True))
    centre, inertia = mass_properties(parts, 3.6)
    masses, centres, sizes = np.array([2.0, 1.6]), 0.5 * (low + high), high - low
    np.testing.assert_allclose(centre, masses @ centres / 3.6, rtol=0, atol=1e-15)
    expected = np.zeros((3, 3))
    for m, c, size in zip(masses, centres - centre, sizes, strict=True):
        expected += m * (size @ size * np.eye(3) - np.diag(size**2)) / 12 + m * (c @ c * np.eye(3) - np.outer(c, c))
    np.testing.assert_allclose(inertia, expected, rtol=0, atol=1e-15)


def test_a_ball_falls_into_the_corner_of_an_angle(tmp_path):
    """Where the hull has none, it comes to rest on both legs."""
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_mesh(angle(tmp_path), mass=50.0, decompose=True, name="part")
    scene.add_sphere(0.1, position=(0.31, 0.2, 0.5), velocity=(-0.5, 0, 0), name="ball")
    run = mbvi.simulate(scene.build(), step=1e-3, duration=1.0, progress=False)
    ball, part = run.q[-1, 7:10], run.q[-1, :3] - run.q[0, :3]
    # at the start the leg that stands is between x = 0 and 0.2
    np.testing.assert_allclose(ball[0] - part[0], 0.3, rtol=0, atol=1e-2)
    np.testing.assert_allclose(ball[2], 0.3, rtol=0, atol=1e-2)


@pytest.mark.slow(seconds=6)
def test_a_ring_falls_over_a_pole_and_two_rings_stay_linked(tmp_path):
    scene, file = mbvi.Scene(friction=0.3, restitution=0.2), ring(tmp_path)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_capsule(0.05, 0.8, fixed=True, position=(0, 0, 0.4), name="pole")
    scene.add_mesh(file, 1.0, decompose=0.2, position=(0.1, 0.0, 1.0), rotation=(0.2, 0.1, 0.0), name="around")
    # one stands in the other
    scene.add_mesh(file, 1.0, decompose=0.2, position=(3.0, 0.0, 0.8), name="first")
    scene.add_mesh(file, 1.0, decompose=0.2, position=(3.3, 0.0, 0.8), rotation=(np.pi / 2, 0, 0), name="second")
    run = mbvi.simulate(scene.build(), step=1e-3, duration=1.5, progress=False)
    end = run.q[-1].reshape(3, 7)
    assert end[0, 2] < 0.1 and np.hypot(end[0, 0], end[0, 1]) < 0.25
    # centres of linked rings are no farther apart than two inner radii
    assert np.linalg.norm(run.q[:, 7:10] - run.q[:, 14:17], axis=1).max() < 2 * 0.3
    # an impact goes in by what its speed makes in half a step, at most
    fastest = max(float(-impact.before.min()) for impact in run.impacts)
    assert run.penetration().max() <= 0.5 * run.step * fastest


def test_settings_by_the_name_of_the_body_and_of_a_part_and_files(tmp_path):
    scene = mbvi.Scene(friction=0.1)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_mesh(angle(tmp_path), mass=3.6, decompose=True, position=(0, 0, 0.5), name="part")
    scene.add_sphere(0.1, position=(0.5, 0.2, 1.5), name="ball")
    scene.set_friction("part", "floor", 0.7)
    scene.set_friction("part[1]", "floor", 0.2)
    scene.exclude("part", "ball")
    problem = scene.build()
    rows = problem.constraints
    mu = {rows.name(k): rows.coefficient_of_friction(k) for k in range(len(rows))}
    assert mu == {"part[0] | floor": 0.7, "part[1] | floor": 0.2, "ball | floor": 0.1}
    run = mbvi.simulate(problem, step=1e-3, duration=0.05, progress=False)
    run.save(tmp_path / "run.h5")
    back = mbvi.load(tmp_path / "run.h5").problem
    again = mbvi.simulate(back, step=1e-3, duration=0.05, progress=False)
    assert [s.name for s in back.scene.shapes] == [s.name for s in problem.scene.shapes]
    np.testing.assert_array_equal(again.q, run.q)


def test_what_cannot_be_cut_is_an_error(tmp_path, monkeypatch):
    file, scene = angle(tmp_path), mbvi.Scene()
    with pytest.raises(mbvi.InputError, match=r"from 0\.01 to 1, not 2"):
        scene.add_mesh(file, decompose=2.0)
    with pytest.raises(mbvi.InputError, match="choose"):
        scene.add_mesh(file, decompose=True, convex=False)
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(mbvi.InputError, match=r"pip install 'mbvi\[decompose\]'"):
        scene.add_mesh(file, scale=2.0, decompose=True)
