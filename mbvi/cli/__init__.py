"""The command line `mbvi`."""
