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
        Contact point [m] and unit normal in the world; NaN where the constraint is no contact. The normal leads from
        the first body named to the second, and out of half-spaces and meshes of the world, which are named second.
    percussion : float
        p >= 0 along the gradient during the step [N s, N m s].
    force : float
        Mean reaction during the step, p / h [N, N m].
    """

    name: str
    point: Array
    normal: Array
    percussion: float
    force: float
