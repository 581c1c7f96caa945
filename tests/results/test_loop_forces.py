"""Forces of connections and couplings against statics, a pendulum, an impact, and the balance in plain numpy."""

import numpy as np
import pytest

import mbvi
from support.four_bar import four_bar

G = 9.81
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.StewartTrinkle()]
every_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=["paoli", "moreau_jean", "centered", "piles"])


def welded(height, e=0.0, mu=0.0):
    """A box of 2 kg with one of 1 kg welded to its side."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.2, 0.2), 2.0, position=(0, 0, 0.1 + height), name="a")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0.3, 0, 0.3 + height), name="b")
    scene.weld("a", "b", name="glue")
    return scene.build()


@every_scheme
def test_a_box_that_hangs_on_a_weld_pulls_with_its_weight(scheme):
    """The first is the world: it holds the box by its weight, and by the moment of its arm."""
    scene = mbvi.Scene()
    scene.add_box((0.2, 0.2, 0.2), 2.0, position=(0.5, 0, 0), name="box")
    scene.weld("world", "box", name="bolt")
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.02, progress=False)
    forces = run.loop_forces("bolt")
    assert forces.shape == (len(run.t), 6)
    assert (forces[0] == 0.0).all()
    # welds are about the world's origin
    assert forces[1:] == pytest.approx(np.tile([0, 0, 2 * G, 0, -0.5 * 2 * G, 0], (20, 1)), abs=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_pendulum_pulls_at_its_hinge(angle):
    """At rest and released: 3 parts of weight and speed, in textbook form; second order in the step."""
    scene = mbvi.Scene()
    length, mass = 0.5, 1.5
    along = np.array([np.sin(angle), 0, -np.cos(angle)])
    scene.add_sphere(0.1, mass, position=length * along, name="ball")
    scene.add_box((0.05, 0.05, 0.05), 1e-3, position=(0, 0, 0), name="pin")
    scene.hinge("world", "pin", at=(0, 0, 0), axis=(0, 1, 0), name="pivot")
    scene.connect("pin", "ball", at=length * along, name="rod")
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.3, progress=False)
    # the pin's seven coordinates stand before those of the ball
    middle, v = 0.5 * (run.q[1:, 7:10] + run.q[:-1, 7:10]), 0.5 * (run.v[1:, 6:9] + run.v[:-1, 6:9])
    tension = mass * (np.einsum("ij,ij->i", v, v) / length + G * -middle[:, 2] / length)
    expected = -tension[:, None] * middle / length
    assert run.loop_forces("rod")[1:, :3] == pytest.approx(expected, abs=2e-4 * mass * G)


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


@pytest.mark.parametrize("scheme", [*SCHEMES, mbvi.Centered(project_positions=True)], ids=str)
def test_a_box_that_spins_about_a_ball_joint_pulls_as_newton_and_euler_say(scheme):
    """Gyroscopic torques of the box are no reaction of its joint. The first step of some schemes has another one."""
    size, mass, spin, arm = np.array([0.4, 0.1, 0.2]), 1.3, np.array([3.0, 5.0, -4.0]), np.array([0.2, 0.0, 0.0])
    scene = mbvi.Scene()
    scene.add_box(size, mass, position=arm, velocity=np.cross(spin, arm), angular_velocity=spin, name="box")
    scene.connect("world", "box", at=(0, 0, 0), name="pivot")
    run = mbvi.simulate(scene.build(), scheme, step=1e-5, duration=5e-5, progress=False)
    # m (a x r + w x (w x r)) = m g + f and I a + w x I w = -r x f, for the angular acceleration a and the force f
    inertia = mass / 12.0 * np.diag((size**2).sum() - size**2)
    A = np.block([[-mass * skew(arm), -np.eye(3)], [inertia, skew(arm)]])
    weight = mass * np.array([0, 0, -G]) - mass * np.cross(spin, np.cross(spin, arm))
    force = np.linalg.solve(A, [*weight, *-np.cross(spin, inertia @ spin)])[3:]
    assert run.loop_forces("pivot")[2, :3] == pytest.approx(force, abs=5e-3)


@every_scheme
@pytest.mark.parametrize(("e", "mu"), [(0.0, 0.0), (0.5, 0.4)])
def test_the_second_body_moves_by_its_connection_alone(scheme, e, mu):
    """m (v+ - v-) of the welded box, less its weight, in flight and through the impact of the other."""
    run = mbvi.simulate(welded(0.05, e, mu), scheme, step=1e-3, duration=0.2, progress=False)
    assert run.impacts
    change = np.diff(run.v[:, 6:9], axis=0) / 1e-3 + [0, 0, G]
    found = run.loop_forces("glue")[1:, :3]
    assert np.abs(found - change).max() < 1e-12 * np.abs(change).max()
    assert np.abs(found[:, 2]).max() > 30 * G


def test_means_of_recorded_steps_are_those_of_all(tmp_path):
    problem = welded(0.05)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.2, progress=False)
    thinned = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.2, every=10, progress=False)
    mean = run.loop_forces("glue")[1:].reshape(20, 10, 6).mean(axis=1)
    assert np.abs(thinned.loop_forces("glue")[1:] - mean).max() < 1e-9 * np.abs(mean).max()
    run.save(tmp_path / "run.h5")
    assert np.array_equal(mbvi.load(tmp_path / "run.h5").loop_forces("glue"), run.loop_forces("glue"))


def test_redundant_rows_share_their_load():
    """A four-bar linkage of boxes in space: more rows than rank, and the sum of its hinges bears its weight."""
    run = mbvi.simulate(four_bar().build(), mbvi.Centered(), step=1e-3, duration=0.1, progress=False)
    names = [c.name for c in run.problem.scene.items.connections]
    forces = {name: run.loop_forces(name) for name in names}
    items = {c.name: c for c in run.problem.scene.items.connections}
    momentum = sum(m * run.v[:, 6 * k : 6 * k + 3] for k, m in enumerate((1.0, 2.0, 1.5)))
    change = np.diff(momentum, axis=0) / 1e-3 + [0, 0, 4.5 * G]
    outside = sum(
        (1.0 if items[name].first == "world" else -1.0) * force[1:, :3]
        for name, force in forces.items()
        if "world" in (items[name].first, items[name].second)
    )
    assert np.abs(outside - change).max() < 1e-8 * np.abs(change).max()


def test_a_coupling_pushes_the_first_joint(tmp_path):
    """Two sliders of 2 kg that move as one: 3 N on one of them pull the other by half."""
    text = (
        '<robot name="r"><link name="base"/><link name="l"><inertial><mass value="2"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="prismatic">'
        '<parent link="base"/><child link="l"/><axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/>'
        "</joint></robot>"
    )
    path = tmp_path / "r.urdf"
    path.write_text(text)
    scene = mbvi.Scene()
    scene.add_urdf(path, "fixed", name="a")
    scene.add_urdf(path, "fixed", name="b", position=(0, 5, 0), control=lambda t, q, v: np.array([3.0]))
    assert scene.couple("a/j", "b/j", ratio=2.0) == "coupling"
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=0.05, progress=False)
    # a moves twice as far as b: 2 * 2 a + 2 * 4 a = 3 ... in generalised coordinates of b, 2 + 2 * 4 = 10 kg
    assert run.loop_forces("coupling")[1:] == pytest.approx(np.full(50, 2.0 * 2.0 * 3.0 / 10.0), rel=1e-9)


def test_what_is_no_connection_is_refused():
    run = mbvi.simulate(welded(0.05), mbvi.Paoli(), step=1e-3, duration=0.01, progress=False)
    with pytest.raises(mbvi.InputError, match="'rope' is no connection or coupling of this run; known are glue"):
        run.loop_forces("rope")
    located = mbvi.simulate(welded(0.05), mbvi.EventDriven(1e-4), duration=0.01, progress=False)
    with pytest.raises(mbvi.InputError, match="EventDriven takes no steps"):
        located.loop_forces("glue")
