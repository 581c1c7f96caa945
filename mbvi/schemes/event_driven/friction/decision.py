"""Coulomb's law on accelerations: which touching contacts stay closed, and which of them stick."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....errors import ProjectionError
from ....projection.coulomb.friction import FrictionalProjection, project_frictional
from ....projection.coulomb.newton.cases import OPEN, STICK
from ....system.system import Array
from ..finding.release_events import OPENS, STAYS
from .modes import ModeEquations

# the velocity of contacts that slide, over the largest acceleration: they go on sliding in any case
_SLIDING = 1e6
# largest residual of the law on accelerations, relative to the largest of them
_RESIDUAL = 1e-10
# most turns in which the forces of sliding contacts settle, and the relative change of accelerations at which they have
_MOST_TURNS, _SETTLED = 100, 1e-12


class Decision(NamedTuple):
    """What the law on accelerations gives for k touching rows.

    Attributes
    ----------
    acceleration : ndarray, shape (nv,)
        dv/dt.
    opening : ndarray, shape (k,)
        Accelerations of gaps relative to the terms of these.
    closed, sticks : ndarray of bool, shape (k,)
        Which rows have a force, and which stick.
    way : ndarray, shape (k, 2)
        Directions of slip.
    force : ndarray, shape (k, 3)
        Contact forces along normals and tangents [N, N m].
    """

    acceleration: Array
    opening: Array
    closed: Array
    sticks: Array
    way: Array
    force: Array


def _within_modes(
    equations: ModeEquations, slides: Array, way: Array, found: FrictionalProjection
) -> FrictionalProjection | None:
    """Return an answer of the law where all closed contacts slide on or stick as in `found`; None if it is none.

    It is that of one linear system.
    """
    closed, mu = found.case != OPEN, equations.mu
    sticks = closed & ~slides & (mu > 0.0)
    if not closed.any() or (found.case[sticks] != STICK).any():
        return None
    normals = equations.normals._replace(J=equations.normals.J[closed], wanted=equations.normals.wanted[closed])
    part = ModeEquations(normals, *(column[closed] for column in equations[1:]))
    solved = part.forces(sticks[closed], way[closed])
    pull, edge = np.linalg.norm(solved.tangential, axis=1), mu[closed] * solved.normal
    opening = equations.normals.J @ solved.acceleration - equations.normals.wanted
    if not (
        solved.determined
        and (solved.normal > 0.0).all()
        and (pull <= edge * (1.0 + _RESIDUAL)).all()
        and (opening >= -OPENS * equations.normals.scale).all()
    ):
        return None
    percussion = np.zeros((len(mu), 3))
    percussion[closed, 0], percussion[closed, 1:] = solved.normal, solved.tangential
    return found._replace(velocity=solved.acceleration, percussion=percussion.ravel(), residual=0.0)


def decide(equations: ModeEquations, slides: Array) -> Decision | None:
    """Return what Coulomb's law gives for accelerations, with unit step; None if it has no answer.

    Parameters
    ----------
    equations : ModeEquations
        Those of the touching rows.
    slides : ndarray of bool, shape (k,)
        Rows that slide: they have a slip, and go on in its direction.
    """
    free, metric, J, wanted, scale = equations.normals
    size, mu, T = np.linalg.norm(equations.slip, axis=1), equations.mu, equations.T
    slides = slides & (size > 0.0) & (mu > 0.0)
    way = np.where(slides[:, None], equations.slip / np.where(slides, size, 1.0)[:, None], 0.0)
    turning = np.abs(T) @ np.abs(free) + np.abs(equations.along)
    largest = max(float(scale.max()), float(turning.max()))
    lower = np.column_stack([wanted, equations.along - _SLIDING * largest * way])
    wide = np.concatenate([J[:, None], T], axis=1).reshape(3 * len(J), -1)
    try:
        found = project_frictional(free, metric, wide, lower.ravel(), mu)
        known = _within_modes(equations, slides, way, found) if slides.any() else None
        if known is not None:
            found = known
        elif slides.any():
            # where N of sliding contacts is known, so is their friction: a law without the large speed
            lower[:, 1:] = equations.along
            response = metric.solve_rows(np.einsum("k,ki,kij->kj", mu, way, T))
            # dependent contacts may exchange forces from turn to turn: the mean of two turns does not
            direct, pressed = found, found.percussion[::3]
            for _ in range(_MOST_TURNS):
                still = project_frictional(
                    free - pressed[slides] @ response[slides], metric, wide, lower.ravel(), np.where(slides, 0.0, mu)
                )
                change = np.abs(still.velocity - found.velocity).max()
                found, pressed = still, 0.5 * (pressed + still.percussion[::3])
                if change <= _SETTLED * np.abs(still.velocity - free).max():
                    break
            else:
                # friction acts strongly on loads: the law with the large speed remains, which is less exact
                found = direct
    except ProjectionError:
        return None
    if not found.residual <= _RESIDUAL:
        return None
    force = found.percussion.reshape(-1, 3)
    force[slides, 1:] = -(mu * force[:, 0])[slides, None] * way[slides]
    pull = np.linalg.norm(force[:, 1:], axis=1)
    begins = ~slides & (pull > 0.0)
    way[begins] = -force[begins, 1:] / pull[begins, None]
    opening = (J @ found.velocity - wanted) / scale
    # of dependent contacts some stay at rest at the edge of their cones
    rests = np.linalg.norm(T @ found.velocity - equations.along, axis=1) <= OPENS * (turning.max(axis=1) + scale)
    rests |= found.case == STICK
    closed = found.case != OPEN
    # contacts on which nothing acts may stick without a force
    sticks = (closed | (opening <= STAYS)) & ~slides & (mu > 0.0) & rests
    return Decision(found.velocity, opening, closed, sticks, way, force)
