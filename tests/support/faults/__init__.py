"""Faults by seed, for tests and for `make faults`: arguments, files, studies, robots, states, controls, pairs."""
