"""Distances of convex shapes by search, and the points where they touch."""
