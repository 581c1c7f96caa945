"""Forces whose slopes jump along a motion."""
