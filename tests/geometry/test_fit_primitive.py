"""Simpler shapes for hulls: the stated distance bounds the true one, and what is exact moves the same."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.geometry.shapes.fit_primitive import fit_primitive
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Hull, Sphere

BOX = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.15, 0.15) for z in (-0.05, 0.05)])


def support(shape, u):
    """Support function along directions of shape (n, 3)."""
    across = np.hypot(u[:, 0], u[:, 1])
    match shape:
        case Sphere():
            return np.full(len(u), shape.radius)
        case Box():
            return np.abs(u) @ (0.5 * np.array(shape.size))
        case Capsule():
            return np.abs(u[:, 2]) * 0.5 * shape.length + shape.radius
        case Cylinder():
            return np.abs(u[:, 2]) * 0.5 * shape.length + shape.radius * across
        case Hull():
            return (u @ shape.vertices.T).max(axis=1)


def apart(hull, found, rng):
    """The Hausdorff distance of convex bodies is that of their support functions: this samples it from below."""
    u = rng.normal(size=(4000, 3))
    # where it is largest as a rule
    u = np.concatenate([u, hull.vertices - hull.vertices.mean(axis=0), hull.faces[0]])
    u /= np.linalg.norm(u, axis=1)[:, None]
    other = support(found.shape, u @ found.rotation) + u @ found.position
    return np.abs(other - support(hull, u)).max()


def ring(n, radius, height):
    angle = 2 * np.pi * np.arange(n) / n
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, height)], axis=1)


def ball(n, radius):
    heights = radius * np.sin(np.linspace(-0.5, 0.5, n + 1) * np.pi)
    return np.concatenate([ring(2 * n, np.sqrt(max(radius**2 - z**2, 0.0)), z) for z in heights])


CAPSULE = np.concatenate([ball(12, 0.1) + np.array([0, 0, z]) for z in (-0.2, 0.2)])
MESHES = {
    "box": (BOX, Box, 1e-12),
    "bevelled box": (np.concatenate([BOX * (1 - 0.01 * np.eye(3)[k]) for k in range(3)]), Box, 3e-3),
    "cylinder": (np.concatenate([ring(48, 0.1, -0.2), ring(48, 0.1, 0.2)]), Cylinder, 3e-4),
    "disk": (np.concatenate([ring(48, 0.3, -0.02), ring(48, 0.3, 0.02)]), Cylinder, 6e-4),
    "ball": (ball(16, 0.2), Sphere, 4e-3),
    "capsule": (CAPSULE, Capsule, 3e-3),
}


@pytest.mark.parametrize("kind", MESHES)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_primitive_is_found_wherever_it_lies(kind, seed):
    rng = np.random.default_rng(seed)
    points, shape, tolerance = MESHES[kind]
    turn = Rotation.random(random_state=rng).as_matrix()
    hull = Hull(points @ turn.T + rng.normal(size=3))
    found = fit_primitive(hull, tolerance)
    assert isinstance(found.shape, shape)
    assert apart(hull, found, rng) <= found.distance + 1e-14
    assert found.distance <= tolerance
    # and not by much more than it is
    assert found.distance < 2.5 * apart(hull, found, rng) + 1e-14
    # at 0 only what is exact
    assert (fit_primitive(hull, 0.0) is None) == (kind != "box")


@given(seed=st.integers(0, 2**32 - 1), tolerance=st.floats(1e-3, 0.3))
def test_fewer_vertices_keep_within_the_tolerance(seed, tolerance):
    rng = np.random.default_rng(seed)
    hull = Hull(rng.normal(size=(80, 3)) * rng.uniform(0.2, 1.0, size=3) + rng.normal(size=3))
    found = fit_primitive(hull, tolerance)
    if found is not None and isinstance(found.shape, Hull):
        assert len(found.shape.vertices) < len(hull.vertices)
        assert apart(hull, found, rng) <= found.distance + 1e-14 <= tolerance + 1e-14


def test_a_fine_hull_loses_most_of_its_vertices(rng):
    egg = Hull(ball(24, 1.0) * [0.1, 0.15, 0.3])
    found = fit_primitive(egg, 2e-3)
    assert isinstance(found.shape, Hull)
    assert len(found.shape.vertices) < 0.5 * len(egg.vertices)
    assert apart(egg, found, rng) <= 2e-3


def box_file(tmp_path, points=BOX):
    hull = Hull(points)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in hull.vertices.tolist()]
    lines += ["f " + " ".join(str(k + 1) for k in t) for t in hull.triangles.tolist()]
    (tmp_path / "block.obj").write_text("\n".join(lines) + "\n")
    return tmp_path / "block.obj"


def falling(tmp_path, e=0.5):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    # the mesh's frame is off its centre
    turn = Rotation.from_euler("xyz", [0.3, 0.4, 0.1]).as_matrix()
    file = box_file(tmp_path, BOX + np.array([0.03, 0.02, 0.01]))
    scene.add_mesh(file, 2.0, position=(0, 0, 0.4), rotation=turn, velocity=(0.2, 0, -1), name="block")
    scene.add_sphere(0.1, 1.0, position=(0.05, 0.02, 0.8), velocity=(0, 0, -2))
    scene.add_mesh(box_file(tmp_path), fixed=True, position=(1, 0, 0.5), rotation=turn, name="ramp")
    scene.add_sphere(0.05, 1.0, position=(1, 0, 0.8), velocity=(0, 0, -3))
    return scene


@pytest.mark.parametrize(
    "scheme", [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.SchatzmanPaoli(), mbvi.StewartTrinkle()]
)
def test_a_block_moves_as_its_mesh(scheme, tmp_path):
    scene = falling(tmp_path, 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.5)
    reduced, full = scene.build(), scene.build(reduce=())
    kinds = [type(next(s for s in p.scene.shapes if s.name == "block").shape) for p in (reduced, full)]
    assert kinds == [Box, Hull]
    assert "hull block: replaced by a box, " in reduced.report()
    assert reduced.tolerance == full.tolerance
    runs = [mbvi.simulate(p, scheme, step=1e-3, duration=0.3) for p in (reduced, full)]
    assert {"block", "ramp"} <= {name.split(" | ")[0] for i in runs[0].impacts for name in i.constraints}
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-9)


def test_a_tolerance_is_kept_with_the_run(tmp_path):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_convex(MESHES["cylinder"][0], [(0, 0, 1), (1, 0, 1)], density=1000.0, tolerance=1e-3)
    problem = scene.build()
    assert "hull grains[0] and 1 alike: replaced by a cylinder, " in problem.report()
    assert "saves 140 vertices" in problem.report()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-2, duration=0.1)
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5").problem
    assert again.report() == problem.report()
    np.testing.assert_array_equal(again.system.metric(again.q0).dense(), problem.system.metric(problem.q0).dense())


def test_a_tolerance_must_be_positive(tmp_path):
    with pytest.raises(mbvi.InputError, match="tolerance must be positive"):
        mbvi.Scene().add_mesh(box_file(tmp_path), tolerance=0.0)
