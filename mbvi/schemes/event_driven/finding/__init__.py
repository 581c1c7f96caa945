"""Finds events within a step: closings, releases, changes of features, and roots in general."""
