"""Controls and forces in Python that kernels of the compiled loop call."""

from __future__ import annotations

import ctypes
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np

from ...constraints.mechanism.state import MechanismState
from ...system.control_table import FUNCTION, ControlTable, no_control
from ...system.system import System

# time, and addresses of q, v and the torque
_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
# the C functions below those of `signal`, which make enumerations of handlers: that takes as long as a step
_C: Any = import_module("_signal")


class AskedForces:
    """The controls and forces of a system as a control of the compiled loop, which calls Python by an address.

    A function of the user that raises leaves a torque of NaN, with which no step is taken; `check` raises its error.

    Parameters
    ----------
    system : System
        The system.
    state : MechanismState
        Its constraints, which functions of the user may query.

    Attributes
    ----------
    table : ControlTable
        As kernels take it.
    before : callable or None
        Called before each call of a function of the user, with no argument.
    """

    def __init__(self, system: System, state: MechanismState) -> None:
        self._state = state
        self._torque, self._size = system.torque, (8 * system.nq, 8 * system.nv)
        self._q, self._v, self._tau = np.zeros(system.nq), np.zeros(system.nv), np.zeros(system.nv)
        self._places = self._q.ctypes.data, self._v.ctypes.data, self._tau.ctypes.data
        self.before: Callable[[], None] | None = None
        self._error: BaseException | None = None
        self._inside, self._interrupts = False, list[Any]()
        self._handler: Any = None
        self._callback = _CALLBACK(self._called)
        address = ctypes.cast(self._callback, ctypes.c_void_p).value
        self.table: ControlTable = no_control(system.nv)._replace(
            kind=FUNCTION, address=np.array([address], dtype=np.int64)
        )

    def _called(self, t: float, q: int, v: int, torque: int) -> None:
        try:
            self._inside = True
            while self._interrupts:
                self._handler(*self._interrupts.pop())
            own_q, own_v, own_tau = self._places
            ctypes.memmove(own_q, q, self._size[0])
            ctypes.memmove(own_v, v, self._size[1])
            if self.before is not None:
                self.before()
            # copies, which functions of the user may keep
            self._tau[:] = self._torque(t, self._q.copy(), self._v.copy())
            if not self._state.entered and not self._state.enter():
                # the step is Python's
                self._tau[:] = np.nan
            ctypes.memmove(torque, own_tau, self._size[1])
        except BaseException as error:
            # a second interrupt waits
            self._inside = False
            self._error = error
            self._tau[:] = np.nan
            ctypes.memmove(torque, self._places[2], self._size[1])
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
