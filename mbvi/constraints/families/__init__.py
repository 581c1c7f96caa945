"""The families of constraints, one file for each."""
