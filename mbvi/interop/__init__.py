"""Runs as differentiable functions of JAX and PyTorch, which are imported where such a function is made."""

from .with_jax import jax_rollout
from .with_torch import torch_rollout

__all__ = ["jax_rollout", "torch_rollout"]
