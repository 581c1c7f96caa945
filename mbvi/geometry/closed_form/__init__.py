"""Contacts of simple shapes and of spheres with meshes in closed form."""
