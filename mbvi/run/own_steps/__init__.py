"""Runs of the schemes that choose their own steps."""
