"""Contacts and their resultants over a run: weights at rest, balance of momentum, names, files."""

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from support.paths import ROBOTS
from support.programs import kill_writing
from support.scenes import robot_and_bodies

G = 9.81
SCHEMES = (
    mbvi.Paoli(),
    mbvi.Paoli(project_positions=True),
    mbvi.MoreauJean(),
    mbvi.MoreauJean(0.8, project_positions=True),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.SchatzmanPaoli(),
    mbvi.StewartTrinkle(),
    mbvi.EventDriven(1e-9),
)


def named(scheme):
    return type(scheme).__name__ + "+" * getattr(scheme, "project_positions", 0)


def options(scheme, step=2e-3):
    return {} if isinstance(scheme, mbvi.EventDriven) else {"step": step}


def centre_of_mass(system, q):
    return pin.centerOfMass(system.model, system.model.createData(), q)


@pytest.mark.parametrize(
    ("robot", "height", "locked"),
    [("quadruped", 0.45, False), ("quadruped", 0.45, True), ("biped", 1.1, True), ("hopper", 0.8, False)],
)
def test_the_forces_under_a_robot_at_rest_are_its_weight(robot, height, locked):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="ground")
    path = ROBOTS / robot / f"{robot}.urdf"
    joints = pin.buildModelFromUrdf(str(path)).names.tolist()[1:] if locked else []
    scene.add_urdf(path, position=(0.3, -0.2, height), name="robot", locked=joints)
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=1e-3, duration=2.5, record="contacts")
    weight = G * sum(inertia.mass for inertia in problem.system.model.inertias)
    wrench, late = run.contact_forces("robot"), run.t > 2.0
    np.testing.assert_allclose(wrench[late, 2], weight, rtol=1e-9)
    np.testing.assert_allclose(wrench[late][:, [0, 1, 5]], 0.0, atol=1e-9 * weight)
    # about the centre of mass nothing is left of the moment
    centre = np.array([centre_of_mass(problem.system, q) for q in run.q[late]])
    moment = wrench[late, 3:] - np.cross(centre, wrench[late, :3])
    np.testing.assert_allclose(moment, 0.0, atol=1e-5 * weight)
    np.testing.assert_array_equal(run.contact_forces("ground"), -wrench)
    links = {frame.name for frame in problem.scene.items.robots[0].robot.model.frames if "BODY" in str(frame.type)}
    total = sum(run.contact_forces(f"robot/{link}") for link in links)
    np.testing.assert_allclose(total, wrench, rtol=0, atol=1e-9 * weight)
    contacts = run.contacts(2.25)
    assert sum(c.force * c.normal[2] for c in contacts if "ground" in c.name) == pytest.approx(weight, rel=1e-9)
    assert all(c.percussion == pytest.approx(1e-3 * c.force) and c.percussion > 0.0 for c in contacts)


def shapes(scene):
    """Bodies that rest on the floor and on a fixed box; return their masses and where their centres are."""
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((1, 1, 0.2), position=(3, 0, 0.1), fixed=True, name="table")
    scene.add_box((0.2, 0.3, 0.1), 1.5, position=(0, 0, 0.05), name="brick")
    scene.add_cylinder(0.1, 0.3, 2.0, position=(0.5, 0, 0.15), name="tin")
    scene.add_sphere(0.1, 0.7, (1.0, 0, 0.1), name="ball")
    scene.add_box((0.2, 0.2, 0.1), 3.0, position=(3.1, 0.2, 0.25), name="book")
    return {"brick": (1.5, 0.05), "tin": (2.0, 0.15), "ball": (0.7, 0.1), "book": (3.0, 0.25)}


@pytest.mark.parametrize("scheme", SCHEMES, ids=named)
def test_bodies_at_rest_press_with_their_weight(scheme):
    scene = mbvi.Scene()
    masses = shapes(scene)
    run = mbvi.simulate(scene.build(), scheme, duration=0.2, record="contacts", **options(scheme))
    for name, (mass, _) in masses.items():
        wrench = run.contact_forces(name)
        np.testing.assert_array_equal(wrench[0], 0.0)
        assert wrench[-1, 2] == pytest.approx(mass * G, rel=1e-9)
        np.testing.assert_allclose(wrench[-1, :2], 0.0, atol=1e-9)
    pairs = run.contact_forces()
    assert {("book", "table"), ("table", "book")} & set(pairs)
    on_table = run.contact_forces("table")
    assert on_table[-1, 2] == pytest.approx(-3.0 * G, rel=1e-9)


def test_what_sleeps_still_presses():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(3):
        scene.add_box((0.2, 0.2, 0.1), 1.0 + k, position=(0, 0, 0.05 + 0.1 * k), name=f"stone {k}")
    forces = []
    for reduce in (["rest"], []):
        run = mbvi.simulate(
            scene.build(reduce), mbvi.Centered(project_positions=True), step=1e-3, duration=0.3, record="contacts"
        )
        forces.append(run.contact_forces("floor"))
        assert run.contact_forces("floor")[-1, 2] == pytest.approx(-6.0 * G, rel=1e-9)
        # each stone carries those above it
        assert run.contact_forces()["stone 0", "stone 1"][-1, 2] == pytest.approx(-5.0 * G, rel=1e-9)
    np.testing.assert_allclose(forces[0][1:, :3], forces[1][1:, :3], rtol=1e-9, atol=1e-9)


def heap(seed, e):
    """Return a random scene of bodies that meet each other, a floor, a ramp, a box of the world and a mesh."""
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene(gravity=(0.5, -0.3, -G), restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, 1), -1.5, name="ramp")
    scene.add_box((0.4, 0.4, 0.4), position=(0, 0, 0.2), fixed=True, name="step")
    masses = {}
    for k, place in enumerate(rng.permutation([(x, y, z) for x in (-0.5, 0, 0.5) for y in (0, 0.4) for z in (0.6, 1)])):
        mass = float(rng.uniform(0.5, 3.0))
        body = {"position": place, "velocity": rng.uniform(-1, 1, 3), "name": f"body {k}"}
        kind = rng.integers(3)
        if kind == 0:
            masses[scene.add_sphere(0.12, mass, **body)] = mass
        elif kind == 1 and k < 6:
            turned = {"rotation": pin.exp3(rng.normal(size=3)), "angular_velocity": rng.normal(size=3)}
            masses[scene.add_box((0.15, 0.2, 0.12), mass, **body, **turned)] = mass
        else:
            turned = {"rotation": pin.exp3(rng.normal(size=3))}
            masses[scene.add_capsule(0.08, 0.1, mass, **body, **turned)] = mass
    return scene, masses


def velocities(run, name):
    """Return the velocity of a free body's centre over time, shape (n + 1, 3)."""
    system, body = run.problem.system, run.problem.system.bodies.index(name)
    rows = np.zeros((3, system.nv))
    for k, normal in enumerate(np.eye(3)):
        place = system.placements(run.q[0], np.array([body]))[0, 3]
        one = system.separation_rows(run.q[0], np.array([0]), np.array([body]), place[None], normal[None])
        rows[k] = one.toarray()[0] if hasattr(one, "toarray") else one[0]
    return run.v @ rows.T


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("scheme", SCHEMES[:-1], ids=named)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_momentum_of_every_body_is_what_gravity_and_contacts_gave_it(scheme, seed, every):
    e, h = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else [0.4, 1.0][seed % 2], 2e-3
    scene, masses = heap(seed, e)
    run = mbvi.simulate(scene.build(), scheme, step=h, duration=0.7013, every=every, record="contacts")
    gravity, dt = np.array([0.5, -0.3, -G]), np.diff(run.t, prepend=run.t[0])
    if isinstance(scheme, mbvi.SchatzmanPaoli):
        # the last step is a whole one, which goes on beyond the end of the run
        dt[-1] = h * np.ceil(dt[-1] / h)
    if isinstance(scheme, mbvi.SchatzmanPaoli):
        # gravity acts for half of the first step: v is the velocity in the middle of a step
        dt_gravity = dt.copy()
        dt_gravity[1] -= 0.5 * h
    else:
        dt_gravity = dt
    touched = total = largest = 0
    for name, mass in masses.items():
        force = run.contact_forces(name)[:, :3]
        touched += bool(force.any())
        v = velocities(run, name)
        given = np.cumsum(dt[:, None] * force + mass * dt_gravity[:, None] * gravity, axis=0)
        scale = mass * np.abs(v).max() + np.abs(dt[:, None] * force).sum()
        # bodies in the air that are moved out of each other keep their angular momentum by impulses of the order of the
        # depth, which are no contact forces and cancel within a group
        close = 2e-4 if getattr(scheme, "project_positions", False) else 1e-9
        np.testing.assert_allclose(given, mass * (v - v[0]), rtol=0, atol=close * scale)
        total, largest = total + given - mass * (v - v[0]), largest + scale
    np.testing.assert_allclose(total, 0.0, atol=1e-9 * largest)
    assert touched > len(masses) // 2
    # every force has its counterpart
    things = {"floor", "ramp", "step", *masses}
    both = np.array([run.contact_forces(name) for name in things])
    np.testing.assert_allclose(both.sum(axis=0), 0.0, atol=1e-9 * np.abs(both).max())
    pairs = run.contact_forces()
    for name in things:
        on = sum((f for (first, _), f in pairs.items() if first == name), np.zeros((len(run.t), 6)))
        by = sum((f for (_, second), f in pairs.items() if second == name), np.zeros((len(run.t), 6)))
        np.testing.assert_allclose(on - by, run.contact_forces(name), rtol=0, atol=1e-9 * np.abs(both).max())


def test_forces_and_moments_are_what_the_gradients_make_of_percussions():
    """J' p of each body, step by step, of the scheme that ends where its law is applied."""
    scene, masses = heap(3, 0.5)
    problem, h = scene.build(), 2e-3
    run = mbvi.simulate(problem, mbvi.Paoli(), step=h, duration=0.5, record="contacts")
    wrenches = {name: run.contact_forces(name) for name in masses}
    system, first = problem.system, {}
    for block in system.blocks:
        width = block.system.nv // (len(block.system.bodies) - 1)
        first |= {name: (block.v.start + width * k, width) for k, name in enumerate(block.system.bodies[1:])}
    pressed = 0
    for i, step in zip(range(1, 251), mbvi.steps(scene.build(), mbvi.Paoli(), step=h), strict=False):
        pushed = step.active.jacobian.T @ step.percussion
        pressed += bool(step.percussion.any())
        for name, (start, width) in first.items():
            force, moment = wrenches[name][i, :3], wrenches[name][i, 3:]
            np.testing.assert_allclose(h * force, pushed[start : start + 3], atol=1e-10)
            if width == 6:
                place = system.placements(step.q, np.array([system.bodies.index(name)]))[0]
                # rows of a placement are the body's axes
                about = place[:3] @ (moment - np.cross(place[3], force))
                np.testing.assert_allclose(h * about, pushed[start + 3 : start + 6], atol=1e-10)
    assert pressed > 50


@pytest.mark.parametrize("every", [1, 5])
def test_error_control_gives_the_reactions_of_the_smooth_motion(every):
    """Balls that bounce, come to rest, roll into each other and slide along a ramp."""
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, 2), -1.0, name="ramp")
    masses = {"a": 1.0, "b": 2.5, "c": 0.5}
    for k, (name, mass) in enumerate(masses.items()):
        scene.add_sphere(0.1, mass, (0.3 * k, 0, 0.2), (1.5 - k, 0.0, 0.0), name=name)
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-10), duration=1.5, every=every, record="contacts")
    assert any("|" in n and "floor" not in n and "ramp" not in n for i in run.impacts for n in i.constraints)
    dt = np.diff(run.t, prepend=run.t[0])
    for k, (name, mass) in enumerate(masses.items()):
        force = run.contact_forces(name)[:, :3]
        struck = np.zeros(3)
        for impact in run.impacts:
            for n, p, normal in zip(impact.constraints, impact.percussion, impact.normal, strict=True):
                first, second = n.split(" | ")
                sign = 1.0 if second in ("floor", "ramp") else (second == name) - (first == name)
                struck += p * normal * sign * (name in (first, second))
        given = (dt[:, None] * (force - mass * np.array([0, 0, G]))).sum(axis=0) + struck
        v = run.v[:, 3 * k : 3 * k + 3]
        # each bounce of less than 1e-14 of the scene's length is put to rest, which takes up to 1.4e-7 m/s
        np.testing.assert_allclose(given, mass * (v[-1] - v[0]), rtol=0, atol=1e-6 * mass)
    assert np.abs(run.contact_forces("ramp")).max() > 1.0


def test_error_control_of_a_robot_that_comes_to_rest():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.6), joints={"knee": 0.4}, name="hopper")
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.EventDriven(), duration=2.0, record="contacts")
    weight = G * sum(inertia.mass for inertia in problem.system.model.inertias)
    quiet = np.abs(run.v).max(axis=1) < 1e-9
    if quiet[-1]:
        assert run.contact_forces("hopper")[-1, 2] == pytest.approx(weight, rel=1e-9)
    # the mean over the run is the weight less what is left of the momentum
    dt = np.diff(run.t, prepend=run.t[0])
    struck = sum(float(i.percussion @ i.normal[:, 2]) for i in run.impacts if np.isfinite(i.normal).all())
    assert struck > 0.0 and (dt @ run.contact_forces("hopper")[:, 2]) > 0.5 * weight


def test_steps_that_are_cut_add_up():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_box((1, 1, 0.01), position=(0, 0, 0), fixed=True, name="plate")
    scene.add_sphere(0.01, 2.0, (0, 0, 0.3), (0, 0, -100.0), name="bullet")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.05, record="contacts")
    assert any("shortened" in note for note in run.notes)
    force = run.contact_forces("bullet")
    given = 1e-3 * (force[:, 2] - 2.0 * G)[1:].sum()
    assert given == pytest.approx(2.0 * (run.v[-1, 2] - run.v[0, 2]), rel=1e-12)
    np.testing.assert_array_equal(force, -run.contact_forces("plate"))


@pytest.mark.parametrize("scheme", [mbvi.Centered(project_positions=True), mbvi.EventDriven(1e-6)], ids=named)
def test_recording_changes_nothing_else(scheme):
    runs = [
        mbvi.simulate(robot_and_bodies().build(), scheme, duration=0.6, record=record, **options(scheme))
        for record in (None, "contacts")
    ]
    for name in ("t", "q", "v", "residual"):
        assert getattr(runs[0], name).tobytes() == getattr(runs[1], name).tobytes()
    assert [i.percussion.tobytes() for i in runs[0].impacts] == [i.percussion.tobytes() for i in runs[1].impacts]


def same_contacts(a, b, states):
    for i in range(states):
        first, second = a.contacts(a.t[i]), b.contacts(b.t[i])
        assert [(c.name, c.percussion, c.force) for c in first] == [(c.name, c.percussion, c.force) for c in second]
        for c, d in zip(first, second, strict=True):
            np.testing.assert_array_equal(c.point, d.point)
            np.testing.assert_array_equal(c.normal, d.normal)


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("scheme", [mbvi.Centered(project_positions=True), mbvi.EventDriven(1e-6)], ids=named)
def test_files_keep_contacts(scheme, every, tmp_path):
    path = tmp_path / "out.h5"
    kept = {"duration": 0.5, "every": every, "record": "contacts", **options(scheme)}
    run = mbvi.simulate(robot_and_bodies().build(), scheme, out=path, **kept)
    run.save(tmp_path / "saved.h5")
    assert any(len(run.contacts(t)) > 0 for t in run.t)
    for again in (mbvi.load(path), mbvi.load(tmp_path / "saved.h5")):
        same_contacts(run, again, len(run.t))
        for name in ("hopper", "hopper/foot", "spheres", "spheres[1]", "floor"):
            np.testing.assert_array_equal(again.contact_forces(name), run.contact_forces(name))
        assert again.contact_forces().keys() == run.contact_forces().keys()


def test_a_run_that_touches_nothing_keeps_that_it_recorded(tmp_path):
    scene = mbvi.Scene()
    scene.add_sphere(0.1, name="ball")
    mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1, record="contacts", out=tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    assert again.contacts(0.05) == () and again.contact_forces() == {}
    np.testing.assert_array_equal(again.contact_forces("ball"), np.zeros((11, 6)))


KILLED = """
import sys
from support.scenes import robot_and_bodies
import mbvi
mbvi.simulate(robot_and_bodies().build(), mbvi.Paoli(), step=2e-4, duration=1000.0, every=5, out=sys.argv[1],
    record="contacts")
"""


def test_a_killed_run_keeps_contacts_as_far_as_states(tmp_path):
    path = tmp_path / "killed.h5"
    kill_writing(KILLED, path, states=1000, impacts=1)
    cut = mbvi.load(path)
    assert not cut.complete and len(cut.t) >= 1000
    duration = float(cut.t[800])
    whole = mbvi.simulate(
        robot_and_bodies().build(), mbvi.Paoli(), step=2e-4, duration=duration, every=5, record="contacts"
    )
    same_contacts(cut, whole, 800)
    assert cut.contacts(float(cut.t[-1]))


def test_who_did_not_record_is_told_how():
    run = mbvi.simulate(robot_and_bodies().build(), mbvi.Paoli(), step=1e-3, duration=0.1)
    for ask in (lambda: run.contacts(0.05), lambda: run.contact_forces(), lambda: run.contact_forces("hopper")):
        with pytest.raises(mbvi.InputError, match=r'record="contacts"'):
            ask()
    for record in ("contact", "", 1, True, ["contacts"], np.array(["contacts"])):
        with pytest.raises(mbvi.InputError, match="record must be one of 'contacts'"):
            mbvi.simulate(robot_and_bodies().build(), mbvi.Paoli(), step=1e-3, duration=0.1, record=record)


def test_names_that_are_not_known_and_times_outside():
    run = mbvi.simulate(robot_and_bodies().build(), mbvi.Paoli(), step=1e-3, duration=0.4, record="contacts")
    for name in ("dog", "hopper/", "spheres[2]", "hopper/knee", "", 3):
        with pytest.raises(mbvi.InputError, match=r"unknown name .* known are floor, hopper, .*hopper/foot"):
            run.contact_forces(name)
    for t in (-1e-9, 0.5, np.nan):
        with pytest.raises(mbvi.InputError, match="outside the run"):
            run.contacts(t)
    assert run.contacts(0.0) == ()
    # a link without shapes touches nothing, and several shapes of one are one link
    assert not run.contact_forces("hopper/thigh").any() or run.contact_forces("hopper/thigh").shape == (401, 6)
    parts = [n for n in ("hopper/shin_0", "hopper/shin_1") if any(n in s.name for s in run.problem.scene.shapes)]
    np.testing.assert_allclose(run.contact_forces("hopper/shin"), sum(run.contact_forces(n) for n in parts))


def test_limits_are_contacts_without_a_place():
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", name="pendulum")
    problem = scene.build()
    limits = [k for k in range(len(problem.constraints)) if "limit" in problem.constraints.name(k)]
    if not limits:
        pytest.skip("the pendulum has no limits")
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=1.0, record="contacts")
    assert not run.contact_forces("pendulum").any()


def test_given_functions_have_no_bodies(tmp_path):
    system = mbvi.LagrangianSystem(lambda q: 2.0 * np.eye(1), lambda t, q, v: np.array([-2.0 * G]), 1)
    problem = mbvi.Problem(system, [mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1), name="wall")], [0.0], [0.0])
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.1, record="contacts")
    (contact,) = run.contacts(0.05)
    assert (contact.name, contact.force) == ("wall", pytest.approx(2.0 * G)) and np.isnan(contact.point).all()
    assert run.contact_forces() == {}
    run.save(tmp_path / "run.h5")
    with pytest.raises(mbvi.InputError, match="known are none"):
        run.contact_forces("wall")
