"""Arguments of the kernels that call Pinocchio by address, and what Pinocchio computed for them."""

import numpy as np
import pinocchio as pin

from mbvi.system.mechanisms.by_address import pinocchio_address
from mbvi.system.mechanisms.joint_tree import joint_tree
from mbvi.system.mechanisms.mechanism import mechanism
from support.robot_arguments import moving_robot

# by the address of their array of calls
_RECORDS = {}


def _moving(rng):
    """The array of calls of a robot with new data, and random arguments."""
    system, q, v = moving_robot(rng)
    model = system.model
    record = mechanism(
        model,
        model.createData(),
        system.evaluation.support,
        joint_tree(pin.Model(), system.evaluation.parent),
        system._free,
    )
    _RECORDS[record.calls.ctypes.data] = record
    # arrays that are only read may be read-only
    q = np.array(q)
    q.setflags(write=bool(rng.integers(2)))
    return model, record.calls, q, v


def _store(rng):
    _, calls, q, v = _moving(rng)
    return (calls, pinocchio_address._Q, q) if rng.random() < 0.5 else (calls, pinocchio_address._V, v)


def _fetch(rng):
    _, calls, q, _ = _moving(rng)
    calls[pinocchio_address._NUMBERS :] = rng.normal(size=len(calls) - pinocchio_address._NUMBERS).view(np.int64)
    return calls, pinocchio_address._NEW, np.full(len(q), np.nan)


def _tangent(rng):
    model, calls, q, v = _moving(rng)
    return calls, q, pin.integrate(model, q, v), np.full(model.nv, np.nan)


def _taking(*others):
    def arguments(rng):
        model, calls, q, v = _moving(rng)
        return calls, q, *(other(model, v, rng) for other in others)

    return arguments


def _v(model, v, rng):
    return v


ADDRESS_ARGUMENTS = {
    "_store": _store,
    "_fetch": _fetch,
    "crba": _taking(),
    "nonlinear_effects": _taking(_v),
    "retract": _taking(_v, lambda model, v, rng: np.full(model.nq, np.nan)),
    "tangent": _tangent,
}


def results_by_address(name, arguments):
    """The arguments after the call, and the results in the memory of the data."""
    calls, *others = arguments
    record = _RECORDS[calls.ctypes.data]
    results = {
        "_store": [calls[pinocchio_address._NUMBERS :]],
        "crba": [record.poses, record.columns, np.tril(record.mass)],
        "nonlinear_effects": [record.effects],
    }
    return [*others, *results.get(name, ())]
