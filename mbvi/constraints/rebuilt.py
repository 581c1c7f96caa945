"""Copies of what keeps results, functors of Coal or views of Pinocchio's memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Kind = TypeVar("Kind", bound="Rebuilt")


class Rebuilt:
    """An object that is copied and pickled as the arguments it was made of: a copy is built from these again.

    What it keeps between calls, which a copy need not have and much of which cannot be pickled, stays behind.
    """

    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls: type[Kind], *arguments: Any, **options: Any) -> Kind:
        """Keep what the object is made of."""
        new = super().__new__(cls)
        new._arguments = arguments, options
        return new

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return _build, (type(self), *self._arguments)


def _build(kind: type[Kind], arguments: tuple[Any, ...], options: dict[str, Any]) -> Kind:
    return kind(*arguments, **options)
