"""Replays: one HTML page with meshcat inside, shapes and keyframes."""
