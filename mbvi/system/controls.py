"""Controls of one robot that the compiled loop evaluates without Python: torques, PD control, compiled functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from ..arguments import array, function, integer, several_names, shown
from ..compiled import plain_array
from ..errors import InputError
from .control_table import FUNCTION, HELD, ControlTable, tracking, write_torque
from .given import called
from .joint_forces import ForceRows
from .mechanisms.named_joints import expanded, in_order, positions
from .system import Array

# by how much a time may differ from that of a step by rounding [steps]
_MARGIN = 1e-6
# largest size of q or v that counts as one
_MOST_COORDINATES = 100_000


class LoopControl:
    """A control of one robot that the compiled loop evaluates itself; it can be called as any other control.

    Attributes
    ----------
    table : ControlTable
        As kernels take it.
    """

    table: ControlTable

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torque at (t, q, v), shape (nv,) [N, N m]."""
        torque = np.empty(len(v))
        write_torque(self.table, t, plain_array(q), plain_array(v), torque)
        return torque

    def fitted(self, model: pin.Model, name: str) -> LoopControl:
        """Return the control as it acts on a robot of that name, or raise `InputError` if it does not fit."""
        self.check(list(zip(list(model.nqs)[1:], list(model.nvs)[1:], strict=True)), name)
        table, position = self.table, positions(model)[model.nv - self.table.torque.shape[1] :]
        moved = np.flatnonzero(table.stiffness)
        if np.array_equal(table.position[moved], position[moved]):
            return self
        # a joint of several coordinates, as one without limits, lies behind a joint with a stiffness
        new = copy(self)
        new.table = table._replace(position=position)
        return new

    def check(self, sizes: list[tuple[int, int]], name: str) -> None:
        """Raise `InputError` if the control does not fit a robot, of whose joints nq and nv are given."""
        n, nv = self.table.torque.shape[1], sum(size for _, size in sizes)
        if n > nv:
            raise InputError(f"the control of {name} acts on {n} velocities; it has {nv}")
        moved = np.flatnonzero(self.table.stiffness)
        place = np.repeat([nq == size == 1 for nq, size in sizes], [size for _, size in sizes])[nv - n :]
        if not place[moved].all():
            raise InputError(
                f"the control of {name} has a stiffness on a joint whose position is not one coordinate: "
                "a free base, or a joint without limits"
            )


class ConstantTorque(LoopControl):
    """Torques that do not change during a run, or that are set from outside between the steps of a `Simulator`.

    Parameters
    ----------
    torque : ndarray, shape (n,)
        Torques of the robot's last n velocities [N, N m].

    Attributes
    ----------
    torque : ndarray, shape (n,)
        The same; `control.torque[:] = ...` changes them.

    Raises
    ------
    InputError
        If these are no finite numbers.
    """

    def __init__(self, torque: Array) -> None:
        self.table = tracking(array(torque, "torque", ("n",))[None].copy())
        self.torque = self.table.torque[0]


class PDControl(LoopControl):
    """Proportional-derivative control of joints to given positions, or along a trajectory.

    tau_k = torque_k + stiffness_k (q*_k - q_k) + damping_k (v*_k - v_k), between -limit_k and limit_k. Between the
    times of a trajectory q*, v* and torque are linear in t; before the first and after the last they are constant.

    Parameters
    ----------
    q : ndarray, shape (n,) or (k, n), or mapping of str to float or ndarray
        Positions of the robot's last n joints, each with one degree of freedom [rad or m]; or of joints by name, on
        which alone it acts, {"knee": 0.4}, with k values each along a trajectory.
    stiffness, damping : float, ndarray, shape (n,), or mapping
        Gains [N m/rad, N m s/rad]; by name of all joints that q names.
    v, torque : ndarray, shape (n,) or (k, n), or mapping, optional
        Velocities, and torques that are added [N m]; by name of some of the joints that q names. Zero by default.
    times : ndarray, shape (k,), optional
        Times of the trajectory, ascending [s].
    limit : float, ndarray, shape (n,), mapping, or "effort", optional
        Largest torques [N m]; by name of some joints; "effort": those of the robot's file. None by default.

    Attributes
    ----------
    q, v, torque : ndarray, shape (k, n)
        The same, with k = 1 without times; between the steps of a `Simulator` they may be written to, unless joints are
        named or efforts are taken from the file: then each robot has a copy.

    Raises
    ------
    InputError
        If shapes do not fit, numbers are not finite, times do not ascend, a gain or limit is negative, or names differ
        from those of q. With a robot, if it has no such joint, or its file no effort limit of one that is above 0.
    """

    def __init__(
        self,
        q: Array | Mapping[str, Any],
        stiffness: float | Array | Mapping[str, float],
        damping: float | Array | Mapping[str, float],
        *,
        v: Array | Mapping[str, Any] | None = None,
        torque: Array | Mapping[str, Any] | None = None,
        times: Array | None = None,
        limit: float | Array | Mapping[str, float] | Literal["effort"] | None = None,
    ) -> None:
        self._joints = several_names(list(q), "q") if isinstance(q, Mapping) else None
        self._of_file = isinstance(limit, str)
        if self._of_file and limit != "effort":
            raise InputError(f"limit must be numbers or 'effort', the limits of the robot's file; got {shown(limit)}")
        joints = self._joints
        q, stiffness, damping = (
            in_order(one, name, joints) for one, name in ((q, "q"), (stiffness, "stiffness"), (damping, "damping"))
        )
        v, torque = in_order(v, "v", joints, 0.0), in_order(torque, "torque", joints, 0.0)
        limit = None if self._of_file else in_order(limit, "limit", joints, np.inf)
        k = 1 if times is None else len(array(times, "times", ("k",)))
        place = array(q, "q", ("n",) if times is None else (k, "n")).reshape(k, -1)
        n = place.shape[1]
        rows = [
            np.zeros((k, n)) if each is None else _rows(each, name, k, n)
            for each, name in ((torque, "torque"), (v, "v"))
        ]
        gains = [_not_negative(each, name, n) for each, name in ((stiffness, "stiffness"), (damping, "damping"))]
        most = np.full(n, np.inf) if limit is None else _not_negative(limit, "limit", n, finite=self._joints is None)
        when = np.zeros(1) if times is None else array(times, "times", ("k",))
        if (np.diff(when) <= 0.0).any():
            raise InputError("times must ascend")
        self.q, self.v, self.torque = place.copy(), rows[1], rows[0]
        self.table = tracking(self.torque, when)._replace(
            q=self.q, v=self.v, stiffness=gains[0], damping=gains[1], limit=most
        )

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torque at (t, q, v), shape (nv,) [N, N m]."""
        if self._joints is not None or self._of_file:
            raise InputError("a control with names of joints, or efforts of a file, is that of a robot: give it to one")
        return super().__call__(t, q, v)

    def fitted(self, model: pin.Model, name: str) -> LoopControl:
        """Return the control as it acts on a robot of that name, or raise `InputError` if it does not fit."""
        if self._joints is None and not self._of_file:
            return super().fitted(model, name)
        new = object.__new__(PDControl)
        new._joints, new._of_file = None, False
        new.table = table = expanded(self.table, model, self._joints, self._of_file, name)
        new.q, new.v, new.torque = table.q, table.v, table.torque
        return new.fitted(model, name)


class HeldTorque(LoopControl):
    """Torques that are constant during each step.

    Parameters
    ----------
    torque : ndarray, shape (k, n)
        Torques of the robot's last n velocities in each step, those of several runs one below the other [N, N m].
    steps : int
        Steps of a run.
    actuators : ForceRows, optional
        What acts besides, with as many rows of inputs.
    """

    def __init__(self, torque: Array, steps: int, actuators: ForceRows | None = None) -> None:
        table = tracking(np.zeros((1, torque.shape[1])), np.array([0.0, 1.0]))
        self.table = table._replace(kind=HELD, held=np.array([0, steps]), torque=torque)
        if actuators is not None:
            self.table = self.table._replace(actuators=actuators)

    def copy(self) -> HeldTorque:
        """Return a control for another thread, with the same torques and inputs."""
        table = self.table
        return HeldTorque(table.torque, table.held.item(1), table.actuators)

    def begin(self, run: int, start: float, h: float, at_end: bool) -> None:
        """Take the rows of a run that starts at a time, with steps of h [s].

        `at_end` is whether the scheme evaluates forces at the end of its steps, which is the end of their rows' time.
        """
        table = self.table
        table.held[0] = run * table.held[1] % len(table.torque)
        table.times[:] = start + (_MARGIN if at_end else -_MARGIN) * h, h


class CompiledControl(LoopControl):
    """A control whose function numba compiles, with indices checked.

    Parameters
    ----------
    control : function
        control(t, q, v, tau): writes the torques to tau, shape (nv,), which is zero before; it may use what numba
        compiles, and constants, but no other state.
    nq, nv : int
        Sizes of the robot's q and v.

    Raises
    ------
    InputError
        If it is no function, or numba cannot compile it. At any call, if it raises, as by an index beyond an array.
    """

    def __init__(self, control: Callable[[float, Array, Array, Array], None], nq: int, nv: int) -> None:
        function(control, "control", "control(t, q, v, tau)")
        nq, nv = integer(nq, "nq"), integer(nv, "nv")
        if max(nq, nv) > _MOST_COORDINATES:
            raise InputError(f"nq and nv must be at most {_MOST_COORDINATES}; got {nq} and {nv}")
        self._control, self._sizes = control, (nq, nv)
        self._function, self._compiled = _compile(control, nq, nv)
        address = np.array([self._compiled.address], dtype=np.int64)
        self.table = tracking(np.zeros((1, nv)))._replace(kind=FUNCTION, address=address)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torque at (t, q, v), shape (nv,) [N, N m]."""
        # the function would read beyond shorter arrays
        if (len(q), len(v)) != self._sizes:
            raise InputError(f"q and v have {len(q)} and {len(v)} entries; the control is made for {self._sizes}")
        # as the loop passes them: writable, so that the function is not compiled again
        tau, state = np.zeros(len(v)), (np.array(q, float, order="C"), np.array(v, float, order="C"))
        try:
            self._function(t, *state, tau)
        except Exception as error:
            raise InputError(
                f"the control {called(self._control)} at t = {t:.9g}: {self._in_python(error, t, q, v)}"
            ) from error
        return tau

    def _in_python(self, error: Exception, t: float, q: Array, v: Array) -> Exception:
        """Return what Python raises where numba raised an error: it names the index and the size."""
        plain = getattr(self._control, "py_func", self._control)
        try:
            plain(t, np.array(q, float), np.array(v, float), np.zeros(len(v)))
        except Exception as named:
            return named
        return error

    def check(self, sizes: list[tuple[int, int]], name: str) -> None:
        """Raise `InputError` if the control was made for other sizes of q and v."""
        of_robot = sum(nq for nq, _ in sizes), sum(nv for _, nv in sizes)
        if of_robot != self._sizes:
            raise InputError(f"the control of {name} is made for nq, nv = {self._sizes}; it has {of_robot}")

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        # the address is good in this process only
        return type(self), (self._control, *self._sizes)


def _rows(value: Any, name: str, k: int, n: int) -> Array:
    given = array(value, name)
    if given.shape not in ((n,), (k, n)):
        raise InputError(f"{name} has shape {given.shape}; it must have ({n},) or ({k}, {n})")
    return np.broadcast_to(given, (k, n)).copy()


def _not_negative(value: Any, name: str, n: int, finite: bool = True) -> Array:
    given = array(value, name) if finite else np.asarray(value)
    if given.shape not in ((), (n,)):
        raise InputError(f"{name} has shape {given.shape}; it must be one number or {n} of them")
    if not (given >= 0.0).all():
        raise InputError(f"{name} must be at least 0; got {shown(value)}")
    return np.broadcast_to(given, (n,)).copy()


def _compile(control: Callable[..., None], nq: int, nv: int) -> tuple[Any, Any]:
    """Return the compiled function, and a C function control(t, q, v, tau) on addresses: tau is NaN where it raises."""
    from numba import carray, cfunc, njit, types
    from numba.core.errors import NumbaError

    compiled = njit(boundscheck=True)(getattr(control, "py_func", control))
    pointer = types.CPointer(types.float64)

    def on_addresses(t: float, q: Any, v: Any, tau: Any) -> None:
        torque = carray(tau, (nv,))
        try:
            compiled(t, carray(q, (nq,)), carray(v, (nv,)), torque)
        except Exception:
            # the step is then left to Python, where the call raises
            torque[:] = np.nan

    try:
        made = cfunc(types.void(types.float64, pointer, pointer, pointer))(on_addresses)
    except NumbaError as error:
        raise InputError(f"control cannot be compiled by numba: {str(error)[:500]}") from error
    returned = compiled.nopython_signatures[0].return_type
    if returned is not types.none:
        raise InputError(f"control returns {returned}; it must write the torques to tau and return nothing")
    return compiled, made
