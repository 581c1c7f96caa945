"""Problems and runs are pickled and copied, and copies run to the same bytes; schemes are equal by their options."""

import copy
import importlib.util
import multiprocessing
import pickle
import sys
import warnings

import numpy as np
import pytest

import mbvi
from mbvi import packing, surfaces
from mbvi.sweeps.points import points_of, takes_rng
from support.paths import EXAMPLES
from support.repeated_runs import bytes_of, every_shape, short_run, simulate_elsewhere


class Found(Exception):
    """Raised in the place of a run, with what was to be simulated."""

    def __init__(self, problem, scheme, options):
        super().__init__("not simulated")
        self.run = problem, scheme, options


def example(name, monkeypatch):
    """What an example would simulate first: problem, scheme and options."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    # functions are pickled by the name of their module
    monkeypatch.setitem(sys.modules, name, module)

    def found(problem, scheme=None, **options):
        raise Found(problem, scheme, options)

    def found_first(make, parameters, *, measure, out, scheme, **options):
        raise Found(run_of_point(make, parameters), scheme, options)

    with monkeypatch.context() as patched:
        patched.setattr(mbvi, "simulate", found)
        patched.setattr(mbvi, "steps", found)
        patched.setattr(mbvi, "Simulator", found)
        patched.setattr(mbvi, "rollout", lambda problem, q0, v0, **options: found(problem, step=options["step"]))
        patched.setattr(mbvi, "sweep", found_first)
        spec.loader.exec_module(module)
        with pytest.raises(Found) as error:
            module.main()
    return error.value.run


def run_of_point(make, parameters):
    """The problem of the first point of a sweep."""
    arguments = points_of(parameters, make)[0] | ({"rng": np.random.default_rng(0)} if takes_rng(make) else {})
    made = make(**arguments)
    return made.build() if isinstance(made, mbvi.Scene) else made


COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda x: pickle.loads(pickle.dumps(x))}


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("name", [p.stem for p in sorted(EXAMPLES.glob("*.py"))])
def test_every_example_is_copied_and_its_copies_run_to_the_same_bytes(name, way, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    problem, scheme, options = example(name, monkeypatch)
    before = COPIES[way](problem)
    run = short_run(problem, scheme, **options)
    expected = bytes_of(run)
    # what a run left behind in the original is not in a copy
    after = COPIES[way](problem)
    for other in (before, after, COPIES[way](after), problem):
        assert bytes_of(short_run(other, COPIES[way](scheme), **options)) == expected
    assert not after.q0.flags.writeable
    assert not after.v0.flags.writeable
    kept = COPIES[way](run)
    assert bytes_of(kept) == expected
    assert not kept.q.flags.writeable
    np.testing.assert_array_equal(kept.energy(), run.energy())
    np.testing.assert_array_equal(kept.penetration(), run.penetration())
    middle = 0.5 * (run.t[0] + run.t[-1])
    assert [x.tobytes() for x in kept.at(middle)] == [x.tobytes() for x in run.at(middle)]
    assert bytes_of(short_run(kept.problem, scheme, **options)) == expected
    assert repr(after) == repr(problem)
    assert after.report() == problem.report()
    kept.save(tmp_path / "kept.h5")
    run.save(tmp_path / "run.h5")
    with warnings.catch_warnings():
        # controls are not kept
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        assert bytes_of(mbvi.load(tmp_path / "kept.h5")) == bytes_of(mbvi.load(tmp_path / "run.h5"))


def crowd():
    """More shapes than are listed pair by pair, spheres in bulk, a mesh, and walls that move."""
    scene = mbvi.Scene()
    scene.add_container((-0.5, -0.5, 0.0), (0.5, 0.5), motion=mbvi.motion.Oscillation((0, 0, 0.01), 5.0))
    places = 0.12 * np.indices((8, 8, 1)).reshape(3, -1).T + [-0.4, -0.4, 0.1]
    scene.add_boxes(places, (0.1, 0.08, 0.06), 1.0)
    balls = packing.lattice((6, 6, 1), 0.04, spacing=0.1, corner=(-0.3, -0.3, 0.3), jitter=1e-3, seed=1)
    scene.add_spheres(*balls, density=1000.0)
    return scene.build()


def funnel():
    scene = mbvi.Scene()
    scene.add_surface(*surfaces.hourglass(radius=0.2, neck=0.05, height=0.4, segments=16), name="glass")
    scene.add_spheres(*packing.lattice((3, 3, 3), 0.015, spacing=0.04, corner=(-0.04, -0.04, 0.1)), density=1000.0)
    return scene.build()


def in_a_plane():
    scene = mbvi.Scene(plane="xz", restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    for k in range(3):
        scene.add_box((0.2, 0.2, 0.2), position=(0.15 * k, 0, 0.3 + 0.3 * k))
    scene.add_sphere(0.1, position=(-0.5, 0, 0.3))
    return scene.build()


SCENES = [every_shape, crowd, funnel, in_a_plane]


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("scene", SCENES, ids=lambda f: f.__name__)
def test_scenes_of_every_shape_are_copied_before_and_after_a_run(scene, way):
    problem = scene()
    before = COPIES[way](problem)
    expected = bytes_of(short_run(problem, mbvi.Centered(project_positions=True), step=8e-3))
    assert expected[4]
    for other in (before, COPIES[way](problem), COPIES[way](COPIES[way](problem))):
        assert bytes_of(short_run(other, mbvi.Centered(project_positions=True), step=8e-3)) == expected


def test_a_copy_taken_in_the_middle_of_a_run_starts_from_the_start():
    problem = every_shape()
    expected = bytes_of(short_run(every_shape(), mbvi.Paoli(), step=2e-3))
    steps = mbvi.steps(problem, mbvi.Paoli(), step=2e-3)
    for _ in range(30):
        next(steps)
    other = pickle.loads(pickle.dumps(problem))
    last = next(steps)
    assert bytes_of(short_run(other, mbvi.Paoli(), step=2e-3)) == expected
    # and the original goes on as if nothing had been copied
    fresh = mbvi.steps(every_shape(), mbvi.Paoli(), step=2e-3)
    for _ in range(31):
        again = next(fresh)
    assert again.q.tobytes() == last.q.tobytes()


def test_copies_share_nothing_that_runs_write_to():
    """Two copies stepped in turn, each as if it were alone."""
    problem = every_shape()
    alone = [step.q.tobytes() for step, _ in zip(mbvi.steps(problem, mbvi.Paoli(), step=2e-3), range(40), strict=False)]
    walks = [mbvi.steps(copy.deepcopy(problem), mbvi.Paoli(), step=2e-3) for _ in range(2)]
    for expected in alone:
        assert [next(walk).q.tobytes() for walk in walks] == [expected, expected]


def test_another_process_simulates_a_problem_that_was_sent_to_it():
    problem = every_shape()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.apply(simulate_elsewhere, (problem,))
    assert found == simulate_elsewhere(problem)


def test_a_function_without_a_name_is_refused_by_pickle_and_copied_by_deepcopy():
    scene = mbvi.Scene()
    scene.add_urdf(mbvi.robot("hopper"), position=(0, 0, 1), control=lambda t, q, v: -0.1 * v)
    problem = scene.build()
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        pickle.dumps(problem)
    expected = bytes_of(short_run(problem, mbvi.Paoli()))
    assert bytes_of(short_run(copy.deepcopy(problem), mbvi.Paoli())) == expected


REPRESENTED = {
    "Paoli()": mbvi.Paoli(),
    "Paoli(project_positions=True)": mbvi.Paoli(project_positions=True),
    "MoreauJean(theta=0.5)": mbvi.MoreauJean(),
    "MoreauJean(theta=0.7, project_positions=True)": mbvi.MoreauJean(0.7, project_positions=True),
    "Centered()": mbvi.Centered(),
    "Centered(project_positions=True)": mbvi.Centered(project_positions=True),
    "SchatzmanPaoli()": mbvi.SchatzmanPaoli(),
    "StewartTrinkle()": mbvi.StewartTrinkle(),
    "EventDriven(tolerance=1e-06)": mbvi.EventDriven(1e-6),
    "EventDriven(tolerance=1e-08)": mbvi.EventDriven(1e-8),
}


def test_schemes_say_what_they_were_made_with_and_are_equal_where_that_is():
    for shown, scheme in REPRESENTED.items():
        assert repr(scheme) == shown
        again = eval(shown, vars(mbvi))
        assert again == scheme
        assert hash(again) == hash(scheme)
        for other in COPIES.values():
            assert other(scheme) == scheme
    assert len(set(REPRESENTED.values())) == len(REPRESENTED)
    assert mbvi.Paoli() != mbvi.Centered()
    assert mbvi.Paoli() != "Paoli()"


def test_a_scheme_derived_from_another_is_not_that_one():
    class Own(mbvi.Paoli):
        pass

    assert Own() != mbvi.Paoli()
    assert repr(Own()) == "Own()"


def fall(t, q, v):
    """A force with a name."""
    return np.array([-9.81])


def test_what_is_given_by_functions_is_shown_without_addresses():
    system = mbvi.LagrangianSystem(mass=np.eye, force=fall, dim=1)
    gap = mbvi.GapFunction(lambda q: q[0], np.ones_like, name="floor")
    assert repr(system) == "LagrangianSystem(mass=eye, force=fall, dim=1)"
    assert repr(gap) == "GapFunction(<lambda>, ones_like, name='floor')"
    assert "0x" not in repr(mbvi.GapFunction(lambda q: 1.0, np.zeros_like))
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=fall, dim=1)
    assert repr(mbvi.Problem(system, [gap], [1.0], [0.0])) == "Problem(nq=1, nv=1, constraints=1, t0=0)"
