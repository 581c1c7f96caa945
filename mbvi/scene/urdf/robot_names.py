"""Finds robots by their names: those that mbvi ships, and of robot_descriptions those in its cache."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...arguments import file_path, shown
from ...errors import InputError
from .shipped import robot, shipped_robots

_PREFIX = "robot:"
_PACKAGE = "robot_descriptions"


def description_file(path: str | os.PathLike[str], kind: str) -> Path:
    """Return the path of a robot description.

    Parameters
    ----------
    path : path
        A file, or "robot:" and a name: of a robot that mbvi ships, such as "robot:hopper", or of robot_descriptions,
        such as "robot:go2_description"; nothing is downloaded.
    kind : "URDF" or "MJCF"
        What the description must be.

    Raises
    ------
    InputError
        If the package is not installed, has no such robot or no such format of it, or its cache lacks it.
    """
    file = file_path(path)
    if not str(file).startswith(_PREFIX):
        return file
    name = str(file).removeprefix(_PREFIX)
    if name in shipped_robots():
        if kind != "URDF":
            raise InputError(f"{name} is URDF, not {kind}: use add_urdf")
        return robot(name)
    module = _description(name)
    found: str | None = getattr(module, f"{kind}_PATH", None)
    if found is None:
        known = [word for word in ("URDF", "MJCF", "XACRO") if hasattr(module, f"{word}_PATH")]
        hint = {"URDF": ": use add_urdf", "MJCF": ": use add_mjcf", "XACRO": ": convert it to URDF"}
        raise InputError(f"{name} is {' and '.join(known)}, not {kind}" + hint.get("".join(known), ""))
    return Path(found)


def format_of(path: str | os.PathLike[str]) -> str:
    """Return "MJCF" if a name "robot:..." has no URDF and a MJCF, else "URDF"."""
    name = str(path).removeprefix(_PREFIX)
    if name in shipped_robots():
        return "URDF"
    module = _description(name)
    return "MJCF" if hasattr(module, "MJCF_PATH") and not hasattr(module, "URDF_PATH") else "URDF"


def is_robot_name(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is the name of a robot, "robot:..."."""
    return str(path).startswith(_PREFIX)


def _description(name: str) -> Any:
    """Return the module of a description whose repositories are in the cache."""
    try:
        known = importlib.import_module(f"{_PACKAGE}._descriptions").DESCRIPTIONS
        repositories = importlib.import_module(f"{_PACKAGE}._repositories").REPOSITORIES
    except ImportError as error:
        known_here = ", ".join(sorted(shipped_robots()))
        said = f"mbvi ships {known_here}; other robots are found in robot_descriptions: pip install 'mbvi[robots]'"
        raise InputError(said) from error
    if name not in known:
        near = [other for other in known if name.removesuffix("_description") in other][:5]
        more = f"; similar are {', '.join(near)}" if near and name else ""
        raise InputError(f"robot_descriptions has no {shown(name)}{more}")
    # importing a description downloads what the cache lacks
    for repository in _repositories(name):
        _check_cache(name, repositories[repository])
    return importlib.import_module(f"{_PACKAGE}.{name}")


def _repositories(name: str) -> Iterator[str]:
    """Yield the repositories that a description's module asks the cache for."""
    spec = importlib.util.find_spec(f"{_PACKAGE}.{name}")
    assert spec is not None and spec.origin is not None
    for node in ast.walk(ast.parse(Path(spec.origin).read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "_clone_to_cache":
            (first, *_) = node.args
            assert isinstance(first, ast.Constant)
            yield str(first.value)


def _check_cache(name: str, repository: Any) -> None:
    """Raise unless the cache has a repository at the revision that the package wants."""
    folder = Path(os.path.expanduser(os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")))
    commit = os.environ.get("ROBOT_DESCRIPTION_COMMIT")
    within = repository.cache_path if commit is None else f"{repository.cache_path}-{commit}/{repository.cache_path}"
    fill = f"fill the cache by `python -m robot_descriptions pull {name}`"
    if not (folder / within).is_dir():
        raise InputError(f"{name} is not in the cache of robot_descriptions, {folder}: {fill}")
    git = importlib.import_module("git")
    wanted = repository.commit if commit is None else commit
    try:
        local = git.Repo(folder / within)
        same = wanted is None or local.git.rev_parse(wanted).strip() == local.git.rev_parse("HEAD").strip()
    except (git.InvalidGitRepositoryError, git.NoSuchPathError, git.GitCommandError):
        same = False
    if not same:
        raise InputError(f"the cache of robot_descriptions, {folder}, has another version of {name}: {fill}")
