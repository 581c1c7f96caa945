"""Runs of steps of one length, in which connections may be switched."""
