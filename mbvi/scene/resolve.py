"""Moves a start that overlaps out of penetration: the nearest admissible configuration in the kinetic metric."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from ..constraints import AdmissibleSet, ConstraintFamily, Rows
from ..constraints.rows import take
from ..errors import InadmissibleStartError, ProjectionError
from ..problem import ACTIVATION
from ..projection import Projector
from ..system import System, located_parts
from .model import Start

# most linearisations of each of the two iterations
_MOST = 60
# the largest distance by which a linearisation raises the gap of a contact, in lengths of the scene
_STEP = 0.1
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


class _Search:
    """Searches admissible configurations; `worst` names the deepest constraint of the last one that was not."""

    def __init__(self, system: System, constraints: AdmissibleSet, length: float) -> None:
        self._system, self._constraints = system, constraints
        self._step, self._tolerance = _STEP * length, ACTIVATION * length
        self._projector = Projector(_RESIDUAL)
        self.worst = ""

    def from_(self, q: Array, anchored: bool) -> Array | None:
        """Return an admissible configuration, or None; `anchored` is whether displacements are those from q."""
        system, place, metric = self._system, q, self._system.metric(q)
        moved, settled = np.zeros(system.nv), False
        for k in range(_MOST):
            rows = thinned(self._constraints.active(0.0, place, 2.0 * self._step))
            deep = self._depth(rows) > self._tolerance
            if not deep and (settled or not anchored or k == 0):
                return place
            lever = self._constraints.levers(rows.constraint)
            # gaps of joint limits, which have no normal, are linear
            lower = np.where(np.isnan(rows.normal[:, 0]), -rows.gap, np.minimum(-rows.gap, self._step / lever))
            try:
                if anchored:
                    lower += rows.jacobian @ moved
                z = self._projector.project(np.zeros(system.nv), metric, rows.jacobian, lower).velocity
            except ProjectionError:
                return None
            if anchored:
                change = z - moved
                settled = change @ metric.apply(change) <= _SETTLED**2 * (z @ metric.apply(z))
                moved, place = z, system.integrate(q, z)
            else:
                place = system.integrate(place, z)
                metric = system.metric(place)
        return None if self._depth(self._constraints.active(0.0, place, 0.0)) > self._tolerance else place

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
