"""Steps of mechanisms as kernels: one file for each scheme, and the phases that they share."""
