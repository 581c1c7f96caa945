"""What makes two schemes the same: their class and the options they were made with."""

from __future__ import annotations

import inspect
from typing import Any


class Options:
    """A scheme whose options are attributes of the names that its constructor gives them."""

    def _options(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in inspect.signature(type(self)).parameters if hasattr(self, name)}

    def __repr__(self) -> str:
        # what is not switched on goes without saying
        shown = [f"{name}={value!r}" for name, value in self._options().items() if value is not False]
        return f"{type(self).__name__}({', '.join(shown)})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, Options) and self._options() == other._options()

    def __hash__(self) -> int:
        return hash((type(self), *self._options().items()))
