"""The bars of tqdm, imported where one is shown."""

from __future__ import annotations

from tqdm import tqdm

# seconds before a bar is shown
PATIENCE = 1.0


class Bar(tqdm):
    """A bar that ends without a word where Ctrl-C interrupts its making."""

    def close(self) -> None:
        """Clear the bar, or leave its last state."""
        # what tqdm sets last; without it there is nothing to close
        if hasattr(self, "start_t"):
            super().close()


def parts(count: int, what: str) -> Bar:
    """Return a bar as that of `watched` for parts that are no loop: a context, in which `update()` ends a part."""
    return Bar(total=count, desc=what, unit="part", delay=PATIENCE, disable=None, leave=False)
