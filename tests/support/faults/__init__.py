"""Faults by seed, for tests and for `make faults`: wrong arguments, damaged files and studies, mutated robots, faulty states."""
