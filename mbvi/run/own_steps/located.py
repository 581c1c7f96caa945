"""Finds when connections are switched within the steps of a scheme that chooses their lengths."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import NamedTuple

from ...results.run_data import Array
from ...schemes.observer import Contacts
from ..fixed_steps.switching import Switching

# longest time between two states at which a function is asked [s], and how many there are at least in a run
_LONGEST, _FEWEST = 1e-3, 100


class Located(NamedTuple):
    """A switch: its time [s], and whether each of the connections is on since then."""

    time: float
    connections: dict[str, bool]


class LocatedSwitches:
    """Asks a user's function along the steps of a run.

    Parameters
    ----------
    switching : Switching
        The function.
    t0, duration : float
        Start and duration of the run [s].

    Attributes
    ----------
    found : Located or None
        The next switch, from where it was found until it is taken.
    """

    def __init__(self, switching: Switching, t0: float, duration: float) -> None:
        self._switching, self._end = switching, t0 + duration
        self._spacing = min(_LONGEST, duration / _FEWEST)
        self.found: Located | None = None
        # the state at which the function was asked last
        self._last: tuple[float, Array, Array, Contacts] | None = None

    def take(self) -> dict[str, bool]:
        """Return the connections that are switched now; empty if none are."""
        found, self.found = self.found, None
        return {} if found is None else found.connections

    def at(self, t: float, q: Array, v: Array, contacts: Contacts) -> bool:
        """Ask at a state; return whether connections are switched there."""
        if t >= self._end:
            return False
        self._last = t, q, v, contacts
        changed = self._switching.asked_at(*self._last)
        self.found = Located(t, changed) if changed else None
        return bool(changed)

    def begin(self, t: float, q: Array, v: Array) -> None:
        """Go on from a state at which connections were switched."""
        self._last = t, q, v, tuple

    def along(
        self, t0: float, t1: float, at: Callable[[float], tuple[Array, Array]], contacts: Contacts
    ) -> float | None:
        """Ask along a step; return the time at which connections are switched in it [s], None if none are.

        It is the first number at which they change, if the function depends on the state alone. One with a memory gives
        another answer where it has been asked before; what it changes is switched where it was asked first.

        Parameters
        ----------
        t0, t1 : float
            Start and end of the step [s].
        at : callable
            at(t) -> (q, v) within the step.
        contacts : callable
            Returns the contacts during the step.
        """
        count = max(ceil((t1 - t0) / self._spacing), 1)
        for k in range(1, count + 1):
            t = t1 if k == count else t0 + k * (t1 - t0) / count
            if t >= self._end or t <= t0:
                continue
            last, self._last = self._last, (t, *at(t), contacts)
            changed = self._switching.wanted(*self._last)
            if not changed:
                continue
            if last is not None and not self._switching.wanted(*last):
                t, changed = self._first(last[0], t, at, contacts, changed)
            self._switching.switched(changed)
            self.found = Located(t, changed)
            return t
        return None

    def _first(
        self, low: float, high: float, at: Callable[[float], tuple[Array, Array]], contacts: Contacts,
        changed: dict[str, bool],
    ) -> tuple[float, dict[str, bool]]:  # fmt: skip
        """Return the first time after `low` at which connections change, and these; at `high` they are `changed`."""
        while low < (middle := 0.5 * (low + high)) < high:
            found = self._switching.wanted(middle, *at(middle), contacts)
            if found:
                high, changed = middle, found
            else:
                low = middle
        return high, changed
