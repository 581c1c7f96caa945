"""Studies: work-precision charts, stress tests, and other engines on the same problems."""
