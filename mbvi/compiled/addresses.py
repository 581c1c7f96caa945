"""Calls of C functions by their addresses, from kernels and from Python."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

_KINDS: dict[type, Any] = {np.int32: ctypes.c_int, float: ctypes.c_double, np.float64: ctypes.c_double}


# numpy's C interface has the address of the data as the first field behind the head of an array's object; reading it
# there takes a ninth of the time of `__array_interface__`
_HEAD = object.__basicsize__


def address(array: np.ndarray) -> int:
    """Return the address of an array's first number."""
    return ctypes.c_size_t.from_address(id(array) + _HEAD).value


class AddressCall:
    """Calls the C function at an address with integer arguments; its result is ignored.

    In kernels it compiles to a plain call. The address is an argument at run time, so that kernels that call it can be
    kept on disk.
    """

    def __call__(self, function: int, *arguments: int | float | np.int32) -> None:
        """Call the function; int32 stands for a C int, float for a double, others for 64-bit integers or pointers."""
        kinds: list[Any] = [_KINDS.get(type(a), ctypes.c_int64) for a in arguments]
        given = (float(a) if kind is ctypes.c_double else int(a) for kind, a in zip(kinds, arguments, strict=True))
        ctypes.CFUNCTYPE(None, *kinds)(int(function))(*given)

    def callee(self) -> Any:
        """Return numba's form of it."""
        from llvmlite import ir
        from numba.core import cgutils, types
        from numba.extending import intrinsic

        def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
            arguments = cgutils.unpack_tuple(builder, values[1])
            kind = ir.FunctionType(ir.VoidType(), [each.type for each in arguments])
            builder.call(builder.inttoptr(values[0], kind.as_pointer()), arguments)
            return context.get_dummy_value()

        @intrinsic
        def call_address(typing: Any, function: Any, *arguments: Any) -> Any:
            return types.void(types.int64, types.StarArgTuple.from_types(arguments)), generate

        return call_address


call_address = AddressCall()
