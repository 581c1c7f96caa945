"""Forces and controls of a scene."""
