"""Connections of bodies and couplings of joints in a scene."""
