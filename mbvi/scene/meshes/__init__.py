"""Mesh files, and simpler shapes in the place of their hulls."""
