"""What a run leaves behind, in memory and in its file."""

from dataclasses import replace
from itertools import pairwise

import h5py
import numpy as np
import pytest

import mbvi
from support.paths import ROBOTS
from support.programs import kill_writing
from support.scenes import robot_bodies_and_post


@pytest.fixture(scope="module")
def run():
    return mbvi.simulate(robot_bodies_and_post().build(), mbvi.Paoli(), step=1e-3, duration=0.5)


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
    same(run, mbvi.simulate(robot_bodies_and_post().build(), mbvi.Paoli(), step=1e-3, duration=0.5))


def test_thinned_runs_keep_every_impact(run):
    thin = mbvi.simulate(robot_bodies_and_post().build(), mbvi.Paoli(), step=1e-3, duration=0.5, every=7)
    assert len(thin.t) == 1 + -(-500 // 7)
    np.testing.assert_array_equal(thin.q[:-1], run.q[::7])
    np.testing.assert_array_equal(thin.q[-1], run.q[-1])
    assert [i.time for i in thin.impacts] == [i.time for i in run.impacts]


def knee_and_ball():
    """A knee that strikes its limit, and a ball that strikes the floor."""
    scene = mbvi.Scene(restitution=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    robot = {"joints": {"knee": 0.4}, "velocity": {"knee": -20.0}}
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", base="fixed", position=(0, 0, 3), **robot)
    scene.add_sphere(0.1, 1.0, position=(5, 0, 0.5), name="ball")
    return scene.build()


@pytest.mark.parametrize(
    "scheme", [mbvi.Paoli(), mbvi.SchatzmanPaoli(), mbvi.StewartTrinkle(), mbvi.Adaptive(1e-2), mbvi.EventDriven(1e-3)]
)
def test_thinned_runs_keep_the_greatest_depths(scheme):
    """Depths of impacts last a step, which need not be a recorded one."""
    problem = knee_and_ball()
    own = isinstance(scheme, mbvi.EventDriven | mbvi.Adaptive)
    options = {"duration": 0.6003, "progress": False} | ({} if own else {"step": 2e-3})
    whole, thin = (mbvi.simulate(problem, scheme, every=every, **options) for every in (1, 7))
    assert len(thin.t) < len(whole.t)
    assert not isinstance(scheme, mbvi.Paoli) or min(whole.penetration().max(), whole.limit_violation().max()) > 1e-4
    for all_of, some in ((whole.penetration(), thin.penetration()), (whole.limit_violation(), thin.limit_violation())):
        ends = np.searchsorted(whole.t, thin.t, side="right")
        greatest = [all_of[begin:end].max() for begin, end in pairwise(ends) if end > begin]
        assert some.max() == all_of.max()
        if not own:
            np.testing.assert_array_equal(some[1:], greatest)


def test_the_last_step_is_cut_to_end_on_time():
    run = mbvi.simulate(robot_bodies_and_post().build(), mbvi.Paoli(), step=0.003, duration=0.01)
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
    mbvi.simulate(robot_bodies_and_post().build(), mbvi.Paoli(), step=1e-3, duration=0.5, out=tmp_path / "out.h5")
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
from support.scenes import robot_bodies_and_post
import mbvi
mbvi.simulate(robot_bodies_and_post().build(), mbvi.Paoli(), step=2e-4, duration=1000.0, every=5, out=sys.argv[1])
"""


def test_a_killed_run_leaves_all_but_its_last_second(tmp_path):
    path = tmp_path / "killed.h5"
    written = kill_writing(KILLED, path, states=500, impacts=1)
    cut = mbvi.load(path)
    assert not cut.complete
    assert len(cut.t) >= 500
    whole = mbvi.simulate(robot_bodies_and_post().build(), mbvi.Paoli(), step=2e-4, duration=float(cut.t[-1]), every=5)
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


def test_the_impact_table_shows_rounding_as_zero(run):
    first = run.impacts[0]
    strong, weak = first.percussion.max(), 1e-20 * np.abs(first.before).max()
    impact = replace(
        first,
        constraints=("a", "b"),
        percussion=np.array([strong, 1e-18 * strong]),
        before=np.array([first.before.min(), weak]),
        after=np.array([0.5, -weak]),
    )
    line = replace(run, impacts=[impact]).impact_table().splitlines()[2]
    assert line.split() == ["0", "0", "0", "b"]


def test_a_printed_run_says_in_five_lines_what_happened(run, tmp_path):
    text = str(run)
    assert repr(run) == text and len(text.splitlines()) == 5 and len(text) < 1000 and "array" not in text
    strongest, beyond = max(run.impacts, key=lambda i: i.percussion.max()), run.limit_violation()
    for part in (
        "hopper, 1 body, 2 spheres",
        f"{run.problem.system.nv} degrees of freedom",
        "Paoli, h = 0.001 s",
        "501 states",
        f"{len(run.impacts)} impacts",
        f"{strongest.percussion.max():.4g} N s at t = {strongest.time:.6g} s",
        f"Energy {run.energy()[0]:.6g} J at the start, {run.energy()[-1]:.6g} J at the end",
        f"{run.penetration().max():.3g} m at t = {run.t[run.penetration().argmax()]:.6g} s",
        f"limits violated by {beyond.max():.3g} rad at t = {run.t[beyond.argmax()]:.6g} s",
    ):
        assert part in text
    run.save(tmp_path / "run.h5")
    assert repr(mbvi.load(tmp_path / "run.h5")) == text


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.EventDriven(tolerance=1e-4)])
def test_contacts_and_joint_limits_are_kept_apart(scheme, tmp_path):
    """Each has its own depth."""
    problem = knee_and_ball()
    step = {} if isinstance(scheme, mbvi.EventDriven) else {"step": 2e-3}
    run = mbvi.simulate(problem, scheme, duration=0.6, progress=False, **step)
    ball = [c for i in run.impacts for c in i.constraints if "ball" in c]
    limits = [c for i in run.impacts for c in i.constraints if "limit" in c]
    assert ball and limits and "m or" not in repr(run)
    gaps = np.array([problem.constraints.gap(t, q) for t, q in zip(run.t, run.q, strict=True)])
    n = problem.constraints.limits
    assert all("limit" in problem.constraints.name(k) for k in range(n))
    assert "limit" not in problem.constraints.name(n)
    if step:
        # Paoli's rows are those of the state itself
        for found, part in ((run.penetration(), gaps[:, n:]), (run.limit_violation(), gaps[:, :n])):
            np.testing.assert_allclose(found[1:], np.maximum(-part.min(axis=1), 0.0)[1:], rtol=0, atol=1e-12)
            assert found.max() > 1e-4
    run.save(tmp_path / "run.h5")
    back = mbvi.load(tmp_path / "run.h5")
    np.testing.assert_array_equal(back.limit_violation(), run.limit_violation())
    np.testing.assert_array_equal(back.penetration(), run.penetration())


def test_a_run_of_functions_and_one_without_impacts_print_too():
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.array([-9.81]), 1)
    for height, impacts in ((1.0, "1 impact at t = 0.45"), (9.0, "No impacts")):
        gap = mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1))
        run = mbvi.simulate(mbvi.Problem(system, [gap], [height], [0.0]), duration=0.5)
        lines = repr(run).splitlines()
        assert len(lines) == 5 and lines[0].startswith("Run of given functions, 1 degree of freedom, by EventDriven:")
        assert lines[1].startswith(impacts) and "EventDriven(tolerance=1e-06) was chosen" in lines[4]


@pytest.mark.parametrize("body", ["sphere", "box"])
def test_what_is_struck_elsewhere_is_another_matter(body):
    """One body lands in the first step, in which another begins to press on the floor that both stand on."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for name, x, height, speed in (("resting", 0, 0.1, 0.0), ("landing", 1, 0.1005, -1.0)):
        place = {"position": (x, 0, height), "velocity": (0, 0, speed), "name": name}
        if body == "sphere":
            scene.add_sphere(0.1, 1.0, **place)
        else:
            scene.add_box((0.2, 0.2, 0.2), 1.0, **place)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1, record="contacts")
    assert {name for i in run.impacts for name in i.constraints} == {"landing | floor"}
    assert {c.name for c in run.contacts(1e-3)} == {"landing | floor", "resting | floor"}


def test_contacts_of_a_pile_that_press_now_and_then_are_no_impacts():
    scene = mbvi.Scene()
    scene.add_container((0, 0, 0), (0.4, 0.4), name="box")
    rng = np.random.default_rng(5)
    grid = np.array([(x, y, z) for z in range(5) for x in range(4) for y in range(4)]) * 0.1
    scene.add_spheres(grid + 0.05 + rng.uniform(-5e-3, 5e-3, grid.shape), radius=0.044, mass=1.0, name="grains")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.5, record="contacts")
    late = [i for i in run.impacts if i.time > 0.5]
    listed = sum(len(i.constraints) for i in late)
    # where nothing has closed there is no impact, and one closes in each
    assert all((i.before < 0.0).any() for i in run.impacts)
    assert len(late) <= listed < 0.04 * sum(len(run.contacts(i.time)) for i in late)


def test_all_that_passes_a_blow_on_belongs_to_the_impact():
    """Balls in a row at rest, struck by one at e = 1 and at e = 0: the rows between them close nowhere."""
    for e in (0.0, 1.0):
        scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e)
        for k in range(6):
            scene.add_sphere(0.1, 1.0, (0.2 * k + (k > 0) * 0.1, 0, 0), ((k == 0) * 1.0, 0, 0), name=f"ball {k}")
        # another row far away rests as it is
        for k in range(3):
            scene.add_sphere(0.1, 1.0, (0.2 * k, 9, 0), name=f"far {k}")
        run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.2)
        names = {f"ball {k} | ball {k + 1}" for k in range(5)}
        assert set(run.impacts[0].constraints) == names


def test_states_at_many_times_are_those_at_each(run):
    times = [0.3, 0.0, 0.1234, 0.5]
    q, v = run.at(times)
    assert q.shape == (4, run.q.shape[1]) and v.shape == (4, run.v.shape[1])
    for k, t in enumerate(times):
        for many, one in zip((q, v), run.at(t), strict=True):
            np.testing.assert_array_equal(many[k], one)
    np.testing.assert_allclose(run.at(run.t)[0], run.q, rtol=0, atol=1e-15)
    for many, one in zip(run.at([]), (run.q, run.v), strict=True):
        assert many.shape == (0, one.shape[1])
    for wrong in ([0.1, 0.6], [[0.1]], ["a"], [0.1, np.nan], None):
        with pytest.raises(mbvi.InputError):
            run.at(wrong)


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.EventDriven()], ids=repr)
@pytest.mark.parametrize("options", [{}, {"plane": "xz"}], ids=str)
@pytest.mark.parametrize("shape", ["box", "sphere"])
def test_many_states_of_free_bodies_are_those_at_each(shape, options, scheme):
    scene = mbvi.Scene(restitution=0.5, **options)
    for k in range(2):
        spin = {"angular_velocity": (0.0, 2.0 + k, 0.0)} if shape == "box" else {}
        size = (0.1, 0.2, 0.3) if shape == "box" else 0.1
        getattr(scene, f"add_{shape}")(size, mass=1.0, position=(k, 0, 1), velocity=(0.3, 0, k), **spin)
    run = mbvi.simulate(scene.build(), scheme, duration=0.1, **({} if "Event" in repr(scheme) else {"step": 0.01}))
    times = np.linspace(0.0, 0.1, 38)[::-1]
    for many, each in zip(run.at(times), zip(*map(run.at, times.tolist()), strict=True), strict=True):
        np.testing.assert_array_equal(many, each)
