"""Other engines on the same problems, each in a process of its own; none is needed by mbvi."""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple


class Peer(NamedTuple):
    """Another engine: its name, our module for it, the package that brings it."""

    name: str
    module: str
    imported: str
    install: str

    @property
    def installed(self) -> bool:
        """Whether it can be imported here."""
        return find_spec(self.imported) is not None


PEERS = (
    Peer("MuJoCo", "in_mujoco", "mujoco", "pip install mujoco"),
    Peer("Drake", "in_drake", "pydrake", "pip install drake"),
    Peer("DART", "in_dart", "dartpy", "pip install dartpy"),
    Peer("PyBullet", "in_pybullet", "pybullet", "pip install pybullet"),
    Peer("jiminy", "in_jiminy", "jiminy_py", "pip install jiminy-py"),
)
