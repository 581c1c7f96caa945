"""Kernels: loops that numba compiles, and the cache that keeps them."""

from .kernel import KERNELS, Kernel, kernel, load, plain_array

__all__ = ["KERNELS", "Kernel", "kernel", "load", "plain_array"]
