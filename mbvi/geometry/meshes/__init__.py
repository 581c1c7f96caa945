"""Triangle meshes of the world, hollows and all, and height fields."""
