"""What `StewartTrinkle` does: bounds on rates that keep gaps open, within a reach of each group of contacts."""
