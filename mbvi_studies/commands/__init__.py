"""The commands `chart` and `stress`, which pyproject.toml names as entry points of `mbvi.commands`."""
