"""Faults of studies, one case a seed: damaged files of their folders, and runs that end their worker processes."""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import signal
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import mbvi
from support import sweep_functions as functions

OPTIONS = {"scheme": mbvi.Paoli(), "step": 2e-3, "duration": 0.1}
POINTS = {"height": [0.1, 0.2, 0.3], "e": [0.0, 0.5]}
# what becomes of runs of `sweep_functions.troubled`
ENDS = {"fine": "ok", "exits": "killed", "segfaults": "killed", "kills": "killed", "raises": "failed"}


@functools.cache
def _client() -> Any:
    import distributed

    return distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0")


def _study(folder: Path) -> Any:
    return mbvi.sweep(functions.drop, POINTS, measure=functions.bounces, out=folder, client=_client(), **OPTIONS)


@functools.cache
def _finished() -> tuple[Path, Any]:
    folder = Path(tempfile.mkdtemp(prefix="mbvi-study-")) / "study"
    return folder, _study(folder).drop_vars(["cpu", "host"])


def studies(seed: int) -> str:
    """Damage, cut off or remove a file of a finished study: the same table, or an error that names the file."""
    rng = np.random.default_rng(seed)
    whole, table = _finished()
    with tempfile.TemporaryDirectory() as parent:
        # the name of the folder is part of the table
        folder = Path(parent) / "study"
        shutil.copytree(whole, folder)
        files = sorted(path for path in folder.rglob("*") if path.suffix in (".parquet", ".json", ".pkl"))
        path, kind = files[rng.integers(len(files))], str(rng.choice(["flipped", "cut off", "removed", "mixed up"]))
        data = bytearray(path.read_bytes())
        if kind == "flipped":
            for place in rng.integers(len(data), size=rng.integers(1, 4)):
                data[place] ^= 1 << int(rng.integers(8))
        elif kind == "cut off":
            del data[rng.integers(len(data)) :]
        elif kind == "mixed up":
            data = bytearray(files[rng.integers(len(files))].read_bytes())
        path.write_bytes(data)
        if kind == "removed":
            path.unlink()
        again = _study(folder).drop_vars(["cpu", "host"])
        for name in table.variables:
            same = np.array_equal(again[name], table[name], equal_nan=again[name].dtype.kind == "f")
            assert same, f"{path.name} {kind}: {name} is another one"
    return f"{path.name} {kind}"


def workers(seed: int) -> str:
    """Run points some of which end their process, on a cluster of one or two, and kill a worker meanwhile."""
    from mbvi.sweeps.cluster import local_client

    rng = np.random.default_rng(seed)
    kinds = [str(kind) for kind in rng.permutation(["fine"] * 6 + list(rng.choice(sorted(ENDS), 3)))]
    with tempfile.TemporaryDirectory() as folder, local_client(int(rng.integers(1, 3))) as client:
        if rng.random() < 0.5:
            pids = list(client.run(os.getpid).values())
            with contextlib.suppress(ProcessLookupError):
                os.kill(pids[0], signal.SIGKILL)
        table = mbvi.sweep(
            functions.troubled, {"kind": kinds}, measure=functions.height, out=Path(folder) / "study", client=client,
            **OPTIONS,
        )  # fmt: skip
    expected = [ENDS[kind] for kind in kinds]
    assert table["status"].values.tolist() == expected, f"{kinds}: {table['status'].values.tolist()}"
    assert (table["cpu"].values >= 0.0).all(), "CPU times are negative"
    return " ".join(kinds)
