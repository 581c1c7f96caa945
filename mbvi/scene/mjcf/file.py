"""Reads a MJCF file by MuJoCo's own parser and compiler, where MuJoCo is installed."""

from __future__ import annotations

import importlib
import logging
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import InputError, MjcfError
from ...geometry.shapes.shapes import Array
from ..urdf.checks import read_xml

_logger = logging.getLogger(__name__)


def mujoco_module() -> Any:
    """Return MuJoCo's module, or raise `InputError` where it is not installed."""
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise InputError("MJCF is read by MuJoCo, which is not installed: pip install 'mbvi[mjcf]'") from error


def disabled(m: Any, *flags: str) -> bool:
    """Return whether an MjModel disables one of some flags, named as in mjtDisableBit: "CONTACT"."""
    bits = mujoco_module().mjtDisableBit
    return any(m.opt.disableflags & int(getattr(bits, f"mjDSBL_{flag}")) for flag in flags)


def gravity_of(m: Any) -> Array:
    """Return the gravity that acts in an MjModel, in its frame, shape (3,) [m/s^2]."""
    return np.zeros(3) if disabled(m, "GRAVITY") else np.array(m.opt.gravity)


def compiled_model(file: Path) -> tuple[Any, str]:
    """Return the MjModel of a MJCF, and the MJCF as MuJoCo writes it, without includes and default values.

    Raises
    ------
    MjcfError
        If there is no such file, it is no MJCF, or MuJoCo refuses it.
    """
    _, root = read_xml(file, MjcfError)
    if root.tag == "robot":
        raise MjcfError(f"{file} is a URDF: use add_urdf")
    if root.tag != "mujoco":
        raise MjcfError(f"{file} is no MJCF: its root element is <{root.tag}>, not <mujoco>")
    mujoco = mujoco_module()
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(file))
            model, text = spec.compile(), spec.to_xml()
    except (ValueError, RuntimeError, TypeError, mujoco.FatalError) as error:
        raise MjcfError(f"{file}: MuJoCo refuses it: {' '.join(str(error).split())}") from error
    for warning in said:
        _logger.info("%s: MuJoCo warns: %s", file, " ".join(str(warning.message).split()))
    return model, text


def mjcf_name(file: Path) -> str:
    """Return the name that a MJCF gives its model, or else that of the file."""
    _, root = read_xml(file, MjcfError)
    return root.get("model") or file.stem


def placement(position: Array, quaternion: Array) -> pin.SE3:
    """Return a pose from MuJoCo's position and quaternion (w, x, y, z)."""
    w, x, y, z = np.asarray(quaternion, dtype=float).tolist()
    turn = pin.Quaternion(w, x, y, z).normalized()
    return pin.SE3(turn.toRotationMatrix(), np.asarray(position, dtype=float))
