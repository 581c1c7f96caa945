"""What a run leaves behind, in memory and in its file."""

import os

import h5py
import numpy as np
import pytest
from conftest import ROBOTS, kill_writing

import mbvi


def scene():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.6), joints={"knee": 0.4}, velocity={"hip": -1.0})
    scene.add_box((0.2, 0.1, 0.1), position=(0.6, 0, 0.3), angular_velocity=(0, 1, 0), name="brick")
    scene.add_spheres([[1, 0, 0.3], [1.05, 0, 0.55]], radius=0.1, mass=[1.0, 2.0])
    scene.add_cylinder(0.1, 0.2, position=(-1, 0, 0.1), fixed=True, name="post")
    scene.set_restitution("hopper/foot", "floor", 0.8)
    return scene


@pytest.fixture(scope="module")
def run():
    return mbvi.simulate(scene().build(), mbvi.Paoli(), step=1e-3, duration=0.5)


def same(a, b):
    for name in ("t", "q", "v", "residual"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_array_equal(a.penetration(), b.penetration())
    assert [i.constraints for i in a.impacts] == [i.constraints for i in b.impacts]
    for i, j in zip(a.impacts, b.impacts, strict=True):
        assert (i.time, i.energy_change) == (j.time, j.energy_change)
        for name in ("percussion", "before", "after", "point", "normal"):
            np.testing.assert_array_equal(getattr(i, name), getattr(j, name))


def test_shapes_and_read_only(run):
    system = run.problem.system
    assert run.t.shape == (501,)
    assert run.q.shape == (501, system.nq)
    assert run.v.shape == (501, system.nv)
    assert run.energy().shape == run.penetration().shape == (501,)
    assert run.t[-1] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        run.q[0, 0] = 1.0
    with pytest.raises(AttributeError):
        run.t = run.t


def test_at_is_q_h_and_v_h(run):
    """Theorem 3.2: q_h(t) = q_i + (t - t_i) v_i and v_h(t) = v_i on [t_i, t_{i+1})."""
    system = run.problem.system
    for i in (0, 17, 250, 499):
        for part in (0.0, 0.3, 0.999):
            t = run.t[i] + part * 1e-3
            q, v = run.at(t)
            np.testing.assert_allclose(q, system.integrate(run.q[i], (t - run.t[i]) * run.v[i]), atol=1e-9)
            np.testing.assert_array_equal(v, run.v[i])
    np.testing.assert_array_equal(run.at(0.5)[0], run.q[-1])
    with pytest.raises(mbvi.InputError, match="outside the run"):
        run.at(0.6)


def test_impacts_obey_newtons_law_and_lie_on_the_surfaces(run):
    assert len(run.impacts) > 5
    floor = [(i, k) for i in run.impacts for k, name in enumerate(i.constraints) if name.endswith("| floor")]
    assert floor
    for impact, k in floor:
        e = 0.8 if impact.constraints[k].startswith("hopper/foot") else 0.5
        assert impact.after[k] == pytest.approx(-e * impact.before[k], abs=1e-9)
        assert impact.percussion[k] > 0
        np.testing.assert_allclose(impact.normal[k], [0, 0, 1])
        assert abs(impact.point[k, 2]) < 0.02
    assert all(i.energy_change <= 1e-12 for i in run.impacts)
    assert {n for i in run.impacts for n in i.constraints} >= {"hopper/foot | floor", "brick | floor"}


def test_total_energy_falls_only_at_impacts(run):
    energy = run.energy()
    assert energy[-1] < energy[0]
    assert np.diff(energy).max() < 1e-3 * energy[0]


def test_the_same_problem_gives_the_same_bytes(run):
    same(run, mbvi.simulate(scene().build(), mbvi.Paoli(), step=1e-3, duration=0.5))


def test_thinned_runs_keep_every_impact(run):
    thin = mbvi.simulate(scene().build(), mbvi.Paoli(), step=1e-3, duration=0.5, every=7)
    assert len(thin.t) == 1 + -(-500 // 7)
    np.testing.assert_array_equal(thin.q[:-1], run.q[::7])
    np.testing.assert_array_equal(thin.q[-1], run.q[-1])
    assert [i.time for i in thin.impacts] == [i.time for i in run.impacts]


def test_the_last_step_is_cut_to_end_on_time():
    run = mbvi.simulate(scene().build(), mbvi.Paoli(), step=0.003, duration=0.01)
    np.testing.assert_allclose(run.t, [0, 0.003, 0.006, 0.009, 0.01], atol=1e-15)
    assert run.t[-1] == 0.01
    np.testing.assert_allclose(run.q[-1, :3], run.q[-2, :3] + 0.001 * run.v[-2, :3], atol=1e-6)


def test_save_and_load_bring_everything_back(run, tmp_path):
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    same(run, again)
    np.testing.assert_array_equal(run.energy(), again.energy())
    assert (again.scheme, again.step, again.complete) == ("Paoli", 1e-3, True)
    assert again.problem.report() == run.problem.report()
    # the problem that comes back is the same one: it runs to the same bytes
    same(run, mbvi.simulate(again.problem, mbvi.Paoli(), step=1e-3, duration=0.5))


def test_streaming_writes_the_same_file(run, tmp_path):
    mbvi.simulate(scene().build(), mbvi.Paoli(), step=1e-3, duration=0.5, out=tmp_path / "out.h5")
    same(run, mbvi.load(tmp_path / "out.h5"))
    np.testing.assert_allclose(mbvi.load(tmp_path / "out.h5").energy(), run.energy(), rtol=1e-12)


def test_file_is_readable_without_mbvi(run, tmp_path):
    run.save(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        assert file["t"].attrs["unit"] == "s"
        assert file["q"].shape == run.q.shape
        assert file["impacts/percussion"].attrs["unit"] == "N s or N m s"
        assert file["impacts/constraint"].asstr()[0] == run.impacts[0].constraints[0]
        assert b"<robot" in file["problem/scene"][()]
        np.testing.assert_array_equal(file["problem/q0"], run.q[0])
        assert all("unit" in file[name].attrs for name in ("t", "q", "v", "energy", "penetration", "residual"))


def test_a_run_of_given_functions_keeps_its_energies(tmp_path):
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-9.81]), 1)
    problem = mbvi.Problem(system, [mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1))], [1.0], [0.0])
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.5)
    run.save(tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    assert again.problem is None
    np.testing.assert_array_equal(again.energy(), run.energy())
    np.testing.assert_allclose(again.at(0.1234)[0], run.at(0.1234)[0])


def test_a_run_without_impacts_loads(tmp_path):
    scene = mbvi.Scene()
    scene.add_sphere(0.1)
    mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1).save(tmp_path / "run.h5")
    assert mbvi.load(tmp_path / "run.h5").impacts == ()


KILLED = """
import sys
sys.path.insert(0, sys.argv[2])
from test_trajectory import scene
import mbvi
mbvi.simulate(scene().build(), mbvi.Paoli(), step=2e-4, duration=1000.0, every=5, out=sys.argv[1])
"""


def test_a_killed_run_leaves_all_but_its_last_second(tmp_path):
    path = tmp_path / "killed.h5"
    written = kill_writing(KILLED, path, os.path.dirname(__file__), states=500, impacts=1)
    cut = mbvi.load(path)
    assert not cut.complete
    assert len(cut.t) >= 500
    whole = mbvi.simulate(scene().build(), mbvi.Paoli(), step=2e-4, duration=float(cut.t[-1]), every=5)
    n = len(cut.t) - 1
    np.testing.assert_array_equal(cut.q[:n], whole.q[:n])
    np.testing.assert_allclose(cut.energy()[:n], whole.energy()[:n], rtol=1e-12)
    assert np.median(np.diff(written)) < 1.0
    assert len(cut.impacts) > 0


def test_impact_table_names_the_strongest(run):
    table = run.impact_table(3)
    strongest = max(run.impacts, key=lambda i: i.percussion.max())
    assert f"{strongest.time:.4f}" in table
    assert "weaker ones" in table
