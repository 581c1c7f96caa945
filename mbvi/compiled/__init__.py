"""Kernels: functions on arrays that numba compiles at their first call, and the cache that keeps them."""

from .addresses import address, call_address, record_at
from .folder import cache_folder
from .kernels import (
    KERNELS,
    Kernel,
    all_kernels,
    calling_others,
    compile_all,
    held,
    kernel,
    plain_array,
    record,
    seconds_compiling,
)

__all__ = [
    "KERNELS",
    "Kernel",
    "address",
    "all_kernels",
    "cache_folder",
    "call_address",
    "calling_others",
    "compile_all",
    "held",
    "kernel",
    "plain_array",
    "record",
    "record_at",
    "seconds_compiling",
]
