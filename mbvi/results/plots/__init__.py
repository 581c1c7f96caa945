"""The quantities of a run that are plotted, and their pictures by matplotlib."""
