"""The projection of positions, and the bounds with which contacts close."""
