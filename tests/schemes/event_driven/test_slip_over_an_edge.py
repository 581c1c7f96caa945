"""A box tips over the edge of a table and begins to slip, in scenes turned in any way."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import mbvi

G, MU, DURATION = 9.81, 0.4, 0.3
# half of the box's length and height, and how far its centre is beyond the edge at the start [m]
LONG, HIGH, BEYOND = 0.2, 0.05, 0.03
# the second one turns tangents about the normal, in the third one the normal passes the plane where they jump
TURNED = {
    "not turned": np.eye(3),
    "turned": Rotation.from_euler("ZXY", [0.7, 0.5, -1.1]).as_matrix(),
    "normal becomes horizontal": Rotation.from_euler("ZYZ", [0.4, 0.5 * np.pi - 0.5, 0.2]).as_matrix(),
}


def _rates(y, sticks):
    """Return the accelerations of the angle and of the slip, the load and the friction, of a box of mass 1."""
    angle, along, spin, slip = y
    inertia = (LONG**2 + HIGH**2) / 3
    # forces along the box, forces across it, moments; then friction, along the box up the slope
    A = [[HIGH, 1, 0, 1], [-along, 0, -1, 0], [inertia, 0, -along, -HIGH], [0, 1, 0, 0] if sticks else [0, 0, MU, -1]]
    b = [G * np.sin(angle) + along * spin**2, HIGH * spin**2 + 2 * slip * spin - G * np.cos(angle), 0, 0]
    return np.linalg.solve(A, b)


def _end():
    """Return place and velocity of the centre in the plane of the motion, the angle and the spin at the end."""

    def left(_, y):
        _, _, load, friction = _rates(y, True)
        return MU * load - friction

    left.terminal, y, t = True, np.array([0, BEYOND, 0, 0]), 0.0
    for sticks in (True, False):
        run = solve_ivp(
            lambda _, y, sticks=sticks: [*y[2:], *_rates(y, sticks)[:2]],
            (t, DURATION), y, "DOP853", events=left if sticks else None, rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        t, y = run.t[-1], run.y[:, -1]
    assert run.t[0] > 0.2
    angle, along, spin, slip = y
    u, n = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    return along * u + HIGH * n, (slip + HIGH * spin) * u - along * spin * n, angle, spin


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
@pytest.mark.parametrize("name", TURNED)
def test_a_box_begins_to_slip_over_an_edge(name, tolerance):
    """Both contacts begin to slip in the direction of the forces, and few steps keep to the tolerance."""
    turned = TURNED[name]
    scene = mbvi.Scene(friction=MU, gravity=turned @ [0, 0, -G])
    scene.add_box((4, 4, 0.2), position=turned @ [-2, 0, -0.1], rotation=turned, fixed=True)
    scene.add_box((2 * LONG, 0.3, 2 * HIGH), 1.0, position=turned @ [BEYOND, 0.02, HIGH], rotation=turned)
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(tolerance), duration=DURATION)
    assert run.notes == ()
    assert len(run.t) <= 20
    place, velocity, angle, spin = _end()
    axes = Rotation.from_quat(run.q[-1][3:]).as_matrix()
    np.testing.assert_allclose(turned.T @ run.q[-1][:3], [place[0], 0.02, place[1]], atol=tolerance)
    np.testing.assert_allclose(turned.T @ run.v[-1][:3], [velocity[0], 0, velocity[1]], atol=tolerance)
    np.testing.assert_allclose(turned.T @ axes, Rotation.from_rotvec([0, angle, 0]).as_matrix(), atol=tolerance)
    np.testing.assert_allclose(turned.T @ axes @ run.v[-1][3:], [0, spin, 0], atol=10 * tolerance)
