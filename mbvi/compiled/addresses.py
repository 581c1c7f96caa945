"""Calls of C functions and uses of records by their addresses, from kernels and from Python."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any
from weakref import WeakValueDictionary, finalize

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


class RecordAt:
    """Returns the record at an address, of the kind of another one: an array may hold the addresses of several."""

    def __init__(self) -> None:
        # records that Python knows, by their addresses
        self._known: WeakValueDictionary[int, Any] = WeakValueDictionary()

    def __call__(self, like: Any, where: int) -> Any:
        """Return the record, where Python runs the kernel."""
        return self._known[int(where)]

    def addresses(self, records: Sequence[Any]) -> np.ndarray:
        """Return the addresses of held records, 0 of None; these stay alive as long as the array."""
        found = np.zeros(len(records), np.int64)
        for k, each in enumerate(records):
            if each is not None:
                found[k], self._known[each.memory_address] = each.memory_address, each
        finalize(found, len, records).atexit = False
        return found

    def callee(self) -> Any:
        """Return numba's form of it."""
        from numba.core import types
        from numba.extending import intrinsic

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[1], context.get_value_type(signature.return_type))

        @intrinsic
        def record_at(typing: Any, like: Any, where: Any) -> Any:
            return like(like, types.int64), generate

        return record_at


call_address, record_at = AddressCall(), RecordAt()
