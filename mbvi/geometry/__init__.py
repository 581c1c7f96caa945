"""Shapes, meshes, prescribed motions, and signed distances between shapes: no configuration q is known here."""
