"""Moves a start that overlaps out of penetration: the nearest admissible configuration in the kinetic metric."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from ..constraints import AdmissibleSet, ConstraintFamily, Rows
from ..constraints.rows import take
from ..errors import InadmissibleStartError, ProjectionError
from ..problem import ACTIVATION
from ..projection import DenseMetric, Metric, Projector
from ..system import System, located_parts
from ..system.mechanisms.loop_margin import widest_open
from .model import Start

# most linearisations of each of the two iterations, and of those after which the least depth is no smaller
_MOST, _MOST_IN_VAIN = 200, 30
# in lengths of the scene, the distance by which a linearisation raises gaps of contacts at most: that of the first, and
# the longest, with which links do not yet pass through each other. It doubles after a linearisation that gained at
# least a part of it, and is halved after others
_STEP, _LONGEST, _GAINED = 0.1, 1.0, 0.5
# the largest angle by which a linearisation turns anything [rad]
_MOST_TURN = 0.5
# where rows contradict each other, what misses one of them, relative to what meets it, and in how many linearisations
_YIELDING, _MOST_YIELDED = 1e-2, 20
# residual of the projections, and the change of a displacement, relative to it, below which it is the nearest
_RESIDUAL, _SETTLED = 1e-9, 1e-6
# displacements of coordinates below this are rounding [m, rad]
_ROUNDING = 1e-12
# most rows of a pair of shapes in a projection
_MOST_ROWS = 8
# most joints, bodies or spheres that a note names
_MOST_NAMED = 8


def resolved(system: System, constraints: Sequence[ConstraintFamily], q: Array, length: float) -> Start | None:
    """Return the admissible configuration nearest to q at t = 0, and by how much it moves what; None if q is one.

    The displacement z of least |z|_M with f(q + z) >= 0 is the limit of those of least |z|_M with
    f(q_k) + J(q_k) (z - z_k) >= 0, where q_k = q + z_k. Where these do not converge, as in deep overlaps, each
    linearisation starts from the configuration before, and the displacement is not the least.

    Raises
    ------
    InadmissibleStartError
        If no admissible configuration is found.
    """
    search = _Search(system, AdmissibleSet(system, constraints, np.zeros(len(constraints))), length)
    for anchored in (True, False):
        found = search.from_(q, anchored)
        if found is not None:
            return None if found is q else Start(found, _described(system, q, found))
    raise InadmissibleStartError(
        f"the initial configuration is not admissible, and resolve=True finds no way out: {search.worst}; start nearer "
        "to an admissible configuration, or leave a pair out by Scene.exclude"
    )


def closed_start(system: System, q: Array) -> Start | None:
    """Return the nearest configuration where loops and couplings are closed; None if they are at q.

    Raises
    ------
    InadmissibleStartError
        If none is found.
    """
    found = system.closed(q)
    if np.array_equal(found, q):
        return None
    if not np.isfinite(found).all():
        raise InadmissibleStartError(
            f"loops or couplings cannot be closed: {widest_open(system, q)} at the start, and no motion closes them; "
            "start nearer to where they are closed"
        )
    moved = _described(system, q, found)
    return Start(found, moved, "to close loops and couplings") if moved else None


class _Search:
    """Searches admissible configurations; `worst` names the deepest constraint of the last one that was not."""

    def __init__(self, system: System, constraints: AdmissibleSet, length: float) -> None:
        self._system, self._constraints = system, constraints
        self._first, self._longest, self._tolerance = _STEP * length, _LONGEST * length, ACTIVATION * length
        self._projector = Projector(_RESIDUAL)
        self.worst = ""

    def from_(self, q: Array, anchored: bool) -> Array | None:
        """Return an admissible configuration, or None; `anchored` is whether displacements are those from q."""
        system, place, metric = self._system, q, self._system.metric(q)
        moved, settled, step, before, least, since = np.zeros(system.nv), False, self._first, np.inf, np.inf, 0
        yielded = 0
        for k in range(_MOST):
            rows = thinned(self._constraints.active(0.0, place, 2.0 * step))
            depth = self._depth(rows)
            if depth <= self._tolerance and (settled or not anchored or k == 0):
                return place
            least, since = (depth, k) if depth < least else (least, since)
            if k - since > _MOST_IN_VAIN:
                return None
            if k > 0:
                gained = before - depth >= _GAINED * min(before, step)
                step = min(2.0 * step, self._longest) if gained else max(0.5 * step, self._first)
            before, lever = depth, self._constraints.levers(rows.constraint)
            # gaps of joint limits, which have no normal, are linear
            lower = np.where(np.isnan(rows.normal[:, 0]), -rows.gap, np.minimum(-rows.gap, step / lever))
            if anchored:
                lower += rows.jacobian @ moved
            try:
                z = self._projector.project(np.zeros(system.nv), metric, rows.jacobian, lower).velocity
            except ProjectionError:
                # of a long step the rows may be too many, or contradict each other
                if step > self._first:
                    step = self._first
                    continue
                if anchored or yielded == _MOST_YIELDED:
                    return None
                yielded += 1
                try:
                    z = self._yielding(metric, rows.jacobian, lower)
                except ProjectionError:
                    # nothing moves what is too deep, such as a ball on the axis of its joint
                    return None
            if anchored:
                change = z - moved
                settled = change @ metric.apply(change) <= _SETTLED**2 * (z @ metric.apply(z))
                moved, place = z, system.integrate(q, z)
            else:
                # where gradients nearly vanish, the displacement of a linearisation has no bound
                turn = np.abs(z[~system.are_lengths()]).max(initial=0.0)
                place = system.integrate(place, z * min(1.0, _MOST_TURN / turn) if turn > 0.0 else z)
                metric = system.metric(place)
        return None if self._depth(self._constraints.active(0.0, place, 0.0)) > self._tolerance else place

    def _yielding(self, metric: Metric, J: Array, lower: Array) -> Array:
        """Return the displacement for rows that contradict each other: each may be missed, at a cost."""
        m, n = J.shape
        lengths = np.linalg.norm(metric.whiten(J.T), axis=0)
        M, missed = np.eye(n + m), np.diag(_YIELDING * lengths)
        M[:n, :n] = metric.dense()
        return self._projector.project(np.zeros(n + m), DenseMetric(M), np.hstack([J, missed]), lower).velocity[:n]

    def _depth(self, rows: Rows) -> float:
        """Return how deep the deepest of some rows is, as a length [m]; 0 if there are none."""
        depths = -rows.gap * self._constraints.levers(rows.constraint)
        if not depths.size:
            return 0.0
        deepest = int(np.argmax(depths))
        self.worst = f"{self._constraints.name(int(rows.constraint[deepest]))} is still {depths[deepest]:.3g} m deep"
        return float(depths[deepest])


def thinned(rows: Rows) -> Rows:
    """Return at most 8 rows of each constraint: the deepest, then always the one farthest from those that are taken."""
    kept = np.ones(len(rows.gap), bool)
    numbers, counts = np.unique(rows.constraint, return_counts=True)
    for number in numbers[counts > _MOST_ROWS]:
        own = np.flatnonzero(rows.constraint == number)
        kept[own], points = False, rows.point[own]
        taken, far = int(np.argmin(rows.gap[own])), np.full(len(own), np.inf)
        for _ in range(_MOST_ROWS):
            kept[own[taken]] = True
            far = np.minimum(far, np.linalg.norm(points - points[taken], axis=1))
            taken = int(np.argmax(far))
    return take(rows, kept)


def _described(system: System, before: Array, after: Array) -> str:
    """Return in words by how much each robot, body and sphere was moved from one configuration to another."""
    moved, lengths = system.difference(before, after), system.are_lengths()
    said = []
    for part in located_parts(system):
        model = part.system.model
        if model is not None:
            steps = [
                (model.names[j], slice(part.v + model.idx_vs[j], part.v + model.idx_vs[j] + model.nvs[j]))
                for j in range(1, model.njoints)
            ]
            name = f"{part.system.name}: "
        else:
            bodies = part.system.bodies[1:]
            width = part.system.nv // len(bodies)
            steps = [(body, slice(part.v + k * width, part.v + (k + 1) * width)) for k, body in enumerate(bodies)]
            name = ""
        each = [(thing, moved[here][lengths[here]], moved[here][~lengths[here]]) for thing, here in steps]
        amounts = [(thing, float(np.linalg.norm(far)), float(np.linalg.norm(turn))) for thing, far, turn in each]
        amounts = [one for one in amounts if max(one[1:]) > _ROUNDING]
        said += [name + _listed(amounts)] if amounts else []
    return "; ".join(said)


def _listed(amounts: list[tuple[str, float, float]]) -> str:
    """Return names with lengths [m] and angles [rad], the largest first."""
    most = sorted(amounts, key=lambda one: -max(one[1:]))[:_MOST_NAMED]
    words = []
    for thing, far, turn in most:
        sizes = [f"{size:.3g} {unit}" for size, unit in ((far, "m"), (turn, "rad")) if size > _ROUNDING]
        words.append(f"{thing} by {' and '.join(sizes)}")
    more = len(amounts) - len(most)
    return ", ".join(words) + (f", and {more} more by less" if more else "")
