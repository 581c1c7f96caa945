"""One contact with its percussion, as controls and results give it."""

from __future__ import annotations

from dataclasses import dataclass

from ..arguments import Array


@dataclass(frozen=True)
class Contact:
    """One row of the active set with its percussion over one step.

    Attributes
    ----------
    name : str
        Name of the constraint: "hopper/foot | floor", "hopper/knee lower limit".
    point, normal : ndarray, shape (3,)
        Contact point [m] and unit normal in the world; NaN where the constraint is no contact. The normal points from
        the first body of the name to the second. Exception: half-spaces and meshes of the world are named second, and
        the normal points out of them.
    percussion : float
        p >= 0 along the gradient during the step [N s, N m s].
    force : float
        Mean reaction during the step, p / h [N, N m].
    tangential : ndarray, shape (3,), or None
        Tangential percussion on the body that the normal points to, in the world [N s]; None in problems without
        friction. Of a constraint without a contact point the first two entries are those along its tangents.
    slip : ndarray, shape (3,), or None
        Tangential velocity of that body relative to the other after the step, in the world [m/s]; zero where mu = 0.
    regime : str or None
        "stick" or "slip"; where mu = 0 it is "slip".
    torque : ndarray, shape (3,), or None
        Mean torque of torsional and rolling friction during the step on the body that the normal points to, in the
        world [N m]; not finite in an instantaneous impact with one. None in problems without friction.
    """

    name: str
    point: Array
    normal: Array
    percussion: float
    force: float
    tangential: Array | None = None
    slip: Array | None = None
    regime: str | None = None
    torque: Array | None = None
