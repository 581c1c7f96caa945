"""Build the wheel of mbvi for this Python, with machine code of the kernels that Python calls.

    python tools/wheel.py [FOLDER]    # into dist/

The machine code is for any processor of the platform. It is compiled into NUMBA_CACHE_DIR, by default out/kernels, by a
process for each core; what is there already is taken from there. Needs mbvi and hatchling in the environment.
"""

from __future__ import annotations

import dis
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import CodeType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
_GLOBALS, _ATTRIBUTES = {"LOAD_GLOBAL", "LOAD_NAME"}, {"LOAD_ATTR", "LOAD_METHOD"}


def main() -> None:
    """Compile the kernels, and build the wheel."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "dist").resolve()
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    environment = {"NUMBA_CACHE_DIR": str(ROOT / "out/kernels"), **os.environ}
    environment |= {"PYTHONPATH": paths, "NUMBA_CPU_NAME": "generic"}
    processes = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as code:
        shares = [[sys.executable, __file__, code, str(k), str(processes)] for k in range(processes)]
        started = [subprocess.Popen(share, env=environment) for share in shares]
        # all are waited for, also where one failed
        if any([process.wait() for process in started]):
            sys.exit("the kernels could not be compiled")
        build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", folder]
        subprocess.run(build, cwd=ROOT, env={**environment, "MBVI_MACHINE_CODE": code}, check=True)


def carry(folder: Path, process: int, processes: int) -> None:
    """Compile the kernels, and write a share of the machine code to a folder."""
    kernels = called_kernels()
    first = process * len(kernels) // processes
    # each process begins with its share, and loads what the others have compiled by then
    for item in (*kernels[first:], *kernels[:first]):
        item.compiled()
    for item in kernels[process::processes]:
        item.carry(folder)


def called_kernels() -> list:
    """Return the kernels that other code of mbvi than kernels names, those that no kernel calls, and those apart."""
    from mbvi.compiled import all_kernels
    from mbvi.run.loop.step_loop import LOOPS

    kernels = all_kernels()
    modules = {getattr(one, "__file__", None): vars(one) for one in list(sys.modules.values())}
    own = {(item.loops.__code__.co_filename, item.loops.__code__.co_firstlineno) for item in kernels}
    named: set[int] = set()
    for file in {item.loops.__code__.co_filename for item in kernels}.union(map(str, (ROOT / "mbvi").rglob("*.py"))):
        for code in _codes(compile(Path(file).read_text(), file, "exec"), own):
            named.update(_named_in(code, modules.get(file), kernels))
    below = {id(other) for item in kernels for other in item.callees().values()}
    called = [item for item in kernels if id(item) in named or id(item) not in below or item.apart]
    # a scheme names its step to choose the loop that has it inside
    return [item for item in called if item not in LOOPS]


def _named_in(code: CodeType, module: dict[str, Any] | None, kernels: list) -> Iterator[int]:
    """Yield the kernels that a code may name; `module` has the globals of its module, None if it is not imported.

    Functions of Python may have the name of a kernel. Of attributes it is not known what they are.
    """
    names, found = set(), set()
    for each in dis.get_instructions(code):
        if each.opname in _GLOBALS and module is not None:
            found.add(id(module.get(each.argval)))
        elif each.opname in _GLOBALS | _ATTRIBUTES:
            names.add(each.argval)
    for item in kernels:
        if id(item) in found or item.__name__ in names:
            yield id(item)


def _codes(code: CodeType, without: set[tuple[str, int]]) -> Iterator[CodeType]:
    """Yield a code and those inside it, but not the kernels."""
    if (code.co_filename, code.co_firstlineno) not in without or code.co_name == "<module>":
        yield code
        for inner in code.co_consts:
            if isinstance(inner, CodeType):
                yield from _codes(inner, without)


if __name__ == "__main__":
    if len(sys.argv) == 4:
        carry(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
    else:
        main()
