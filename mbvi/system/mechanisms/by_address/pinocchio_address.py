"""Pinocchio's C++ functions called by their addresses, without the time of its Python bindings.

The wheels of Pinocchio export the functions that the bindings call. The addresses of the C++ model and data come from
Boost.Python's own converter, and results are read where the getters of `pin.Data` show them; see `memory`. Only the
header of an Eigen vector, {data, size}, is laid out here. `pinocchio_check` tests all this in a child process first.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from ....compiled import address, call_address, kernel
from .memory import Window

Array = np.ndarray

# mangled names of the functions in the order of their places
SYMBOLS = (
    # crba(model, data, q, convention)
    "_ZN9pinocchio4crbaIdLi0ENS_25JointCollectionDefaultTplEN5Eigen3RefIKNS2_6MatrixIdLin1ELi1ELi0ELin1ELi1EEELi0ENS2_"
    "11InnerStrideILi1EEEEEEERKNS_7DataTplIT_XT0_ET1_E8MatrixXsERKNS_8ModelTplISB_XT0_ESC_EERSD_RKNS2_10MatrixBaseIT2_"
    "EENS_10ConventionE",
    # nonLinearEffects(model, data, q, v)
    "_ZN9pinocchio4impl16nonLinearEffectsIdLi0ENS_25JointCollectionDefaultTplEN5Eigen3RefIKNS3_6MatrixIdLin1ELi1ELi0EL"
    "in1ELi1EEELi0ENS3_11InnerStrideILi1EEEEESA_EERKNS_7DataTplIT_XT0_ET1_E17TangentVectorTypeERKNS_8ModelTplISC_XT0_ES"
    "D_EERSE_RKNS3_10MatrixBaseIT2_EERKNSN_IT3_EE",
    # integrate(model, q, dv, new)
    "_ZN9pinocchio9integrateINS_11LieGroupMapEdLi0ENS_25JointCollectionDefaultTplEN5Eigen6MatrixIdLin1ELi1ELi0ELin1ELi"
    "1EEES5_S5_Li0EEEvRKNS_8ModelTplIT0_XT1_ET2_EERKNS3_10MatrixBaseIT3_EERKNSC_IT4_EERKNSC_IT5_EE",
    # difference(model, q0, q1, dv)
    "_ZN9pinocchio10differenceINS_11LieGroupMapEdLi0ENS_25JointCollectionDefaultTplEN5Eigen6MatrixIdLin1ELi1ELi0ELin1EL"
    "i1EEES5_S5_Li0EEEvRKNS_8ModelTplIT0_XT1_ET2_EERKNS3_10MatrixBaseIT3_EERKNSC_IT4_EERKNSC_IT5_EE",
)
MODEL = b"N9pinocchio8ModelTplIdLi0ENS_25JointCollectionDefaultTplEEE"
DATA = b"N9pinocchio7DataTplIdLi0ENS_25JointCollectionDefaultTplEEE"
# stems of the libraries' names
PINOCCHIO, BOOST = "pinocchio_default", f"boost_python{sys.version_info[0]}{sys.version_info[1]}"
REGISTRY_QUERY = "_ZN5boost6python9converter8registry5queryENS0_9type_infoE"
GET_LVALUE = "_ZN5boost6python9converter22get_lvalue_from_pythonEP7_objectRKNS1_12registrationE"

# places in an array of calls: functions, model and data, then of each argument its header, its numbers and its size
_CRBA, _NLE, _INTEGRATE, _DIFFERENCE = range(len(SYMBOLS))
_MODEL, _DATA = 4, 5
_HEADER, _START, _SIZE = 6, 9, 12
# the headers themselves, of which Eigen reads {data, rows, columns}, and then the numbers
_HEADERS, _HEADER_SIZE, _NUMBERS = 16, 8, 40
# arguments: configurations, and a tangent vector
_Q, _NEW, _V = range(3)
# Eigen reads up to eight doubles at once from where it expects them aligned
_ALIGNED = 8
# Convention.WORLD
_WORLD = np.int32(0)


@kernel("void(i8[::1], i8, Array(f8, 1, 'C', True))")
def _store(calls: Array, argument: int, values: Array) -> None:
    """Copy an array to an argument of Pinocchio's functions."""
    if len(values) != calls[_SIZE + argument]:
        raise ValueError("an array has another size than the model")
    numbers, start = calls.view(np.float64), calls[_START + argument]
    for k in range(len(values)):
        numbers[start + k] = values[k]


@kernel("void(i8[::1], i8, f8[::1])")
def _fetch(calls: Array, argument: int, values: Array) -> None:
    """Copy an argument of Pinocchio's functions to an array."""
    if len(values) != calls[_SIZE + argument]:
        raise ValueError("an array has another size than the model")
    numbers, start = calls.view(np.float64), calls[_START + argument]
    for k in range(len(values)):
        values[k] = numbers[start + k]


@kernel("void(i8[::1], Array(f8, 1, 'C', True))")
def crba(calls: Array, q: Array) -> None:
    """Compute poses, Jacobian columns and mass matrix at q, shape (nq,), where `results_in_place` shows them."""
    _store(calls, _Q, q)
    call_address(calls[_CRBA], calls[_MODEL], calls[_DATA], calls[_HEADER + _Q], _WORLD)


@kernel("void(i8[::1], Array(f8, 1, 'C', True), Array(f8, 1, 'C', True))")
def nonlinear_effects(calls: Array, q: Array, v: Array) -> None:
    """Compute the nonlinear effects at q and v, shapes (nq,), (nv,), where `results_in_place` shows them."""
    _store(calls, _Q, q)
    _store(calls, _V, v)
    call_address(calls[_NLE], calls[_MODEL], calls[_DATA], calls[_HEADER + _Q], calls[_HEADER + _V])


@kernel("void(i8[::1], Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[::1])")
def retract(calls: Array, q: Array, dv: Array, new: Array) -> None:
    """Write q + dv along the retraction to `new`, shapes (nq,), (nv,), (nq,)."""
    _store(calls, _Q, q)
    _store(calls, _V, dv)
    call_address(calls[_INTEGRATE], calls[_MODEL], calls[_HEADER + _Q], calls[_HEADER + _V], calls[_HEADER + _NEW])
    _fetch(calls, _NEW, new)


@kernel("void(i8[::1], Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[::1])")
def tangent(calls: Array, q0: Array, q1: Array, dv: Array) -> None:
    """Write the tangent vector from q0 to q1 to dv, shapes (nq,), (nq,), (nv,)."""
    _store(calls, _Q, q0)
    _store(calls, _NEW, q1)
    call_address(calls[_DIFFERENCE], calls[_MODEL], calls[_HEADER + _Q], calls[_HEADER + _NEW], calls[_HEADER + _V])
    _fetch(calls, _V, dv)


def array_of_calls(model: pin.Model, data: pin.Data) -> Array:
    """Return the array that the kernels of this module take first: addresses, and aligned arguments.

    Parameters
    ----------
    model, data : pinocchio.Model, pinocchio.Data
        Kept by the array, which is for one thread at a time.

    Raises
    ------
    OSError
        If a library is not loaded, a function is missing in it, or the objects are not of Pinocchio's C++ classes.
    """
    sizes = [model.nq, model.nq, model.nv]
    rooms = [-(-size // _ALIGNED) * _ALIGNED for size in sizes]
    starts = _NUMBERS + np.cumsum([0, *rooms[:-1]])
    calls = _aligned(_NUMBERS + sum(rooms))
    first = address(calls)
    calls[: len(SYMBOLS)] = function_addresses()
    calls[_MODEL], calls[_DATA] = _pointer(model, MODEL), _pointer(data, DATA)
    for k, (start, size) in enumerate(zip(starts.tolist(), sizes, strict=True)):
        header = _HEADERS + _HEADER_SIZE * k
        calls[_HEADER + k], calls[_START + k], calls[_SIZE + k] = first + 8 * header, start, size
        calls[header : header + 2] = first + 8 * start, size
    return np.asarray(Window((model, data, calls), first, calls.shape, "<i8"))


@cache
def function_addresses() -> tuple[int, ...]:
    """Return the addresses of Pinocchio's functions in the order of `SYMBOLS`."""
    library = loaded_library(PINOCCHIO)
    return tuple(_symbol(library, name) for name in SYMBOLS)


@cache
def loaded_library(stem: str) -> ctypes.CDLL:
    """Return a library of Pinocchio's that this process has loaded; a second copy would have a registry of its own."""
    for path in library_paths(stem):
        try:
            return ctypes.CDLL(str(path), mode=os.RTLD_NOLOAD | os.RTLD_NOW)
        except OSError:
            continue
    raise OSError(f"the library {stem} is not loaded")


def library_paths(stem: str) -> list[Path]:
    """Return the files that may be a library of Pinocchio's, the longest names first, which links lead to."""
    # the prefix of wheels: lib/python3.x/site-packages/pinocchio
    folder = Path(pin.__file__).parents[3]
    found = {path for suffix in (".so*", "*.dylib") for path in folder.glob(f"lib{stem}{suffix}")}
    return sorted(found, key=lambda path: (-len(path.name), path.name))


def _symbol(library: ctypes.CDLL, name: str) -> int:
    try:
        return ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
    except AttributeError:
        raise OSError(f"{name} is missing in {library._name}") from None


def _pointer(instance: object, name: bytes) -> int:
    """Return the address of the C++ object of a mangled type in an instance of Boost.Python."""
    query, lvalue = _lookups()
    registration = query(name)
    pointer = lvalue(instance, registration) if registration else None
    if not pointer:
        raise OSError(f"{type(instance).__name__} holds no {name.decode()}")
    return int(pointer)


@cache
def _lookups() -> tuple[Callable[[bytes], int | None], Callable[[object, int], int | None]]:
    """Return Boost.Python's functions that find a type by its name, and the address in an instance."""
    boost = loaded_library(BOOST)
    query = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_char_p)(_symbol(boost, REGISTRY_QUERY))
    lvalue = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)(_symbol(boost, GET_LVALUE))
    return query, lvalue


def _aligned(size: int) -> Array:
    """Return zeros, shape (size,) of int, that begin at a multiple of 64 bytes."""
    memory = np.zeros(size + _ALIGNED, np.int64)
    skipped = -address(memory) % (8 * _ALIGNED) // 8
    return memory[skipped : skipped + size]
