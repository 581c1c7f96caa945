"""Resultants of the contacts of a run: on robots, links, bodies, walls, and between pairs of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ..arguments import shown
from ..errors import InputError
from .contacts import ContactTable
from .run_data import RunData

if TYPE_CHECKING:
    from ..problem import Problem

Array = np.ndarray
_BETWEEN = " | "
# names that an error lists
_MOST_NAMED = 50


class ContactNames:
    """The two parts of each contact, by the name of its constraint.

    Parameters
    ----------
    problem : Problem or None
        The problem that was run; None where a file could not bring it back.
    constraints : sequence of str
        Names of constraints.

    Attributes
    ----------
    sides : list of (str, str, float) or None
        Of each constraint the first part, the second, and the sign of the force on the first along the normal; None
        where the constraint is no contact.
    things : dict of str to set of str
        The parts of every robot, link, body, wall and group of bodies.
    """

    def __init__(self, problem: Problem | None, constraints: Sequence[str]) -> None:
        scene = None if problem is None else problem.scene
        # normals point out of walls and meshes, which are named second
        self._sheets: set[str] = set() if scene is None else {*scene.walls, *(s.name for s in scene.surfaces)}
        self._parts = set(self._sheets) if scene is None else {*self._sheets, *(s.name for s in scene.shapes)}
        self.sides = [self._sides(name) for name in constraints]
        parts = self._parts or {part for sides in self.sides if sides is not None for part in sides[:2]}
        self.things: dict[str, set[str]] = {part: {part} for part in parts}
        for part in parts:
            self.things.setdefault(part.split("/", 1)[0].split("[", 1)[0], set()).add(part)
        if scene is not None:
            for robot in (item.robot for item in scene.items.robots):
                self.things.setdefault(robot.name, set())
                frames = [frame.name for frame in robot.model.frames if frame.type == pin.FrameType.BODY]
                links = {f"{robot.name}/{name}" for name in frames}
                for link in links:
                    # several shapes of a link are numbered
                    shapes = {part for part in parts - links if part.rpartition("_")[0] == link}
                    self.things.setdefault(link, shapes)

    def parts(self, name: str) -> set[str]:
        """Return the parts of a thing, or raise `InputError` if nothing has that name."""
        if not isinstance(name, str) or name not in self.things:
            known = sorted(self.things)
            more = f" and {len(known) - _MOST_NAMED} more" if len(known) > _MOST_NAMED else ""
            raise InputError(f"unknown name {shown(name)}; known are {', '.join(known[:_MOST_NAMED]) or 'none'}{more}")
        return self.things[name]

    def _sides(self, constraint: str) -> tuple[str, str, float] | None:
        words = constraint.split(_BETWEEN)
        if len(words) < 2:
            return None
        splits = [(_BETWEEN.join(words[:k]), _BETWEEN.join(words[k:])) for k in range(1, len(words))]
        # a link's name in a file may hold what stands between two names
        first, second = next((pair for pair in splits if self._parts.issuperset(pair)), splits[0])
        return first, second, 1.0 if second in self._sheets else -1.0


def force_on(table: ContactTable, names: ContactNames, name: str, durations: Array) -> Array:
    """Return the force and the moment about the origin on something, shape (n + 1, 6) [N, N m].

    Parameters
    ----------
    table : ContactTable
        The contacts of a run.
    names : ContactNames
        Of its constraints.
    name : str
        A robot, a link "robot/link", a body, a wall, spheres, or one of them "spheres[3]".
    durations : ndarray, shape (n + 1,)
        Of the intervals [s].

    Raises
    ------
    InputError
        If nothing goes by that name.
    """
    parts = names.parts(name)
    # between two parts of one thing the two forces cancel
    signs = [0.0 if s is None else s[2] * ((s[0] in parts) - (s[1] in parts)) for s in names.sides]
    sign = np.array([*signs, 0.0])
    index = np.flatnonzero(sign[table.constraint])
    corrections = table.corrections
    corrected = None if corrections is None else np.flatnonzero(sign[corrections.constraint])
    return _summed(table, index, corrected, sign, durations)


def forces_between(table: ContactTable, names: ContactNames, durations: Array) -> dict[tuple[str, str], Array]:
    """Return the force and moment on the first of each pair by the second, arrays as `force_on`."""
    pairs = sorted({sides[:2] for sides in names.sides if sides is not None})
    number = {pair: k for k, pair in enumerate(pairs)}
    pair_of = np.array([*(-1 if s is None else number[s[:2]] for s in names.sides), -1])
    sign = np.array([*(0.0 if s is None else s[2] for s in names.sides), 0.0])
    rows = _of_each(pair_of[table.constraint], len(pairs))
    corrections = table.corrections
    corrected = [None] * len(pairs) if corrections is None else _of_each(pair_of[corrections.constraint], len(pairs))
    return {
        pair: _summed(table, index, others, sign, durations)
        for pair, index, others in zip(pairs, rows, corrected, strict=True)
    }


def _of_each(pair_of: Array, count: int) -> list[Array]:
    """Return the rows of each of some pairs, given the pair of each row."""
    order = np.argsort(pair_of, kind="stable")
    ends = np.searchsorted(pair_of[order], np.arange(count + 1))
    return [order[begin:end] for begin, end in pairwise(ends)]


def _summed(table: ContactTable, index: Array, corrected: Array | None, sign_of: Array, durations: Array) -> Array:
    """Return force and moment of some rows, signed along their normals, shape (n + 1, 6).

    Parameters
    ----------
    table : ContactTable
        The contacts.
    index, corrected : ndarray of int
        Some of its rows, and some of those of its corrections, ascending.
    sign_of : ndarray
        The sign of each constraint.
    durations : ndarray, shape (n + 1,)
        Of the intervals [s].
    """
    total = np.zeros((len(durations), 6))
    # limits and given functions have no place in space
    contact = np.isfinite(table.normal[index, 0])
    index = index[contact]
    sign = sign_of[table.constraint[index]]
    force = (sign * table.percussion[index])[:, None] * table.normal[index]
    if table.tangential is not None:
        force += sign[:, None] * table.tangential[index]
    wrench = np.concatenate([force, np.cross(table.point[index], force)], axis=1)
    if table.angular is not None:
        wrench[:, 3:] += sign[:, None] * table.angular[index]
    interval = np.searchsorted(table.starts, index, side="right") - 1
    if table.corrections is not None and corrected is not None:
        starts, constraint, more = table.corrections.starts, table.corrections.constraint, table.corrections.wrench
        interval = np.concatenate([interval, np.searchsorted(starts, corrected, side="right") - 1])
        wrench = np.concatenate([wrench, sign_of[constraint[corrected], None] * more[corrected]])
    for k in range(6):
        total[:, k] = np.bincount(interval, wrench[:, k], minlength=len(durations))
    passes = durations > 0.0
    total[passes] /= durations[passes, None]
    # an interval without duration, at a located impact, has the force of the interval before
    passes[0] = True
    return np.asarray(total[np.maximum.accumulate(np.where(passes, np.arange(len(passes)), 0))])


def recorded_contacts(run: RunData) -> ContactTable:
    """Return the contacts of a run; raise `InputError` if it did not record them."""
    if run.record.contacts is None:
        raise InputError('this run did not record contacts: simulate(..., record="contacts") does')
    return run.record.contacts


def durations(run: RunData) -> Array:
    """Return the duration of each interval between recorded states, shape (n + 1,) [s]; that of the first is zero."""
    found = np.diff(run.t, prepend=run.t[:1])
    if run.step > 0.0:
        # differences of times are rounded; multiples of the step are known exactly
        whole = run.step * np.rint(found / run.step)
        found = np.where(np.abs(found - whole) < 1e-6 * run.step, whole, found)
        if run.record.timing.whole_steps:
            # the last step goes on beyond the end of the run, and so do its percussions
            found[-1:] = run.step * np.ceil(found[-1:] / run.step)
    return found
