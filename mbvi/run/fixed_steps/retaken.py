"""The one rule for steps that are not solved: shorter parts, then a second bound of the residual, then an error."""

from __future__ import annotations

from collections.abc import Iterator

from ...errors import InfeasibleError, ProjectionError
from ...problem import Problem
from ...projection import Projector
from ...schemes import Scheme, Step
from ..tunnelling import TunnellingGuard

# how often a step is halved
_MOST_HALVINGS = 3
# steps that a note lists one by one
_LISTED = 3


class SolvedSteps:
    """Steps of a run, of which those that are not solved are retaken.

    A step whose projection does not reach its residual is retaken as two halves, each from percussions that are not
    known yet; a half that is not solved either is halved again, down to an eighth of the step. There the second bound
    of the residual applies (`Acceptance.bound`), with the same bound of depths. What it does not accept raises. Rows
    that contradict each other raise at once.

    Parameters
    ----------
    problem : Problem
        System and constraints.
    scheme : Scheme
        Takes the steps.
    guard : TunnellingGuard
        Looks after each of them.

    Attributes
    ----------
    parts : int
        How many steps there are more than there would be if none had been retaken.
    """

    def __init__(self, problem: Problem, scheme: Scheme, guard: TunnellingGuard) -> None:
        self._problem, self._scheme, self._guard = problem, scheme, guard
        self.parts = 0
        self._halved: list[str] = []
        self._loose: list[str] = []

    def steps(self, t: float, state: Step, h: float, projector: Projector) -> Iterator[Step]:
        """Yield the steps from a state at t to t + h; more than one where a step was shortened or retaken."""
        last = state
        try:
            new = self._scheme.step(self._problem, t, state.q, state.v, h, projector)
            for last in self._guard.followed(t, state, new, h, projector):
                yield last
        except ProjectionError as error:
            begin = t if last is state else last.t
            yield from self.retake(begin, last, t + h - begin, projector, error)

    def retake(self, t: float, state: Step, h: float, projector: Projector, error: ProjectionError) -> list[Step]:
        """Return the steps that replace one from a state at t to t + h, which ended with an error."""
        found = self._halves(t, state, h, projector, error, _MOST_HALVINGS)
        self.parts += len(found) - 1
        self._halved.append(f"at t = {t:.6g} s in {len(found)} parts{self._place(error.constraint)}")
        self.note_loose(t, projector)
        return found

    def note_loose(self, t: float, projector: Projector) -> None:
        """Note the residuals above the one asked for that were accepted in a step from t [s]."""
        for residual, constraint in projector.acceptance.beyond:
            self._loose.append(f"{residual:.1e} at t = {t:.6g} s{self._place(constraint)}")
        projector.acceptance.beyond.clear()

    def _halves(
        self, t: float, state: Step, h: float, projector: Projector, error: ProjectionError, left: int
    ) -> list[Step]:
        """Return the steps of both halves, which may be halved `left` times."""
        if isinstance(error, InfeasibleError):
            raise error
        found, half, end = list[Step](), 0.5 * h, t + h
        for begin in (t, t + half):
            if found:
                state = found[-1]
                if self._guard.observe is not None:
                    self._guard.observe(state, state.t - (found[-2].t if len(found) > 1 else t))
            projector.forget()
            found += self._part(begin, state, half if begin == t else end - begin, projector, left - 1)
        return found

    def _part(self, t: float, state: Step, h: float, projector: Projector, left: int) -> list[Step]:
        """Return the steps of one half."""
        try:
            return self._alone(t, state, h, projector)
        except ProjectionError as error:
            if left:
                return self._halves(t, state, h, projector, error, left)
        with projector.acceptance.second_bound():
            projector.forget()
            try:
                return self._alone(t, state, h, projector)
            except ProjectionError as error:
                raise error.after(t) from error

    def _alone(self, t: float, state: Step, h: float, projector: Projector) -> list[Step]:
        new = self._scheme.shortened(self._problem, t, state, h, projector)
        return list(self._guard.followed(t, state, new, h, projector))

    def _place(self, constraint: int | None) -> str:
        return "" if constraint is None else f" ({self._problem.constraints.name(constraint)})"

    def notes(self) -> list[str]:
        """Return notes on the steps that were retaken and on the residuals that were accepted beyond their bound."""
        notes = []
        if self._halved:
            notes.append(f"steps were retaken in parts because they were not solved: {_listed(self._halved)}")
        if self._loose:
            notes.append(f"residuals above the one asked for were accepted: {_listed(self._loose)}")
        return notes


def _listed(words: list[str]) -> str:
    more = f", and {len(words) - _LISTED} more" if len(words) > _LISTED else ""
    return ", ".join(words[:_LISTED]) + more
