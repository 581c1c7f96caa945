"""Callbacks of the compiled loop: controls and forces in Python, and constraints that are functions of the user."""

from __future__ import annotations

import ctypes
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np

from ...constraints.mechanism.row_callback import write_rows
from ...constraints.mechanism.state import MechanismState, has_given_rows
from ...problem import Problem
from ...system.control_table import FUNCTION, ControlTable, no_control
from .loop_scope import has_user_forces

# time, and addresses of q, v and the torque
_FORCES = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
# number of a family, time, address of q, tolerance
_ROWS = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p, ctypes.c_double)
# arrays of kernels that are known by their addresses
_MOST_KNOWN = 64
# the C functions below those of `signal`, which make enumerations of handlers: that takes as long as a step
_C: Any = import_module("_signal")


class PythonCallbacks:
    """Functions of the user that the compiled loop calls by an address.

    A function that raises leaves a torque of NaN or no rows, with which no step is taken; `check` raises its error.

    Parameters
    ----------
    problem : Problem
        The problem.
    state : MechanismState
        Its constraints, which functions of the user may query.

    Attributes
    ----------
    table : ControlTable or None
        Controls and forces as kernels take them; None if kernels evaluate them.
    before : callable or None
        Called before each call of a control, with no argument.
    """

    def __init__(self, problem: Problem, state: MechanismState) -> None:
        system = problem.system
        self._state, self._constraints, self._torque = state, problem.constraints, system.torque
        self._nq, self._nv, self._known = system.nq, system.nv, dict[int, np.ndarray]()
        self._rows = state.arrays.given.rows
        self.before: Callable[[], None] | None = None
        self._error: BaseException | None = None
        self._inside, self._interrupts = False, list[Any]()
        self._handler: Any = None
        self._functions = _FORCES(self._write_torque), _ROWS(self._write_rows)
        forces, rows = (ctypes.cast(each, ctypes.c_void_p).value for each in self._functions)
        self.table: ControlTable | None = None
        if has_user_forces(system):
            self.table = no_control(system.nv)._replace(kind=FUNCTION, address=np.array([forces], dtype=np.int64))
        state.arrays.given.address[0] = rows

    def _write_torque(self, t: float, q: int, v: int, torque: int) -> None:
        if not self._called(self._evaluate_torque, t, q, v, torque):
            self._at(torque, self._nv)[:] = np.nan

    def _write_rows(self, k: int, t: float, q: int, tolerance: float) -> None:
        if not self._called(self._evaluate_rows, k, t, q, tolerance):
            self._rows.size[0] = -1

    def _evaluate_torque(self, t: float, q: int, v: int, torque: int) -> None:
        if self.before is not None:
            self.before()
        # copies, which functions of the user may keep
        tau = self._torque(t, self._at(q, self._nq).copy(), self._at(v, self._nv).copy())
        self._at(torque, self._nv)[:] = tau

    def _at(self, place: int, size: int) -> np.ndarray:
        """Return the array at an address, as long as the kernel that gave it runs."""
        known = self._known.get(place)
        if known is None or len(known) != size:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            known = self._known[place] = np.ctypeslib.as_array((ctypes.c_double * size).from_address(place))
        return known

    def _evaluate_rows(self, k: int, t: float, q: int, tolerance: float) -> None:
        rows, self._rows.size[0] = self._constraints.rows_of(k, t, self._at(q, self._nq).copy(), tolerance), 0
        if rows is not None:
            write_rows(rows, self._constraints.levers(rows.constraint), self._rows)

    def _called(self, function: Callable[..., None], *given: Any) -> bool:
        """Call a function of the user; return False if no step may be taken with what it returned."""
        try:
            self._inside = True
            while self._interrupts:
                self._handler(*self._interrupts.pop())
            function(*given)
            # otherwise the step is Python's
            return self._state.entered or self._state.enter()
        except BaseException as error:
            # a second interrupt waits
            self._inside = False
            self._error = error
            return False
        finally:
            self._inside = False

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Let Ctrl-C interrupt functions of the user, and wait elsewhere in a call of a kernel.

        An exception that is raised in a callback outside of these functions is printed and lost.
        """
        before = _C.getsignal(signal.SIGINT)
        if not callable(before) or threading.current_thread() is not threading.main_thread():
            yield
            return
        self._handler = before

        def interrupt(*received: Any) -> None:
            if self._inside:
                self._handler(*received)
            else:
                self._interrupts.append(received)

        _C.signal(signal.SIGINT, interrupt)
        try:
            yield
        finally:
            _C.signal(signal.SIGINT, before)

    def check(self) -> None:
        """Raise the error of a function of the user, or an interrupt that came during a kernel."""
        error, self._error = self._error, None
        if error is not None:
            raise error
        while self._interrupts:
            self._handler(*self._interrupts.pop())


def python_callbacks(problem: Problem, state: MechanismState) -> PythonCallbacks | None:
    """Return the callbacks of a problem; None if it has no functions of the user."""
    some = has_user_forces(problem.system) or has_given_rows(problem.constraints)
    return PythonCallbacks(problem, state) if some else None
