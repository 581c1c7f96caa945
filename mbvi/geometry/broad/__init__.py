"""Which pairs of shapes may be near each other."""
