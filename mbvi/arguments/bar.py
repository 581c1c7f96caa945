"""The bars of tqdm, imported where one is shown."""

from __future__ import annotations

from tqdm import tqdm


class Bar(tqdm):
    """A bar that ends without a word where Ctrl-C interrupts its making."""

    def close(self) -> None:
        """Clear the bar, or leave its last state."""
        # what tqdm sets last; without it there is nothing to close
        if hasattr(self, "start_t"):
            super().close()
