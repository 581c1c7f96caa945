"""Replay in meshcat: live in a browser, or one page that plays by itself."""
