"""Adapters to other physics engines; each engine is optional and runs in a process of its own."""

from __future__ import annotations

import subprocess
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

# Debian's packages are built for its own Python and NumPy
SYSTEM = "/usr/bin/python3"


class Peer(NamedTuple):
    """Another engine: name, adapter module, imported package, how to install it, and its Python if not this one.

    `piles` and `friction` are the modules that run piles and scenes with friction in it, if there are any.
    """

    name: str
    module: str
    imported: str
    install: str
    python: str = ""
    piles: str = ""
    friction: str = ""

    @property
    def installed(self) -> bool:
        """Whether it can be imported here."""
        return _found(self.python, self.imported) if self.python else find_spec(self.imported) is not None


@lru_cache
def _found(python: str, name: str) -> bool:
    if not Path(python).exists():
        return False
    asked = f"import importlib.util as u, sys; sys.exit(u.find_spec({name!r}) is None)"
    return subprocess.run([python, "-I", "-c", asked], capture_output=True, check=False).returncode == 0


PEERS = (
    Peer("MuJoCo", "in_mujoco", "mujoco", 'pip install "mbvi[studies]"', "", "piles_in_mujoco", "friction_in_mujoco"),
    Peer("Drake", "in_drake", "pydrake", "pip install drake", piles="piles_in_drake", friction="friction_in_drake"),
    Peer("DART", "in_dart", "dartpy", "pip install dartpy"),
    Peer(
        "PyBullet", "in_pybullet", "pybullet", "pip install pybullet", "", "piles_in_pybullet", "friction_in_pybullet"
    ),
    Peer("jiminy", "in_jiminy", "jiminy_py", "pip install jiminy-py"),
    Peer("Siconos", "in_siconos", "siconos", f"apt install python3-siconos, for {SYSTEM}, which runs it", SYSTEM),
)
