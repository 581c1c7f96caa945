"""The kinds of reductions of a scene's model, and the record of each omission."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

from ..arguments import several_names, shown
from ..errors import InputError

REDUCTIONS = ("joints", "pairs", "shapes", "plane", "rest")


class Omission(NamedTuple):
    """One part that was left out of a model.

    Attributes
    ----------
    what, why : str
        In words.
    dofs, pairs, rows, vertices : int
        How many degrees of freedom, pairs to look at, constraint rows and vertices of hulls it saves.
    """

    what: str
    why: str
    dofs: int = 0
    pairs: int = 0
    rows: int = 0
    vertices: int = 0

    def __str__(self) -> str:
        saved = "" if self.what.startswith("pair ") else savings([self])
        return f"{self.what}: {self.why}" + (f"; saves {saved}" if saved else "")


def savings(omitted: Iterable[Omission]) -> str:
    """Return the savings of some omissions together in words; empty if there are none."""
    totals = [sum(column) for column in zip(*(one[2:] for one in omitted), strict=True)]
    kinds = (
        ("degree of freedom", "degrees of freedom"), ("pair", "pairs"), ("row", "rows"), ("vertex", "vertices")
    )  # fmt: skip
    return ", ".join(f"{n} {kind[n > 1]}" for n, kind in zip(totals, kinds, strict=False) if n)


def checked_reductions(reduce: Collection[str]) -> tuple[str, ...]:
    """Return the named ones of `REDUCTIONS`, in their order."""
    names = {reduce} if isinstance(reduce, str) else set(several_names(reduce, "reduce"))
    unknown = sorted(names - set(REDUCTIONS))
    if unknown:
        raise InputError(f"unknown reduction {shown(unknown[0])}; known are {', '.join(REDUCTIONS)}")
    return tuple(name for name in REDUCTIONS if name in names)
