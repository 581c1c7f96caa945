"""How errors fall, and what a given one costs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .errors import fitted_order
from .records import Record

# below this a reference or the sums of a run are not trusted
ROUNDING = 1e-12
# errors of a fixed step that are all below this have not to do with it
_SUMS = 1e-9
# steps this much finer than the finest that was run are guessed no more
_BEYOND = 1e-3


def slope(records: Sequence[Record]) -> str:
    """Return in words how the error falls: with the step, or with the tolerance of a scheme that has one."""
    above = [r for r in records if r.error > ROUNDING]
    stepped = bool(above) and np.isnan(above[0].tolerance)
    # of many bodies the sums are that much longer
    if len(above) < 3 or (stepped and max(r.error for r in records) < _SUMS):
        return "to rounding"
    if stepped:
        return f"order {fitted_order([r.step for r in above], [r.error for r in above]):.2f}"
    return f"tolerance^{fitted_order([r.tolerance for r in above], [r.error for r in above]):.2f}"


def cost(records: Sequence[Record], error: float) -> tuple[float, bool] | None:
    """Return the CPU time of a run to an error [s], and whether it is carried on beyond what was measured.

    Parameters
    ----------
    records : sequence of Record
        Of one scheme on one problem.
    error : float
        Aimed at.

    Returns
    -------
    tuple of float and bool, or None
        The least time of a point that is at most so far off. Where there is none: the step that the fitted order asks
        for, and the time of so many steps. None where that is more than a thousand times finer than the finest one
        that was run, or errors do not fall at all.
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
    # of one step, without what a run costs before its first; coarse ones may cost more, where they are cut
    finest = sorted(points, key=lambda r: r.step)[: -(-len(points) // 2)]
    each = float(np.polyfit([r.duration / r.step for r in finest], [r.cpu for r in finest], 1)[0])
    return best.cpu + each * (best.duration / wanted - best.duration / best.step), True


def table(records: Sequence[Record], error: float) -> str:
    """Return in Markdown what each scheme and engine reached, and what an error costs, a tilde where carried on."""
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
