"""Passes the contacts of accepted steps to the controls that read `state.contacts`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..constraints.contact import Contact
from .contact_friction import ContactFriction, friction_of, with_friction

if TYPE_CHECKING:
    from ..problem import Problem
    from .step import Step

Array = np.ndarray
# returns the contacts of a state, which are computed when it is called
Contacts = Callable[[], tuple[Contact, ...]]


def observer(problem: Problem) -> Callable[[Step, float], None] | None:
    """Return a function to call with each accepted step and its length [s]; None if no control reads contacts.

    The length is 0 for an instantaneous impact, as at an inadmissible initial velocity.
    """
    observe = problem.system.observe
    if observe is None:
        return None

    def pass_on(step: Step, h: float) -> None:
        observe(partial(contacts_of_step, step, h, problem.constraints.name))

    return pass_on


def contacts_of_step(step: Step, h: float, name: Callable[[int], str]) -> tuple[Contact, ...]:
    """Return the contacts of a step of the length h [s]."""
    rows = step.active
    return contacts_of_rows(rows.constraint, step.percussion, rows.point, rows.normal, h, name, friction_of(step))


def contacts_of_rows(
    number: Array,
    percussion: Array,
    point: Array,
    normal: Array,
    h: float,
    name: Callable[[int], str],
    friction: ContactFriction | None = None,
) -> tuple[Contact, ...]:
    """Return the contacts of the rows whose percussion is positive.

    Parameters
    ----------
    number : ndarray of int, shape (k,)
        The constraint of each row.
    percussion : ndarray, shape (k,)
        Percussion of each row within the time h [N s, N m s].
    point, normal : ndarray, shape (k, 3)
        See `Contact`.
    h : float
        Length of the step [s]; 0 for an instantaneous impact, whose forces are infinite.
    name : callable
        Returns the name of a constraint by its number.
    friction : ContactFriction, optional
        Friction of each row, in scenes that have it.
    """
    rows = zip(number.tolist(), point, normal, percussion.tolist(), strict=True)
    found = tuple(Contact(name(k), x, n, p, p / h if h else np.inf) for k, x, n, p in rows if p > 0.0)
    if friction is None:
        return found
    return with_friction(found, friction.take(percussion > 0.0), h)
