"""Free bodies in flat arrays."""
