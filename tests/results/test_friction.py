"""Friction as impacts, contacts, forces, files, summaries and the diagnosis show it."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from support.faults import damaged_files as faults
from support.paths import ROBOTS

G = 9.81
SCHEMES = (mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle())
FIELDS = ("tangential", "slip_before", "slip_after", "e_used")


def named(scheme):
    return type(scheme).__name__


def thrown(shape, e, mu, gravity=0.0, spin=(0.0, 0.0, 0.0)):
    """Return a scene with one body that is about to meet a sloping plane."""
    scene = mbvi.Scene(gravity=(0, 0, -gravity), restitution=e, friction=mu)
    scene.add_halfspace((0.1, 0.2, 1.0), name="ramp")
    place = {"velocity": (1.0, -0.4, -2.0), "position": (0, 0, 0.5), "name": "body"}
    if shape == "sphere":
        scene.add_sphere(0.1, 1.5, **place)
    else:
        turned = {"rotation": pin.exp3(np.array([0.3, 0.8, 0.1])), "angular_velocity": spin}
        scene.add_box((0.6, 0.05, 0.04), 1.5, **place, **turned)
    return scene


def first_impact(scene, scheme=None, duration=0.22):
    run = mbvi.simulate(scene.build(), scheme or mbvi.Paoli(), step=1e-3, duration=duration)
    return run, run.impacts[0]


def energy_lost(run, impact):
    """Return the kinetic energy after an impact less that of the motion under forces alone."""
    k, system = int(np.searchsorted(run.t, impact.time - 1e-9)), run.problem.system
    metric, v, w = system.metric(run.q[k]), run.v[k - 1], run.v[k]
    x = system.free_motion(run.t[k - 1], run.q[k], v, run.step).free
    return 0.5 * (w - x) @ metric.apply(w + x)


@pytest.mark.filterwarnings("ignore:at t = .* an impact raised the energy")
@pytest.mark.parametrize("mu", [0.1, 0.6, 2.0])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_the_energy_of_an_impact_is_what_the_body_lost(shape, e, mu):
    # the sphere's run ends at the impact
    run, impact = first_impact(thrown(shape, e, mu), duration=0.201 if shape == "sphere" else 0.22)
    assert impact.energy_change == pytest.approx(energy_lost(run, impact), rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_with_weight_it_is_what_the_law_took_from_the_free_motion(shape):
    run, impact = first_impact(thrown(shape, 0.0, 0.5, gravity=G, spin=(0.3, 0.2, -0.5)))
    assert impact.energy_change == pytest.approx(energy_lost(run, impact), rel=1e-11)


@pytest.mark.parametrize("scheme", SCHEMES[:3], ids=named)
@pytest.mark.parametrize("mu", [0.05, 3.0])
def test_a_sphere_that_strikes_a_slope_gets_the_percussion_of_its_impact(scheme, mu):
    run, impact = first_impact(thrown("sphere", 0.4, mu), scheme)
    k = int(np.searchsorted(run.t, impact.time + 0.5 * run.step))
    jump = 1.5 * (run.v[k + 1] - run.v[k - 2])[:3]
    given = impact.percussion[0] * impact.normal[0] + impact.tangential[0]
    np.testing.assert_allclose(given, jump, rtol=0, atol=1e-12)
    assert impact.regime == (("stick",) if mu > 1.0 else ("slip",))
    along = impact.tangential[0]
    assert abs(along @ impact.normal[0]) < 1e-14 and abs(impact.slip_before[0] @ impact.normal[0]) < 1e-14
    if impact.regime == ("slip",):
        assert np.linalg.norm(along) == pytest.approx(mu * impact.percussion[0], rel=1e-12)
        direction = impact.slip_after[0] / np.linalg.norm(impact.slip_after[0])
        np.testing.assert_allclose(along, -np.linalg.norm(along) * direction, rtol=0, atol=1e-12)
    else:
        # 2/7 of the slip is taken from a homogeneous sphere
        np.testing.assert_allclose(along, -1.5 * 2 / 7 * impact.slip_before[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(impact.slip_after, 0.0, atol=1e-13)
    np.testing.assert_array_equal(impact.e_used, [0.4])


def test_without_friction_there_is_nothing_of_it():
    scene = mbvi.Scene(friction=0.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.2), name="box")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3, record="contacts")
    assert all(getattr(run.impacts[0], name) is None for name in (*FIELDS, "regime"))
    contact = run.contacts(0.3)[0]
    assert contact.tangential is contact.slip is contact.regime is None
    assert "stick" not in repr(run) and "regime" not in run.impact_table()


def test_contacts_with_their_own_friction_are_told_apart():
    scene = mbvi.Scene(friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    for name, x in (("rough", 0.0), ("smooth", 1.0)):
        scene.add_box((0.2, 0.2, 0.2), 1.0, position=(x, 0, 0.1), velocity=(0, 1.0, 0), name=name)
    scene.set_friction("smooth", "floor", 0.0)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.6, record="contacts")
    late = {contact.name: contact for contact in run.contacts(0.6)}
    assert late["rough | floor"].regime == "stick" and late["smooth | floor"].regime == "slip"
    assert not late["smooth | floor"].tangential.any()
    early = {contact.name: contact for contact in run.contacts(0.1)}
    assert early["rough | floor"].regime == "slip"
    np.testing.assert_allclose(early["rough | floor"].slip[1], 1.0 - 0.4 * G * 0.1, rtol=1e-9)
    np.testing.assert_allclose(run.contact_forces("rough")[50, :3], [0.0, -0.4 * G, G], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("every", [1, 6])
@pytest.mark.parametrize("scheme", SCHEMES, ids=named)
def test_a_box_on_an_incline_is_held_by_its_contacts(scheme, every):
    slope = np.array([0.3, 0.1, 1.0])
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace(slope, name="ramp")
    normal = slope / np.linalg.norm(slope)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0, 1]), normal).toRotationMatrix()
    scene.add_box((0.3, 0.2, 0.1), 2.0, position=0.05 * normal, rotation=turn, name="box")
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.12, every=every, record="contacts")
    wrench = run.contact_forces("box")[-1]
    np.testing.assert_allclose(wrench[:3], [0, 0, 2.0 * G], rtol=0, atol=1e-8)
    np.testing.assert_allclose(wrench[3:], np.cross(run.q[-1, :3], wrench[:3]), rtol=0, atol=1e-7)
    assert {contact.regime for contact in run.contacts(0.12)} == {"stick"}
    np.testing.assert_array_equal(run.contact_forces("ramp"), -run.contact_forces("box"))


def test_a_quadruped_on_a_slope_is_held_by_its_feet():
    path = ROBOTS / "quadruped/quadruped.urdf"
    slope = np.array([0.2, 0.0, 1.0])
    scene = mbvi.Scene(friction=0.8)
    scene.add_halfspace(slope, name="ramp")
    joints = pin.buildModelFromUrdf(str(path)).names.tolist()[1:]
    turn = pin.exp3(np.array([0, np.arctan(0.2), 0]))
    scene.add_urdf(path, position=(0, 0, 0.46), rotation=turn, name="robot", locked=joints)
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=1e-3, duration=0.2, record="contacts")
    weight = G * sum(inertia.mass for inertia in problem.system.model.inertias)
    np.testing.assert_allclose(run.contact_forces("robot")[-1, :3], [0, 0, weight], rtol=0, atol=1e-9 * weight)
    feet = run.contacts(0.2)
    assert len(feet) == 4 and {foot.regime for foot in feet} == {"stick"}
    assert run.impacts[0].regime == ("stick",) * 4


def pile(e):
    scene = mbvi.Scene(gravity=(0.5, -0.3, -G), restitution=e, friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, 1), -1.5, name="ramp")
    scene.add_box((0.4, 0.4, 0.4), position=(0, 0, 0.2), fixed=True, name="step")
    scene.add_halfspace((1, 0, 0), -0.9, name="belt", motion=mbvi.motion.Translation((0, 0.5, 0)))
    rng, masses = np.random.default_rng(5), {}
    for k, place in enumerate([(-0.5, 0, 0.3), (0, 0.1, 0.6), (0.4, 0, 0.4), (-0.4, 0.1, 0.7), (0.1, 0.1, 1.0)]):
        body = {"position": place, "velocity": rng.uniform(-2, 2, 3), "name": f"body {k}"}
        turned = {"rotation": pin.exp3(rng.normal(size=3)), "angular_velocity": rng.normal(size=3)}
        if k % 2:
            masses[scene.add_sphere(0.12, 1.0 + k, **body)] = 1.0 + k
        else:
            masses[scene.add_box((0.15, 0.2, 0.12), 1.0 + k, **body, **turned)] = 1.0 + k
    return scene.build(), masses


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("scheme", SCHEMES, ids=named)
def test_momentum_is_what_gravity_and_contacts_gave(scheme, every):
    problem, masses = pile(0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.3)
    run = mbvi.simulate(problem, scheme, step=2e-3, duration=0.4, every=every, record="contacts")
    dt, system = np.diff(run.t, prepend=run.t[0]), problem.system
    for name, mass in masses.items():
        force = run.contact_forces(name)[:, :3]
        body = np.array([system.bodies.index(name)])
        centre = system.placements(run.q[0], body)[0, 3]
        rows = system.separation_rows(run.q[0], np.zeros(3, int), body.repeat(3), np.tile(centre, (3, 1)), np.eye(3))
        v = run.v @ np.asarray(rows).T
        given = np.cumsum(dt[:, None] * (force + mass * np.array([0.5, -0.3, -G])), axis=0)
        scale = mass * np.abs(v).max() + np.abs(dt[:, None] * force).sum()
        np.testing.assert_allclose(given, mass * (v - v[0]), rtol=0, atol=1e-9 * scale)
        assert force.any()


def rough_rod(**more):
    """Return a scene with a rod that meets the floor at 45 degrees and gains energy by its friction."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.95, friction=1.0, **more)
    scene.add_halfspace((0, 0, 1), name="floor")
    turn = pin.exp3(np.array([0.0, np.pi / 4, 0.0]))
    scene.add_capsule(0.005, 1.0, 1.0, position=(0, 0, 0.5), rotation=turn, velocity=(0.5, 0, -1), name="rod")
    return scene


def test_an_impact_that_gains_energy_is_noted_and_reported():
    with pytest.warns(mbvi.MbviWarning, match="raised the energy"):
        run, impact = first_impact(rough_rod(), duration=0.2)
    assert impact.energy_change == pytest.approx(energy_lost(run, impact), rel=1e-11) and impact.energy_change > 0.01
    assert f"raised the energy by {impact.energy_change:.3g} J" in run.notes[0] and "Kane" in run.notes[0]
    found = run.diagnosis()
    assert found.gains == ((impact.time, impact.energy_change),)
    assert found.energy_excess == pytest.approx(impact.energy_change, rel=1e-6)
    assert "1 impact with friction raised the kinetic energy" in str(found)


def test_an_impact_gives_the_restitution_that_gained_no_energy(tmp_path):
    run, impact = first_impact(rough_rod(energy_cap=True), duration=0.2)
    assert 0.0 < impact.e_used[0] < 0.95 and impact.after == pytest.approx(-impact.e_used * impact.before)
    assert impact.energy_change == pytest.approx(energy_lost(run, impact), abs=1e-12)
    assert abs(impact.energy_change) < 1e-9 and not run.diagnosis().gains
    run.save(tmp_path / "run.h5")
    same_fields(mbvi.load(tmp_path / "run.h5").impacts[0], impact)


def test_the_diagnosis_names_dependent_contacts():
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.1), velocity=(1, 0, 0), name="box")
    found = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1).diagnosis()
    assert not any(instant.friction_independent for instant in found.instants)
    assert "rows of contacts with friction are dependent at" in str(found) and "velocities need not be" in str(found)
    assert found.energy_excess < 1e-9 and not found.gains


def test_it_does_not_where_they_are_independent():
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(2):
        scene.add_sphere(0.1, 1.0, position=(0.5 * k, 0, 0.2), velocity=(1, 0, 0))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3)
    found = run.diagnosis()
    assert all(instant.friction_independent for instant in found.instants)
    assert "dependent" not in str(found)
    # two spheres that land at once: their impact is not followed
    assert found.not_followed == 1 and np.isnan(found.horizon) and "only sought without friction" in str(found)


def brick_and_ball(**more):
    scene = mbvi.Scene(friction=0.3, restitution=0.2, **more)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.1), velocity=(2, 0.2, -1), name="brick")
    scene.add_sphere(0.1, 1.0, position=(1, 0, 0.12), velocity=(-1, 0, -1), name="ball")
    return scene


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("streamed", [False, True])
def test_files_keep_friction_to_the_bit(every, streamed, tmp_path):
    path = tmp_path / "run.h5"
    out = {"out": path} if streamed else {}
    problem = brick_and_ball().build()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.3, every=every, record="contacts", **out)
    if not streamed:
        run.save(path)
    back = mbvi.load(path)
    assert len(run.impacts) == len(back.impacts) > 2 and {"stick", "slip"} <= {w for i in run.impacts for w in i.regime}
    for first, second in zip(run.impacts, back.impacts, strict=True):
        same_fields(first, second)
    for t in run.t:
        for first, second in zip(run.contacts(t), back.contacts(t), strict=True):
            same_fields(first, second)
    np.testing.assert_array_equal(run.contact_forces("brick"), back.contact_forces("brick"))
    assert "Coulomb friction, mu 0.3" in back.problem.report()
    assert repr(back) == repr(run) and back.impact_table() == run.impact_table()


def same_fields(first, second):
    for field in dataclasses.fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        assert type(a) is type(b), field.name
        assert a.tobytes() == b.tobytes() if isinstance(a, np.ndarray) else a == b, field.name


def test_runs_of_functions_keep_friction_too(tmp_path):
    """A particle on a rough plane, given by functions: tangents (1, 0, 0) and (0, 1, 0) stand for its own."""
    system = mbvi.LagrangianSystem(lambda q: 2.0 * np.eye(3), lambda t, q, v: np.array([0.0, 0.0, -2.0 * G]), 3)
    rows = np.eye(3)
    plane = mbvi.GapFunction(lambda q: q[2], lambda q: rows[2], tangents=lambda q: rows[:2])
    problem = mbvi.Problem(system, [plane], [0.0, 0.0, 0.0], [0.6, -0.8, -1.0], friction=0.25)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.1, record="contacts")
    late = run.contacts(0.05)[0]
    np.testing.assert_allclose(late.tangential, 1e-3 * 0.25 * 2 * G * np.array([-0.6, 0.8, 0]), rtol=0, atol=1e-13)
    assert late.regime == "slip" and np.isnan(late.normal).all()
    run.save(tmp_path / "run.h5")
    back = mbvi.load(tmp_path / "run.h5")
    assert back.problem is None
    same_fields(back.contacts(0.05)[0], late)
    assert [impact.regime for impact in back.impacts] == [impact.regime for impact in run.impacts]


DAMAGE = {
    "impacts/regime: _missing": "friction, or lack it", "contacts/slip: _missing": "no column contacts/slip",
    "impacts/tangential: one nan": "impacts/tangential holds", "impacts/e_used: one inf": "impacts/e_used holds",
    "contacts/regime: _objects": "contacts/regime holds other words", "impacts/slip_after: _shorter": "rows",
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGE)
def test_wrong_columns_of_friction_are_named(name, tmp_path):
    path = tmp_path / "run.h5"
    run = mbvi.simulate(brick_and_ball().build(), mbvi.Paoli(), step=1e-3, duration=0.2, record="contacts")
    run.save(path)
    faults.mutate(path, dict(faults.mutations(path))[name], np.random.default_rng(1), sealed=True)
    with pytest.raises(mbvi.TrajectoryFileError, match=DAMAGE[name]):
        mbvi.load(path)


def test_a_control_sees_what_sticks():
    scene, seen = brick_and_ball(), []
    scene.add_control(lambda state: seen.append((state.t, state.contacts)))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.2, record="contacts")
    # Paoli evaluates forces at the end of a step, which has contacts later
    at, contacts = seen[150]
    for first, second in zip(contacts, run.contacts(at - 1.5e-3), strict=True):
        same_fields(first, second)
    assert {contact.regime for _, contacts in seen for contact in contacts} == {"stick", "slip"}


def test_summary_and_table_count_what_sticks_and_slips():
    run = mbvi.simulate(brick_and_ball().build(), mbvi.Paoli(), step=1e-3, duration=0.3)
    words = [word for impact in run.impacts for word in impact.regime]
    assert f"where {words.count('stick')} contacts stick and {words.count('slip')} slip" in repr(run)
    assert len(repr(run).splitlines()) == 5
    line = next(line for line in run.impact_table().splitlines() if "slip" in line)
    assert "brick | floor" in line or "ball | floor" in line


def test_a_belt_has_its_own_speed():
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="belt", motion=mbvi.motion.Translation((0.7, 0, 0)))
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05), name="brick")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3, record="contacts")
    early, late = run.contacts(0.05)[0], run.contacts(0.3)[0]
    assert early.regime == "slip" and late.regime == "stick"
    np.testing.assert_allclose(early.slip, [0.5 * G * 0.05 - 0.7, 0, 0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES, ids=named)
def test_what_slips_has_the_percussion_of_coulombs_law_and_what_sticks_no_velocity(scheme):
    problem, _ = pile(0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.3)
    run = mbvi.simulate(problem, scheme, step=2e-3, duration=0.4, record="contacts")
    rows = [(p, t, u, word) for i in run.impacts
            for p, t, u, word in zip(i.percussion, i.tangential, i.slip_after, i.regime, strict=True)]  # fmt: skip
    rows += [(c.percussion, c.tangential, c.slip, c.regime) for t in run.t for c in run.contacts(t)]
    assert {word for *_, word in rows} == {"stick", "slip"}
    for p, tangential, slip, word in rows:
        size, speed = np.linalg.norm(tangential), np.linalg.norm(slip)
        if word == "stick":
            assert size <= 0.3 * p * (1 + 1e-9) and speed < 1e-8
        else:
            np.testing.assert_allclose(tangential * speed, -0.3 * p * slip, rtol=0, atol=1e-8 * 0.3 * p * speed)
