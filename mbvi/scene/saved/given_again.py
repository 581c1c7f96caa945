"""Functions of a scene that a file could not keep: their placeholders, and functions that a user gives again."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...arguments import Array, function, shown
from ...errors import InputError
from ...system.actuators import Actuators
from ..items import Force, SceneControl, SceneItems
from ..state import State

Control = Callable[[float, Array, Array], Array]
Controls = Mapping[str, Control] | SceneControl | Sequence[Mapping[str, Control] | SceneControl]


@dataclass(frozen=True)
class LostControl:
    """Placeholder of a control that a file could not keep: zero torque, with the source text of the function."""

    source: str

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return no torque."""
        return np.zeros(len(v))


@dataclass(frozen=True)
class LostSceneControl:
    """Placeholder of a control of the whole scene; see `LostControl`."""

    source: str

    def __call__(self, state: State) -> None:
        """Return no torques."""


@dataclass(frozen=True)
class LostInputs:
    """Placeholder of a function of actuators' inputs; see `LostControl`."""

    source: str
    count: int

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return inputs of zero."""
        return np.zeros(self.count)


@dataclass(frozen=True)
class LostForce:
    """Placeholder of an external force; see `LostControl`. A force on a link receives its robot's q and v."""

    source: str
    on_link: bool

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return no force and no moment."""
        return np.zeros(6 if self.on_link else v.shape)


LOST = (LostControl, LostInputs, LostSceneControl, LostForce)


@dataclass
class GivenAgain:
    """Functions that a user gives in place of those that a file could not keep.

    Attributes
    ----------
    robots : dict of str to callable
        Controls of single robots and of hinges.
    scene : list of callable
        Controls of the whole scene, all of them or none.
    forces : dict of str to list of callable
        Forces by the name of what they act on, all of these or none.
    """

    robots: dict[str, Control] = field(default_factory=dict)
    scene: list[SceneControl] = field(default_factory=list)
    forces: dict[str, list[Force]] = field(default_factory=dict)


def functions_to_give(items: SceneItems) -> list[str]:
    """Return the arguments of `load` for the functions of a scene, "..." in the place of each."""
    named = [one.robot.name for one in items.robots if one.control and not isinstance(one.control, Actuators)]
    named += [one.name for one in items.connections if one.control is not None]
    controls = ["{" + ", ".join(f"{name!r}: ..." for name in named) + "}"] if named else []
    controls += ["..."] * len(items.controls)
    each = [force.body for force in items.forces]
    forces = [f"{name!r}: " + ("..." if each.count(name) == 1 else "[...]") for name in dict.fromkeys(each)]
    found = [f"control={controls[0] if len(controls) == 1 else '[' + ', '.join(controls) + ']'}"] if controls else []
    return [*found, "force={" + ", ".join(forces) + "}"] if forces else found


def given_again(
    control: Controls | None,
    force: Mapping[str, Force | Sequence[Force]] | None,
    scene: str,
    path: str,
) -> GivenAgain:
    """Return the functions that a user gives, sorted into the placeholders of a file.

    Parameters
    ----------
    control, force
        See `load`.
    scene : str
        What `describe` wrote.
    path : str
        Where, for errors.

    Raises
    ------
    InputError
        If the file has no place for one of them, or they are not as many as it lost, or one is no function.
    """
    data, found = json.loads(scene), GivenAgain()
    owners = [*data.get("robots", ()), *data.get("connections", ())]
    robots = [one["name"] for one in owners if one.get("control") is not None]
    for one in control if isinstance(control, list | tuple) else () if control is None else (control,):
        if not isinstance(one, Mapping):
            found.scene.append(function(one, "control", "control(state) -> {robot: tau}"))
            continue
        for name, law in one.items():
            if name not in robots:
                known = ", ".join(map(repr, robots)) or "none"
                raise InputError(f"control names {shown(name)}; what had a control in {path} is: {known}")
            found.robots[name] = function(law, f"the control of {name!r}", "control(t, q, v) -> tau")
    many = len(data.get("controls", ()))
    if found.scene and len(found.scene) != many:
        raise InputError(
            f"control gives {len(found.scene)} functions control(state) of the scene; {path} had {many} of them. Give "
            "them in their order; the controls of single robots are given by their names"
        )
    _check_forces(found, {} if force is None else force, [f["body"] for f in data.get("forces", ())], path)
    return found


def _check_forces(found: GivenAgain, force: Mapping[str, Any], bodies: list[str], path: str) -> None:
    if not isinstance(force, Mapping):
        raise InputError(f"force must be a dict of functions by the names of bodies; got {shown(force)}")
    for name, given in force.items():
        if name not in bodies:
            known = ", ".join(map(repr, dict.fromkeys(bodies))) or "none"
            raise InputError(f"force names {shown(name)}; what a force acted on in {path} is: {known}")
        functions = list(given) if isinstance(given, list | tuple) else [given]
        if len(functions) != bodies.count(name):
            raise InputError(f"force gives {len(functions)} functions for {name!r}; {path} had {bodies.count(name)}")
        found.forces[name] = [function(f, f"the force on {name!r}", "force(t, q, v) -> (6,)") for f in functions]
