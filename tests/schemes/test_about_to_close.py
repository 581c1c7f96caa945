"""Contacts that a step leaves slightly open bear load in the next step, where positions are projected."""

import numpy as np
import pytest

import mbvi
from mbvi.run.fixed_steps import taking
from support.shaken_table import Table

LEGS = np.tile([0.0, 0.6, -1.2], 4)


def landing(friction, e=0.0):
    """A quadruped on soft PD control, dropped by two centimetres."""
    scene = mbvi.Scene(friction=friction, restitution=e)
    scene.add_halfspace((0, 0, 1))
    names = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]
    control = mbvi.PDControl(LEGS, 60.0, 1.5)
    path = mbvi.robot("quadruped")
    scene.add_urdf(path, position=(0, 0, 0.37), joints=dict(zip(names, LEGS, strict=True)), control=control)
    return scene.build()


@pytest.mark.parametrize("friction", [0.0, 0.7])
@pytest.mark.parametrize("h", [4e-3, 2e-3, 1e-3])
def test_a_robot_that_has_landed_stands_still(friction, h):
    """Without penetration its feet would be active in every other step only, and its legs would rattle."""
    problem = landing(friction)
    run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=h, duration=1.0, progress=False)
    assert max(impact.time for impact in run.impacts) < 0.2
    # with friction it still sways
    assert np.abs(run.v[-1]).max() < 0.1
    assert run.penetration()[-10:].max() <= 10 * problem.tolerance
    feet = problem.constraints.gap(run.t[-1], run.q[-1])
    assert (np.sort(feet)[:4] <= 100 * problem.tolerance).all()


@pytest.mark.parametrize(("friction", "e"), [(0.0, 0.5), (0.7, 0.5), (0.7, 0.0)])
def test_it_lands_the_same_by_the_loop_and_by_python(friction, e, monkeypatch):
    """A row that bears load and closes within the step is closed: each part of the code that asks must know."""
    runs, scheme = [], mbvi.Centered(project_positions=True)
    for loop in (True, False):
        if not loop:
            monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
        runs.append(mbvi.simulate(landing(friction, e), scheme, step=1e-3, duration=0.2, progress=False))
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(runs[0].v, runs[1].v, rtol=0.0, atol=1e-8)
    assert [i.time for i in runs[0].impacts] == [i.time for i in runs[1].impacts]


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("other", ["robot", "box"])
def test_a_ball_bounces_beside_a_body_that_is_projected(other, friction, loop, monkeypatch):
    """The velocity after the position projection keeps Newton's law of contacts that bounce."""
    if not loop:
        monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    scene = mbvi.Scene(restitution=0.5, friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(2, 0, 0.6), name="ball")
    if other == "robot":
        scene.add_urdf(mbvi.robot("hopper"), position=(0, 0, 0.5), joints={"knee": 0.4})
    else:
        scene.add_box((0.4, 0.3, 0.1), mass=1.0, position=(0, 0, 0.08), rotation=(0.02, 0.01, 0), name="box")
    problem, count = scene.build(), 0
    for step in (7e-4, 1e-3, 2e-3):
        run = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=step, duration=1.0, progress=False)
        for impact in run.impacts:
            for k, name in enumerate(impact.constraints):
                if name == "ball | floor" and impact.before[k] < -0.05:
                    assert impact.after[k] == pytest.approx(-0.5 * impact.before[k], abs=1e-6)
                    count += 1
    assert count >= 9


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("tilt", [3e-4, 1e-3, 3e-3, 1e-2])
def test_a_tilted_box_leaves_by_newtons_law(tilt, friction):
    """The edge that rises is not the one that sinks, though both are contacts of one pair."""
    scene = mbvi.Scene(restitution=0.5, friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.3, 0.1), mass=1.0, position=(0, 0, 0.3), rotation=(0, tilt, 0), name="box")
    run = mbvi.simulate(scene.build(), mbvi.Centered(project_positions=True), step=1e-3, duration=0.6, progress=False)
    hard = [(i.before[k], i.after[k]) for i in run.impacts for k in np.flatnonzero(i.before < -0.05)]
    assert len(hard) >= 4
    for before, after in hard:
        assert after >= -0.5 * before - 1e-3


@pytest.mark.parametrize("friction", [0.0, 0.7])
@pytest.mark.parametrize("ground", ["field", "mesh"])
def test_a_body_that_tilts_bears_its_load_in_every_step_on_any_ground(ground, friction):
    """A leaning capsule slides and falls over: its gap opens by the curvature of its path, on a mesh as on a plane."""
    runs = []
    for kind in (ground, "plane"):
        scene = mbvi.Scene(friction=friction, restitution=0.5)
        if kind == "plane":
            scene.add_halfspace((0, 0, 1))
        elif kind == "field":
            scene.add_heightfield(np.zeros((9, 9)), size=(8, 8))
        else:
            corners = [[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]]
            scene.add_surface(corners, [[0, 1, 2], [0, 2, 3]], one_sided=True)
        height = 0.1 + 0.15 * np.cos(0.3)
        scene.add_capsule(0.1, 0.3, position=(0, 0, height), rotation=(0, 0.3, 0), velocity=(2, 0, 0))
        scheme = mbvi.Centered(project_positions=True)
        runs.append(mbvi.simulate(scene.build(), scheme, step=2e-3, duration=0.1, record="contacts"))
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-9)
    assert all(runs[0].contacts(t) for t in runs[0].t[1:])


def on_shaken_table(kind, friction, amplitude, frequency, phase, e):
    """A body of 1 kg that the table, which moves by `amplitude` sin, bears, and its start at the table's speed."""
    w = 2.0 * np.pi * frequency
    start, speed = amplitude * np.sin(phase), amplitude * w * np.cos(phase)
    if kind == "function":
        system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=lambda t, q, v: np.array([-9.81]), dim=1)
        return mbvi.Problem(system, [Table(amplitude, w)], [start], [speed], restitution=e, t0=phase / w)
    scene = mbvi.Scene(friction=friction, restitution=e)
    shaken = mbvi.motion.Oscillation((0, 0, amplitude), frequency, phase)
    scene.add_halfspace((0, 0, 1), motion=shaken, name="table")
    if kind == "ball":
        scene.add_sphere(0.05, 1.0, position=(0, 0, 0.05 + start), velocity=(0, 0, speed))
    else:
        scene.add_box((0.1, 0.12, 0.08), 1.0, position=(0, 0, 0.04 + start), velocity=(0, 0, speed))
    return scene.build()


PROJECTED = [mbvi.Centered(project_positions=True), mbvi.Paoli(project_positions=True)]
PROJECTED += [mbvi.MoreauJean(project_positions=True)]


@pytest.mark.parametrize("scheme", PROJECTED, ids=repr)
@pytest.mark.parametrize(("kind", "friction"), [("ball", 0.0), ("box", 0.5), ("function", 0.0)])
@pytest.mark.parametrize(("amplitude", "frequency", "phase"), [(0.01, 3.0, 0.0), (0.002, 8.0, 0.0), (2e-4, 30.0, 1.5)])
@pytest.mark.parametrize("h", [4e-3, 1e-3])
def test_what_a_shaken_table_bears_is_borne_in_every_step(scheme, kind, friction, amplitude, frequency, phase, h):
    """Below an acceleration of g it stays on the table. The force is m (g + a), with a of the last steps."""
    problem = on_shaken_table(kind, friction, amplitude, frequency, phase, 0.0)
    run = mbvi.simulate(problem, scheme, step=h, duration=0.4, progress=False)
    w, t, vertical = 2.0 * np.pi * frequency, run.t[1:] - run.t[0], 0 if kind == "function" else 2
    most = amplitude * w**2
    assert most < 9.81
    forces = 9.81 + np.diff(run.v[:, vertical]) / h
    around = w * np.linspace(t - 2.0 * h, t + 0.5 * h, 26) + phase
    expected, order = 9.81 - most * np.sin(around), 0.3 * w * h * most
    # the first steps begin at the speed of the table, which no step before led to
    assert (forces >= expected.min(axis=0) - order)[3:].all() and (forces <= expected.max(axis=0) + order)[3:].all()
    gaps = [problem.constraints.gap(time, q).min() for time, q in zip(run.t, run.q, strict=True)]
    assert min(gaps) >= -1e-8


@pytest.mark.parametrize("scheme", PROJECTED, ids=repr)
def test_a_table_that_falls_faster_leaves_what_lies_on_it(scheme):
    """It flies on as a parabola from the time at which the table's acceleration is that of gravity."""
    amplitude, w = 0.02, 2.0 * np.pi * 5.0
    problem = on_shaken_table("ball", 0.0, amplitude, 5.0, 0.0, 0.0)
    h = 1e-3
    run = mbvi.simulate(problem, scheme, step=h, duration=0.06, progress=False)
    left = np.arcsin(9.81 / (amplitude * w**2)) / w
    flown = run.t[-1] - left
    height = 0.05 + amplitude * np.sin(w * left) + amplitude * w * np.cos(w * left) * flown - 9.81 / 2 * flown**2
    assert left < 0.02
    # the last step on the table may be half of one too long
    assert run.q[-1, 2] == pytest.approx(height, abs=1e-4)
    assert problem.constraints.gap(run.t[-1], run.q[-1]).min() > 1e-3
