"""Which pairs of shapes of a scene may touch."""
