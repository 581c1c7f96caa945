"""Error messages about the results of functions that a user gives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import DivergedError

Array = np.ndarray


def called(function: Callable[..., Any]) -> str:
    """Return the name of a function, without its address."""
    return str(getattr(function, "__name__", type(function).__name__))


def not_finite(what: str, value: Array, t: float | None, q: Array, v: Array | None = None) -> DivergedError:
    """Return the error for a result that is not finite, with its time and state."""
    when = "" if t is None else f" at t = {t:.9g} s"
    if not np.isfinite(q).all() or (v is not None and not np.isfinite(v).all()):
        return DivergedError(f"the state{when} is not finite: q = {short(q)}; take a smaller step")
    where = f"q = {short(q)}" if v is None else f"q = {short(q)}, v = {short(v)}"
    advice = "correct it there, or take a smaller step if the motion ran away"
    error = DivergedError(f"{what} is not finite{when}, {where}: it returned {short(value)}; {advice}")
    error.returned = True
    return error


def short(value: Any) -> str:
    """Return a value in at most 120 characters."""
    if isinstance(value, np.generic):
        value = value.item()
    text = np.array2string(value, threshold=8, separator=", ") if isinstance(value, np.ndarray) else repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 120 else f"{text[:117]}..."
