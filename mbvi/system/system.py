"""What a scheme may ask of a mechanical system."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from ..projection import FreeMotion, Metric, TreeFreeMotion

Array = np.ndarray


class System(Protocol):
    """M(q) dv/dt = g(t, q, v) on a configuration manifold (equation 1).

    Bodies are numbered from 1; body 0 is the world. Velocities are in the tangent space at q.

    Attributes
    ----------
    nq, nv : int
        Sizes of q and v.
    bodies : tuple of str
        Names, the world first.
    velocity_dependent : bool
        Whether forces change with v, and may be worked out twice a step.

    Notes
    -----
    A method `start()`, where there is one, is called when a run starts.
    """

    nq: int
    nv: int
    bodies: tuple[str, ...]
    velocity_dependent: bool

    def integrate(self, q: Array, dv: Array) -> Array:
        """Return q + dv along the retraction, shape (nq,)."""
        ...

    def difference(self, q0: Array, q1: Array) -> Array:
        """Return the tangent vector, shape (nv,), that leads from q0 to q1."""
        ...

    def metric(self, q: Array) -> Metric:
        """Return M(q), factorised."""
        ...

    def force(self, t: float, q: Array, v: Array) -> Array:
        """Return g(t, q, v), shape (nv,) [N, N m]."""
        ...

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        """Return v + h M^-1 g, shape (nv,)."""
        ...

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion | TreeFreeMotion:
        """Return v + h M^-1 g, shape (nv,), together with M(q); good until the system is asked about another q."""
        ...

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return M^-1 g, shape (nv,) [m/s^2, rad/s^2]."""
        ...

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        """Return the rate of dv, shape (nv,), where `integrate(q, dv)` moves with the velocity v."""
        ...

    def kinetic_energy(self, q: Array, v: Array) -> float:
        """Return v' M v / 2 [J]."""
        ...

    def potential_energy(self, t: float, q: Array) -> float:
        """Return the potential energy [J]."""
        ...

    def placements(self, q: Array, bodies: Array) -> Array:
        """Return where bodies' frames are, shape (n, 4, 3): the three columns of the rotation, then the origin [m].

        A point x of the body is at (x, 1) times that.
        """
        ...

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array | csr_array:
        """Return the gradient of the separation of two bodies at m contact points.

        Parameters
        ----------
        q : ndarray, shape (nq,)
            Configuration.
        first, second : ndarray of int, shape (m,)
            The bodies; 0 where the side belongs to the world or to another system.
        point, normal : ndarray, shape (m, 3)
            Contact points and unit normals from the first to the second body, in the world.

        Returns
        -------
        ndarray or csr_array, shape (m, nv)
            Rows r with r . v = normal . (velocity of second - velocity of first) at the point; sparse where the
            system's attribute `sparse` says so.
        """
        ...

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        """Return the accelerations of points fixed to bodies while v does not change, shape (k, 3), in the world.

        `points`, shape (k, 3), are in the bodies' own frames.
        """
        ...

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        """Return how far each velocity can carry a point of a ball fixed to a body, shape (nv,) [m per unit].

        No point of the ball moves by more than `reach @ |dv|` along the retraction by dv. Entries are positive
        exactly for the velocities that move the body.
        """
        ...
