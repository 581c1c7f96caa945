"""Which closed loop constraints would open where they contradict each other, in words."""

from __future__ import annotations

import numpy as np

from ..errors import InfeasibleError
from ..problem import Problem
from ..system.mechanisms.loop_margin import with_equalities
from ..system.system import Array

# a loop opposes rates if it opens by more than this part of them
_OPPOSED = 1e-9


def opened_loop(problem: Problem, q: Array, h: float, error: InfeasibleError) -> str:
    """Return which connection or coupling would open most if bodies moved as rows demand, and what to change.

    The motion is the least one that gives the rates that the rows demand; q is the configuration before the step of
    length h [s]. "" is returned where no loop is opened by it.
    """
    # an error of a user's own scheme may not say which rows
    if not {"J", "lower"} <= error.problem.keys():
        return ""
    J, lower = error.problem["J"], np.asarray(error.problem["lower"])
    J = np.asarray(J if isinstance(J, np.ndarray) else J.toarray())
    demanded = lower > 0.0
    if J.shape[1] != problem.system.nv or not demanded.any():
        return ""
    moved = h * np.linalg.lstsq(J[demanded], lower[demanded], rcond=None)[0]
    begins = {part.q: part.v for part in problem.system.located_parts()}
    widest, name = 0.0, ""
    for part, where in with_equalities(problem.system):
        begin = begins[where.start]
        opened = np.abs(part.equality_gradients(q[where]) @ moved[begin : begin + part.nv])
        if opened.max() > max(widest, _OPPOSED * h * float(lower.max())):
            widest, name = float(opened.max()), part.equality_names()[int(opened.argmax())]
    if not name:
        return ""
    return (
        f"; a loop opposes it: {name} would stay open by {widest:.3g} m or rad after this step. It is at a dead "
        "centre, or has lengths or limits with which it cannot move: change its lengths, start it away from the dead "
        "centre, or widen or leave out the joint limits and contacts of its bodies"
    )
