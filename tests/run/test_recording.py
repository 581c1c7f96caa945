"""What is recorded, shown or written changes no byte of a run, and contacts of the loop are those of the steps."""

import importlib.util
import inspect
from functools import partial

import numpy as np
import pytest

import mbvi
from mbvi.run.fixed_steps import taking
from mbvi.run.loop import compiled_loop
from mbvi.run.progress import Progress
from support.loop_arguments import among_boxes, hopper, on_block, quadruped, swaying, two_hoppers
from support.paths import EXAMPLES, ROBOTS, real_robot

DEFAULT, PAOLI, PILES = mbvi.Centered(project_positions=True), mbvi.Paoli(), mbvi.StewartTrinkle()
EVENTS = mbvi.EventDriven(1e-8)
EVERY = 3
# ways to look at a run that keep all of its states; `out` becomes a file
WATCHED = [{"record": "contacts"}, {"progress": True}, {"out": True}]
ALL = {"record": "contacts", "progress": True, "out": True, "every": EVERY}
pytestmark = pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")


def rough_pile(e, mu):
    """Spheres and boxes fall onto each other."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    rng = np.random.default_rng(3)
    for k in range(12):
        place, velocity = (*(0.12 * rng.normal(size=2)), 0.1 + 0.21 * k), 0.5 * rng.normal(size=3)
        if k % 2:
            scene.add_sphere(0.08, 1.0 + k, position=place, velocity=velocity)
        else:
            scene.add_box((0.2, 0.15, 0.12), 1.0 + k, position=place, velocity=velocity)
    return scene.build()


def at_rest(e, mu):
    """Stacks fall asleep, and a ball wakes one of them."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(8):
        scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0.5 * (k % 4), 0, 0.05 + 0.1 * (k // 4)))
    scene.add_sphere(0.05, 1.0, position=(0, 0, 0.9))
    return scene.build()


def bouncing(e, mu):
    """A ball bounces beside a pendulum that meets its limits."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0.3), velocity=(0.5, 0, 0))
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(1, 0, 0.05), velocity=(1, 0, 0))
    return scene.build()


def capped(e, mu):
    """An impact with friction takes a smaller e, which the Python step alone does."""
    scene = mbvi.Scene(restitution=e, friction=mu, energy_cap=True)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.3, 0.1), 1.0, position=(0, 0, 0.15), velocity=(1, 0, -1), angular_velocity=(1, 2, 0.5))
    return scene.build()


def shaken(e, mu):
    """A box on a floor that moves."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor", motion=mbvi.motion.Oscillation((0.02, 0.0, 0.01), 5.0))
    scene.add_box((0.2, 0.3, 0.1), 1.0, position=(0, 0, 0.05))
    return scene.build()


def watching(e, mu):
    """A robot whose control looks at the contacts of the step before."""

    def push(state):
        felt = sum(contact.percussion for contact in state.contacts)
        return {"hopper": [0.0] * 6 + [-20.0 * felt, 3.0 * felt]}

    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.475), joints={"knee": 0.4}, name="hopper")
    scene.add_control(push)
    return scene.build()


# each with steps of the loop, of Python or of both
SCENES = {
    "hopper, rough": (hopper, 0.0, 0.6, DEFAULT),
    "hopper, bounces": (hopper, 0.5, 0.0, PAOLI),
    "hopper, StewartTrinkle": (hopper, 0.0, 0.6, PILES),
    "quadruped, rough": (quadruped, 0.0, 0.6, DEFAULT),
    "quadruped under control": (swaying, 0.0, 0.6, DEFAULT),
    "quadruped, MoreauJean": (quadruped, 0.5, 0.6, mbvi.MoreauJean()),
    "quadruped on a block": (on_block, 0.3, 0.6, mbvi.Centered()),
    "two hoppers": (two_hoppers, 0.0, 0.6, DEFAULT),
    "quadruped among boxes": (among_boxes, 0.0, 0.0, DEFAULT),
    "pile": (rough_pile, 0.0, 0.4, PILES),
    "pile, default": (rough_pile, 0.2, 0.4, DEFAULT),
    "asleep": (at_rest, 0.0, 0.5, PAOLI),
    "asleep, StewartTrinkle": (at_rest, 0.0, 0.5, PILES),
    "events": (bouncing, 0.5, 0.0, EVENTS),
    "SchatzmanPaoli": (bouncing, 0.5, 0.0, mbvi.SchatzmanPaoli()),
    "energy cap": (capped, 0.7, 0.6, PAOLI),
    "moving floor": (shaken, 0.0, 0.4, DEFAULT),
    "control that sees contacts": (watching, 0.0, 0.4, DEFAULT),
}


def run_of(problem, scheme, duration, folder, step=1e-3, **options):
    if options.pop("out", False):
        options["out"] = folder / "run.h5"
    if not isinstance(scheme, mbvi.EventDriven):
        options["step"] = step
    return mbvi.simulate(problem, scheme, duration=duration, **{"progress": False, **options})


def same_impacts(run, other):
    assert len(run.impacts) == len(other.impacts)
    for one, two in zip(run.impacts, other.impacts, strict=True):
        for name, value in vars(two).items():
            np.testing.assert_array_equal(getattr(one, name), value, err_msg=name)


def recording_changes_nothing(make, scheme, duration, folder, step=1e-3, looks=(*WATCHED, ALL)):
    """Assert the law on the problem that `make` returns; return the run of which only states are kept."""
    run = run_of(make(), scheme, duration, folder, step)
    assert len(run.t) > 2
    kept = {row.tobytes() for row in np.hstack([run.t[:, None], run.q, run.v])}
    for options in looks:
        other = run_of(make(), scheme, duration, folder, step, **options)
        same_impacts(run, other)
        if "every" not in options:
            for name in ("t", "q", "v", "residual"):
                assert getattr(run, name).tobytes() == getattr(other, name).tobytes(), (options, name)
            assert run.penetration().tobytes() == other.penetration().tobytes()
        else:
            assert (run.t[-1], *run.q[-1], *run.v[-1]) == (other.t[-1], *other.q[-1], *other.v[-1])
            rows = [row.tobytes() for row in np.hstack([other.t[:, None], other.q, other.v])]
            assert len(rows) < len(kept) or scheme is EVENTS
            # a located impact has states of its own
            assert kept.issuperset(rows), options
        assert other.notes == run.notes
    return run


@pytest.mark.parametrize("name", SCENES)
def test_recording_changes_no_byte(name, tmp_path):
    make, e, mu, scheme = SCENES[name]
    run = recording_changes_nothing(partial(make, e, mu), scheme, 0.2505, tmp_path)
    # reading a run leaves it as it is, and a new problem gives the same run
    before = run.q.tobytes(), run.v.tobytes()
    assert np.isfinite(run.energy()).all() and str(run)
    if len(run.impacts) < 50:
        assert run.diagnosis().variation > 0.0
    again = run_of(make(e, mu), scheme, 0.2505, tmp_path)
    assert (run.q.tobytes(), run.v.tobytes()) == before == (again.q.tobytes(), again.v.tobytes())


def by_python(problem, scheme, **options):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(taking, "compiled_loop", lambda *_: None)
        return mbvi.simulate(problem, scheme, progress=False, **options)


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("make", [hopper, swaying, on_block, two_hoppers, among_boxes])
def test_contacts_of_the_loop_are_those_of_the_steps(make, mu, every, monkeypatch):
    """Of Paoli's scheme, of which the loop and the Python step agree: to the last bit for one robot."""
    loops, build = [], taking.compiled_loop
    monkeypatch.setattr(taking, "compiled_loop", lambda *given: loops.append(build(*given)) or loops[-1])
    problem, options = make(0.3, mu), {"step": 1e-3, "duration": 0.2505, "every": every, "record": "contacts"}
    run, other = mbvi.simulate(problem, PAOLI, progress=False, **options), by_python(problem, PAOLI, **options)
    assert loops[0].codes.sum() > 0
    if problem.system.single_mechanism:
        assert run.q.tobytes() == other.q.tobytes()
        one, two = run.record.contacts, other.record.contacts
        assert one.names == two.names and len(one.constraint) > 20
        for name in ("starts", "constraint", "point", "normal", "percussion", "tangential", "slip", "sticks"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
        assert (one.tangential is not None and bool(one.tangential.any())) == (mu > 0.0)
    ground = "block" if make is on_block else "floor"
    force, expected = run.contact_forces(ground), other.contact_forces(ground)
    assert expected.any()
    np.testing.assert_allclose(force, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())


def test_an_interrupt_leaves_no_state_without_its_contacts(monkeypatch):
    """The run ends while the impacts of steps of the loop are found."""

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(compiled_loop.CompiledLoop, "_replay", interrupted)
    with pytest.raises(KeyboardInterrupt) as error:
        mbvi.simulate(hopper(0.0, 0.6), PAOLI, step=1e-3, duration=0.3, record="contacts", progress=False)
    run = error.value.run
    assert len(run.record.contacts.starts) == len(run.t) + 1
    assert any(run.contacts(t) for t in run.t)


def test_a_bar_is_shown_before_the_first_step(capsys):
    """The loop may leave even the first step to Python, and the bar is asked before it is taken."""
    with Progress(10, True) as bar:
        assert bar.poll(0) < float("inf")
    assert "10" in capsys.readouterr().err


# problems of the examples


class _Found(Exception):
    """Ends an example at its first run, and bears what that is given."""


def first_run(name, folder):
    """Return the problem, the scheme and the step of the first run of an example."""

    def catch(problem, scheme=None, *, step=None, **_):
        raise _Found(problem, scheme, step)

    def catch_point(make, points, *, scheme=None, step=None, **_):
        chosen = [values[0] for values in points.values()] if isinstance(points, dict) else list(points[0])
        # of some examples a generator draws the rest
        drawn = [np.random.default_rng(0)] if "rng" in inspect.signature(make).parameters else []
        made = make(*chosen, *drawn)
        catch(made.build() if isinstance(made, mbvi.Scene) else made, scheme, step=step)

    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.MonkeyPatch.context() as patched, pytest.raises(_Found) as found:
        patched.chdir(folder)
        for word in ("simulate", "steps", "Simulator"):
            patched.setattr(mbvi, word, catch)
        patched.setattr(mbvi, "rollout", lambda problem, *_, step, **__: catch(problem, step=step))
        patched.setattr(mbvi, "sweep", catch_point)
        module.main()
    return found.value.args


@pytest.mark.slow(seconds=60)
@pytest.mark.parametrize("name", [p.stem for p in sorted(EXAMPLES.glob("*.py"))])
def test_recording_changes_no_byte_of_an_example(name, tmp_path):
    _, scheme, step = first_run(name, tmp_path)
    step = step or 1e-3
    duration = 0.5 if isinstance(scheme, mbvi.EventDriven) else 150.5 * step
    # a control of an example remembers what it saw
    recording_changes_nothing(lambda: first_run(name, tmp_path)[0], scheme, duration, tmp_path, step, (ALL,))


PUBLISHED = {
    "go2": "go2_description/urdf/go2.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "talos_full": "talos_data/robots/talos_full_v2.urdf",
    "solo12": "solo_description/robots/solo12.urdf",
    "anymal": "anymal_b_simple_description/robots/anymal.urdf",
    "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
    "bolt": "bolt_description/robots/bolt.urdf",
    "icub": "icub_description/robots/icub_reduced.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "b1": "b1_description/urdf/b1.urdf",
}


@pytest.mark.slow(seconds=60)
@pytest.mark.parametrize("name", PUBLISHED)
def test_recording_changes_no_byte_of_a_published_robot(name, tmp_path):
    """Dropped by 0.1 m onto a rough floor at 1.2 m/s, it lands within the run."""
    scene = mbvi.Scene(friction=0.6)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(real_robot(PUBLISHED[name]), base="free", position=(0, 0, 5))
    problem = scene.build(resolve=True)
    floor = [k for k in range(len(problem.constraints)) if problem.constraints.name(k).endswith(" | floor")]
    q, v = problem.q0.copy(), problem.v0.copy()
    q[2] += 0.02 - problem.constraints.gap(0.0, q)[floor].min()
    v[2] = -1.2
    run = recording_changes_nothing(partial(problem.at, q, v), DEFAULT, 0.1505, tmp_path, looks=(WATCHED[0], ALL))
    assert run.impacts
