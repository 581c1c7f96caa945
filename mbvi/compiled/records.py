"""The type of records in kernels: their fields lie in memory, and kernels pass the address.

numba passes a tuple by its fields, and an array by nine numbers: a kernel that steps a robot would have thousands of
arguments, which take time at each call and most of the time to compile.
"""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from struct import Struct
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models, register_default
from numba.core.imputils import impl_ret_borrowed, lower_cast
from numba.core.pythonapi import NativeValue, unbox
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import lower_getattr_generic, typeof_impl
from numba.np.numpy_support import as_dtype

from .addresses import address


class RecordType(types.Type):
    """The type of a NamedTuple whose fields lie in memory.

    Attributes
    ----------
    kind : type
        The NamedTuple.
    types : tuple of numba's types
        Of its fields, which may be records.
    """

    def __init__(self, kind: Any, fields: tuple[Any, ...]) -> None:
        self.kind, self.types = kind, fields
        # types of equal names are one
        digest = sha256(str(fields).encode()).hexdigest()[:8]
        super().__init__(name=f"{kind.__module__}.{kind.__qualname__}.{digest}")

    @property
    def by_value(self) -> Any:
        """The type of the same record as numba has it."""
        return types.BaseTuple.from_types(self.types, self.kind)

    def can_convert_from(self, context: Any, other: Any) -> Any:
        """Take what a kernel makes by calling the class."""
        return Conversion.safe if other == self.by_value else None


_known: dict[Any, RecordType] = {}


def record_type(kind: Any, fields: tuple[Any, ...]) -> RecordType:
    """Return the type of a record; its values have this type in calls from Python from then on."""
    if kind not in _known or _known[kind].types != fields:
        _known[kind] = RecordType(kind, fields)
        typeof_impl.register(kind, _type_of)
    return _known[kind]


def _type_of(value: Any, context: Any) -> Any:
    """Return the type of a record only if each field has the type that kernels expect: they would misread another."""
    fields = tuple(typeof_impl(each, context) for each in value)
    known = _known[type(value)]
    return known if fields == known.types else types.BaseTuple.from_types(fields, type(value))


@register_default(RecordType)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager: Any, of: RecordType) -> None:
        fields = ir.LiteralStructType([manager.lookup(field).get_data_type() for field in of.types])
        super().__init__(manager, of, fields.as_pointer())


@infer_getattr
class _RecordFields(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, of: RecordType, name: str) -> Any:  # type: ignore[override]
        fields = of.kind._fields
        return of.types[fields.index(name)] if name in fields else None


@lower_getattr_generic(RecordType)
def _field(context: Any, builder: Any, of: RecordType, record: Any, name: str) -> Any:
    k = of.kind._fields.index(name)
    value = context.unpack_value(builder, of.types[k], cgutils.gep_inbounds(builder, record, 0, k))
    return impl_ret_borrowed(context, builder, of.types[k], value)


@lower_cast(types.NamedTuple, RecordType)
@lower_cast(types.NamedUniTuple, RecordType)
def _from_value(context: Any, builder: Any, given: Any, of: RecordType, record: Any) -> Any:
    """Write a record that a kernel has made to memory of this kernel."""
    room = cgutils.alloca_once(builder, context.get_value_type(of).pointee)
    for k, field in enumerate(of.types):
        value = builder.extract_value(record, k)
        context.pack_value(builder, field, value, cgutils.gep_inbounds(builder, room, 0, k))
    return room


# entries for Python are compiled with code for each field of a record; those of longer ones are written by Python
_MOST_FIELDS = 30


@unbox(RecordType)
def _from_python(of: RecordType, record: Any, c: Any) -> Any:
    """Take the address of a `Held` record, or write one that Python gives to memory that lasts until the call ends."""
    pointer = c.context.get_value_type(of)
    place = cgutils.alloca_once(c.builder, pointer)
    failed, cleanups = cgutils.alloca_once_value(c.builder, cgutils.false_bit), list[Any]()
    address = c.pyapi.object_getattr_string(record, "memory_address")
    with c.builder.if_else(cgutils.is_null(c.builder, address)) as (given, held):
        with held:
            c.builder.store(c.builder.inttoptr(c.pyapi.long_as_longlong(address), pointer), place)
            c.pyapi.decref(address)
        with given:
            c.pyapi.err_clear()
            write = _write_held if _number_of_fields(of) > _MOST_FIELDS else _write_fields
            write(of, record, c, place, failed, cleanups)

    def cleanup() -> None:
        for each in reversed(cleanups):
            each()

    return NativeValue(c.builder.load(place), is_error=c.builder.load(failed), cleanup=cleanup if cleanups else None)


def _write_fields(of: RecordType, record: Any, c: Any, place: Any, failed: Any, cleanups: list[Any]) -> None:
    """Generate code that reads each field, and store the address of the record that it writes."""
    room = cgutils.alloca_once(c.builder, c.context.get_value_type(of).pointee)
    for k, field in enumerate(of.types):
        native = c.unbox(field, c.pyapi.tuple_getitem(record, k))
        with c.builder.if_then(native.is_error, likely=False):
            c.builder.store(cgutils.true_bit, failed)
        c.context.pack_value(c.builder, field, native.value, cgutils.gep_inbounds(c.builder, room, 0, k))
        if native.cleanup is not None:
            cleanups.append(native.cleanup)
    c.builder.store(room, place)


def _write_held(of: RecordType, record: Any, c: Any, place: Any, failed: Any, cleanups: list[Any]) -> None:
    """Generate a call of `hold`, and store the address of what it returns, which is kept until the call ends."""
    module = c.pyapi.import_module(c.context.insert_const_string(c.builder.module, __name__))
    function = c.pyapi.object_getattr_string(module, hold.__name__)
    made = c.pyapi.call_function_objargs(function, [record])
    c.pyapi.decref(function)
    c.pyapi.decref(module)
    # null where the record is held already
    kept = cgutils.alloca_once(c.builder, c.pyapi.pyobj)
    with c.builder.if_else(cgutils.is_null(c.builder, made)) as (error, held):
        with error:
            c.builder.store(cgutils.true_bit, failed)
        with held:
            address = c.pyapi.object_getattr_string(made, "memory_address")
            pointer = c.context.get_value_type(of)
            c.builder.store(c.builder.inttoptr(c.pyapi.long_as_longlong(address), pointer), place)
            c.builder.store(made, kept)
            c.pyapi.decref(address)
    cleanups.append(lambda: c.pyapi.decref(c.builder.load(kept)))


def _number_of_fields(of: Any) -> int:
    if isinstance(of, RecordType | types.BaseTuple):
        inner: Any = of.types if isinstance(of, RecordType) else of
        return sum(_number_of_fields(each) for each in inner)
    return 1


class Held:
    """A record in memory of its own: a kernel takes its address, and does not read all its fields at each call.

    Parameters
    ----------
    record : NamedTuple
        The record. Kernels write to its arrays; other fields keep their values.
    of : RecordType
        Its type.
    """

    __slots__ = ("__weakref__", "_memory", "_numba_type_", "_values", "memory_address")

    def __init__(self, record: Any, of: RecordType) -> None:
        self._numba_type_, self._values = of, record
        self._memory: Any = np.zeros(_layout(of)[0].size, np.uint8)
        self.memory_address: int = address(self._memory)
        self._write()

    def __getattr__(self, name: str) -> Any:
        # where Python runs the kernels
        return getattr(self._values, name)

    def __reduce__(self) -> Any:
        # a copy would have the address of this record's memory
        raise TypeError("a held record is not copied: what has it constructs it again")

    def replace(self, **arrays: Any) -> None:
        """Replace some arrays by others."""
        self._values = self._values._replace(**arrays)
        self._write()

    def _write(self) -> None:
        """Write all fields to the memory; records within are held on their own."""
        layout, kinds, records = _layout(self._numba_type_)
        fields = list(self._values)
        for k in records:
            if type(fields[k]) is not Held:
                fields[k] = Held(fields[k], self._numba_type_.types[k])
        self._values = self._numba_type_.kind(*fields)
        numbers: list[Any] = []
        for value, kind in zip(fields, kinds, strict=True):
            _append(value, kind, numbers)
        layout.pack_into(self._memory, 0, *numbers)


def hold(record: Any) -> Held:
    """Return a record that kernels were given in memory of its own."""
    return Held(record, _known[type(record)])


def _append(value: Any, kind: Any, numbers: list[Any]) -> None:
    """Append a field as numba has it: an array is two pointers that stay null, five numbers and those of each axis."""
    if kind is None:
        numbers.append(value.memory_address if type(value) is Held else value)
    elif type(kind) is list:
        for each, its_kind in zip(value, kind, strict=True):
            _append(each, its_kind, numbers)
    else:
        ndim, dtype, writes = kind
        flags = value.flags
        if value.ndim != ndim or value.dtype != dtype or not flags.c_contiguous or writes > flags.writeable:
            raise TypeError(
                f"a record has an array of {value.dtype} with {value.ndim} axes, or one with gaps or read-only; "
                f"kernels take {dtype} with {ndim}, contiguous"
            )
        numbers += 0, 0, value.size, value.itemsize, address(value), *value.shape, *value.strides


@cache
def _layout(of: RecordType) -> tuple[Struct, list[Any], list[int]]:
    """Return the layout of a record, of each field what `_append` takes, and which fields are records.

    `_append` takes None of a number or a record.
    """
    letters, kinds = zip(*(_field_layout(kind) for kind in of.types), strict=True)
    records = [k for k, kind in enumerate(of.types) if isinstance(kind, RecordType)]
    return Struct("@" + "".join(letters)), list(kinds), records


def _field_layout(kind: Any) -> tuple[str, Any]:
    if isinstance(kind, types.BaseTuple):
        inner: Any = kind
        letters, kinds = zip(*(_field_layout(each) for each in inner), strict=True)
        return "".join(letters), list(kinds)
    if isinstance(kind, types.Array):
        return "q" * (5 + 2 * kind.ndim), (kind.ndim, as_dtype(kind.dtype), kind.mutable)
    return ("q" if isinstance(kind, RecordType) else _LETTERS[kind]), None


_LETTERS = {types.float64: "d", types.int64: "q", types.boolean: "?"}
