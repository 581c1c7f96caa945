"""The file for the Rerun viewer, read back by Rerun's own reader."""

import sys

import numpy as np
import pytest
from rerun.chunk import RrdReader

import mbvi
from mbvi.results.replay.motion import motion
from support.paths import ROBOTS


@pytest.fixture(scope="module")
def run():
    scene = mbvi.Scene(restitution=0.3, friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.55), joints={"knee": 0.4})
    scene.add_box((0.2, 0.1, 0.1), position=(0.6, 0, 0.2), name="box")
    scene.add_capsule(0.05, 0.2, position=(1, 0, 0.2), name="capsule")
    scene.add_ellipsoid((0.05, 0.1, 0.1), position=(2, 0, 0.2), name="ellipsoid")
    points = [[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2]]
    scene.add_convex(points, positions=[[3, 0, 0.2]], mass=1.0, name="wedge")
    drive = mbvi.motion.Oscillation((0, 0, 0.1), 2.0)
    scene.add_cylinder(0.1, 0.2, position=(-1, 0, 0.3), name="piston", fixed=True, motion=drive)
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3, record="contacts")


@pytest.fixture(scope="module")
def read(run, tmp_path_factory):
    """Columns of each entity, those over time and those without time."""
    path = tmp_path_factory.mktemp("rerun") / "run.rrd"
    run.to_rerun(path)
    moving, fixed = {}, {}
    for chunk in RrdReader(path).stream():
        columns = chunk.to_record_batch().to_pydict()
        (fixed if chunk.is_static else moving).setdefault(chunk.entity_path, {}).update(columns)
    return moving, fixed


def seconds(column):
    return np.array([time.total_seconds() for time in column])


def test_poses_are_those_of_the_replay(run, read):
    moves, system = motion(run), run.problem.system
    for b, body in enumerate(moves.bodies):
        # the reader gives names as paths, where brackets are escaped
        name = system.bodies[body].replace("[", r"\[").replace("]", r"\]")
        found = read[0][f"/world/bodies/{name}"]
        assert np.abs(seconds(found["time"]) - moves.times).max() < 1e-6
        for part, values in (("translation", moves.position), ("quaternion", moves.quaternion)):
            # in single precision
            np.testing.assert_allclose(
                np.array(found[f"Transform3D:{part}"])[:, 0], values[:, moves.driven + b], atol=1e-6
            )
    driven = np.array(read[0]["/world/driven/0"]["Transform3D:translation"])[:, 0, 2]
    np.testing.assert_allclose(driven, 0.1 * np.sin(4.0 * np.pi * moves.times), atol=1e-6)


def test_shapes_have_their_kinds_and_sizes(read):
    fixed = read[1]
    assert fixed["/world/bodies/box/box"]["Boxes3D:half_sizes"] == [[pytest.approx([0.1, 0.05, 0.05])]]
    assert fixed["/world/bodies/ellipsoid/ellipsoid"]["Ellipsoids3D:half_sizes"] == [[pytest.approx([0.05, 0.1, 0.1])]]
    capsule = fixed["/world/bodies/capsule/capsule"]
    assert capsule["Capsules3D:lengths"] == [[pytest.approx(0.2)]]
    assert capsule["Capsules3D:translations"] == [[pytest.approx([0.0, 0.0, -0.1])]]
    assert fixed["/world/driven/0/piston"]["Cylinders3D:radii"] == [[pytest.approx(0.1)]]
    corners = np.array(fixed["/world/fixed/floor"]["Mesh3D:vertex_positions"][0])
    assert corners.shape == (4, 3) and np.abs(corners[:, 2]).max() < 1e-6
    wedge = fixed[r"/world/bodies/wedge\[0\]/wedge\[0\]"]
    assert len(wedge["Mesh3D:vertex_positions"][0]) == len(wedge["Mesh3D:triangle_indices"][0]) == 4


def test_energies_and_penetration_are_on_the_timeline(run, read):
    kinetic, potential = run.energies()
    series = {"energy/kinetic": kinetic, "energy/potential": potential, "penetration": run.penetration()}
    for name, values in series.items():
        found = read[0][f"/{name}"]
        assert np.abs(seconds(found["time"]) - run.t).max() < 1e-6
        np.testing.assert_array_equal(np.array(found["Scalars:scalars"])[:, 0], values)
    assert read[1]["/energy/kinetic"]["SeriesLines:names"] == [["kinetic [J]"]]


def test_arrows_of_impacts_appear_and_go(run, read):
    found = read[0]["/world/impacts"]
    times, origins = seconds(found["time"]), found["Arrows3D:origins"]
    impact = next(i for i in run.impacts if np.isfinite(i.normal).all())
    k = int(np.flatnonzero(np.abs(times - impact.time) < 1e-6)[0])
    np.testing.assert_allclose(origins[k], impact.point, atol=1e-6)
    arrow = np.array(found["Arrows3D:vectors"][k][0])
    whole = impact.percussion[0] * impact.normal[0] + impact.tangential[0]
    assert arrow @ whole == pytest.approx(np.linalg.norm(arrow) * np.linalg.norm(whole), rel=1e-5)
    assert origins[-1] == [] and (np.diff(times) > 0).all()
    contacts = read[0]["/world/contacts"]
    counts = np.diff(run.record.contacts.starts)
    limits = ~np.isfinite(run.record.contacts.normal[:, 0])
    inside = np.repeat(np.arange(len(counts)), counts)
    counts = counts - np.bincount(inside[limits], minlength=len(counts))
    assert [len(rows) for rows in contacts["Arrows3D:origins"]] == counts.tolist()


def test_what_cannot_be_shown_is_refused(run, tmp_path, monkeypatch):
    with pytest.raises(mbvi.TrajectoryFileError, match=r"missing.*cannot be written"):
        run.to_rerun(tmp_path / "missing" / "run.rrd")
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=lambda t, q, v: np.zeros(1), dim=1)
    bare = mbvi.simulate(mbvi.Problem(system, [], [0.0], [1.0]), mbvi.Paoli(), step=0.1, duration=0.1)
    with pytest.raises(mbvi.InputError, match="no scene"):
        bare.to_rerun(tmp_path / "run.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(mbvi.InputError, match=r"pip install 'mbvi\[rerun\]'"):
        run.to_rerun(tmp_path / "run.rrd")
