"""Runs as functions that PyTorch differentiates."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..errors import InputError
from ..problem import Problem
from ..schemes import EventDriven, Scheme
from .final_state import FinalState


def torch_rollout(
    problem: Problem | Callable[[Any], Problem],
    scheme: Scheme | EventDriven | None = None,
    *,
    duration: float,
    step: float | None = None,
    wrt: Iterable[str] = (),
) -> Callable[..., Any]:
    """Return the final state of a run as a function of tensors, which PyTorch differentiates through impacts.

    Parameters
    ----------
    problem, scheme, duration, step, wrt
        As `jax_rollout`.

    Returns
    -------
    callable
        rollout(q, v), or with `wrt` rollout(q, v, p), -> (q, v) at the end, tensors of the kinds and on the devices of
        q and v, shapes (nq,) and (nv,).

    Raises
    ------
    InputError
        As `jax_rollout`, or if PyTorch is not installed.
    SensitivityError
        By what goes back over a call: see `sensitivity`.

    Notes
    -----
    As `jax_rollout`. Runs are computed in double precision on the CPU.
    """
    final = FinalState(problem, scheme, duration, step, wrt)
    try:
        import torch
    except ImportError as error:
        raise InputError("torch_rollout needs PyTorch: pip install 'mbvi[torch]'") from error

    def arrays(*given: Any) -> list[Any]:
        return [np.asarray(one.detach().to("cpu", torch.float64)) for one in given]

    def tensors(found: Any, like: Any) -> tuple[Any, ...]:
        return tuple(torch.as_tensor(one).to(kind) for one, kind in zip(found, like, strict=True))

    class End(torch.autograd.Function):
        @staticmethod
        def forward(context: Any, q: Any, v: Any, p: Any) -> Any:
            context.save_for_backward(q, v, p)
            return tensors(final.run(*arrays(q, v, p)), (q, v))

        @staticmethod
        @torch.autograd.function.once_differentiable
        def backward(context: Any, *slopes: Any) -> Any:
            start = context.saved_tensors
            return tensors(final.back(*arrays(*start, *slopes)), start)

    def rollout(q: Any, v: Any, p: Any = ()) -> Any:
        given = (one if torch.is_tensor(one) else torch.tensor(np.array(one, dtype=np.float64)) for one in (q, v, p))
        return End.apply(*given)

    return rollout
