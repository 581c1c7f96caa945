"""The parts of a trajectory file: pages with checksums, columns, reading, and the checks of what is read."""
