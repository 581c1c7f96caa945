"""Which features of two bodies touch, and how their gaps, points and normals change as the bodies move."""
