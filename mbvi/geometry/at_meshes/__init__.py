"""Distances and contacts of spheres and convex cores with triangle meshes."""
