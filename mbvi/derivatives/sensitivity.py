"""`sensitivity`: the derivative of a run with impacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Literal, TypeVar, overload

import numpy as np

from ..arguments import boolean, integer, optional, positive, several_names, shown
from ..errors import InputError, SensitivityError
from ..problem import Problem, check_kept
from ..results.diagnosis.error_growth import trusted_until
from ..results.trajectory import Trajectory
from ..run.accuracy import projector_of
from ..run.given_scheme import checked_scheme
from ..run.interrupted import run_so_far
from ..run.own_steps.event_loop import run_event_driven
from ..run.simulate import check_problem, simulate
from ..schemes import Centered, EventDriven, MoreauJean, OwnStepsScheme, Paoli, Scheme, StewartTrinkle
from ..system.hinged import HingedSystem
from ..system.mechanisms.loop_margin import with_equalities
from ..system.system import Array
from .check import SensitivityCheck, VariedRuns
from .directions import Directions, directions
from .fixed_steps import LocatedSteps
from .growth import growth, with_growth
from .one_sided import OneSidedSensitivity, Part, branches
from .orders import Branching
from .variation import Variation

Kind = TypeVar("Kind", bound=Variation)

# tolerance of the scheme if none is given
TOLERANCE = 1e-9
# that of variations along a run of fixed steps
_BETWEEN_STEPS = 1e-6


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The derivative of a run.

    The 2 nv rows are variations of the state: of the configuration as tangent vectors at q, of joints and bodies in
    their own frames [m, rad], then of the velocity [m/s, rad/s], both in the order of `run.v`. Columns are what the run
    is differentiated by. An entry has the unit of its row over that of its column.

    Attributes
    ----------
    run : Trajectory
        The run, the same as that of `simulate`. Its diagnosis and report say how errors of the start grow, where all of
        the state was varied.
    matrix : ndarray, shape (2 nv, p)
        The derivative of the state at the end.
    matrices : ndarray, shape (n + 1, 2 nv, p)
        That of the state at each time of `run.t`, which of `EventDriven` holds an impact twice, before and after it.
        The first one is the identity, without the variations that would open a contact that is closed at the start.
    columns : dict of str to slice
        The columns of each name of `wrt`. Those of "state" are variations as the rows are, those of "restitution" have
        no unit; for others see `sensitivity`.
    """

    run: Trajectory
    matrix: Array
    matrices: Array
    columns: dict[str, slice]
    _varied: VariedRuns = field(repr=False)

    @property
    def growth(self) -> Array:
        """The largest factor by which a variation of the start has grown at each time of `run.t`, shape (n + 1,).

        In lengths of the scene and rad, and these a second. Takes "state" in `wrt`.
        """
        known = self.run.record.growth
        return growth(self._varied.problem, self.matrices, self._varied.varied) if known is None else known

    def trusted_until(self, digits: float = 3.0, start: float = 2.0**-52) -> float:
        """Return the time until which the start, as exactly as it is known, leaves digits of the states [s].

        Parameters
        ----------
        digits : float
            How many digits, relative to lengths of the scene and rad.
        start : float
            Error of the start in the same units: that of rounding, or of what it was measured with.

        Returns
        -------
        float
            The time from which a variation of that size may have grown beyond; inf if it does not within the run.

        Raises
        ------
        InputError
            If digits or start is not positive and finite, or `wrt` does not hold "state".
        """
        error = positive(start, "start")
        return trusted_until(self.run.t, self.growth, positive(digits, "digits"), error)

    def check(self, directions: int = 3) -> SensitivityCheck:
        """Compare the derivative with differences of runs, along random directions.

        Parameters
        ----------
        directions : int
            How many, or p if that is less; each takes three runs or more at tolerance 1e-12, and all take one.

        Returns
        -------
        SensitivityCheck
            Both, and their relative difference; printed it is a table.

        Raises
        ------
        InputError
            If directions is no whole number above 0.
        """
        count = min(integer(directions, "directions", 1), self.matrix.shape[1])
        return self._varied.compared(self.matrix, count)


@overload
def sensitivity(
    problem: Problem,
    scheme: Scheme | EventDriven | None = None,
    *,
    duration: float,
    step: float | None = None,
    wrt: Iterable[str] = ("state",),
    bodies: Iterable[str] | None = None,
    one_sided: Literal[False] = False,
) -> Sensitivity: ...
@overload
def sensitivity(
    problem: Problem,
    scheme: EventDriven | None = None,
    *,
    duration: float,
    wrt: Iterable[str] = ("state",),
    bodies: Iterable[str] | None = None,
    one_sided: Literal[True],
) -> OneSidedSensitivity: ...
def sensitivity(
    problem: Problem,
    scheme: Scheme | EventDriven | None = None,
    *,
    duration: float,
    step: float | None = None,
    wrt: Iterable[str] = ("state",),
    bodies: Iterable[str] | None = None,
    one_sided: bool = False,
) -> Sensitivity | OneSidedSensitivity:
    """Run a problem and differentiate the run, through its impacts, by the initial state, restitution and parameters.

    Parameters
    ----------
    problem : Problem
        The problem to run.
    scheme : EventDriven, optional
        By default `EventDriven(tolerance=1e-9)`; the derivative is about as accurate as the tolerance. `Paoli`,
        `MoreauJean`, `Centered` and `StewartTrinkle` take steps across impacts: the derivative is then that of the
        motion which they approximate, with impacts located within steps. Its error falls with h. It is not the
        derivative of the map of a step, which does not converge.
    duration : float
        Duration [s]; the run may not end at an impact.
    step : float, optional
        Time step h of a scheme of fixed steps [s]; as of `simulate`.
    wrt : sequence of str
        What to differentiate by, each of one column unless said:

        - "state": q0 and v0, as tangent vectors, 2 nv columns.
        - "restitution": e of all contacts, by the same number that is added to each. "restitution of ball | floor":
          that of one pair, by the name that impacts have.
        - "mass of ball" [kg], of a free body, or of what moves with a joint, as `problem.system.bodies` lists them; the
          centre of mass and the inertia about it stay.
        - "centre of mass of arm/elbow" [m], of what moves with a joint, in the joint's frame, 3 columns.
        - "inertia of ball" [kg m^2] about the centre of mass, its entries xx, yy, zz, xy, xz, yz, 6 columns; in the
          axes of a free body, or of the joint's frame.
        - "torque of arm/elbow" [N m, N]: a constant torque that is added, a column for each velocity of the joint.
        - "control stiffness of arm/elbow" [N m/rad, N/m], "control damping of arm/elbow" [N m s/rad, N s/m], "control
          target of arm/elbow" [rad, m]: of a joint on which a `PDControl` has a gain; a target varies by as much at all
          times of a trajectory. A torque at a limit does not vary.
        - "friction": mu of all contacts that have any, by the same number that is added to each. "friction of ball |
          floor": that of one pair.
        - "gravity" [m/s^2]: its acceleration along x, y and z, 3 columns.
        - "offset of floor" [m]: the place of a half-space along its normal; of a `GapFunction` by its name, whose f
          becomes less by it.
    bodies : sequence of str, optional
        The joints and free bodies whose initial q and v are varied, "quadruped/FL_hip_joint" or "ball", as
        `problem.system.bodies` lists them; by default all.
    one_sided : bool
        Whether to differentiate on each side where several constraints close at once and the order of single impacts
        matters: variations decide which of them closes first. Takes `EventDriven`.

    Returns
    -------
    Sensitivity or OneSidedSensitivity
        The run and its derivative, in m, rad and s; with one_sided a run and a derivative for each order.

    Raises
    ------
    SensitivityError
        Where the run has no derivative, with time, bodies and reason. Constraints that close at once and are not
        orthogonal in the kinetic metric; impacts slower than the root of the tolerance, relative to the speed of their
        bodies or to a length of the scene a second, or so slow against the forces that open the gap that the tolerance
        leaves fewer than three digits of their speed, and gaps that just miss such an impact; impacts that accumulate;
        a run that starts or ends at an impact; by parameters also closed contacts that carry no force; a torque of
        a `PDControl`, an actuator or a spring that stays exactly at its limit.
        With friction: several impacts at once, impacts that are about to stick or to slip, and contacts that share
        their load at will where that matters.
        Where mbvi does not know it: another scheme, friction along fixed steps or of joints, loops and coupled joints
        along fixed steps or with friction, closing hinges with forces, controls of the whole scene, polyhedra that
        touch each other.
        With one_sided: friction; orders of impacts in which a row grazes, or a force opens a contact between two
        impacts; more than 20 single impacts that follow each other at once, or 64 branches; columns that keep them
        simultaneous.
    InputError
        If a name is unknown, duration is not positive and finite, or one_sided comes with steps of fixed length.
    UnsuitableError, DivergedError, ProjectionError
        As `simulate`.

    Notes
    -----
    Variations follow the linearised motion; at an impact they follow the saltation matrix, at a release the identity.
    Contacts that are closed stay closed, as loops do: with some at the start the derivative is that along the
    variations which keep them closed. A contact with friction that does not slip at the start is varied so too.
    Functions of the user, forces and controls of robots, must be smooth functions of (t, q, v).
    """
    if boolean(one_sided, "one_sided"):
        if scheme is not None and not isinstance(scheme, EventDriven):
            raise InputError(f"one_sided takes EventDriven, which locates impacts; got {shown(scheme)}")
        names, chosen = several_names(wrt, "wrt"), optional(several_names, bodies, "bodies")
        check_problem(problem)

        def follow(part: Problem, rest: float, kind: Callable[[Problem, float, Directions], Branching]) -> Part:
            return followed(part, scheme, rest, step, names, chosen, kind)

        return branches(follow, problem, positive(duration, "duration"))
    made: list[Variation] = []

    def kept(part: Problem, tolerance: float, varied: Directions) -> Variation:
        made.append(Variation(part, tolerance, varied))
        return made[0]

    try:
        run, variation, varied = followed(problem, scheme, duration, step, wrt, bodies, kept)
    except SensitivityError as error:
        so_far: Trajectory | None = getattr(error, "run", None)
        if made and so_far is not None:
            error.run = with_growth(so_far, made[0])
        raise
    matrices = np.array(variation.matrices) / varied.sizes
    matrices.setflags(write=False)
    runs = VariedRuns(
        problem, float(duration), varied, matrices[0], variation.closed_at_start, variation.still_at_start
    )
    return Sensitivity(with_growth(run, variation), matrices[-1], matrices, varied.columns, runs)


def followed(
    problem: Problem,
    scheme: Scheme | EventDriven | None,
    duration: float,
    step: float | None,
    wrt: Iterable[str],
    bodies: Iterable[str] | None,
    kind: Callable[[Problem, float, Directions], Kind],
) -> tuple[Trajectory, Kind, Directions]:
    """Return a run, what followed its variations, and the columns; arguments and errors as those of `sensitivity`."""
    check_problem(problem)
    check_kept(problem)
    duration, names = positive(duration, "duration"), several_names(wrt, "wrt")
    if not names or len(set(names)) < len(names):
        raise InputError(f"wrt must hold one name or more, each once; got {shown(list(names))}")
    varied = directions(problem, names, optional(several_names, bodies, "bodies"))
    scheme = _checked(problem, EventDriven(TOLERANCE) if scheme is None else checked_scheme(scheme))
    if isinstance(scheme, Scheme):
        return *_along_steps(problem, scheme, duration, step, kind, varied), varied
    if step is not None:
        raise InputError(f"{scheme.name} chooses its own steps: leave out step")
    scheme.check(problem)

    projector, notes = projector_of(problem, scheme, None, None, None)
    notes += problem.system.notes() + ([] if problem.scene is None else problem.scene.notes(problem))
    variation = kind(problem, scheme.tolerance, varied)
    run = run_event_driven(problem, scheme, duration, 1, projector, notes, None, False, watch=variation)
    with run_so_far(lambda: run):
        variation.finish()
    return run, variation, varied


def _along_steps(
    problem: Problem,
    scheme: Scheme,
    duration: float,
    step: float | None,
    kind: Callable[[Problem, float, Directions], Kind],
    varied: Directions,
) -> tuple[Trajectory, Kind]:
    """Return a run of fixed steps, and what followed the variations of the motion that it approximates."""
    run = simulate(problem, scheme, duration=duration, step=step, progress=False)
    variation = kind(problem, _BETWEEN_STEPS, varied)
    variation.approximate = True
    recorded = [0]
    with run_so_far(lambda: run):
        motion = LocatedSteps(run, _BETWEEN_STEPS)
        try:
            for part, ends in motion.parts():
                variation(part, motion)
                if ends:
                    recorded.append(len(variation.matrices) - 1)
            variation.finish()
        finally:
            variation.matrices = [variation.matrices[k] for k in recorded]
    return run, variation


def _checked(problem: Problem, scheme: Scheme | OwnStepsScheme) -> Scheme | EventDriven:
    """Return the scheme; raise `SensitivityError` where mbvi knows no derivative of any run."""
    system, reason = problem.system, ""
    if not isinstance(scheme, EventDriven | Paoli | MoreauJean | Centered | StewartTrinkle):
        reason = (
            f"of {scheme!r} none is known: take EventDriven(tolerance), Paoli, MoreauJean, Centered or StewartTrinkle"
        )
    elif problem.constraints.frictional and not isinstance(scheme, EventDriven):
        reason = f"there is friction, whose derivatives mbvi knows along runs of EventDriven only, not of {scheme.name}"
    elif problem.constraints.moving:
        reason = "walls move on their own, whose derivatives mbvi does not know yet"
    elif system.has_joint_friction:
        reason = "joints have friction, whose derivatives mbvi does not know yet"
    elif with_equalities(system) and not isinstance(scheme, EventDriven):
        reason = (
            f"there are loops or coupled joints, whose derivatives mbvi knows of EventDriven only, not of {scheme.name}"
        )
    elif with_equalities(system) and problem.constraints.frictional:
        reason = "there are loops or coupled joints and friction, whose derivatives mbvi does not know yet"
    elif isinstance(system, HingedSystem):
        reason = "closing hinges have forces, whose derivatives mbvi does not know yet"
    elif system.observe is not None:
        reason = "a control of the whole scene may react to contacts, which has no derivative"
    if reason:
        raise SensitivityError(reason, problem.t0)
    assert isinstance(scheme, Scheme | EventDriven)
    return scheme
