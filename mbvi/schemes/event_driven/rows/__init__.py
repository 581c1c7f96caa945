"""The rows of all constraints as `EventDriven` has them: gaps and gradients at any configuration, near or far."""
