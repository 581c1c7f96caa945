"""Shapes: convex ones, meshes, and the tables in which kernels read them."""
