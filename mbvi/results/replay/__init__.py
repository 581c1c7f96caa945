"""Replays: one HTML page with meshcat inside, shapes and poses."""
