"""The loop over steps: `simulate`, the recorder, the default scheme, sleeping bodies, the tunnelling guard."""
