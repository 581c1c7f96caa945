"""What a study has done so far, as a text."""

from __future__ import annotations

from collections import Counter

import numpy as np

from .rows import STATUS, read_rows
from .study import StudyFolder

_MOST_MESSAGES = 3


def status(folder: StudyFolder) -> str:
    """Return how many runs there are by status, their CPU time, frequent messages and machines.

    Raises
    ------
    InputError
        If the folder holds no study.
    """
    about = folder.about()
    table = read_rows(folder.rows, ["run", "status", "message", "cpu", "host"])
    count, total = table.num_rows, about["runs"]
    by_status = Counter(table["status"].to_pylist()) if count else Counter()
    lines = [
        f"study        {folder.path}",
        f"runs         {count} of {total}" + (", complete" if count == total else ""),
    ]
    lines += [f"{name:<12} {by_status[name]}" for name in STATUS if by_status[name]]
    if count:
        cpu = table["cpu"].to_numpy()
        left = (total - count) * float(np.mean(cpu))
        lines.append(
            f"CPU time     {cpu.sum():.3g} s, {1e3 * cpu.mean():.3g} ms a run"
            + (f", {left:.3g} s left" if left else "")
        )
        lines += [f"machine      {name}: {n} runs" for name, n in Counter(table["host"].to_pylist()).most_common()]
        messages = Counter(text for text in table["message"].to_pylist() if text)
        lines += [f"message      {n} times: {text}" for text, n in messages.most_common(_MOST_MESSAGES)]
    lines.append(f"kept runs    {len(list(folder.runs.glob('*.h5')))} (keep={about['keep']!r})")
    return "\n".join(lines)
