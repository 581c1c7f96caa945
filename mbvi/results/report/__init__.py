"""The report of a run: one page with replay, plots, tables and text."""
