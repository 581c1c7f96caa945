"""Copying and pickling of objects that hold caches, Coal's functors or views of Pinocchio's memory."""

from __future__ import annotations

from typing import Any, TypeVar

Kind = TypeVar("Kind", bound="Rebuilt")


class Rebuilt:
    """An object whose copies are constructed again, from the arguments that it was constructed with.

    Its caches are not copied, because most of them cannot be pickled.
    """

    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls: type[Kind], *arguments: Any, **options: Any) -> Kind:
        """Store the arguments of the constructor for copies."""
        new = super().__new__(cls)
        new._arguments = arguments, options
        return new

    def rebuilt_with(self: Kind, old: Any, new: Any) -> Kind:
        """Return a copy with another object in the place of one argument; it shares all other arguments."""
        arguments, options = self._arguments
        replaced = tuple(new if one is old else one for one in arguments)
        return type(self)(*replaced, **{name: new if one is old else one for name, one in options.items()})

    def __reduce__(self) -> tuple[Any, ...]:
        return _build, (type(self), *self._arguments)


def _build(kind: type[Kind], arguments: tuple[Any, ...], options: dict[str, Any]) -> Kind:
    return kind(*arguments, **options)
