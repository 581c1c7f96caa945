"""Runs as functions that JAX differentiates."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..errors import InputError
from ..problem import Problem
from ..schemes import EventDriven, Scheme
from .final_state import FinalState


def jax_rollout(
    problem: Problem | Callable[[Any], Problem],
    scheme: Scheme | EventDriven | None = None,
    *,
    duration: float,
    step: float | None = None,
    wrt: Iterable[str] = (),
) -> Callable[..., Any]:
    """Return the final state of a run as a function of its initial state, which JAX differentiates through impacts.

    Parameters
    ----------
    problem : Problem or callable
        The problem; with `wrt` problem(p) -> Problem, of a NumPy array p of the shape that calls give it.
    scheme, duration, step
        As `sensitivity`.
    wrt : sequence of str
        What p holds, by the names of `sensitivity`, in this order; an inertia takes six numbers. The problem must
        change with p as these names say, and in nothing else.

    Returns
    -------
    callable
        rollout(q, v), or with `wrt` rollout(q, v, p), -> (q, v) at the end. Shapes are (nq,) and (nv,), units those of
        `Problem.at`; p has any shape with one number for each column.

    Raises
    ------
    InputError
        On wrong types and numbers, or if JAX is not installed. Calls also raise what `Problem.at` and `simulate` do.
    SensitivityError
        By what differentiates a call: see `sensitivity`. Inside `jax.jit`, `jax.vmap` and `jax.jacrev` JAX raises an
        error of its own, whose text has that of this one.

    Notes
    -----
    A derivative is one pass back of `gradient`, beside another run. That by q is by the numbers in q, of unit
    quaternions without the part that would change their length. JAX computes in single precision unless
    `jax.config.update("jax_enable_x64", True)` is called. Second derivatives are not known.
    """
    final = FinalState(problem, scheme, duration, step, wrt)
    try:
        import jax
        import jax.numpy as jnp
    except ImportError as error:
        raise InputError("jax_rollout needs JAX: pip install 'mbvi[jax]'") from error

    def called(values: Callable[..., Any], like: tuple[Any, ...], *given: Any) -> Any:
        """Call a function of numpy arrays, whose results have given shapes."""

        def of_arrays(*given: Any) -> Any:
            found = values(*(np.asarray(one, dtype=np.float64) for one in given))
            return tuple(np.asarray(one, dtype=kind.dtype) for one, kind in zip(found, like, strict=True))

        if any(isinstance(one, jax.core.Tracer) for one in given):
            return jax.pure_callback(of_arrays, like, *given, vmap_method="sequential")
        # errors keep their types here
        return tuple(map(jnp.asarray, of_arrays(*given)))

    def shapes(*given: Any) -> tuple[Any, ...]:
        return tuple(jax.ShapeDtypeStruct(one.shape, one.dtype) for one in given)

    @jax.custom_vjp
    def end(q: Any, v: Any, p: Any) -> Any:
        return called(final.run, shapes(q, v), q, v, p)

    def forward(q: Any, v: Any, p: Any) -> Any:
        return end(q, v, p), (q, v, p)

    def backward(start: Any, slopes: Any) -> Any:
        return called(final.back, shapes(*start), *start, *slopes)

    end.defvjp(forward, backward)

    def rollout(q: Any, v: Any, p: Any = ()) -> Any:
        return end(*(jnp.asarray(one, dtype=float) for one in (q, v, p)))

    return rollout
