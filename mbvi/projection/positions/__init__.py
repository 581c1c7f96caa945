"""Displacements that move rows out of penetration."""
