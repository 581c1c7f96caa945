"""A Problem is all a scheme sees: system, admissible set, initial state, restitution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .constraints import AdmissibleSet, Constraint
from .errors import InadmissibleStartError, InputError
from .system import System
from .system.system import Array

if TYPE_CHECKING:
    from .scene.model import SceneModel

_ACTIVATION = 1e-8


class Problem:
    """The Cauchy problem (P): find q in K and v of bounded variation from (q0, v0).

    Parameters
    ----------
    system : System
        M(q), g(t, q, v) and the retraction.
    constraints : sequence of Constraint
        f_a and their gradients.
    q0 : array_like, shape (nq,)
        Initial configuration, in K.
    v0 : array_like, shape (nv,)
        Initial velocity; outside T_K(q0) the law (8) is applied to it once.
    restitution : float or array_like, shape (len(constraints),)
        e in [0, 1], one for all or one each; constraints built by a `Scene` carry their own.
    t0 : float
        Initial time [s].
    length : float
        Length of the scene [m]: a constraint is active at a gap below 1e-8 of it.

    Raises
    ------
    InputError
        On wrong shapes, numbers that are not finite, e outside [0, 1], an unnormalised quaternion.
    InadmissibleStartError
        If q0 is not in K.
    """

    def __init__(
        self,
        system: System,
        constraints: Sequence[Constraint],
        q0: Array | Sequence[float],
        v0: Array | Sequence[float],
        *,
        restitution: float | Sequence[float] | Array = 0.0,
        t0: float = 0.0,
        length: float = 1.0,
        scene: SceneModel | None = None,
    ) -> None:
        self.system = system
        self.q0 = _vector(q0, system.nq, "q0")
        self.v0 = _vector(v0, system.nv, "v0")
        if not np.isfinite(t0):
            raise InputError(f"t0 must be finite; got {t0}")
        if not (np.isfinite(length) and length > 0):
            raise InputError(f"length must be positive; got {length}")
        self.t0, self.length, self.scene = float(t0), float(length), scene
        self.restitution = check_restitution(restitution, len(constraints))
        self.constraints = AdmissibleSet(system, constraints, self.restitution)
        # gap at and below which a constraint is active [m or rad]
        self.tolerance = _ACTIVATION * self.length
        self._check()

    def _check(self) -> None:
        if hasattr(self.system, "check"):
            self.system.check(self.t0, self.q0, self.v0)
        moved = self.system.integrate(self.q0, np.zeros(self.system.nv))
        if np.abs(moved - self.q0).max(initial=0.0) > 1e-6:
            raise InputError("q0 holds a quaternion that is not of unit length: divide it by its norm")
        self.system.metric(self.q0)
        if not np.isfinite(self.system.force(self.t0, self.q0, self.v0)).all():
            raise InputError("the force at the initial state is not finite")
        self.constraints.check(self.t0, self.q0)
        active = self.constraints.active(self.t0, self.q0, self.tolerance)
        if active.gap.size and active.gap.min() < -self.tolerance:
            worst = int(np.argmin(active.gap))
            others = len(set(active.constraint[active.gap < -self.tolerance])) - 1
            more = f" ({others} more constraint{'s' if others > 1 else ''} with it)" if others else ""
            raise InadmissibleStartError(
                f"the initial configuration is not admissible: {self.constraints.name(int(active.constraint[worst]))} "
                f"penetrates by {-active.gap[worst]:.6g}{more}; move it apart or leave that pair out"
            )

    def report(self) -> str:
        """Return in words what is modelled, what was left out, and why."""
        if self.scene is not None:
            return self.scene.report(self)
        e = np.unique(self.restitution)
        return (
            f"{self.system.nv} degrees of freedom, {len(self.constraints)} constraints given as functions, "
            f"restitution {', '.join(f'{x:g}' for x in e) or 'none'}; nothing was left out"
        )


def check_restitution(restitution: float | Sequence[float] | Array, count: int) -> Array:
    """Return e as an array of `count` numbers in [0, 1], or raise `InputError`."""
    try:
        e = np.broadcast_to(np.asarray(restitution, dtype=float), (count,)).copy()
    except (ValueError, TypeError) as error:
        raise InputError(
            f"restitution must be a number or one per constraint ({count}); got {restitution!r}"
        ) from error
    values = np.atleast_1d(np.asarray(restitution, dtype=float))
    # written so that a NaN is refused too
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError(f"restitution e must lie in [0, 1]; got {restitution}")
    return e


def _vector(values: Array | Sequence[float], size: int, name: str) -> Array:
    try:
        vector = np.array(values, dtype=float)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name} is no array of numbers") from error
    if vector.shape != (size,):
        raise InputError(f"{name} has shape {vector.shape}; the system asks for ({size},)")
    if not np.isfinite(vector).all():
        raise InputError(f"{name} has entries that are not finite: {np.flatnonzero(~np.isfinite(vector)).tolist()}")
    vector.setflags(write=False)
    return vector
