"""Pinocchio called by address, and its results where they lie in memory."""
