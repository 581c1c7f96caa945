"""The constraints of a mechanism in kernels."""
