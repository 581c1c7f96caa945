"""The diagnosis of a run: condition (12), (H4), energy, variation, and impacts with several outcomes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from ...impacts import Forks
from .error_growth import ErrorGrowth
from .jumps import Jump

Array = np.ndarray

# most names, rows and jumps in a report
_MOST_NAMES, _MOST_ROWS, _MOST_JUMPS = 3, 12, 3
# the verdict on a run of which only some steps are known
_OUTCOMES_UNKNOWN = "Whether an impact has several outcomes is not known: the file keeps only some of the steps."


@dataclass(frozen=True)
class Instant:
    """One instant with several active constraints, or a stretch of them with the same ones and no impact.

    Attributes
    ----------
    time, until : float
        The first and the last instant [s]; the same at an impact.
    constraints : tuple of str, length k
        Names, one for each contact point or limit.
    restitution : ndarray, shape (k,)
        e of each constraint.
    impact : bool
        Whether the velocity jumped.
    condition_12 : bool
        Whether the angles satisfy condition (12), throughout a stretch.
    independent : bool
        Whether the gradients are linearly independent, assumption (H4), throughout a stretch.
    energy_change : float
        Kinetic energy gained, measured from the states: v+' M v+ / 2 - v-' M v- / 2 less the work of the forces
        within the step, summed over a stretch [J].
    forks : Forks or None
        The outcomes of an impact where (12) fails; None elsewhere and after the horizon. With friction those of some
        orders in which the contacts close, at the horizon only.
    friction_independent : bool
        Whether the gradients and the tangents of contacts with friction are linearly independent, throughout a
        stretch. Where they are not, percussions are not unique and velocities need not be. True without friction.
    """

    time: float
    until: float
    constraints: tuple[str, ...]
    restitution: Array
    impact: bool
    condition_12: bool
    independent: bool
    energy_change: float
    forks: Forks | None
    _cosines: csr_array = field(repr=False)
    friction_independent: bool = True

    @property
    def angles(self) -> Array:
        """Kinetic angles between the gradients, shape (k, k) [rad]; in a stretch, at the largest violation of (12)."""
        cosines = self._cosines.toarray()
        np.fill_diagonal(cosines, 1.0)
        return np.arccos(cosines)

    @property
    def extreme_angles(self) -> tuple[float, float]:
        """Smallest and largest kinetic angle between two different gradients [rad]."""
        entries = self._cosines.tocoo()
        cosines = entries.data[entries.row != entries.col]
        # entries that are not kept are right angles
        if cosines.size < len(self.constraints) * (len(self.constraints) - 1):
            cosines = np.append(cosines, 0.0)
        return float(np.arccos(cosines.max())), float(np.arccos(cosines.min()))


@dataclass(frozen=True)
class Diagnosis:
    """Which results of a run may be trusted, and until when.

    Attributes
    ----------
    instants : tuple of Instant
        Every instant with several active constraints, in order.
    horizon : float
        First time at which outcomes of one impact differ by more than the tolerance [s]; inf if none do, nan where this
        is unknown because states are missing, or because friction acts in an impact of several constraints and the
        orders that were followed end alike.
    tolerance : float
        Largest cosine that counts as that of a right angle, and largest spread of outcomes, relative to the jump, that
        counts as zero.
    variation : float
        Total variation of the velocity, sum of |v_i - v_{i-1}| (Lemma 3.4) [m/s, rad/s]. Of a scheme that chooses its
        steps, or where states are `unseen`, the sum is over the recorded states: with `every` a lower bound.
    largest_percussion : float
        Largest percussion of an impact (Lemma 3.3) [N s, N m s].
    energy_excess : float
        Largest excess of the kinetic energy over the sum of its initial value, the work of forces and of moving walls,
        and the part due to a changing M [J]. It is at most rounding where the energy estimate before Proposition 3.1
        holds; nan where a file lacks the control that did work.
    vanishing : tuple of str
        Constraints whose gradient vanished while they were active, against assumption (H3): no percussion can act on
        them.
    unseen : bool
        Whether states between the recorded ones could not be computed again: the run was thinned and comes from a file
        that lacks its control, or from another version. The horizon is then an upper bound.
    not_followed : int
        How many impacts of several constraints have friction, and no outcomes that are known to differ: with friction
        only some orders are followed, in which each of up to 16 contacts closes first.
    gains : tuple of (float, float)
        Time [s] and energy [J] of each impact with friction that raised the kinetic energy.
    jumps : tuple of Jump
        Steps with friction in which velocities jump though no contact approaches. Known where steps can be taken again.
    projection_energy : float
        Energy that position projection added during the run [J]; see `Trajectory.projection_energy`.
    dead_centres : tuple of float
        Times at which gradients of closed loops depend on each other that are independent elsewhere [s]: what follows
        is not determined.
    switches : tuple of float
        Times at which connections were switched [s]. What is switched on is an impact with one outcome, the nearest
        velocity that the connections allow; contacts that close at it are looked at as in any impact.
    lost : tuple of str
        Functions that acted and that the file of the run could not keep, such as controls: energies are not known.
    growth : ErrorGrowth or None
        How an error of the start grows; of runs of `sensitivity` by all of the state, else None.
    """

    instants: tuple[Instant, ...]
    horizon: float
    tolerance: float
    variation: float
    largest_percussion: float
    energy_excess: float
    vanishing: tuple[str, ...]
    unseen: bool
    not_followed: int = 0
    gains: tuple[tuple[float, float], ...] = ()
    jumps: tuple[Jump, ...] = ()
    projection_energy: float = 0.0
    dead_centres: tuple[float, ...] = ()
    switches: tuple[float, ...] = ()
    lost: tuple[str, ...] = ()
    growth: ErrorGrowth | None = None

    def __repr__(self) -> str:
        return f"Diagnosis(horizon={self.horizon:g}, instants={len(self.instants)}, jumps={len(self.jumps)})"

    def __str__(self) -> str:
        return self.report()

    def report(self) -> str:
        """Return the diagnosis in words, then the instants as a table, impacts first."""
        lines = [self.verdict()]
        if self.unseen and lines[0] != _OUTCOMES_UNKNOWN:
            lines.append("The file keeps only some of the steps: instants between them were not looked at.")
        if self.vanishing:
            names = ", ".join(self.vanishing[:_MOST_NAMES])
            lines.append(
                f"(H3) fails: the gradient of {names} vanishes where it is active, and nothing holds it there."
            )
        if self.switches:
            times = _times(self.switches)
            lines.append(
                f"Connections were switched at t = {times} s: what is switched on is an impact with one outcome."
            )
        if self.dead_centres:
            times = _times(self.dead_centres)
            lines.append(
                f"At t = {times} s closed loops pass a dead centre: their gradients depend on each other there, and "
                "the loops alone do not determine what follows."
            )
        if not self.instants:
            lines.append("Several constraints were never seen active at once.")
        else:
            several = _count(len(self.instants), "time", "times")
            dependence = _failing("condition (12) on their angles fails", self.instants, "condition_12")
            independence = _failing("(H4) fails: their gradients depend on each other", self.instants, "independent")
            lines.append(f"Several constraints were active at {several}; {dependence}{independence}".rstrip(" ;") + ".")
            rows = _failing("The rows of contacts with friction are dependent", self.instants, "friction_independent")
            if rows:
                lines.append(f"{rows.rstrip(' ;')}: percussions are not unique there, and velocities need not be.")
        if self.gains:
            time, most = max(self.gains, key=lambda gain: gain[1])
            lines.append(
                f"{_count(len(self.gains), 'impact', 'impacts')} with friction raised the kinetic energy, by up to "
                f"{most:.3g} J at t = {time:.6g} s: Newton's law with e > 0 promises no loss there (Kane's paradox)."
            )
        lines += self._jumps()
        lines += [] if self.growth is None else [str(self.growth)]
        if self.projection_energy:
            lines.append(f"Energy added by position projection: {self.projection_energy:.3g} J.")
        known = not np.isnan(self.energy_excess)
        if not known and self.lost:
            lines.append(f"Energies are not known: the file of this run could not keep {', '.join(self.lost)}.")
        excess = f", energy above its estimate {self._rounded(self.energy_excess):.2g} J" if known else ""
        lines.append(
            f"Total variation of the velocity {self.variation:.6g}, largest percussion "
            f"{self.largest_percussion:.6g}{excess}."
        )
        return "\n".join(lines + self._table())

    def _jumps(self) -> list[str]:
        """Return the jumps in words: the first ones, then how many there are."""
        lines = []
        for jump in self.jumps[:_MOST_JUMPS]:
            names = ", ".join(jump.constraints[:_MOST_NAMES])
            names += f" and {len(jump.constraints) - _MOST_NAMES} more" if len(jump.constraints) > _MOST_NAMES else ""
            why = (
                "Coulomb's law has a second solution there, with which the motion would go on as before."
                if jump.second_solution
                else "friction alone makes the percussion, as in Painlevé's configuration."
            )
            lines.append(
                f"At t = {jump.time:.6g} s velocities jump by {jump.change:.3g} m/s at {names} although nothing "
                f"approaches: {why}"
            )
        left = len(self.jumps) - len(lines)
        return [*lines, f"So they do in {_count(left, 'other step', 'other steps')}."] if left else lines

    def _rounded(self, energy: float) -> float:
        """Return an energy, or zero where it is rounding."""
        return energy if not abs(energy) <= 1e-12 * self.variation * self.largest_percussion else 0.0

    def verdict(self) -> str:
        """Return until when the run is the only answer, in a sentence."""
        followed = [(i.time, i.forks) for i in self.instants if i.forks is not None]
        if np.isfinite(self.horizon):
            return (
                f"Beyond t = {self.horizon:.6g} s this run is one of several answers: there changes of the data within "
                f"one step's travel lead to velocities {followed[-1][1].spread:.3g} J^(1/2) apart in the kinetic norm."
            )
        incomplete = [(time, forks.reason) for time, forks in followed if not forks.complete]
        if incomplete:
            return (
                f"No impact was found to have several outcomes, but at {_count(len(incomplete), 'impact', 'impacts')}, "
                f"first at t = {incomplete[0][0]:.6g} s, {incomplete[0][1]}."
            )
        if self.not_followed:
            return (
                f"Whether {_count(self.not_followed, 'impact', 'impacts')} of several constraints with friction have "
                "several outcomes is not known: all are only sought without friction."
            )
        if self.unseen:
            return _OUTCOMES_UNKNOWN
        return "No impact that this run took at once has several outcomes."

    def _table(self) -> list[str]:
        if not self.instants:
            return []
        chosen = sorted(self.instants, key=lambda i: (i.condition_12, not i.impact, i.time))[:_MOST_ROWS]
        lines = [
            f"{'time [s]':>19}  {'(12)':>5}  {'(H4)':>5}  {'angles [deg]':>14}  {'dE [J]':>10}  active constraints"
        ]
        for i in sorted(chosen, key=lambda i: i.time):
            when = f"{i.time:.4f}" + (f" - {i.until:.4f}" if i.until > i.time else "")
            pairs = np.degrees(i.angles[np.triu_indices(len(i.constraints), 1)])
            angles = f"{pairs.min():.1f} - {pairs.max():.1f}" if np.ptp(pairs) > 0.05 else f"{pairs[0]:.1f}"
            names = ", ".join(i.constraints[:_MOST_NAMES])
            names += f" and {len(i.constraints) - _MOST_NAMES} more" if len(i.constraints) > _MOST_NAMES else ""
            verdicts = "  ".join("holds" if holds else "fails" for holds in (i.condition_12, i.independent))
            gained = "-" if np.isnan(i.energy_change) else f"{self._rounded(i.energy_change):.3g}"
            lines.append(f"{when:>19}  {verdicts}  {angles:>14}  {gained:>10}  {names}")
        left = len(self.instants) - len(chosen)
        return lines + ([f"and {left} more"] if left else [])


def _failing(what: str, instants: tuple[Instant, ...], holds: str) -> str:
    bad = [i for i in instants if not getattr(i, holds)]
    return f"{what} at {len(bad)} of these, first at t = {bad[0].time:.6g} s; " if bad else ""


def _times(times: tuple[float, ...]) -> str:
    """Return the first of some times in words."""
    return ", ".join([*(f"{t:.6g}" for t in times[:_MOST_NAMES]), *(["..."] if len(times) > _MOST_NAMES else [])])


def _count(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"
