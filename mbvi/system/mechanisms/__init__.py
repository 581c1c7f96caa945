"""Mechanisms: Pinocchio models, and how kernels call Pinocchio."""
