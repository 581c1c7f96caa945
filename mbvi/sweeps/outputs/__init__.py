"""What becomes of the runs of a sweep."""
