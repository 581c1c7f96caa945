"""The order of errors, and the CPU time to a given error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .errors import fitted_order
from .records import Record

# errors below this are rounding
ROUNDING = 1e-12
# if all errors of a fixed step are below this, they do not depend on the step
_SUMS = 1e-9
# least ratio of an extrapolated step to the finest that was run
_BEYOND = 1e-3


def slope(records: Sequence[Record]) -> str:
    """Return the fitted order of the error in the step, or in the tolerance of `EventDriven`, in words."""
    above = [r for r in records if r.error > ROUNDING]
    stepped = bool(above) and np.isnan(above[0].tolerance)
    # with many bodies rounding adds up
    if len(above) < 3 or (stepped and max(r.error for r in records) < _SUMS):
        return "to rounding"
    if stepped:
        return f"order {fitted_order([r.step for r in above], [r.error for r in above]):.2f}"
    return f"tolerance^{fitted_order([r.tolerance for r in above], [r.error for r in above]):.2f}"


def cost(records: Sequence[Record], error: float) -> tuple[float, bool] | None:
    """Return the CPU time of a run to an error [s], and whether it is extrapolated.

    Parameters
    ----------
    records : sequence of Record
        Records of one scheme on one problem.
    error : float
        Wanted error.

    Returns
    -------
    tuple of float and bool, or None
        The least time of a point with at most this error. Without such a point, the time is extrapolated to the step
        that the fitted order requires. None if that step is over a thousand times finer than the finest that was run,
        or if errors do not fall.
    """
    reached = [r.cpu for r in records if r.error <= error]
    if reached:
        return min(reached), False
    points = [r for r in records if np.isfinite(r.error) and r.error > 0.0]
    if len(points) < 3:
        return None
    order = fitted_order([r.step for r in points], [r.error for r in points])
    best = min(points, key=lambda r: r.error)
    if order <= 0.0 or (finer := (error / best.error) ** (1 / order)) < _BEYOND:
        return None
    wanted = best.step * finer
    # time per step, without the start of a run; coarse steps may cost more, because the tunnelling guard shortens them
    finest = sorted(points, key=lambda r: r.step)[: -(-len(points) // 2)]
    each = float(np.polyfit([r.duration / r.step for r in finest], [r.cpu for r in finest], 1)[0])
    return best.cpu + each * (best.duration / wanted - best.duration / best.step), True


def table(records: Sequence[Record], error: float) -> str:
    """Return a Markdown table of the least error and the cost of a given error; a tilde marks extrapolation."""
    lines = [
        f"| problem | e | scheme | error falls as | least error | its CPU [ms] | CPU to {error:g} [ms] |",
        "|---|---|---|---|---|---|---|",
    ]
    problems = list(dict.fromkeys((r.problem, r.e) for r in records))
    lines_of = dict.fromkeys((r.problem, r.e, r.scheme) for r in records)
    for problem, e, scheme in sorted(lines_of, key=lambda line: problems.index(line[:2])):
        points = [r for r in records if (r.problem, r.e, r.scheme) == (problem, e, scheme)]
        best, found = min(points, key=lambda r: r.error), cost(points, error)
        took = "beyond" if found is None else f"{'~' if found[1] else ''}{1e3 * found[0]:.3g}"
        cells = (problem, f"{e:g}", scheme, slope(points), f"{best.error:.2g}", f"{1e3 * best.cpu:.3g}", took)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
