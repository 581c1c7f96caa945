"""The compiled loop over steps."""
